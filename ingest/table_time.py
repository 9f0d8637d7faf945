"""When the rows of a table were measured: a column of stamps in any of the formats of `nav.time`."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from ..schemas.config import TimeColumn
from .oxts.leap_seconds import gps_to_utc

Times = npt.NDArray[np.int64]

SECOND = 1_000_000_000
WEEK = 604_800 * SECOND
LATEST = int(np.iinfo(np.int64).max)
UNITS = {
    "unix-s": SECOND, "unix-ms": 1_000_000, "unix-us": 1000, "unix-ns": 1, "gps-s": SECOND, "gps-ms": 1_000_000,
    "gps-week-s": SECOND,
}  # fmt: skip
"""ns in what the numbers of each format count."""
EXPECTED = {
    "iso8601": "a date and time with its zone, such as 2024-05-13T01:00:00.1Z (if they are all UTC: iso8601-utc)",
    "iso8601-utc": "a date and time, such as 2024-05-13T01:00:00.1",
    "unix-s": "seconds since 1970",
    "unix-ms": "milliseconds since 1970",
    "unix-us": "microseconds since 1970",
    "unix-ns": "nanoseconds since 1970",
    "gps-s": "seconds since 1980",
    "gps-ms": "milliseconds since 1980",
    "gps-week-s": "seconds of the GPS week, and a week of at least 1024 (counted on, not modulo 1024)",
}
ISO = (
    r"^(?P<moment>\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d)(?:[.,](?P<fraction>\d{1,18}))?"
    r"(?P<zone>Z|[+-]\d\d(?::?\d\d)?)?$"
)
DECIMAL = r"^(?P<whole>\d{1,19})(?:[.](?P<fraction>\d{0,30}))?$"
FIRST_WEEK = 1024
"""GPS weeks before that are of the last century, or have rolled over."""


def parse_times(column: pa.Array, weeks: pa.Array | None, time: TimeColumn) -> tuple[Times, npt.NDArray[np.bool_]]:
    """Return the stamps of a column.

    Integers and text stay exact; of floating point numbers what they hold is taken.

    Args:
        column: (n,) text, numbers or timestamps.
        weeks: (n,) GPS weeks, for `gps-week-s`.
        time: How the column is written.

    Returns:
        ns since 1970 in UTC, (n,), and which of them are known.
    """
    if time.format.startswith("iso8601"):
        return _moments(column, time.format)
    stamps, known = _counts(column, UNITS[time.format])
    if weeks is not None:
        week, week_known = _counts(weeks, 1)
        known &= week_known & (week >= FIRST_WEEK) & (week < LATEST // (2 * WEEK)) & (stamps < WEEK)
        stamps = np.where(known, stamps + np.where(known, week, 0) * WEEK, 0)
    if time.format.startswith("gps"):
        known &= stamps < LATEST // 2
        stamps = np.where(known, gps_to_utc(np.where(known, stamps, 0)), 0)
    return stamps, known


def _counts(column: pa.Array, unit: int) -> tuple[Times, npt.NDArray[np.bool_]]:
    """Return numbers times `unit`, and which are there and fit into 64 bits."""
    kind = column.type
    if pa.types.is_integer(kind) or pa.types.is_timestamp(kind):
        whole, fraction = column.cast(pa.int64(), safe=False), None
    elif pa.types.is_floating(kind):
        values = column.cast(pa.float64()).to_numpy(zero_copy_only=False)
        sound = np.isfinite(values) & (values >= 0) & (values < LATEST / unit - 1)
        floor = np.floor(np.where(sound, values, 0))
        rest = np.rint((np.where(sound, values, 0) - floor) * unit)
        return floor.astype(np.int64) * unit + rest.astype(np.int64), sound
    else:
        parts = pc.extract_regex(pc.utf8_trim_whitespace(column.cast(pa.string())), DECIMAL)
        digits = parts.field("whole")
        # 19 digits may be more than 64 bits hold.
        fits = pc.less_equal(pc.utf8_length(digits), 18)
        fits = pc.or_(fits, pc.less(digits, str(LATEST)))
        whole = pc.if_else(pc.and_(parts.is_valid(), fits), digits, None).cast(pa.int64())
        fraction = _fraction(parts.field("fraction"))
    known = np.asarray(whole.is_valid())
    numbers = np.asarray(whole.fill_null(0))
    known &= (numbers >= 0) & (numbers < LATEST // unit)
    stamps = np.where(known, numbers, 0) * unit
    if fraction is not None:
        stamps += fraction // (SECOND // unit)
    return stamps, known


def _fraction(digits: Any) -> Times:
    """Return ns of the digits after a point."""
    padded = pc.utf8_slice_codeunits(pc.utf8_rpad(pc.fill_null(digits, ""), 9, "0"), 0, 9)
    return np.asarray(padded.cast(pa.int64()))


def _moments(column: pa.Array, form: str) -> tuple[Times, npt.NDArray[np.bool_]]:
    if pa.types.is_timestamp(column.type):
        known = np.asarray(column.is_valid()) & (column.type.tz is not None or form == "iso8601-utc")
        stamps = column.cast(pa.timestamp("ns", column.type.tz), safe=False).cast(pa.int64()).fill_null(0)
        return np.asarray(stamps), known
    parts = pc.extract_regex(pc.utf8_trim_whitespace(column.cast(pa.string())), ISO)
    zone = pc.if_else(pc.equal(parts.field("zone"), ""), "Z" if form == "iso8601-utc" else None, parts.field("zone"))
    text = pc.binary_join_element_wise(parts.field("moment"), zone, "")
    kind = pa.timestamp("s", "UTC")
    try:
        moments = text.cast(kind)
    except pa.ArrowInvalid:  # There is no such day or hour in one of them.
        moments = pa.array([_moment(one, kind) for one in text], kind)
    seconds = np.asarray(moments.cast(pa.int64()).fill_null(0))
    known = np.asarray(moments.is_valid()) & (seconds >= 0) & (seconds < LATEST // SECOND)
    return np.where(known, seconds, 0) * SECOND + _fraction(parts.field("fraction")), known


def _moment(text: Any, kind: pa.DataType) -> Any:
    try:
        return text.cast(kind)
    except pa.ArrowInvalid:
        return None
