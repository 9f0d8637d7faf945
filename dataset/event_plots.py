"""Small plots of what the car did around an event, in the coordinates of an SVG drawing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .events import Event

Style = Literal["solid", "dashed"]

CONTEXT = 8.0
"""s shown before and after an event."""
LONGEST_TRACE = 1200
"""Samples of a line; of a longer one every second, third, … is drawn."""


@dataclass(frozen=True, slots=True)
class Panel:
    """What one small plot shows.

    Attributes:
        title: Name of the quantity.
        unit: Unit of the axis.
        factor: From the stored unit to that of the axis.
        least: Range of the axis that is always shown, so that noise does not look like an event.
        lines: Name, style and columns of each line; the first column that holds anything is drawn.
    """

    title: str
    unit: str
    factor: float
    least: tuple[float, float]
    lines: tuple[tuple[str, Style, tuple[str, ...]], ...]


PANELS = (
    Panel("Speed", "km/h", 3.6, (0, 20), (("", "solid", ("nav_speed", "speed")),)),
    Panel(
        "Acceleration",
        "m/s²",
        1.0,
        (-4, 4),
        (
            ("longitudinal", "solid", ("longitudinal_acceleration", "nav_longitudinal_acceleration")),
            ("lateral", "dashed", ("lateral_acceleration", "nav_lateral_acceleration")),
        ),
    ),
    Panel("Steering wheel angle", "°, positive left", 1.0, (-45, 45), (("", "solid", ("steering_wheel_angle",)),)),
)


@dataclass(frozen=True, slots=True)
class Plot:
    """A small plot in the coordinates of its drawing.

    Attributes:
        title: Name of the quantity.
        unit: Unit of the vertical axis.
        lines: Name, style and SVG path of each line.
        marks_x: Position and label of the marks of the time axis, s from the event's start.
        marks_y: Position and label of the marks of the vertical axis.
        start: Left edge of the event.
        stop: Right edge of the event.
    """

    title: str
    unit: str
    lines: list[tuple[str, Style, str]]
    marks_x: list[tuple[float, str]]
    marks_y: list[tuple[float, str]]
    start: float
    stop: float


LEFT, RIGHT, TOP, BOTTOM = 46.0, 392.0, 8.0, 122.0


def plot(panel: Panel, table: pa.Table, event: Event) -> Plot:
    """Draw one panel around an event.

    Args:
        panel: What to draw.
        table: Synced table of the event's recording.
        event: What to draw around; `CONTEXT` seconds before and after it are shown.
    """
    time = table["time"].cast(pa.int64()).to_numpy()
    margin = round(CONTEXT * 1e9)
    rows = slice(*np.searchsorted(time, (event.start - margin, event.stop + margin)))
    step = -(-(rows.stop - rows.start) // LONGEST_TRACE) or 1
    rows = slice(rows.start, rows.stop, step)
    seconds = (time[rows] - event.start) / 1e9
    lines = [(name, style, _first(table, columns, rows) * panel.factor) for name, style, columns in panel.lines]

    begin, end = -CONTEXT, (event.stop - event.start) / 1e9 + CONTEXT
    drawn = np.concatenate([values for _, _, values in lines])
    finite = drawn[np.isfinite(drawn)]
    low, high = (float(function((*panel.least, *finite))) for function in (min, max))

    def x(value: Any) -> Any:
        return LEFT + (RIGHT - LEFT) * (value - begin) / (end - begin)

    def y(value: Any) -> Any:
        return BOTTOM - (BOTTOM - TOP) * (value - low) / (high - low)

    return Plot(
        panel.title,
        panel.unit,
        [(name, style, _path(x(seconds), y(values))) for name, style, values in lines],
        [(float(x(mark)), label) for mark, label in _marks(begin, end, 8)],
        [(float(y(mark)), label) for mark, label in _marks(low, high, 5)],
        float(x(0.0)),
        float(x(end - CONTEXT)),
    )


def _first(table: pa.Table, columns: Sequence[str], rows: slice) -> NDArray[np.float64]:
    """Return the first of the columns that holds anything in these rows, NaN where it is null."""
    for column in columns:
        values: NDArray[np.float64] = table[column].to_numpy(zero_copy_only=False)[rows].astype(np.float64)
        if np.isfinite(values).any():
            return values
    return np.full(len(range(*rows.indices(len(table)))), np.nan)


def _path(x: NDArray[np.float64], y: NDArray[np.float64]) -> str:
    """Return an SVG path that breaks where a value is missing."""
    present = np.isfinite(y)
    begins = present & ~np.concatenate(([False], present[:-1]))
    points = zip(np.where(begins, "M", "L")[present], x[present], y[present], strict=True)
    return "".join(f"{pen}{px:.1f} {py:.1f}" for pen, px, py in points)


def _marks(low: float, high: float, intervals: int) -> list[tuple[float, str]]:
    """Return multiples of 1, 2 or 5 times a power of ten within [low, high], with labels; at most so many intervals."""
    power = 10.0 ** np.floor(np.log10((high - low) / intervals))
    step = next(power * nice for nice in (1, 2, 5, 10) if (high - low) / (power * nice) <= intervals)
    values = [float(step) * number for number in range(int(np.ceil(low / step)), int(high // step) + 1)]
    return [(value, f"{value:g}".replace("-", "−")) for value in values]
