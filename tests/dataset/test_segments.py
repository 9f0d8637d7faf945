"""Segments, their features and types against plain loops and a drive divided by hand."""

from __future__ import annotations

import math
from itertools import groupby

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.dataset.segments import divide, features, path_types

NAN = math.nan
PERIOD = 100_000_000


def test_a_drive_divided_by_hand() -> None:
    deviation = np.array([NAN, 0.3, 0.1, 0.05, -0.05, -0.2, NAN, -0.1, -0.3, NAN, 0.0])
    run = np.array([0, 0, 0, 0, 0, 0, 1, 1, 1, 2, 2])
    speed = np.array([10.0, 11, 12, 20, 22, 5, 1, 2, 3, 7, 8])
    segment, side = divide(deviation, run, 0.05)
    assert segment.tolist() == [0, 0, 0, 1, 1, 2, 3, 3, 3, 4, 4]
    assert side.tolist() == [1, 1, 1, 0, 0, -1, -1, -1, -1, 0, 0]
    np.testing.assert_allclose(
        features(deviation, speed, segment, PERIOD),
        [[0.3, 0.2, 0.3, 11], [0.2, 0.05, 0.05, 21], [0.1, 0.2, 0.2, 5], [0.3, 0.2, 0.3, 2], [0.2, 0, 0, 7.5]],
        rtol=1e-12,
        atol=1e-12,
    )


deviations = st.one_of(st.floats(-1, 1), st.floats(-0.08, 0.08), st.sampled_from([0.05, -0.05, 0.02, 0.0]))
drives = st.lists(st.lists(deviations, min_size=2, max_size=12), max_size=6)


@given(drives)
def test_equals_the_loop(drive: list[list[float]]) -> None:
    run = np.array([number for number, part in enumerate(drive) for _ in part], dtype=np.int32)
    deviation = np.array([value for part in drive for value in (NAN, *part[1:])])
    speed = np.arange(len(run), dtype=float)

    expected_side, expected_features, expected_run = [], [], []
    row = 0
    for number, part in enumerate(drive):
        sides = ["left" if value > 0.05 else "right" if value < -0.05 else "neutral" for value in part[1:]]
        sides = [sides[0], *sides]
        for side, members in groupby(enumerate(sides), key=lambda pair: pair[1]):
            places = [place for place, _ in members]
            known = [abs(part[place]) for place in places if place > 0]
            expected_side += [side] * len(places)
            expected_run.append(number)
            expected_features.append(
                (
                    0.1 * len(places),
                    math.fsum(known) / len(known),
                    max(known),
                    math.fsum(speed[row + p] for p in places) / len(places),
                )
            )
        row += len(part)

    segment, side = divide(deviation, run, 0.05)
    assert [("right", "neutral", "left")[s + 1] for s in side] == expected_side
    found = features(deviation, speed, segment, PERIOD)
    assert found.shape == (len(expected_features), 4)
    np.testing.assert_allclose(found, np.reshape(expected_features, (-1, 4)), rtol=1e-9, atol=1e-12)
    # every segment lies within one run and one side, and neighbours within a run differ in side
    for number in range(len(expected_features)):
        members = segment == number
        assert len(set(run[members])) == len(set(side[members])) == 1
    begins = np.flatnonzero(np.diff(segment)) + 1
    assert all(run[b] != run[b - 1] or side[b] != side[b - 1] for b in begins)


