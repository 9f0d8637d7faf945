"""A planned path or lane centre from a file: what the driver really looked along."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..schemas.config import Config
from ..schemas.errors import InputError
from ..schemas.store import sha256
from .path import Floats, Runs

SPACING = 0.5
"""m between the points a reference is sampled at: in a turn of 8 m the chords stay within 4 mm of the arc."""

FARTHEST = 10.0
"""m; a car that is farther from its reference is not following it."""

_GAP = 200.0
_CLOSED = 5.0
_PAIRS = (("latitude", "longitude"), ("x", "y"))


@dataclass(frozen=True, slots=True)
class Reference:
    """A path in a recording's plane, its points `SPACING` apart, in the direction of travel.

    Attributes:
        x: m (n_points,), east of the recording's origin.
        y: m, north of it.
        closed: It ends where it begins, as a lap does; then the first point is also the last one.
        file: Where it is from.
    """

    x: Floats
    y: Floats
    closed: bool
    file: Path

    def locate(self, x: Floats, y: Floats, course: Floats, run: Runs) -> Floats:
        """Return the arc length in m (n,) of the path's point that is nearest to a car.

        NaN where the path is more than `FARTHEST` m away or leads elsewhere. Within a run the car is followed, so that
        a path may cross itself.

        Args:
            x: East (n,), m.
            y: North, m.
            course: Direction of travel, deg.
            run: Number of the run of every sample.
        """
        from .pursuit import follow

        number = np.asarray(run, np.int32)
        places: Floats = follow(x, y, np.radians(course), number, self.x, self.y, SPACING, self.closed, FARTHEST)
        return SPACING * places

    def ahead(self, place: Floats, distance: float) -> tuple[Floats, Floats, NDArray[np.int64], NDArray[np.int64]]:
        """Return the points that lie ahead: of all x and y, the one behind each place, and the end of what is ahead.

        Args:
            place: Arc length (n,), m; NaN has nothing ahead.
            distance: m of path that count as ahead.
        """
        reach = int(distance / SPACING) + 1
        x, y = self.x, self.y
        if self.closed:
            again = np.arange(len(x), len(x) + reach) % (len(x) - 1)
            x, y = np.append(x, x[again]), np.append(y, y[again])
        known = np.isfinite(place)
        behind = np.where(known, place, 0.0) // SPACING
        first = behind.astype(np.int64)
        return x, y, first, np.where(known, np.minimum(first + reach, len(x)), 0)

    def curvature(self, place: Floats) -> Floats:
        """Return the path's curvature over 4 m, 1/m, at arc lengths (n, …); 0 beyond its ends."""
        base = 4.0
        length = SPACING * (len(self.x) - 1)
        grid = SPACING * np.arange(len(self.x))

        def point(at: Floats) -> tuple[Floats, Floats]:
            at = at % length if self.closed else at
            return np.interp(at, grid, self.x), np.interp(at, grid, self.y)

        (x0, y0), (x1, y1), (x2, y2) = (point(place + shift) for shift in (-base, 0.0, base))
        before, after = (x1 - x0) + 1j * (y1 - y0), (x2 - x1) + 1j * (y2 - y1)
        inside = (np.abs(before) > 0) & (np.abs(after) > 0) & np.isfinite(place)
        turned = np.angle(np.where(inside, after, 1.0) * np.conj(np.where(inside, before, 1.0)))
        return np.where(inside, turned / base, 0.0)


def find_references(
    project: Path, pattern: str, driver: str, recordings: Iterable[str]
) -> tuple[dict[str, tuple[str, str]], list[InputError]]:
    """Return which reference file each recording of a driver has.

    Args:
        project: Project folder.
        pattern: `[lookahead] reference`: "driven", or a path from the project folder in which {driver} and {recording}
            stand for the names.
        driver: Whose recordings.
        recordings: Their names.

    Returns:
        Path, as `pattern` writes it, and SHA-256 by recording; and a problem for each file that is missing, once.
    """
    found: dict[str, tuple[str, str]] = {}
    missing: dict[str, list[str]] = {}
    for name in recordings if pattern != "driven" else ():
        file = pattern.replace("{driver}", driver).replace("{recording}", name)
        if (project / file).is_file():
            found[name] = (file, sha256(project / file))
        else:
            missing.setdefault(file, []).append(name)
    problems = []
    for file, names in missing.items():
        reason = (
            f"no such file; lookahead.reference = {pattern!r} asks for it, and without it {driver}/{names[0]}"
            f"{f' and {len(names) - 1} more have' if names[1:] else ' has'} no lookahead distance. Put the planned "
            'path or lane centre there, or write reference = "driven"'
        )
        problems.append(InputError(project / file, "", reason))
    return found, problems


