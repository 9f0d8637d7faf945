"""Reader of the CSV files that OxTS's programs export from NCOM."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from ...schemas.errors import InputError
from ...schemas.units import factor, known_units
from ..account import Account
from ..number_table import parse_rows
from ..text import Line, lines, number_of, quote
from .leap_seconds import BEYOND_TABLE, VALID_UNTIL, gps_to_utc
from .ncom_layout import INITIALISING, LOCKED, LOCKING, RAW_IMU

if TYPE_CHECKING:
    import pyarrow as pa

    from ..navigation import Samples

BATCH = 16_384
"""Lines of a batch."""
WEEK = 604_800
"""s; stamps below are those of a week whose number is missing."""

COLUMNS = {
    "latitude": "deg", "longitude": "deg", "altitude": "m", "velocity north": "m/s", "velocity east": "m/s",
    "heading": "deg", "pitch": "deg", "roll": "deg", "acceleration xv": "m/s²", "acceleration yv": "m/s²",
    "acceleration zv": "m/s²", "angular rate zv": "deg/s", "north position accuracy": "m",
    "east position accuracy": "m", "navigation status": "",
}  # fmt: skip
"""The columns that are used, in lower case, with the units they are converted to; all others are passed over."""
REQUIRED = ("latitude", "longitude")

_NAME = re.compile(r"([^()]*?)\s*\(([^()]*)\)")
_SECONDS = re.compile(rb"(\d{1,10})(?:\.(\d{0,9})\d*)?")
_PLAIN_SECONDS = r"^\d{1,10}(\.\d{1,9})?$"
_LATEST = 8_000_000_000
"""GPS seconds; beyond it 64 bits are too few for ns."""


@dataclass(frozen=True, slots=True)
class OxtsCsv:
    """A CSV file whose first line holds names such as ` Time()`, ` Latitude(deg)`, ` Velocity north(m/s)`.

    ` Time()` is seconds of GPS time since 1980-01-06 and is the only stamp that is used: the columns of wall-clock time
    are off by a fixed offset, or in the zone of the machine that exported. UTC is from the table of leap seconds. Axes
    are OxTS's (forward, right, down; heading clockwise from north). An empty cell or `-` is a missing value. Units are
    read from the names.

    Attributes:
        path: The file, plain or compressed.
    """

    format: ClassVar[str] = "csv"
    kind: ClassVar[str] = "nav"

    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether the first line of `head` has a column `Time()` and one of latitude with its unit."""
        names = [name.strip() for name in _decode(head.partition(b"\n")[0]).lstrip("\ufeff").split(",")]
        return "Time()" in names and any(name.startswith("Latitude(") for name in names)

    def batches(self, account: Account) -> Iterator[pa.RecordBatch]:
        """Yield the navigation samples in the order of time, in the schema `NAVIGATION`.

        With a column of the navigation status, lines of status 3 and 4 are whole, those of 1 and 2 give accelerations
        and yaw rate alone, all others their status alone, as in NCOM. Gravity is removed, see `remove_gravity`.

        Args:
            account: Every line after the first that is not blank is one record; rejected are damaged ones and those
                whose time is missing or does not increase.

        Raises:
            InputError: The file cannot be read, or lacks a column, or the unit of one is not known.
        """
        from ..navigation import navigation_batches

        latest = 0

        def read(account: Account) -> Iterator[Samples]:
            nonlocal latest
            numbered = lines(self.path, account)
            header = next(numbered, None)
            table = self._header(header.text if header else b"")
            while batch := list(islice(numbered, BATCH)):
                if records := [line for line in batch if line.text]:
                    samples = _samples(records, table, account)
                    latest = max(latest, int(samples.time.max()))
                    yield samples

        metadata = {"utc_from": "leap second table"}
        yield from navigation_batches(read, account, metadata, unit="line", record="line")
        if latest >= VALID_UNTIL:
            account.remarks.append(("", f"the log's times are GPS time, and {BEYOND_TABLE}"))

    def _header(self, text: bytes) -> _Header:
        cells = [cell.strip() for cell in _decode(text).split(",")]
        columns: dict[str, tuple[int, float]] = {}
        problems = []
        for place, cell in enumerate(cells):
            match = _NAME.fullmatch(cell)
            name, unit = (match[1].lower(), match[2]) if match else ("", "")
            if name not in COLUMNS or name in columns:
                continue
            scale = factor(unit, COLUMNS[name])
            if scale is None:
                known = ", ".join(known_units(COLUMNS[name]))
                problems.append(f"the unit of {cell!r} is not known (known are {known})")
            columns[name] = (place, scale or 0.0)
        missing = [name.capitalize() for name in REQUIRED if name not in columns]
        if "Time()" not in cells:
            missing.insert(0, "Time() in GPS seconds")
        if missing:
            problems.append(f"there is no column {', nor '.join(missing)}")
        if problems:
            reason = "; ".join(problems) + ". Export again with these columns, in these units"
            raise InputError(self.path, "line 1", reason)
        return _Header(len(cells), cells[-1] == "", cells.index("Time()"), columns)


@dataclass(frozen=True, slots=True)
class _Header:
    """What the first line says.

    Attributes:
        cells: How many cells a line has, the empty one after a trailing comma included.
        trailing: Whether a comma ends the line.
        time: Place of the time.
        columns: Places of the columns that are there, and the factors to their units.
    """

    cells: int
    trailing: bool
    time: int
    columns: dict[str, tuple[int, float]]


