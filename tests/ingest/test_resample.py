"""Resampling against plain loops, point by point."""

from __future__ import annotations

import itertools
import math
from typing import get_args

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.ingest.resample import grid, number_runs, resample, resample_pieces
from wheelprint.schemas.signals import Resampling

PERIOD = 100
MAX_GAP = 250
START = 1_700_000_000_000_000_000
METHODS: tuple[Resampling, ...] = get_args(Resampling)

values = st.one_of(st.floats(-1000, 1000), st.just(math.nan))
samples = st.lists(st.tuples(st.integers(0, 2000), values), max_size=60)
dense_samples = st.lists(st.tuples(st.integers(0, 700), values), min_size=20, max_size=80)
recordings = st.one_of(samples, dense_samples)
methods = st.sampled_from(METHODS)


def arrays(recording: list[tuple[int, float]]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    return np.array([t for t, _ in recording], np.int64), np.array([v for _, v in recording], np.float64)


def plain(recording: list[tuple[int, float]], at: int, method: Resampling) -> float:
    """What the docstring of `resample` says, for one point of the grid."""
    last_of_equal = {t: v for t, v in recording if not math.isnan(v)}
    points = sorted(last_of_equal.items())
    if method == "hold":
        earlier = [(t, v) for t, v in points if t <= at]
        return earlier[-1][1] if earlier and at - earlier[-1][0] <= MAX_GAP else math.nan
    if method == "mean" and len(points) > 1:
        steps = [b - a for (a, _), (b, _) in itertools.pairwise(points)]
        if sum(step <= 55 for step in steps) >= len(steps) / 2:
            return plain_mean(points, at)
    if at in last_of_equal:
        return wrapped(last_of_equal[at]) if method == "angle" else last_of_equal[at]
    for (a, va), (b, vb) in itertools.pairwise(points):
        if a < at < b and b - a <= MAX_GAP:
            step = wrapped(vb - va) if method == "angle" else vb - va
            value = va + step * (at - a) / (b - a)
            return wrapped(value) if method == "angle" else value
    return math.nan


def plain_mean(points: list[tuple[int, float]], at: int) -> float:
    start, stop = at - PERIOD // 2, at + PERIOD // 2
    area, covered = 0.0, 0
    for (a, va), (b, vb) in itertools.pairwise(points):
        left, right = max(a, start), min(b, stop)
        if left < right and b - a <= MAX_GAP:
            middle = va + (vb - va) * ((left + right) / 2 - a) / (b - a)
            area += middle * (right - left)
            covered += right - left
    return area / PERIOD if covered == PERIOD else math.nan


def wrapped(angle: float) -> float:
    return (angle + 180) % 360 - 180


@given(recordings, methods)
def test_equals_the_plain_loop(recording: list[tuple[int, float]], method: Resampling) -> None:
    time, given_values = arrays(recording)
    at = grid(-200, 2400, PERIOD)
    found = resample(time, given_values, at, method, MAX_GAP, PERIOD)
    expected = np.array([plain(recording, int(t), method) for t in at])
    assert found.dtype == np.float64
    if method == "angle":
        np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
        off = (found - expected)[~np.isnan(found)]
        np.testing.assert_allclose(np.abs(np.sin(np.radians(off / 2))), 0, atol=1e-9)
        assert ((found[~np.isnan(found)] >= -180) & (found[~np.isnan(found)] < 180)).all()
    else:
        np.testing.assert_allclose(found, expected, atol=1e-8)


@given(recordings, methods)
def test_time_since_1970_changes_nothing(recording: list[tuple[int, float]], method: Resampling) -> None:
    """Any path through float64 would: its spacing at 1.7e18 is 256 ns, more than a whole period here."""
    time, given_values = arrays(recording)
    at = grid(0, 2100, PERIOD)
    near = resample(time, given_values, at, method, MAX_GAP, PERIOD)
    far = resample(time + START, given_values, at + START, method, MAX_GAP, PERIOD)
    np.testing.assert_array_equal(near, far)


@given(recordings, methods, st.floats(-179, 179))
def test_constants_stay(recording: list[tuple[int, float]], method: Resampling, constant: float) -> None:
    time, given_values = arrays(recording)
    level = np.where(np.isnan(given_values), np.nan, constant)
    found = resample(time, level, grid(0, 2100, PERIOD), method, MAX_GAP, PERIOD)
    assert set(found[~np.isnan(found)]) <= {constant}


@given(recordings, methods)
def test_the_order_of_distinct_stamps_does_not_matter(recording: list[tuple[int, float]], method: Resampling) -> None:
    distinct = list(dict(recording).items())
    at = grid(0, 2100, PERIOD)
    forwards = resample(*arrays(distinct), at, method, MAX_GAP, PERIOD)
    np.testing.assert_array_equal(resample(*arrays(distinct[::-1]), at, method, MAX_GAP, PERIOD), forwards)


@given(st.lists(st.tuples(st.integers(0, 2000), st.integers(-80, 80), st.integers(-3, 3)), max_size=40))
def test_turns_of_an_angle_do_not_matter(recording: list[tuple[int, int, int]]) -> None:
    """Between -80 and 80 deg the shorter arc is the straight line."""
    time, angle, turns = np.array(recording, np.int64).reshape(-1, 3).T
    at = grid(0, 2100, PERIOD)
    straight = resample(time, angle, at, "linear", MAX_GAP, PERIOD)
    around = resample(time, angle + 360.0 * turns, at, "angle", MAX_GAP, PERIOD)
    np.testing.assert_allclose(around, straight, atol=1e-9)


@given(recordings, methods, st.integers(1, 9))
def test_a_grid_in_pieces_gives_what_it_gives_at_once(
    recording: list[tuple[int, float]], method: Resampling, piece: int
) -> None:
    at = grid(0, 2100, PERIOD)
    whole = resample(*arrays(recording), at, method, MAX_GAP, PERIOD)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wheelprint.ingest.resample.PIECE", piece)
        pieces = resample(*arrays(recording), at, method, MAX_GAP, PERIOD)
    np.testing.assert_allclose(pieces, whole, atol=1e-8)


@pytest.mark.parametrize("method", METHODS)
def test_nothing_comes_from_a_gap(method: Resampling) -> None:
    time = np.concatenate((np.arange(0, 1001, 10), np.arange(2000, 3001, 10))).astype(np.int64)
    at = grid(0, 3001, 50)
    found = resample(time, np.sin(time / 100), at, method, MAX_GAP, 50)
    inside = (at > 1000 + (MAX_GAP if method == "hold" else 0)) & (at < 2000)
    assert np.isnan(found[inside]).all()
    assert np.isfinite(found[(at > 50) & (at < 950)]).all()


def test_a_gap_of_just_the_longest_length_is_bridged() -> None:
    at = np.array([200], np.int64)
    for width, bridged in ((MAX_GAP, True), (MAX_GAP + 1, False)):
        two = np.array([0, width], np.int64)
        assert np.isfinite(resample(two, [1.0, 2.0], at, "linear", MAX_GAP, PERIOD)).all() == bridged
        assert np.isfinite(resample(two, [1.0, 2.0], at, "angle", MAX_GAP, PERIOD)).all() == bridged
        assert np.isfinite(resample(two - width + 200, [1.0, np.nan], at, "hold", MAX_GAP, PERIOD)).all() == bridged
        dense = np.concatenate((np.arange(-100, 101, 10), np.arange(100 + width, 400 + width, 10))).astype(np.int64)
        assert np.isfinite(resample(dense, dense / 10, at, "mean", MAX_GAP, PERIOD)).all() == bridged


def test_a_sample_on_the_grid_counts_by_itself() -> None:
    found = resample(np.array([0, 1000], np.int64), [1.0, 2.0], grid(0, 1001, 500), "linear", MAX_GAP, 500)
    np.testing.assert_array_equal(found, [1.0, np.nan, 2.0])


def test_angles_go_the_short_way() -> None:
    time = np.array([0, 200], np.int64)
    assert resample(time, [170.0, -170.0], np.array([50, 150]), "angle", MAX_GAP, 100).tolist() == [175.0, -175.0]


def test_the_mean_takes_vibration_away_where_linear_would_sample_it() -> None:
    time = np.arange(0, 100_001, 5, dtype=np.int64)
    vibration = 3 * np.sin(2 * np.pi * time / 100) + time / 1000
    at = grid(1000, 99_000, 100)
    mean = resample(time, vibration, at, "mean", MAX_GAP, 100)
    np.testing.assert_allclose(mean, at / 1000, atol=1e-9)
    assert np.abs(resample(time + 25, vibration, at, "linear", MAX_GAP, 100) - at / 1000).max() > 2.9


def test_sparse_samples_have_no_mean() -> None:
    time = np.array([0, 60, 120, 180], np.int64)
    kinked = [0.0, 60.0, 0.0, 60.0]
    at = np.array([60, 100], np.int64)
    assert resample(time, kinked, at, "mean", MAX_GAP, 100).tolist() == [60.0, 20.0]


def test_of_equal_stamps_the_last_counts_unless_it_is_missing() -> None:
    time = np.array([100, 0, 100, 0], np.int64)
    found = resample(time, [1.0, 2.0, 3.0, np.nan], np.array([0, 100]), "hold", MAX_GAP, PERIOD)
    assert found.tolist() == [2.0, 3.0]


def test_nothing_at_all() -> None:
    empty = np.empty(0, np.int64)
    for method in METHODS:
        assert np.isnan(resample(empty, [], np.array([0, 100]), method, MAX_GAP, PERIOD)).all()
        assert resample(np.array([0, 10]), [1.0, 2.0], empty, method, MAX_GAP, PERIOD).shape == (0,)


@given(st.integers(-(10**19) // 10, 10**18), st.integers(0, 500), st.integers(1, 60))
def test_grid_is_every_multiple_in_the_half_open_interval(start: int, length: int, period: int) -> None:
    expected = [t for t in range(start, start + length) if t % period == 0]
    found = grid(start, start + length, period)
    assert found.dtype == np.int64
    assert found.tolist() == expected


@given(st.lists(st.booleans(), max_size=40))
def test_runs_are_numbered_in_order(complete: list[bool]) -> None:
    expected: list[int] = []
    run = -1
    for there, group in itertools.groupby(complete):
        run += there
        expected += [run if there else -1 for _ in group]
    found = number_runs(np.array(complete, bool))
    assert found.dtype == np.int32
    assert found.tolist() == expected


def in_pieces(time: npt.NDArray[np.int64], values: npt.NDArray[np.float64], cuts: list[int], method: Resampling,
              grid_time: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:  # fmt: skip
    places = np.searchsorted(time, sorted(cuts))
    pieces = zip(np.split(time, places), np.split(values, places), strict=True)
    return resample_pieces(pieces, grid_time, method, MAX_GAP, PERIOD)


cuts = st.lists(st.integers(0, 2000), max_size=4)


@given(recordings, st.sampled_from([method for method in METHODS if method != "mean"]), cuts)
def test_pieces_give_what_the_whole_gives(
    recording: list[tuple[int, float]], method: Resampling, cuts: list[int]
) -> None:
    time, values = arrays(sorted(recording, key=lambda sample: sample[0]))
    grid_time = grid(0, 2100, PERIOD)
    whole = resample(time, values, grid_time, method, MAX_GAP, PERIOD)
    np.testing.assert_allclose(in_pieces(time, values, cuts, method, grid_time), whole, rtol=0, atol=1e-9)


@given(st.lists(st.tuples(st.integers(1, 50), st.floats(-1000, 1000)), min_size=6, max_size=80), cuts)
def test_pieces_of_a_dense_signal_give_its_averages(steps: list[tuple[int, float]], cuts: list[int]) -> None:
    time = np.cumsum([step for step, _ in steps])
    time[len(time) // 2 :] += MAX_GAP  # a gap
    values = np.array([value for _, value in steps])
    grid_time = grid(0, 4500, PERIOD)
    whole = resample(time, values, grid_time, "mean", MAX_GAP, PERIOD)
    averages = in_pieces(time, values, [cut for cut in cuts if cut > time[1]], "mean", grid_time)
    np.testing.assert_allclose(averages, whole, rtol=0, atol=1e-9)
