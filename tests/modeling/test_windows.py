"""Windows are cut by definition: whole, within one stretch, within the allowed rows."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.dataset.folds import deal_folds, training_mask
from wheelprint.modeling.windows import Series, WindowRows, cut_windows, window_centres
from wheelprint.schemas.tables import DATASET

TICK = 100_000_000
START = 1_700_000_000_000_000_000


def dataset(rows: list[tuple[str, int, int, int]]) -> pa.Table:
    """Rows of recording, run, segment and tick; Δθ, v and δ say which row they are of."""
    recording, run, segment, tick = zip(*rows, strict=True)
    number = np.arange(len(rows))
    columns = {
        "time": START + np.array(tick) * TICK,
        "run": run,
        "course_deviation": number * 0.5,
        "speed": 1000.0 + number,
        "steering_wheel_angle": 2000.0 + number,
        "segment": segment,
        "fold": number % 3,
    }
    arrays = [
        pa.array(columns[f.name]).cast(f.type, safe=False) if f.name in columns else pa.nulls(len(rows), f.type)
        for f in DATASET
    ]
    return pa.Table.from_arrays(arrays, schema=DATASET).add_column(0, "recording", pa.array(recording))


def straight(rows: int) -> Series:
    return Series.from_table(dataset([("a", 0, 0, tick) for tick in range(rows)]), TICK)


def test_series_ends_stretches_and_segments() -> None:
    rows = [
        ("a", 0, 0, 0),
        ("a", 0, 0, 1),
        ("a", 1, 1, 5),
        ("a", 1, 1, 6),
        ("a", 1, 1, 8),
        ("b", 1, 1, 9),
        ("b", 1, 2, 10),
    ]
    series = Series.from_table(dataset(rows), TICK)
    assert series.stretch.tolist() == [0, 0, 1, 1, 2, 3, 3]
    assert series.segment.tolist() == [0, 0, 1, 1, 1, 2, 3]
    assert series.recording.tolist() == ["a"] * 5 + ["b"] * 2
    assert series.time.tolist() == [START + tick * TICK for *_, tick in rows]
    assert series.fold.tolist() == [0, 1, 2, 0, 1, 2, 0]
    assert np.isnan(series.lookahead).all()


def test_rows_without_path_or_steering_are_told() -> None:
    table = dataset([("a", 0, 0, tick) for tick in range(4)])
    for place, name in enumerate(("course_deviation", "speed", "steering_wheel_angle")):
        values = [None if row == place else value for row, value in enumerate(table[name].to_pylist())]
        table = table.set_column(table.column_names.index(name), name, pa.array(values, pa.float64()))
    assert Series.from_table(table, TICK).has_path_and_steering.tolist() == [False, False, False, True]


@given(
    st.lists(st.tuples(st.booleans(), st.sampled_from([True, True, True, False])), max_size=40),
    st.integers(0, 3),
    st.integers(0, 4),
)
def test_centres_are_those_of_the_definition(rows: list[tuple[bool, bool]], past: int, future: int) -> None:
    stretch = np.cumsum([begins and place > 0 and place % 3 == 0 for place, (begins, _) in enumerate(rows)], dtype=int)
    allowed = np.array([is_allowed for _, is_allowed in rows], dtype=bool)
    expected = []
    for centre in range(len(rows)):
        touched = range(centre - past, centre + future + 1)
        if all(0 <= row < len(rows) and allowed[row] and stretch[row] == stretch[centre] for row in touched):
            expected.append(centre)
    assert window_centres(stretch, allowed, past, future).tolist() == expected


@given(
    st.lists(st.integers(1, 60), min_size=1, max_size=4),
    st.integers(2, 4),
    st.integers(0, 12),
    st.integers(0, 2),
    st.integers(1, 8),
)
def test_no_window_crosses_recordings_folds_or_the_embargo(
    lengths: list[int], folds: int, embargo: int, past: int, future: int
) -> None:
    rows = [(f"r{number}", 0, 0, tick) for number, length in enumerate(lengths) for tick in range(length)]
    series = Series.from_table(dataset(rows), TICK)
    fold = deal_folds(len(rows), folds, seed=0)
    for test_fold in range(folds):
        training = training_mask(fold, series.recording, series.time, test_fold, embargo * TICK)
        held_out = set(np.flatnonzero(fold == test_fold).tolist())
        for centre in window_centres(series.stretch, fold == test_fold, past, future):
            assert held_out.issuperset(range(centre - past, centre + future + 1))
        for centre in window_centres(series.stretch, training, past, future):
            touched = [rows[row] for row in range(centre - past, centre + future + 1)]
            assert len({recording for recording, *_ in touched}) == 1
            near = [
                row
                for row in held_out
                if rows[row][0] == touched[0][0] and touched[0][3] - embargo <= rows[row][3] <= touched[-1][3] + embargo
            ]
            assert not near


@pytest.mark.parametrize(
    ("past_steps", "past", "seen"), [(-1, 0, []), (0, 0, [5]), (1, 1, [4, 5]), (3, 3, [2, 3, 4, 5])]
)
def test_layout_of_a_window(past_steps: int, past: int, seen: list[int]) -> None:
    windows = cut_windows(straight(12), np.array([5]), past_steps, 4)
    path = list(range(5 - past, 10))
    expected = [row * 0.5 for row in path] + [1000.0 + row for row in path] + [2000.0 + row for row in seen]
    assert windows.inputs.tolist() == [expected]
    assert windows.outputs.tolist() == [[2006.0, 2007.0, 2008.0, 2009.0]]
    assert windows.current.tolist() == [2005.0]
    assert windows.centres.tolist() == [5]


def test_inputs_hold_no_steering_to_come() -> None:
    series = straight(30)
    centres = window_centres(series.stretch, series.has_path_and_steering, 3, 10)
    windows = cut_windows(series, centres, 3, 10)
    steering = windows.inputs[:, -4:]
    assert (steering.max(axis=1) == windows.current).all()
    assert (windows.outputs.min(axis=1) > windows.current).all()


def test_no_windows() -> None:
    series = straight(5)
    centres = window_centres(series.stretch, np.ones(5, dtype=bool), 1, 4)
    windows = cut_windows(series, centres, 1, 4)
    assert windows.inputs.shape == (0, 14)
    assert windows.outputs.shape == (0, 4)


@pytest.mark.parametrize("past_steps", [-1, 0, 2])
def test_rows_cut_when_asked_for_are_inputs_and_outputs_side_by_side(past_steps: int) -> None:
    series = straight(30)
    centres = window_centres(series.stretch, series.has_path_and_steering, 2, 5)
    windows = cut_windows(series, centres, past_steps, 5)
    rows = WindowRows(series, centres, past_steps, 5)
    expected = np.concatenate([windows.inputs, windows.outputs], axis=1)
    assert rows.shape == expected.shape
    assert len(rows) == len(centres)
    np.testing.assert_array_equal(rows[:], expected)
    np.testing.assert_array_equal(rows[3:9], expected[3:9])
    np.testing.assert_array_equal(rows[np.array([7, 2])], expected[[7, 2]])