def _decode(text: bytes) -> str:
    try:
        return text.decode()
    except UnicodeDecodeError:  # The ² of a unit as Windows writes it.
        return text.decode("latin-1")


def _samples(records: list[Line], header: _Header, account: Account) -> Samples:
    from ..navigation import Samples, impossible_positions, inertial_signals

    count = len(records)
    time = np.zeros(count, np.int64)
    values = np.full((count, len(header.columns)), np.nan)
    doubts = {}
    places = [place for place, _ in header.columns.values()]
    plain = _plain(records, header, places)
    if plain is not None:
        time, values = plain
    for index, line in enumerate(records if plain is None else ()):
        try:
            cells = _cells(line, header, account)
            time[index] = _gps_nanoseconds(cells[header.time])
            values[index] = [_value(cells[place]) for place in places]
        except ValueError as error:
            doubts[index] = str(error)
    time = gps_to_utc(time)
    scaled = values * [scale for _, scale in header.columns.values()]
    column = {name: np.full(count, np.nan) for name in COLUMNS} | dict(zip(header.columns, scaled.T, strict=True))

    status = column["navigation status"]
    with np.errstate(invalid="ignore"):
        strange = ~np.isnan(status) & ((status < 0) | (status > 255) | (status % 1 != 0))
    for index in np.flatnonzero(strange).tolist():
        doubts[index] = f"expected a navigation status (0 to 255); found {status[index]:g}"
    valid, inertial = np.isin(status, (LOCKING, LOCKED)), np.isin(status, (RAW_IMU, INITIALISING))
    if "navigation status" not in header.columns:
        valid[:] = True

    def pick(where: npt.NDArray[np.bool_], *names: str) -> npt.NDArray[np.float64]:
        return np.where(where[:, None], np.column_stack([column[name] for name in names]), np.nan)

    latitude, longitude, altitude = pick(valid, "latitude", "longitude", "altitude").T
    accuracy = pick(valid, "north position accuracy", "east position accuracy")
    signals = inertial_signals(
        latitude=latitude,
        longitude=longitude,
        altitude=altitude,
        velocity=pick(valid, "velocity north", "velocity east"),
        orientation=np.radians(pick(valid, "heading", "pitch", "roll")),
        specific_force=pick(valid | inertial, "acceleration xv", "acceleration yv", "acceleration zv"),
        yaw_rate=np.radians(pick(valid | inertial, "angular rate zv")[:, 0]),
    )
    signals |= {"nav_status": status, "position_accuracy": np.hypot(*accuracy.T)}
    doubts = impossible_positions(latitude, longitude, altitude, "line") | doubts
    place = np.array([line.number for line in records], np.int64)
    return Samples(place, time, np.ones(count, bool), signals, doubts)


def _plain(
    records: list[Line], header: _Header, places: list[int]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]] | None:
    """Return stamps and values of lines, all of which are beyond doubt, else None."""
    import pyarrow as pa
    import pyarrow.compute as pc

    # What may be a part of a line, or one comma more than the first line has, is looked at alone.
    if not records[-1].ended or header.time in places:
        return None
    parsed = parse_rows([line.text for line in records], ",", header.cells, places, missing=("", "-"), text=header.time)
    if parsed is None or parsed[1] is None:
        return None
    values, seconds = parsed[0], pc.ascii_trim_whitespace(parsed[1])
    if not pc.all(pc.match_substring_regex(seconds, _PLAIN_SECONDS)).as_py():
        return None
    # What a decimal number of nine places holds are nanoseconds; ten digits of seconds fit into its lower half.
    exact = seconds.cast(pa.decimal128(28, 9))
    nanoseconds = np.frombuffer(exact.buffers()[1], np.int64)[2 * exact.offset :: 2][: len(exact)].copy()
    in_range = (nanoseconds >= WEEK * 1_000_000_000) & (nanoseconds < _LATEST * 1_000_000_000)
    return (nanoseconds, values) if in_range.all() else None


def _cells(line: Line, header: _Header, account: Account) -> list[bytes]:
    """Return the cells of a line, as many as the first line has.

    Raises:
        ValueError: It has fewer or more.
    """
    cells = line.text.split(b",")
    if not line.ended and len(cells) < header.cells:
        account.truncated = True
        raise ValueError(f"the file ends within this line: {len(cells)} cells, not {header.cells}")
    # Some exporters end only the first line, or only the others, with a comma.
    if header.trailing and len(cells) == header.cells - 1:
        cells.append(b"")
    elif len(cells) == header.cells + 1 and not cells[-1].strip():
        cells.pop()
    if len(cells) != header.cells:
        raise ValueError(f"expected {header.cells} cells as in the first line; found {len(cells)}: {quote(line.text)}")
    return cells


def _gps_nanoseconds(cell: bytes) -> int:
    """Return GPS seconds as ns since GPS time began.

    Raises:
        ValueError: The cell holds none.
    """
    match = _SECONDS.fullmatch(cell.strip())
    if not match or int(match[1]) < WEEK:
        raise ValueError(
            f"expected GPS seconds since 1980 as Time(); found {quote(cell.strip())}; "
            "the unit had no GNSS time yet, or the line is damaged"
        )
    seconds = int(match[1])
    if seconds > _LATEST:
        raise ValueError(f"Time() {seconds} s is beyond the year 2233; the line is damaged")
    return seconds * 1_000_000_000 + int((match[2] or b"").ljust(9, b"0"))


def _value(cell: bytes) -> float:
    cell = cell.strip()
    return np.nan if cell in {b"", b"-"} else number_of(cell)