def read_reference(path: Path, origin: Mapping[str, float] | None, config: Config) -> Reference:
    """Read a reference into a recording's plane.

    Args:
        path: CSV with a header line, or Parquet; the columns `latitude` and `longitude` in deg, or `x` and `y` in m.
        origin: Of the recording: latitude, longitude, altitude; None where it has none.
        config: The project file; x and y need a file for each recording.

    Raises:
        InputError: The file cannot be read, lacks columns, holds something else than numbers, or does not
            make a path.
    """
    table = _read(path)
    pair = next((names for names in _PAIRS if set(names) <= set(table.column_names)), None)
    if pair is None:
        found = ", ".join(table.column_names) or "nothing"
        reason = f"the columns latitude and longitude (deg), or x and y (m), are needed; found: {found}"
        raise InputError(path, "header", reason)
    first, second = (_numbers(path, table, name) for name in pair)
    if pair == ("x", "y"):
        if "{recording}" not in config.lookahead.reference:
            reason = (
                "x and y are metres from one recording's origin, and this file is for all; give latitude and "
                "longitude, or a file for each recording ({driver} and {recording} in lookahead.reference)"
            )
            raise InputError(path, "x, y", reason)
        return _sample(path, first, second)
    if beyond := np.flatnonzero((np.abs(first) > 90) | (np.abs(second) > 180)).tolist():
        reason = (
            f"latitude within ±90 and longitude within ±180 deg are needed; found {first[beyond[0]]:g} and "
            f"{second[beyond[0]]:g}, and {len(beyond)} such rows in all; are the columns exchanged?"
        )
        raise InputError(path, f"row {beyond[0] + 1}", reason)
    if not origin or not {"latitude", "longitude", "altitude"} <= set(origin):
        reason = "the recording has no origin to turn latitude and longitude into x and y; give x and y instead"
        raise InputError(path, "latitude, longitude", reason)
    from ..ingest.navigation import Origin, local_position

    place = Origin(origin["latitude"], origin["longitude"], origin["altitude"])
    x, y = local_position(first, second, np.full(len(first), np.nan), place)
    return _sample(path, x, y)


def _read(path: Path) -> pa.Table:
    import pyarrow.csv
    import pyarrow.parquet

    try:
        if path.suffix.lower() == ".csv":
            return pyarrow.csv.read_csv(path)
        if path.suffix.lower() == ".parquet":
            return pyarrow.parquet.read_table(path, partitioning=None)
    except (OSError, pa.ArrowInvalid) as error:
        raise InputError(path, "", f"not a table that can be read: {error}") from None
    raise InputError(path, "", "a reference is a .csv or .parquet file")


def _numbers(path: Path, table: pa.Table, name: str) -> Floats:
    column = table[name]
    if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
        raise InputError(path, name, f"numbers are needed, with a point as decimal mark; found {column.type}")
    values: Floats = column.cast(pa.float64()).to_numpy()
    if missing := np.flatnonzero(~np.isfinite(values)).tolist():
        rows = ", ".join(str(row + 1) for row in missing[:5]) + (", …" if len(missing) > 5 else "")
        raise InputError(path, name, f"a number is needed in every row; missing in {len(missing)}: row {rows}")
    return values


def _sample(path: Path, x: Floats, y: Floats) -> Reference:
    """Sample a path at equal steps, without the points that stand still; `path` is for what is wrong with it."""
    moves = np.append(True, np.hypot(np.diff(x), np.diff(y)) > 0)
    rows, x, y = np.flatnonzero(moves), x[moves], y[moves]
    steps = np.hypot(np.diff(x), np.diff(y))
    if steps.sum() < 2 * _CLOSED:
        reason = (
            f"{len(x)} different points over {steps.sum():.1f} m, and a path of {2 * _CLOSED:g} m at least is needed"
        )
        raise InputError(path, "", reason)
    if steps.max() > _GAP:
        widest = int(steps.argmax())
        reason = (
            f"its points lie up to {_GAP:g} m apart at most, and from row {rows[widest] + 1} to the next it is "
            f"{steps.max():.0f} m; is the path in order and in one piece?"
        )
        raise InputError(path, f"row {rows[widest] + 1}", reason)
    closed = bool(np.hypot(x[-1] - x[0], y[-1] - y[0]) <= _CLOSED and steps.sum() > 20 * _CLOSED)
    if closed and steps.size and np.hypot(x[-1] - x[0], y[-1] - y[0]) > 0:
        x, y = np.append(x, x[0]), np.append(y, y[0])
    along = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    # Of a closed path the last step would be a shorter one: all are stretched by what is missing.
    length = along[-1]
    points = round(length / SPACING) + 1 if closed else int(length / SPACING) + 1
    at = np.linspace(0.0, length, points) if closed else SPACING * np.arange(points)
    return Reference(np.interp(at, along, x), np.interp(at, along, y), closed, path)
