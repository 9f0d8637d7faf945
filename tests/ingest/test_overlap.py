"""How logs lie in time to each other."""

from __future__ import annotations

import pytest

from wheelprint.ingest.overlap import HOUR, SECOND, LogSpan, doubt, duration, near_each_other, of_every_kind, time_zone

START = 1_700_000_000 * SECOND


def span(name: str, kind: str, start: float, length: float) -> LogSpan:
    begin = START + round(start * SECOND)
    return LogSpan(name, kind, begin, begin + round(length * SECOND))


CAN = span("can.log", "can", 0, 600)


def test_logs_are_divided_where_one_scale_would_not_show_both_sides() -> None:
    long = span("long", "nav", 2300, 700)
    later = span("later", "can", 3000 + 8900, 10)
    last = span("last", "can", 90_000_000, 10)
    assert near_each_other([last, later, CAN, long]) == [[CAN, long, later], [last]]
    assert len(near_each_other([CAN, span("other", "can", 600 + 1801, 1)])) == 2
    assert len(near_each_other([span("short", "can", 0, 1), span("other", "can", 60, 1)])) == 1


def test_the_time_of_every_kind() -> None:
    logs = [CAN, span("b", "can", 700, 100), span("nav", "nav", 300, 420), span("cam", "camera", -50, 2000)]
    assert of_every_kind(logs) == [
        (START + 300 * SECOND, START + 600 * SECOND),
        (START + 700 * SECOND, START + 720 * SECOND),
    ]
    assert of_every_kind([*logs, span("x", "other", 5000, 1)]) == []


@pytest.mark.parametrize("hours", [-12, -5, 1, 2, 5.5, 9.5, 14])
def test_a_time_zone_lies_between(hours: float) -> None:
    nav = span("nav.ncom", "nav", 40 - hours * 3600, 580)
    assert time_zone(CAN, nav) == hours * HOUR
    assert time_zone(nav, CAN) == (-hours * HOUR if abs(hours) <= 12 else None)


@pytest.mark.parametrize(("start", "length"), [(7200 + 301, 600), (7200 + 200, 600), (15 * 3600, 600), (5400 + 900, 9)])
def test_no_time_zone_lies_between(start: float, length: float) -> None:
    assert time_zone(CAN, span("nav.ncom", "nav", start, length)) is None


def test_what_is_said_of_a_log_that_fits_to_no_other() -> None:
    shifted = span("nav.ncom", "nav", -7200 + 5, 600)
    counting = LogSpan("relative.asc", "can", 0, 600 * SECOND)
    far = span("far.ncom", "nav", 17 * 86_400, 60)
    assert doubt(CAN, [CAN, span("b.log", "can", 9000, 1)]) == ""
    assert doubt(CAN, [CAN, far, span("nav.ncom", "nav", 599, 600)]) == ""
    assert doubt(CAN, [CAN, shifted]) == (
        "it has nothing in common with nav.ncom, but 2 hours earlier it would: the stamps of one of them may be local "
        "time"
    )
    assert doubt(shifted, [CAN, shifted]) == (
        "it has nothing in common with can.log, but 2 hours later it would: the stamps of one of them may be local time"
    )
    assert doubt(counting, [counting, far]) == (
        "its stamps begin in 1970: they count from the logger's own start and are no dates"
    )
    assert doubt(far, [counting, far]) == ""
    assert doubt(CAN, [CAN, far]) == (
        "it has nothing in common with a log of another kind; the nearest, far.ncom, begins 17 days after it"
    )
    assert doubt(far, [CAN, far]) == (
        "it has nothing in common with a log of another kind; the nearest, can.log, ends 17 days before it"
    )


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (0.25, "0.25 s"),
        (59.96, "60 s"),
        (245, "4 min 05 s"),
        (12_000, "3 h 20 min"),
        (2e6, "23 days"),
        (4e8, "12.7 years"),
    ],
)
def test_durations(seconds: float, said: str) -> None:
    assert duration(round(seconds * SECOND)) == said
