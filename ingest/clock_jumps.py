"""What a logger's stamps say of its clock by themselves: where it was set, what repeats, which clock it may show."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from .oxts.leap_seconds import gps_ahead
from .resample import Times

SECOND = 1_000_000_000
BACK_S = 0.02
"""Stamps of one message that go back farther are no jitter."""
AHEAD_S = 0.5
"""Stamps that go ahead farther are a drop-out, or a clock that was set."""
DISORDER = 0.01
"""Where a greater share of the stamps goes back, the log is not in the order of time at all."""
PIECES = 20
LIKELY_S = 30.0
"""A clock that is set by hand or by a telephone is right to so much."""
ZONES = (-9.5, -3.5, 3.5, 4.5, 5.5, 5.75, 6.5, 8.75, 9.5, 10.5, 12.75, *range(-12, 0), *range(1, 15))
"""h ahead of UTC that clocks on earth show."""
ROLL_OVER_S = 1024 * 7 * 86_400
"""GPS counts its weeks in ten bits."""
TAI_AHEAD_OF_GPS_S = 19


class Piece(NamedTuple):
    """Samples that follow one another without a jump of their stamps: `[start, stop)` in the order of the log."""

    start: int
    stop: int


def split_at_jumps(time: Times) -> tuple[list[Piece], bool]:
    """Split a message's stamps where they jump.

    Args:
        time: (n,) ns, in the order of the log.

    Returns:
        The pieces in the order of their first stamps, those between the 19 greatest jumps; and whether some overlap
        in time, as when a clock was set back. A log that is in no order, or several in another one, do not overlap.
    """
    step = np.diff(time)
    back = step < -BACK_S * SECOND
    if np.count_nonzero(back) > max(DISORDER * len(time), PIECES):
        return [Piece(0, len(time))], False
    jumps = np.flatnonzero(back | (step > AHEAD_S * SECOND))
    greatest = np.sort(jumps[np.argsort(-np.abs(step[jumps]), kind="stable")[: PIECES - 1]])
    bounds = [0, *(greatest + 1).tolist(), len(time)]
    pieces = sorted((Piece(start, stop) for start, stop in pairwise(bounds)), key=lambda piece: int(time[piece.start]))
    ends = [int(time[piece.start : piece.stop].max()) for piece in pieces]
    overlap = any(int(time[later.start]) < end - BACK_S * SECOND for end, later in zip(ends, pieces[1:], strict=False))
    return pieces, overlap


def jump_near(time: Times, place: int, size_s: float, reach_s: float) -> int | None:
    """Return the last stamp before a jump of about `size_s` beyond the usual interval, within `reach_s` of `place`.

    Args:
        time: (n,) ns, in the order of the log.
        place: ns.
        size_s: s, negative where the stamps go back.
        reach_s: s.

    Returns:
        The stamp in ns; None where no jump differs from `size_s` by less than a quarter of it.
    """
    step = np.diff(time)
    excess = (step - np.median(step)) / SECOND - size_s
    near = np.flatnonzero(np.abs(time[:-1] - place) <= reach_s * SECOND)
    if not len(near):
        return None
    best = int(near[np.argmin(np.abs(excess[near]))])
    return int(time[best]) if abs(excess[best]) < 0.25 * abs(size_s) else None


def count_repeated(time: Times) -> int:
    """Return how many stamps occurred before, and so are no time of their own."""
    if (time[1:] > time[:-1]).all():
        return 0
    return len(time) - len(np.unique(time))


def likely_clock(offset_s: float, utc: int) -> str:
    """Return what an offset of a clock from UTC looks like, empty where it looks like nothing in particular.

    Args:
        offset_s: Stamp - UTC, s.
        utc: ns, at which moment.
    """
    weeks = round(offset_s / ROLL_OVER_S)
    if weeks and abs(offset_s - weeks * ROLL_OVER_S) < LIKELY_S:
        side = "behind" if weeks > 0 else "ahead of"
        return (
            f"navigation's dates are {1024 * abs(weeks)} weeks {side} CAN's: its GPS week rolled over, or it counts "
            "from another one"
        )
    zone = min(ZONES, key=lambda hours: abs(offset_s - 3600 * hours))
    if abs(offset_s - 3600 * zone) < LIKELY_S:
        minutes = round(60 * abs(zone))
        part = f":{minutes % 60:02d}" if minutes % 60 else ""
        return f"the stamps of CAN look like local time, UTC{'-' if zone < 0 else '+'}{minutes // 60}{part}"
    ahead = gps_ahead(utc)
    for name, seconds in (("GPS time", ahead), ("TAI", ahead + TAI_AHEAD_OF_GPS_S)):
        if seconds and abs(offset_s - seconds) < 0.5:
            return f"the stamps of CAN look like {name}, {seconds} s ahead of UTC"
    minutes = round(offset_s / 60)
    if minutes and abs(minutes) <= 5 and abs(offset_s - 60 * minutes) < 0.5:
        return f"the clocks are {abs(minutes)} whole min apart: a GPS minute may have been miscounted"
    return ""
