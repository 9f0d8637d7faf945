"""Each manner of smoothing against a plain loop, and what must come back as it was."""

from __future__ import annotations

import math
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from wheelprint.dataset.path import course_deviation
from wheelprint.dataset.smoothing import smooth, smooth_angles
from wheelprint.schemas.config import Smoothing

Floats = NDArray[np.float64]

MANNERS: tuple[Smoothing, ...] = get_args(Smoothing)
manners = st.sampled_from(MANNERS)
windows = st.integers(0, 4).map(lambda half: 2 * half + 1)
numbers = st.one_of(st.floats(-1e6, 1e6), st.just(math.nan))
drives = st.lists(st.tuples(numbers, st.sampled_from([0, 0, 0, 1])), max_size=60).map(
    lambda samples: (np.array([v for v, _ in samples]), np.cumsum([step for _, step in samples]).astype(np.int32))
)


def reach(values: Floats, run: NDArray[np.int32], centre: int, side: int, most: int) -> int:
    """Samples of the same run without a NaN on one side of a sample, at most so many."""
    steps = 0
    while steps < most and 0 <= (next_one := centre + side * (steps + 1)) < len(values):
        if run[next_one] != run[centre] or math.isnan(values[next_one]):
            break
        steps += 1
    return steps


def by_loop(values: Floats, run: NDArray[np.int32], window: int, manner: Smoothing) -> Floats:
    """The definitions, sample by sample."""
    smoothed = []
    for centre, value in enumerate(values):
        if math.isnan(value):
            smoothed.append(math.nan)
        elif manner == "causal":
            since = reach(values, run, centre, -1, window - 1)
            smoothed.append(math.fsum(values[centre - since : centre + 1]) / (since + 1))
        else:
            half = min(reach(values, run, centre, side, window // 2) for side in (-1, 1))
            part = values[centre - half : centre + half + 1]
            if manner == "moving average":
                smoothed.append(math.fsum(part) / len(part))
            else:
                place = np.arange(-half, half + 1)
                smoothed.append(float(np.polyfit(place, part - value, min(2, 2 * half))[-1]) + value)
    return np.array(smoothed)


@given(drives, windows, manners)
def test_equals_the_loop(drive: tuple[Floats, NDArray[np.int32]], window: int, manner: Smoothing) -> None:
    values, run = drive
    before = values.copy()
    found = smooth(values, run, window, manner)
    assert len(found) == len(values)
    np.testing.assert_allclose(found, by_loop(values, run, window, manner), rtol=0, atol=1e-8)
    np.testing.assert_array_equal(values, before)


@given(st.floats(-1e9, 1e9), st.integers(1, 40), windows, manners)
def test_constants_come_back_bit_for_bit(value: float, samples: int, window: int, manner: Smoothing) -> None:
    values = np.full(samples, value)
    np.testing.assert_array_equal(smooth(values, np.zeros(samples, np.int32), window, manner), values)


@given(drives, windows, manners, st.data())
def test_nothing_comes_from_another_run(
    drive: tuple[Floats, NDArray[np.int32]], window: int, manner: Smoothing, data: st.DataObject
) -> None:
    values, run = drive
    own = run == (data.draw(st.sampled_from(run.tolist())) if len(run) else 0)
    alone = smooth(values[own], run[own], window, manner)
    np.testing.assert_array_equal(smooth(values, run, window, manner)[own], alone)


@given(drives, st.integers(1, 9), st.data())
def test_causal_knows_nothing_of_what_comes(
    drive: tuple[Floats, NDArray[np.int32]], window: int, data: st.DataObject
) -> None:
    values, run = drive
    now = data.draw(st.integers(0, len(values)))
    np.testing.assert_array_equal(
        smooth(values, run, window, "causal")[:now], smooth(values[:now], run[:now], window, "causal")
    )


def test_straight_lines_and_far_positions_come_back() -> None:
    run = np.zeros(300, np.int32)
    line = 4e6 + 0.7 * np.arange(300, dtype=np.float64)
    for manner in ("moving average", "zero-phase"):
        np.testing.assert_allclose(smooth(line, run, 5, manner), line, rtol=0, atol=1e-9)
    np.testing.assert_allclose(smooth(line, run, 5, "causal")[4:], line[2:-2], rtol=0, atol=1e-9)
    parabola = 4e6 + 0.01 * np.arange(300.0) ** 2
    np.testing.assert_allclose(smooth(parabola, run, 11, "zero-phase"), parabola, rtol=0, atol=1e-8)


def test_the_inside_equals_numpy_and_scipy() -> None:
    values = np.random.default_rng(1).normal(size=50)
    run = np.zeros(50, np.int32)
    mean = np.convolve(values, np.full(5, 0.2), "valid")
    np.testing.assert_allclose(smooth(values, run, 5)[2:-2], mean, rtol=0, atol=1e-14)
    np.testing.assert_allclose(smooth(values, run, 5, "causal")[4:], mean, rtol=0, atol=1e-14)
    parabola = savgol_filter(values, 11, 2)[5:-5]
    np.testing.assert_allclose(smooth(values, run, 11, "zero-phase")[5:-5], parabola, rtol=0, atol=1e-14)


def test_what_each_keeps_takes_out_and_how_late_it_is() -> None:
    bend = np.sin(np.pi * np.arange(400) / 10)  # half a hertz: quick steering
    noise = np.random.default_rng(2).normal(size=100_000)

    def gain_and_noise(window: int, manner: Smoothing) -> tuple[float, float]:
        kept = smooth(bend, np.zeros(400, np.int32), window, manner)[50:-50].max()
        return kept, float(np.var(smooth(noise, np.zeros(len(noise), np.int32), window, manner)))

    # The gain of an average is that of Dirichlet's kernel; the noise that is left, the sum of the squared weights.
    average = math.sin(math.pi / 4) / (5 * math.sin(math.pi / 20))
    assert gain_and_noise(5, "moving average") == pytest.approx((average, 1 / 5), abs=3e-3)
    assert gain_and_noise(5, "causal") == pytest.approx((average, 1 / 5), abs=3e-3)
    assert gain_and_noise(5, "zero-phase") == pytest.approx((0.999, 17 / 35), abs=3e-3)
    assert gain_and_noise(11, "zero-phase") == pytest.approx((0.974, 89 / 429), abs=3e-3)


@given(drives, windows, manners, st.floats(-720, 720))
def test_angles_equal_the_loop_on_their_turned_values(
    drive: tuple[Floats, NDArray[np.int32]], window: int, manner: Smoothing, turn: float
) -> None:
    steps, run = drive
    slow = turn + np.cumsum(np.where(np.isnan(steps), 0.0, steps / 1e6 * 170)) + np.where(np.isnan(steps), np.nan, 0)
    wrapped = (slow + 180) % 360 - 180
    found = smooth_angles(wrapped, run, window, manner)
    expected = by_loop(slow, run, window, manner)
    difference = (found - expected + 180) % 360 - 180
    np.testing.assert_array_equal(np.isnan(found), np.isnan(steps))
    assert np.nanmax(np.abs(difference), initial=0) < 1e-9
    assert not np.any((found < -180) | (found >= 180))


@given(drives, windows, manners, st.floats(-360, 360))
def test_where_the_circle_is_cut_changes_no_course_deviation(
    drive: tuple[Floats, NDArray[np.int32]], window: int, manner: Smoothing, turn: float
) -> None:
    steps, run = drive
    course = np.cumsum(np.nan_to_num(steps) / 1e6 * 40)
    here, there = (smooth_angles((course + by + 180) % 360 - 180, run, window, manner) for by in (0.0, turn))
    np.testing.assert_allclose(course_deviation(there, run), course_deviation(here, run), rtol=0, atol=1e-9)


@pytest.mark.parametrize("manner", MANNERS)
@pytest.mark.parametrize("values", [np.zeros(0), np.array([np.nan]), np.array([3.0])])
def test_next_to_nothing(values: Floats, manner: Smoothing) -> None:
    run = np.zeros(len(values), np.int32)
    np.testing.assert_array_equal(smooth(values, run, 5, manner), values)
    np.testing.assert_array_equal(smooth_angles(values, run, 5, manner), values)
