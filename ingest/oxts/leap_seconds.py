"""GPS time and UTC: the leap seconds since GPS began, for logs that do not say the difference themselves."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Times = npt.NDArray[np.int64]

GPS_EPOCH = 315_964_800_000_000_000
"""1980-01-06T00:00:00 UTC, where GPS time begins, in ns since 1970."""

VALID_UNTIL = int(np.datetime64("2027-06-28", "ns").astype(np.int64))
"""Up to then (ns since 1970, UTC) no leap second follows the last one of the table (IERS Bulletin C, July 2026)."""

BEYOND_TABLE = "the table of leap seconds ends on 2027-06-28: its times may be a second off. Update Wheelprint"
"""What is said of a log in GPS time that goes on after `VALID_UNTIL`."""

LEAP_SECONDS = (
    ("1980-01-06", 0),
    ("1981-07-01", 1),
    ("1982-07-01", 2),
    ("1983-07-01", 3),
    ("1985-07-01", 4),
    ("1988-01-01", 5),
    ("1990-01-01", 6),
    ("1991-01-01", 7),
    ("1992-07-01", 8),
    ("1993-07-01", 9),
    ("1994-07-01", 10),
    ("1996-01-01", 11),
    ("1997-07-01", 12),
    ("1999-01-01", 13),
    ("2006-01-01", 14),
    ("2009-01-01", 15),
    ("2012-07-01", 16),
    ("2015-07-01", 17),
    ("2017-01-01", 18),
)
"""From this UTC midnight on, GPS time is ahead of UTC by so many seconds (IERS Bulletin C)."""

_STARTS = np.array([date for date, _ in LEAP_SECONDS], "datetime64[ns]").astype(np.int64)
_AHEAD = np.array([seconds for _, seconds in LEAP_SECONDS], np.int64) * 1_000_000_000


def gps_to_utc(gps: Times) -> Times:
    """Return ns since 1970 in UTC for ns since `GPS_EPOCH` of GPS time, by the table.

    Within a leap second, UTC repeats the second that follows it, as Unix time does.
    """
    counted = gps + GPS_EPOCH
    return counted - _AHEAD[np.maximum(np.searchsorted(_STARTS + _AHEAD, counted, "right") - 1, 0)]


def gps_ahead(utc: int) -> int:
    """Return by how many seconds GPS time is ahead of UTC at ns since 1970 in UTC, by the table."""
    return int(_AHEAD[max(int(np.searchsorted(_STARTS, utc, "right")) - 1, 0)]) // 1_000_000_000


def utc_to_gps(utc: Times) -> Times:
    """Return ns since `GPS_EPOCH` of GPS time for ns since 1970 in UTC, by the table."""
    return utc - GPS_EPOCH + _AHEAD[np.maximum(np.searchsorted(_STARTS, utc, "right") - 1, 0)]
