"""Leap seconds, against the table of the time zone database."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from importlib import resources

import numpy as np
import pytest

from wheelprint.ingest.oxts.leap_seconds import (
    GPS_EPOCH,
    LEAP_SECONDS,
    VALID_UNTIL,
    gps_ahead,
    gps_to_utc,
    utc_to_gps,
)

SECOND = 1_000_000_000


def unix(text: str) -> int:
    return int(datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp()) * SECOND


def test_the_table_is_that_of_the_time_zone_database() -> None:
    pytest.importorskip("tzdata")
    text = (resources.files("tzdata.zoneinfo") / "leapseconds").read_text()
    published = []
    for line in text.splitlines():
        if line.startswith("Leap"):
            _, year, month, day, clock, sign, _ = line.split()
            assert (clock, sign) == ("23:59:60", "+")
            published.append(datetime.strptime(f"{year} {month} {day}Z", "%Y %b %d%z").date() + timedelta(days=1))
    since_gps = [date.isoformat() for date in published if date.year > 1980]
    assert (("1980-01-06", 0), *((date, n) for n, date in enumerate(since_gps, 1))) == LEAP_SECONDS


@pytest.mark.parametrize(
    ("text", "ahead"),
    [
        ("1980-01-06T00:00:00", 0),
        ("1981-06-30T23:59:59", 0),
        ("1981-07-01T00:00:00", 1),
        ("2008-12-31T23:59:59", 14),
        ("2009-10-21T08:39:50", 15),
        ("2016-12-31T23:59:59", 17),
        ("2017-01-01T00:00:00", 18),
        ("2040-01-01T00:00:00", 18),
    ],
)
def test_gps_is_ahead_of_utc(text: str, ahead: int) -> None:
    utc = np.array([unix(text)])
    gps = utc_to_gps(utc)
    assert gps.tolist() == [unix(text) - GPS_EPOCH + ahead * SECOND]
    assert gps_to_utc(gps).tolist() == utc.tolist()


def test_a_leap_second_repeats_the_next_one() -> None:
    gps = utc_to_gps(np.array([unix("2016-12-31T23:59:59")])) + np.arange(4) * (SECOND // 2)
    begin = unix("2017-01-01T00:00:00")
    assert (gps_to_utc(gps) - begin).tolist() == [-SECOND, -SECOND // 2, 0, SECOND // 2]
    assert (gps_to_utc(gps + 2 * SECOND) - begin).tolist() == [0, SECOND // 2, SECOND, 3 * SECOND // 2]


def test_the_table_says_how_long_it_holds() -> None:
    assert unix(LEAP_SECONDS[-1][0]) < VALID_UNTIL == unix("2027-06-28")


def test_gps_is_ahead_by_the_table() -> None:
    for date, seconds in LEAP_SECONDS:
        midnight = int(np.datetime64(date, "ns").astype(np.int64))
        assert gps_ahead(midnight) == seconds
        assert gps_ahead(midnight - 1) == max(seconds - 1, 0)
