"""Hysteresis and thresholds that rise, against a plain loop."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.dataset.excursions import excursions, risen_threshold

amounts = st.lists(st.one_of(st.just(float("nan")), st.integers(0, 6).map(float)), max_size=40)


def plainly(amount: list[float], run: list[int], enter: float, leave: float, least: int) -> list[tuple[int, int]]:
    """Walk along the samples."""
    found = []
    row = 0
    while row < len(amount):
        stop = row
        while stop < len(amount) and run[stop] == run[row] and amount[stop] > leave:
            stop += 1
        if sum(value > enter for value in amount[row:stop]) >= max(least, 1):
            found.append((row, stop))
        row = max(stop, row + 1)
    return found


@given(amounts, st.integers(1, 40), st.integers(0, 3), st.integers(0, 5), st.integers(0, 4))
def test_excursions_are_those_of_a_plain_loop(
    amount: list[float], length: int, hysteresis: int, leave: int, least: int
) -> None:
    run = [row // length for row in range(len(amount))]
    found = excursions(np.array(amount, float), np.array(run, np.int64), leave + hysteresis, leave, least)
    assert [(rows.start, rows.stop) for rows in found] == plainly(amount, run, leave + hysteresis, leave, least)


@given(amounts, st.integers(1, 40), st.sampled_from([0.0, 0.1, 0.3, 0.9]), st.sampled_from([0.5, 1.0]))
def test_the_threshold_is_the_lowest_that_serves(amount: list[float], length: int, share: float, leave: float) -> None:
    run = np.arange(len(amount)) // length
    values = np.array(amount, float)
    allowed = int(share * np.count_nonzero(~np.isnan(values)))

    def held(threshold: float) -> int:
        return sum(stop - start for start, stop in plainly(amount, run.tolist(), threshold, leave * threshold, 1))

    threshold = risen_threshold(values, run, 1.0, share, leave, 1, 0)
    assert held(threshold) <= allowed
    lower = [value for value in {1.0, *amount} if 1.0 <= value < threshold]
    assert all(held(value) > allowed for value in lower)
    assert threshold in {1.0, *amount}


def test_short_driving_is_taken_for_longer() -> None:
    values = np.array([0.0] * 90 + [5.0] * 10)
    run = np.zeros(100, np.int64)
    assert risen_threshold(values, run, 2.0, 0.05, 1.0, 1, 0) == 5.0
    assert risen_threshold(values, run, 2.0, 0.05, 1.0, 1, 200) == 2.0


@pytest.mark.parametrize("values", [[], [0.0] * 9, [float("nan")] * 9])
def test_nothing_is_beyond_nothing(values: list[float]) -> None:
    assert risen_threshold(np.array(values), np.zeros(len(values), np.int64), 0.0, 0.1, 1.0, 1, 0) == np.inf
