"""One recording as the report shows it: how far it went, its clock's alignment, its map."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..dataset.events import Event
from ..schemas.times import iso_utc
from . import drive_figures
from .blocks import Figure

Values = NDArray[np.float64]

STRETCH, CLOSE = 20.0, 6.0
"""s of each recording that show the alignment; the shorter where the offset could not be seen in the longer."""
SMALL_OFFSET = 0.2
"""s"""


@dataclass(frozen=True, slots=True)
class Drive:
    """What one recording's tables say, read once.

    Attributes:
        key: `driver/recording`.
        start: ns UTC of the first row.
        minutes: From the first row to the last.
        synced: Rows times period, s.
        driven: Time in runs, s.
        distance: Length of the way in runs, m.
        alignment: The car's and navigation's speed before and after alignment; where there is none, the reason.
        track: Its map; None without positions.
    """

    key: str
    start: int
    minutes: float
    synced: float
    driven: float
    distance: float
    alignment: Figure | str
    track: Figure | None


def describe(
    key: str,
    table: pa.Table,
    dataset: pa.Table | None,
    clock: Mapping[str, Any],
    events: Sequence[Event],
    period: float,
    at_most: int,
) -> Drive:
    """Return what the report says of one recording.

    Args:
        key: `driver/recording`.
        table: Its synced table, not empty.
        dataset: Its dataset, whose path labels colour the map; None before there is one.
        clock: Its CAN clock in the manifest.
        events: Its events.
        period: Grid period, s.
        at_most: Points of the map.
    """
    time = nanoseconds(table)
    in_run = table["run"].is_valid().to_numpy()
    navigation = column(table, "nav_speed")
    speed = np.where(np.isfinite(navigation), navigation, column(table, "speed"))
    return Drive(
        key,
        int(time[0]),
        float((time[-1] - time[0]) / 60e9),
        len(table) * period,
        float(in_run.sum() * period),
        float(np.nansum(speed[in_run]) * period),
        alignment(key, table, clock, period),
        track(key, table, dataset, events, at_most),
    )


def alignment(key: str, table: pa.Table, clock: Mapping[str, Any], period: float) -> Figure | str:
    """Show a stretch of speeding up and slowing down before and after the recording's CAN clock was aligned.

    The synced table holds the car's speed on UTC. What its stamps said before is the same line, moved by the offset.

    Args:
        key: The recording.
        table: Its synced table.
        clock: Its clock in the manifest.
        period: Grid period, s.

    Returns:
        The figure with the estimate in words; or why there is nothing to show.
    """
    car, navigation = column(table, "speed"), column(table, "nav_speed")
    duration = CLOSE if clock["applied"] and abs(clock["offset_s"]) < SMALL_OFFSET else STRETCH
    length = round(duration / period)
    both = np.isfinite(car) & np.isfinite(navigation)
    begins = range(0, max(len(both) - length, 0) + 1, max(length // 4, 1))
    whole = [begin for begin in begins if both[begin : begin + length].all()]
    if not whole:
        absent = [name for name, values in (("the car's", car), ("navigation's", navigation)) if np.isnan(values).all()]
        if absent:
            return f"{' and '.join(absent)} speed {'is' if len(absent) == 1 else 'are'} missing"
        return f"the car's and navigation's speed are nowhere both there for {duration:.0f} s without a gap"
    # Where the speed rises evenly an offset looks like another scale: it is shown where the acceleration changes.
    begin = max(whole, key=lambda begin: float(np.std(np.diff(navigation[begin : begin + length]))))
    rows = slice(begin, begin + length)
    time = nanoseconds(table)
    seconds = (time - time[begin]) / 1e9
    shown = (seconds[rows], navigation[rows])
    stretch = f"{key}: {duration:.0f} s from {readable(int(time[begin]))}"
    estimate = estimate_in_words(clock)
    if not clock["applied"]:
        figure = drive_figures.alignment(*shown, car[rows], None, 0.0)
        return Figure(f"{stretch}; CAN as stamped, not aligned. {estimate}", figure)
    shift = clock["offset_s"] + 1e-6 * (clock.get("drift_ppm") or 0.0) * begin * period
    present = np.isfinite(car)
    before = np.interp(seconds[rows] - shift, seconds[present], car[present], left=math.nan, right=math.nan)
    if np.isfinite(before).any():
        figure = drive_figures.alignment(*shown, before, car[rows], shift)
        spread = [3.6 * float(np.nanstd(values - navigation[rows])) for values in (before, car[rows])]
        agreement = f"the difference varies by {spread[0]:.2f} km/h before and {spread[1]:.2f} km/h after"
        return Figure(f"{stretch}, before and after alignment; {agreement} (sd). {estimate}", figure)
    figure = drive_figures.alignment(*shown, None, car[rows], shift)
    apart = f"by its own stamps the CAN log was {shift:+,.1f} s away from here".replace("-", "−")
    return Figure(f"{stretch}, aligned; {apart}. {estimate}", figure)


def estimate_in_words(clock: Mapping[str, Any]) -> str:
    """Return offset, drift, residual and standard error of a CAN clock, and where they are from; or why none is used.

    Args:
        clock: In the manifest.
    """
    reason = clock.get("reason") or ""
    if not clock["applied"]:
        return f"Nothing is applied: {reason or 'no offset was estimated'}."
    parts = [f"Offset {clock['offset_s']:+.4f} s at the start"]
    parts += [
        f"{name} {value:{form}} {unit}"
        for name, value, form, unit in (
            ("drift", clock.get("drift_ppm"), "+.1f", "ppm"),
            ("residual", clock.get("residual_ms"), ".1f", "ms"),
            ("standard error", clock.get("standard_error_ms"), ".1f", "ms"),
        )
        if value is not None
    ]
    numbers = ", ".join(parts).replace("-", "−")
    return f"{numbers}; {reason}." if reason else f"{numbers}."


def track(key: str, table: pa.Table, dataset: pa.Table | None, events: Sequence[Event], at_most: int) -> Figure | None:
    """Draw a recording's map; `at_most` points of it are kept.

    Args:
        key: The recording.
        table: Its synced table.
        dataset: Its dataset, whose path labels give the colours; None before there is one.
        events: Its events.
        at_most: Points that are drawn.
    """
    time = nanoseconds(table)
    x, y, speed, run = (column(table, name) for name in ("x", "y", "nav_speed", "run"))
    if not np.isfinite(x).any():
        return None
    label = None
    if dataset is not None:
        label = np.full(len(time), math.nan)
        at = np.searchsorted(time, nanoseconds(dataset))
        label[np.minimum(at, len(time) - 1)] = column(dataset, "path_label")
    marks = {}
    for decision in drive_figures.DECISIONS:
        middles = [
            int(np.searchsorted(time, (event.start + event.stop) // 2))
            for event in events
            if event.decision == decision
        ]
        middles = [middle for middle in middles if middle < len(time)]
        if middles:
            marks[decision] = (x[middles], y[middles])
    few = drive_figures.thin(len(time), at_most)
    broken = np.diff(run[few], prepend=run[0]) != 0  # NaN, outside a run, differs from everything
    thinned = np.where(broken, math.nan, x[few])
    figure = drive_figures.track(thinned, y[few], speed[few], None if label is None else label[few], marks)
    whose = "" if label is None else "; labels are the driver's own clusters"
    every = "" if few.step == 1 else f", one row in {few.step}"
    return Figure(f"{key}: path on equal axes from the recording's origin{every}{whose}.", figure)


def readable(time: int) -> str:
    """Return ns UTC as date and time of day to the millisecond."""
    return iso_utc(time).replace("T", " ").removesuffix("Z")


def nanoseconds(table: pa.Table) -> NDArray[np.int64]:
    """Return the times of a stored table (n_rows,), ns UTC."""
    time: NDArray[np.int64] = table["time"].cast(pa.int64()).to_numpy()
    return time


def column(table: pa.Table, name: str) -> Values:
    """Return a column of a stored table as floats (n_rows,), NaN where it is null."""
    values: Values = table[name].cast(pa.float64()).to_numpy(zero_copy_only=False)
    return values
