"""What the car did within a stretch of a recording, as the page draws it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ...schemas.store import read_table

Floats = NDArray[np.float64]

LONGEST_WINDOW = 3000
"""Rows that are sent one by one; of more, the extremes of each signal within stretches of equal length."""
LONGEST_OUTLINE = 1500
"""Points of a whole recording's path."""


@dataclass(frozen=True, slots=True)
class Panel:
    """One plot: quantities that share an axis.

    Attributes:
        title: What they are.
        unit: Unit of the axis.
        factor: From the stored unit to that of the axis.
        least: Range of the axis that is always shown, so that noise does not look like an event.
        lines: Column and name of each line.
    """

    title: str
    unit: str
    factor: float
    least: tuple[float, float]
    lines: tuple[tuple[str, str], ...]


PANELS = (
    Panel("Speed", "km/h", 3.6, (0, 20), (("speed", "car"), ("nav_speed", "navigation"))),
    Panel(
        "Longitudinal acceleration",
        "m/s²",
        1.0,
        (-4, 3),
        (("longitudinal_acceleration", "car"), ("nav_longitudinal_acceleration", "navigation")),
    ),
    Panel(
        "Lateral acceleration, left +",
        "m/s²",
        1.0,
        (-4, 4),
        (("lateral_acceleration", "car"), ("nav_lateral_acceleration", "navigation")),
    ),
    Panel("Brake pressure", "bar", 1.0, (0, 20), (("brake_pressure", "car"),)),
    Panel("Steering wheel angle, left +", "°", 1.0, (-45, 45), (("steering_wheel_angle", "car"),)),
    Panel("Steering wheel speed, left +", "°/s", 1.0, (-90, 90), (("steering_wheel_speed", "car"),)),
    Panel("Yaw rate, left +", "°/s", 1.0, (-10, 10), (("yaw_rate", "car"), ("nav_yaw_rate", "navigation"))),
)

SIGNALS = tuple(column for panel in PANELS for column, _ in panel.lines)
PLACES = ("x", "y", "course")


@dataclass(frozen=True, slots=True)
class Drive:
    """The columns of one synced table that the page shows; NaN where there is no value.

    Attributes:
        time: ns UTC (n_samples,), ascending.
        columns: Values (n_samples,) of each of `SIGNALS` and `PLACES` that holds any.
    """

    time: NDArray[np.int64]
    columns: Mapping[str, Floats]

    @classmethod
    def read(cls, path: Path) -> Drive:
        """Read a synced table.

        Raises:
            InputError: It is missing or damaged.
        """
        known = set(pq.read_schema(path).names) if path.is_file() else set()
        table = read_table(path, ["time", *(name for name in (*SIGNALS, *PLACES) if name in known)])
        columns: dict[str, Floats] = {}
        for name in table.column_names[1:]:
            if table[name].null_count < len(table):
                columns[name] = table[name].cast(pa.float64()).to_numpy(zero_copy_only=False)
        return cls(table["time"].cast(pa.int64()).to_numpy(), columns)

    def window(self, start: int, stop: int) -> dict[str, Any]:
        """Return the samples within [start, stop), ns UTC: `time` in ms from `start`, and the columns that hold any.

        Of more than `LONGEST_WINDOW` samples, least and greatest value of equally long stretches are returned in
        the order in which they occurred.
        """
        first, last = np.searchsorted(self.time, (start, stop))
        rows = slice(int(first), int(last))
        time = self.time[rows]
        columns = {name: values[rows] for name, values in self.columns.items()}
        if len(time) > LONGEST_WINDOW:
            width = -(-len(time) // (LONGEST_WINDOW // 2))
            whole = len(time) // width * width
            places = np.arange(0, whole, width)[:, None] + np.array([0, width // 2])
            time = time[places].ravel()
            columns = {
                name: values[places].ravel() if name in PLACES else _extremes(values[:whole].reshape(-1, width))
                for name, values in columns.items()
            }
        return {
            "time": ((time - start) // 1_000_000).tolist(),
            "columns": {name: _numbers(values) for name, values in columns.items() if np.isfinite(values).any()},
        }

    def outline(self) -> dict[str, Any]:
        """Return the recording in `LONGEST_OUTLINE` points: `start`, `stop`, `time` in ms UTC, `x`, `y`, `speed`."""
        step = max(1, len(self.time) // LONGEST_OUTLINE)
        time = self.time[::step] // 1_000_000
        speed = self.columns.get("nav_speed", self.columns.get("speed"))
        lines = {"x": self.columns.get("x"), "y": self.columns.get("y"), "speed": speed}
        return {
            "start": int(self.time[0]) // 1_000_000 if len(time) else None,
            "stop": int(self.time[-1]) // 1_000_000 + 1 if len(time) else None,
            "time": time.tolist(),
            **{name: None if values is None else _numbers(values[::step]) for name, values in lines.items()},
        }


@dataclass(slots=True)
class Drives:
    """The recordings that were looked at last; a table that was written again is read again."""

    most: int = 4
    kept: dict[tuple[Path, int, int], Drive] = field(default_factory=dict)

    def get(self, path: Path) -> Drive | None:
        """Return the drive of a synced table, None where there is no such file.

        Raises:
            InputError: It is damaged.
        """
        if not path.is_file():
            return None
        state = path.stat()
        key = (path, state.st_mtime_ns, state.st_size)
        drive = self.kept.pop(key, None) or Drive.read(path)
        self.kept[key] = drive
        for oldest in list(self.kept)[: -self.most]:
            self.kept.pop(oldest, None)
        return drive


def _extremes(values: Floats) -> Floats:
    """Return least and greatest value of each row (n_rows, width) in the order in which they stand: (2 n_rows,)."""
    missing = np.isnan(values)
    low = np.where(missing, np.inf, values).argmin(axis=1)
    high = np.where(missing, -np.inf, values).argmax(axis=1)
    places = np.sort(np.stack([low, high], axis=1), axis=1)
    return np.take_along_axis(values, places, axis=1).ravel()


def _numbers(values: Sequence[float] | Floats) -> list[float | None]:
    """Return values as JSON holds them: three decimals, None for what is missing."""
    rounded = np.round(values, 3)
    return [None if missing else value for value, missing in zip(rounded.tolist(), np.isnan(rounded), strict=True)]
