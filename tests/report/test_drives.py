"""One recording as the report shows it: distances, the clock before and after, the map."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from wheelprint.dataset.events import Event
from wheelprint.report.blocks import Figure
from wheelprint.report.drives import alignment, describe, estimate_in_words, track
from wheelprint.schemas.tables import DATASET, SYNCED

START = 1_700_000_000_000_000_000
TICK = 100_000_000
CLOCK = {"offset_s": 1.5, "drift_ppm": 0.0, "applied": True, "reason": ""}


def table(schema: pa.Schema, rows: int, **columns: Any) -> pa.Table:
    """A stored table with some of its columns; the others are null."""
    arrays = {f.name: pa.nulls(rows, f.type) for f in schema}
    for name, values in columns.items():
        arrays[name] = pa.array(values, from_pandas=True).cast(schema.field(name).type, safe=False)
    return pa.table(arrays, schema=schema)


def synced(rows: int = 600, **columns: Any) -> pa.Table:
    """A minute on a straight road, slowly faster and, after half a minute, livelier."""
    t = np.arange(rows) / 10
    speed = 10 + 0.01 * t + np.where(t > 30, 3 * np.sin(t), 0)
    usual = {
        "time": START + TICK * np.arange(rows),
        "run": np.zeros(rows, np.int32),
        "speed": speed,
        "nav_speed": speed,
        "x": np.cumsum(speed) / 10,
        "y": np.zeros(rows),
    }
    return table(SYNCED, rows, **(usual | columns))


def lines(figure: Any) -> dict[str, Any]:
    assert isinstance(figure, Figure)
    return {trace.name: trace for trace in figure.figure.data}


def test_before_alignment_the_car_is_late_by_the_offset() -> None:
    drive = synced()
    shown = lines(alignment("anna/ring", drive, CLOCK, 0.1))
    assert list(shown) == ["navigation", "CAN as stamped (+1.500 s)", "CAN aligned"]
    at = shown["navigation"].x.astype(float)
    begin = int(np.argmin(np.abs(drive["nav_speed"].to_numpy() * 3.6 - shown["navigation"].y[0])))
    assert begin >= 250, "the liveliest stretch is shown"
    speed = drive["speed"].to_numpy() * 3.6
    np.testing.assert_allclose(shown["CAN aligned"].y, speed[begin : begin + 200], rtol=1e-6)
    before = shown["CAN as stamped (+1.500 s)"].y
    np.testing.assert_allclose(before, speed[begin - 15 : begin + 185], rtol=1e-6)
    assert at[-1] == pytest.approx(19.9)


def test_drift_adds_to_the_offset_where_the_stretch_begins() -> None:
    shown = lines(alignment("anna/ring", synced(), CLOCK | {"drift_ppm": 10_000.0}, 0.1))
    (name,) = [name for name in shown if name.startswith("CAN as stamped")]
    shift = float(name.split("+")[1].split(" ")[0])
    assert 1.5 + 0.01 * 25 <= shift <= 1.5 + 0.01 * 40


def test_a_clock_hours_away_is_said_in_words() -> None:
    figure = alignment("anna/ring", synced(), CLOCK | {"offset_s": 28800.0}, 0.1)
    assert list(lines(figure)) == ["navigation", "CAN aligned"]
    assert isinstance(figure, Figure)
    assert figure.caption == (
        "anna/ring: 20 s from 2023-11-14 22:13:50.000, aligned; by its own stamps the CAN log was +28,800.0 s away "
        "from here. Offset +28800.0000 s at the start, drift +0.0 ppm."
    )


def test_a_clock_that_was_not_aligned_shows_the_stamps_as_they_are() -> None:
    figure = alignment("anna/ring", synced(), {"offset_s": 0.0, "drift_ppm": 0.0, "applied": False}, 0.1)
    assert list(lines(figure)) == ["navigation", "CAN as stamped"]


def test_without_one_of_the_speeds_there_is_nothing_to_compare() -> None:
    nothing = np.full(600, np.nan)
    holes = np.where(np.arange(600) % 100 < 2, np.nan, 10.0)
    for columns, reason in (
        ({"speed": nothing}, "the car's speed is missing"),
        ({"nav_speed": nothing}, "navigation's speed is missing"),
        ({"speed": nothing, "nav_speed": nothing}, "the car's and navigation's speed are missing"),
        ({"speed": holes}, "the car's and navigation's speed are nowhere both there for 20 s without a gap"),
    ):
        assert alignment("anna/ring", synced(**columns), CLOCK, 0.1) == reason


def test_a_small_offset_is_shown_from_near_by_and_the_difference_in_numbers() -> None:
    drive = synced()
    figure = alignment("anna/ring", drive, CLOCK | {"offset_s": -0.1}, 0.1)
    assert isinstance(figure, Figure)
    assert [len(trace.x) for trace in figure.figure.data] == [60, 60, 60]
    after, before, navigation = (lines(figure)[name].y.astype(float) for name in (
        "CAN aligned", "CAN as stamped (−0.100 s)", "navigation",
    ))  # fmt: skip
    assert np.array_equal(after, navigation)
    assert f"varies by {np.std(before - navigation):.2f} km/h before and 0.00 km/h after (sd)." in figure.caption


def test_the_estimate_in_words() -> None:
    estimate = CLOCK | {
        "offset_s": -0.06349, "drift_ppm": -6.31, "residual_ms": 12.04, "standard_error_ms": None,
        "reason": "estimated from speed (-0.064 s)",
    }  # fmt: skip
    assert estimate_in_words(estimate) == (
        "Offset −0.0635 s at the start, drift −6.3 ppm, residual 12.0 ms; estimated from speed (-0.064 s)."
    )
    assert estimate_in_words(estimate | {"applied": False, "reason": "too short"}) == "Nothing is applied: too short."
    assert estimate_in_words({"applied": False}) == "Nothing is applied: no offset was estimated."


def test_time_and_distance_count_runs_only() -> None:
    run = np.where(np.arange(600) < 400, 0.0, np.nan)
    drive = describe("anna/ring", synced(run=run, nav_speed=np.full(600, 10.0)), None, CLOCK, [], 0.1, 100)
    assert (drive.synced, drive.driven, drive.distance) == pytest.approx((60.0, 40.0, 400.0))
    assert drive.start == START
    assert drive.minutes == pytest.approx(59.9 / 60)


def test_the_map_has_each_label_where_the_dataset_says() -> None:
    labels = np.where(np.arange(300) < 100, 1, 3)
    dataset = table(DATASET, 300, time=START + TICK * np.arange(200, 500), path_label=labels)
    drive = synced()
    figure = track("anna/ring", drive, dataset, [], 1000)
    shown = lines(figure)
    x = drive["x"].to_numpy().astype(np.float32)
    np.testing.assert_array_equal(shown["label 1"].x, x[200:300])
    np.testing.assert_array_equal(shown["label 3"].x, x[300:500])
    assert "label 2" not in shown
    assert figure is not None
    assert figure.figure.layout.yaxis.scaleanchor == "x"


def test_the_map_breaks_at_gaps_is_thinned_and_marks_events() -> None:
    run = np.where(np.arange(600) < 300, 0, 1).astype(float)
    run[300:320] = np.nan
    event = Event("anna/ring", START + 100 * TICK, START + 121 * TICK, "swerve", 1.0, "emergency", "x", "")
    shown = lines(track("anna/ring", synced(run=run), None, [event], 300))
    (line,) = [trace for trace in shown.values() if trace.name is None]
    assert len(line.x) == 300
    missing = np.flatnonzero(np.isnan(line.x))
    assert missing.tolist() == list(range(150, 161)), "the gap, and the first point after it"
    np.testing.assert_allclose(shown["event: emergency"].x, synced()["x"].to_numpy()[[111]], rtol=1e-6)


def test_a_recording_without_positions_has_no_map() -> None:
    nothing = np.full(600, np.nan)
    assert track("anna/ring", synced(x=nothing, y=nothing), None, [], 300) is None
