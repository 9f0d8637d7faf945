"""The moving average against a plain loop, and what must come back as it was."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from wheelprint.dataset.smoothing import moving_average, moving_average_of_angles

Floats = NDArray[np.float64]

windows = st.integers(0, 4).map(lambda half: 2 * half + 1)
numbers = st.one_of(st.floats(-1e6, 1e6), st.just(math.nan))
drives = st.lists(st.tuples(numbers, st.sampled_from([0, 0, 0, 1])), max_size=60).map(
    lambda samples: (np.array([v for v, _ in samples]), np.cumsum([step for _, step in samples]).astype(np.int32))
)


def by_loop(values: Floats, run: NDArray[np.int32], window: int) -> Floats:
    """The definition: the widest symmetric window of the same run without a NaN, at most `window` long."""
    smoothed = []
    for centre, value in enumerate(values):
        reach = 0
        while reach < window // 2 and not math.isnan(value):
            outer = (centre - reach - 1, centre + reach + 1)
            if outer[0] < 0 or outer[1] >= len(values):
                break
            if any(run[i] != run[centre] or math.isnan(values[i]) for i in outer):
                break
            reach += 1
        smoothed.append(math.fsum(values[centre - reach : centre + reach + 1]) / (2 * reach + 1))
    return np.array(smoothed)


@given(drives, windows)
def test_equals_the_loop(drive: tuple[Floats, NDArray[np.int32]], window: int) -> None:
    values, run = drive
    before = values.copy()
    np.testing.assert_allclose(moving_average(values, run, window), by_loop(values, run, window), rtol=0, atol=1e-8)
    np.testing.assert_array_equal(values, before)


@given(st.floats(-1e9, 1e9), st.integers(1, 40), windows)
def test_constants_come_back_bit_for_bit(value: float, samples: int, window: int) -> None:
    values = np.full(samples, value)
    np.testing.assert_array_equal(moving_average(values, np.zeros(samples, np.int32), window), values)


def test_straight_lines_and_far_positions_come_back() -> None:
    line = 4e6 + 0.7 * np.arange(300, dtype=np.float64)
    np.testing.assert_allclose(moving_average(line, np.zeros(300, np.int32), 5), line, rtol=0, atol=1e-9)


def test_the_centre_of_a_window_is_the_plain_mean() -> None:
    values = np.random.default_rng(1).normal(size=50)
    smoothed = moving_average(values, np.zeros(50, np.int32), 5)
    np.testing.assert_allclose(smoothed[2:-2], np.convolve(values, np.full(5, 0.2), "valid"), rtol=0, atol=1e-14)


@given(drives, windows, st.floats(-720, 720))
def test_angles_equal_the_loop_on_their_turned_values(
    drive: tuple[Floats, NDArray[np.int32]], window: int, turn: float
) -> None:
    steps, run = drive
    slow = turn + np.cumsum(np.where(np.isnan(steps), 0.0, steps / 1e6 * 170)) + np.where(np.isnan(steps), np.nan, 0)
    wrapped = (slow + 180) % 360 - 180
    found = moving_average_of_angles(wrapped, run, window)
    expected = by_loop(slow, run, window)
    difference = (found - expected + 180) % 360 - 180
    np.testing.assert_array_equal(np.isnan(found), np.isnan(steps))
    assert np.nanmax(np.abs(difference), initial=0) < 1e-9
    assert not np.any((found < -180) | (found >= 180))


@pytest.mark.parametrize("values", [np.zeros(0), np.array([np.nan]), np.array([3.0])])
def test_next_to_nothing(values: Floats) -> None:
    np.testing.assert_array_equal(moving_average(values, np.zeros(len(values), np.int32), 5), values)
    np.testing.assert_array_equal(moving_average_of_angles(values, np.zeros(len(values), np.int32), 5), values)
