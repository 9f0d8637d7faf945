"""What stamps say by themselves, and jumps of the shift between two clocks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.ingest.alignment import find_step
from wheelprint.ingest.clock_jumps import Piece, count_repeated, jump_near, likely_clock, split_at_jumps

SECOND = 10**9
EPOCH = 1_700_000_000 * SECOND


def stamps(*steps_s: float) -> np.ndarray:
    """Stamps every 20 ms, with some steps in between, each after another hundred."""
    step = np.full(100 * (len(steps_s) + 1), SECOND // 50)
    step[100 * np.arange(1, len(steps_s) + 1)] = [round(s * SECOND) for s in steps_s]
    return EPOCH + np.cumsum(step)


def test_stamps_without_jumps_are_one_piece() -> None:
    assert split_at_jumps(stamps()) == ([Piece(0, 100)], False)
    assert split_at_jumps(stamps(0.5, -0.02, 0.3)) == ([Piece(0, 400)], False)
    assert split_at_jumps(stamps()[:1]) == ([Piece(0, 1)], False)


def test_a_drop_out_parts_and_a_clock_that_was_set_back_overlaps() -> None:
    assert split_at_jumps(stamps(0.6, 5.0)) == ([Piece(0, 100), Piece(100, 200), Piece(200, 300)], False)
    assert split_at_jumps(stamps(-1.0)) == ([Piece(0, 100), Piece(100, 200)], True)


def test_pieces_are_in_the_order_of_time() -> None:
    """Two files that were joined the wrong way round; then a logger that began at 1970."""
    assert split_at_jumps(stamps(-4.5)) == ([Piece(100, 200), Piece(0, 100)], False)
    assert split_at_jumps(stamps(-EPOCH / SECOND)) == ([Piece(100, 200), Piece(0, 100)], False)


def test_many_jumps_leave_the_greatest_and_a_jumble_none() -> None:
    pieces, _ = split_at_jumps(stamps(*[1.0 + 0.1 * k for k in range(40)]))
    assert len(pieces) == 20
    assert pieces[0] == Piece(0, 2200)
    jumbled = np.random.default_rng(0).permutation(stamps(0.6, 0.7))
    assert split_at_jumps(jumbled) == ([Piece(0, 300)], False)


def test_a_jump_is_found_near_a_place() -> None:
    time = stamps(0.1, -0.3, 0.1)
    assert jump_near(time, int(time[150]), 0.08, 3.0) in (int(time[99]), int(time[299]))
    assert jump_near(time, int(time[150]), -0.3, 3.0) == int(time[199])
    assert jump_near(time, int(time[150]), 0.2, 3.0) is None
    assert jump_near(time, int(time[0]) - 100 * SECOND, 0.08, 3.0) is None


def test_repeated_stamps_are_counted_wherever_they_are() -> None:
    assert count_repeated(np.array([1, 2, 2, 3, 1, 1])) == 3
    assert count_repeated(np.array([], np.int64)) == 0


@pytest.mark.parametrize(
    ("offset_s", "said"),
    [
        (28_812.0, "the stamps of CAN look like local time, UTC+8"),
        (-12_600.0, "the stamps of CAN look like local time, UTC-3:30"),
        (20_700.0, "the stamps of CAN look like local time, UTC+5:45"),
        (18.1, "the stamps of CAN look like GPS time, 18 s ahead of UTC"),
        (37.0, "the stamps of CAN look like TAI, 37 s ahead of UTC"),
        (60.2, "the clocks are 1 whole min apart: a GPS minute may have been miscounted"),
        (0.0, ""),
        (1.2, ""),
        (17.0, ""),
        (1000.0, ""),
        (15 * 3600.0, ""),
        (-1.7e9, ""),
    ],
)
def test_what_an_offset_looks_like(offset_s: float, said: str) -> None:
    assert likely_clock(offset_s, EPOCH) == said


def test_a_week_that_rolled_over() -> None:
    weeks = 1024 * 7 * 86_400.0
    assert likely_clock(weeks + 1, EPOCH).startswith("navigation's dates are 1024 weeks behind CAN's: its GPS week ")
    assert likely_clock(-2 * weeks, EPOCH).startswith("navigation's dates are 2048 weeks ahead of CAN's: its GPS week ")


@given(st.integers(0, 2**32 - 1), st.integers(3, 57), st.sampled_from([-0.08, -0.02, 0.02, 0.08]))
def test_a_jump_of_the_shift_is_found_to_a_block(seed: int, block: int, size: float) -> None:
    random = np.random.default_rng(seed)
    grip = random.uniform(1, 3, 60)
    line = 0.001 * np.arange(60) / 60
    shift = line + size * (np.arange(60) >= block) + random.normal(0, 0.001, 60) / np.sqrt(grip)
    found = find_step(grip * shift, grip)
    assert found is not None
    assert found.block == block
    assert found.size_s == pytest.approx(size, abs=0.004)


@given(st.integers(0, 2**32 - 1))
def test_noise_and_a_line_are_no_jump(seed: int) -> None:
    random = np.random.default_rng(seed)
    grip = np.where(random.random(60) < 0.2, 0.0, random.uniform(0.5, 3, 60))
    shift = 0.05 * np.arange(60) / 60 + random.normal(0, 0.002, 60)
    assert find_step(grip * shift, grip) is None


def test_too_few_blocks_tell_nothing() -> None:
    assert find_step(np.zeros(8), np.ones(8)) is None
    assert find_step(np.zeros(60), np.zeros(60)) is None
