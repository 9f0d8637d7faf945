"""Rates and gaps, counted batch by batch."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.ingest.cadence import Cadence

START = 1_700_000_000_000_000_000
MS = 1_000_000


def cadence_of(steps_ms: list[float], cuts: tuple[int, ...] = ()) -> Cadence:
    cadence = Cadence()
    times = START + np.concatenate(([0], np.cumsum(np.round(np.array(steps_ms) * MS)))).astype(np.int64)
    for part in np.split(times, cuts):
        cadence.add(part)
    return cadence


def test_the_rate_is_that_outside_of_gaps() -> None:
    cadence = cadence_of([10.0] * 100 + [5000.0] + [10.0] * 100 + [700.0], (0, 30, 101, 150))
    assert (cadence.count, cadence.gaps) == (203, 2)
    assert cadence.rate == pytest.approx(100.0)
    assert cadence.facts() == {
        "count": 203, "start": "2023-11-14T22:13:20.000Z", "stop": "2023-11-14T22:13:27.700Z", "rate_hz": 100.0,
        "gaps": 2, "longest_interval_s": 5.0, "longest_interval_at": "2023-11-14T22:13:21.000Z",
    }  # fmt: skip


@pytest.mark.parametrize(("interval", "gaps"), [(499.0, 0), (500.0, 0), (501.0, 1)])
def test_half_a_second_is_bridged(interval: float, gaps: int) -> None:
    assert cadence_of([20.0] * 20 + [interval]).gaps == gaps


@pytest.mark.parametrize(("interval", "gaps"), [(2900.0, 0), (3900.0, 1)])
def test_a_slow_message_has_a_gap_from_three_times_its_usual_interval_on(interval: float, gaps: int) -> None:
    assert cadence_of([1000.0] * 20 + [interval]).gaps == gaps


def test_what_came_once_or_never_has_no_rate() -> None:
    once, never = cadence_of([]), Cadence()
    assert (once.count, once.rate, once.gaps, once.longest_at) == (1, None, 0, None)
    assert (never.count, never.rate, never.gaps, never.start) == (0, None, 0, None)


@given(st.lists(st.integers(-3000, 6000), max_size=60), st.lists(st.integers(0, 61), max_size=3))
def test_batches_make_no_difference_and_going_back_is_no_interval(steps: list[int], cuts: list[int]) -> None:
    whole, parts = cadence_of([float(s) for s in steps]), cadence_of([float(s) for s in steps], tuple(sorted(cuts)))
    assert whole.facts() == parts.facts()
    assert whole.longest == max([0, *(step * MS for step in steps)])