def test_hysteresis_and_merging_by_hand() -> None:
    deviation = np.array([NAN, 0.06, 0.04, 0.03, 0.02, 0.04, -0.04, -0.06, -0.04, 0.04, 0.06])
    run = np.zeros(11, np.int32)
    assert divide(deviation, run, 0.05)[1].tolist() == [1, 1, 0, 0, 0, 0, 0, -1, 0, 0, 1]
    assert divide(deviation, run, 0.05, 0.025)[1].tolist() == [1, 1, 1, 1, 0, 0, 0, -1, -1, 0, 1]
    segment, side = divide(deviation, run, 0.05, 0.025, 2)
    # the single neutral sample goes to the right bend, which is longer than the last left one, and then that too
    assert side.tolist() == [1, 1, 1, 1, 0, 0, 0, -1, -1, -1, -1]
    assert segment.tolist() == [0, 0, 0, 0, 1, 1, 1, 2, 2, 2, 2]
    assert divide(deviation, run, 0.05, 0.025, 5)[1].tolist() == [1] * 11
    # neutral between two left bends: all three are one
    assert divide(np.array([NAN, 0.1, 0.0, 0.1, 0.1]), run[:5], 0.05, None, 2)[0].tolist() == [0] * 5


def states(part: list[float], neutral: float, release: float) -> list[int]:
    """The sides of a run's samples but the first, by a switch that remembers."""
    state, found = 0, []
    for value in part[1:]:
        if abs(value) > neutral:
            state = 1 if value > 0 else -1
        elif abs(value) <= release or value * state < 0:
            state = 0
        found.append(state)
    return found


def merged(sides: list[int], shortest: int) -> list[int]:
    """The sides of a run's samples when the first of the shortest segments is merged again and again."""
    while True:
        parts = [(side, len(list(members))) for side, members in groupby(sides)]
        least, place = min((samples, place) for place, (_, samples) in enumerate(parts))
        if least >= shortest or len(parts) == 1:
            return sides
        near = [other for other in (place - 1, place + 1) if 0 <= other < len(parts)]
        parts[place] = (parts[max(near, key=lambda other: parts[other][1])][0], least)
        sides = [side for side, samples in parts for _ in range(samples)]


@given(drives, st.sampled_from([0.0, 0.02, 0.05]), st.integers(1, 6))
def test_hysteresis_and_merging_equal_the_loops(drive: list[list[float]], release: float, shortest: int) -> None:
    run = np.array([number for number, part in enumerate(drive) for _ in part], dtype=np.int32)
    deviation = np.array([value for part in drive for value in (NAN, *part[1:])])
    expected = []
    for part in drive:
        sides = states(part, 0.05, release)
        expected += merged([sides[0], *sides], shortest)
    segment, side = divide(deviation, run, 0.05, release, shortest)
    assert side.tolist() == expected
    begins = np.flatnonzero((np.diff(run) != 0) | (np.diff(side) != 0)) + 1
    np.testing.assert_array_equal(segment, np.cumsum(np.isin(np.arange(len(run)), begins)))
    for number, samples in enumerate(np.bincount(segment)):
        own = run[segment == number][0]
        assert samples >= min(shortest, np.count_nonzero(run == own))


@given(drives, st.sampled_from([0.0, 0.02, 0.05]), st.integers(1, 6))
def test_the_other_side_is_the_mirror_image(drive: list[list[float]], release: float, shortest: int) -> None:
    run = np.array([number for number, part in enumerate(drive) for _ in part], dtype=np.int32)
    deviation = np.array([value for part in drive for value in (NAN, *part[1:])])
    segment, side = divide(deviation, run, 0.05, release, shortest)
    mirrored = divide(-deviation, run, 0.05, release, shortest)
    np.testing.assert_array_equal(mirrored, (segment, -side))


def test_a_run_of_one_sample_has_a_segment_without_averages() -> None:
    segment, side = divide(np.array([NAN]), np.array([0]), 0.05)
    assert (segment.tolist(), side.tolist()) == ([0], [0])
    np.testing.assert_array_equal(features(np.array([NAN]), np.array([3.0]), segment, PERIOD), [[0.1, NAN, NAN, 3.0]])


def test_types_repeat_the_own_label_at_the_ends_of_a_run() -> None:
    labels, run = np.array([2, 3, 1, 2, 2, 3]), np.array([0, 0, 0, 1, 2, 2])
    assert path_types(labels, run) == ["2-2-3", "2-3-1", "3-1-1", "2-2-2", "2-2-3", "2-3-3"]
    assert path_types(labels[:0], run[:0]) == []
