"""Signals of any rate to one grid of time, without inventing anything in their gaps."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from ..schemas.angles import wrap_degrees
from ..schemas.signals import Resampling

Times = npt.NDArray[np.int64]
Values = npt.NDArray[np.float64]

PIECE = 1 << 14
"""Points of a grid looked at at once, with the samples around them: a day takes no more memory than an hour."""


def grid(start: int, stop: int, period: int) -> Times:
    """Return the exact multiples of `period` in the half-open interval [start, stop), all in ns since 1970.

    The first is at or after `start`, the last before `stop`: the grid of samples that end at `last`, inclusive, is
    `grid(first, last + 1, period)`.
    """
    return np.arange(-(-start // period), -(-stop // period), dtype=np.int64) * period


def resample(
    time: Times, values: npt.ArrayLike, grid_time: Times, method: Resampling, max_gap: int, period: int
) -> Values:
    """Bring one signal to a grid; NaN where it says nothing. Nothing is extrapolated.

    Args:
        time: (n_samples,) stamps in ns; they need not increase, and of equal ones the last counts.
        values: (n_samples,) values; NaN and infinite ones are dropped before anything else.
        grid_time: (n_grid,) times in ns.
        method: `linear` between the two neighbours if they are at most `max_gap` apart; a sample that hits the grid
            counts by itself. `angle` the same in degrees along the shorter arc, in [-180, 180). `mean` the average of
            the piecewise linear signal over one `period` centred on the grid time, where all of that period is
            covered by samples at most `max_gap` apart; `linear` instead if the samples are not twice as dense as the
            grid, that is if less than half of their distances are at most 0.55 periods, which leaves room for jitter.
            `hold` the last value at or before, not older than `max_gap`.
        max_gap: Longest gap that is bridged, ns.
        period: Period of the grid, ns.

    Returns:
        (n_grid,) values.
    """
    time, samples = _in_order(time, np.asarray(values, np.float64))
    if method == "mean" and not _is_dense(time, period):
        method = "linear"
    result = np.empty(len(grid_time))
    reach = max_gap + period
    for first in range(0, len(grid_time), PIECE):
        at = grid_time[first : first + PIECE]
        start, stop = np.searchsorted(time, (at.min() - reach, at.max() + reach + 1)).tolist()
        result[first : first + PIECE] = _to_grid(time[start:stop], samples[start:stop], at, method, max_gap, period)
    return result


def resample_pieces(
    pieces: Iterable[tuple[Times, Values]],
    grid_time: Times,
    method: Resampling,
    max_gap: int,
    period: int,
) -> Values:
    """Bring a signal to a grid as `resample` does, piece by piece; more than two pieces are never in memory.

    Args:
        pieces: Stamps in ns and values, (n_samples,) each; no piece begins before the one before it ends. The first
            one with two samples tells whether the samples are dense enough for `mean`.
        grid_time: (n_grid,) times in ns, increasing.
        method: As for `resample`.
        max_gap: Longest gap that is bridged, ns.
        period: Period of the grid, ns.

    Returns:
        (n_grid,) values.
    """
    result = np.full(len(grid_time), np.nan)
    reach = max_gap + period
    settled, decided = 0, method != "mean"
    time, values = np.array([], np.int64), np.array([])
    for new_time, new_values in pieces:
        time, values = _in_order(np.concatenate((time, new_time)), np.concatenate((values, new_values)))
        if not decided and len(time) > 1:
            decided, method = True, "mean" if _is_dense(time, period) else "linear"
        if decided and len(time):
            stop = max(settled, int(np.searchsorted(grid_time, time[-1] - reach)))
            result[settled:stop] = _to_grid(time, values, grid_time[settled:stop], method, max_gap, period)
            settled = stop
            if settled < len(grid_time):
                kept = time >= grid_time[settled] - reach
                time, values = time[kept], values[kept]
    method = method if decided else "linear"
    result[settled:] = _to_grid(time, values, grid_time[settled:], method, max_gap, period)
    return result


def _is_dense(time: Times, period: int) -> bool:
    return len(time) > 1 and bool(np.mean(20 * np.diff(time) <= 11 * period) >= 0.5)


def _to_grid(time: Times, values: Values, grid_time: Times, method: Resampling, max_gap: int, period: int) -> Values:
    if len(time) == 0 or (method == "mean" and len(time) == 1):
        return np.full(len(grid_time), np.nan)
    if method == "hold":
        before = np.searchsorted(time, grid_time, "right") - 1
        held = (before >= 0) & (grid_time - time[before] <= max_gap)
        return np.where(held, values[before], np.nan)
    if method == "mean":
        return _average(time, values, grid_time, max_gap, period)
    return _interpolate(time, values, grid_time, max_gap, circular=method == "angle")


def number_runs(complete: npt.NDArray[np.bool_]) -> npt.NDArray[np.int32]:
    """Return for each row the number of its stretch of complete rows, from 0, and -1 where it is not complete."""
    begins = complete & ~np.concatenate(([False], complete[:-1]))
    return np.where(complete, np.cumsum(begins) - 1, -1).astype(np.int32)


def _in_order(time: Times, values: Values) -> tuple[Times, Values]:
    """Return the finite samples by strictly increasing time."""
    present = np.isfinite(values)
    if not present.all():
        time, values = time[present], values[present]
    if (np.diff(time) > 0).all():
        return time, values
    order = np.argsort(time, kind="stable")
    time, values = time[order], values[order]
    last = np.append(time[1:] != time[:-1], True)
    return time[last], values[last]


def _interpolate(time: Times, values: Values, at: Times, max_gap: int, *, circular: bool) -> Values:
    after = np.searchsorted(time, at, "left")
    inside = (at >= time[0]) & (at <= time[-1])
    after = np.clip(after, 0, len(time) - 1)
    before = np.maximum(after - 1, 0)
    hit = inside & (time[after] == at)
    width = time[after] - time[before]
    between = inside & ~hit & (width <= max_gap)
    share = (at - time[before]) / np.maximum(width, 1)
    step = values[after] - values[before]
    if circular:
        step = wrap_degrees(step)
    result = np.where(hit, values[after], np.where(between, values[before] + share * step, np.nan))
    return wrap_degrees(result) if circular else result


def _average(time: Times, values: Values, at: Times, max_gap: int, period: int) -> Values:
    start = at - period // 2
    stop = start + period
    gaps_before = np.concatenate(([0], np.cumsum(np.diff(time) > max_gap)))
    first = np.clip(np.searchsorted(time, start, "right") - 1, 0, len(time) - 2)
    last = np.clip(np.searchsorted(time, stop, "left"), 1, len(time) - 1)
    covered = (start >= time[0]) & (stop <= time[-1]) & (gaps_before[first] == gaps_before[last])
    # The integral runs over the deviation from the median, so that a constant comes back as it was.
    level = float(np.median(values))
    deviation = values - level
    width = np.diff(time)
    integral = np.concatenate(([0.0], np.cumsum(0.5 * width * (deviation[1:] + deviation[:-1]))))

    def integral_to(end: Times, segment: npt.NDArray[np.intp]) -> Values:
        elapsed = end - time[segment]
        slope = (deviation[segment + 1] - deviation[segment]) / width[segment]
        return integral[segment] + elapsed * (deviation[segment] + 0.5 * slope * elapsed)

    area = integral_to(stop, last - 1) - integral_to(start, first)
    return np.where(covered, level + area / period, np.nan)
