"""Reader of Vector ASC logs (CANoe, CANalyzer and those who write like them), plain or compressed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import ClassVar

import numpy as np

from ..account import Account
from ..content import head
from .frames import FrameBatch
from .text_log import OTHER, go_back, read_frames

REASONS = (
    "expected a frame such as `0.100000 1 123x Rx d 2 01 AB`, or another line that ASC is known to have",
    "expected a time such as 12.345678 at the start: seconds, a point, 1 to 9 digits",
    "the time is beyond the year 2262, the last that 64-bit nanoseconds can hold",
    "expected an identifier in digits of the base that the header names; log numbers instead of symbolic names",
    "the identifier is beyond 11 bits (7FF); identifiers of 29 bits end in x",
    "the identifier is beyond 29 bits (1FFFFFFF)",
    "expected d (data) or r (remote request) behind the direction",
    "expected a length code of 0 to 15 (F)",
    "fewer bytes than the line's own length",
    "expected bytes in the base that the header names: 2 hex digits, or decimal 0 to 255",
    "expected nothing behind the payload but Length, BitCount, ID or a comment",
    "expected bit rate switch and error state, each 0 or 1, behind the identifier or its name",
    "the number of bytes is not what the length code means",
    "expected flags in hex as third number behind the payload",
    "the last number may be cut",
    "longer than 65536 bytes, no line of this format",
    "one channel more than the 256 that a log may have",
)
"""What is said of a rejected line, by the codes of `asc_lines`."""

_BOM = b"\xef\xbb\xbf"
_TIME_OF_DAY = rb"(\d{1,2}):(\d{2}):(\d{2})(?:\.(\d{1,9}))?(?:\s+([ap]m))?"
_DATE = re.compile(rb"(?:[^\s\d]+\s+)?([^\s\d]{3,9})\s+(\d{1,2})\s+" + _TIME_OF_DAY + rb"\s+(\d{4})", re.IGNORECASE)
_DATED = re.compile(rb"(?:date(?=\s)|(?P<block>begin\s+triggerblock))(?:\s+(?P<date>.+))?", re.IGNORECASE)
_BASE = re.compile(rb"base\s+(hex|dec)(?:\s+timestamps\s+(absolute|relative))?", re.IGNORECASE)
_NO_RECORD = re.compile(
    rb"//.*|end\s+triggerblock|(?:no\s+)?internal\s+events\s+logged|previous\s+log\s+file:.*|"
    # Behind a stamp: what CANoe says of itself, of the buses, and of traffic that is not CAN's or no frame of its own.
    rb"\d+\.\d+\s+(?://.*|(?:start|stop|end)\s+of\s+measurement|log\s+(?:trigger|direct)\s.*|trigger\s+event.*|"
    rb"(?:canfd\s+)?\d+\s+(?:rx\s+|tx\s+)?(?:statistic:|j1939tp\s|overloadframe\b|\S+\s+txrq\s|txrq\s).*|"
    rb"can\s+\d+\s+status:.*|(?:tfs|sv|comment|gps|cal|test\w*):.*|"
    rb"(?:l[i\d]\d*|m\d+|fr|frpdu|eth|afdx|a429|wlan|j1587|j1708|k-line)\s.*|\S+\s+:=.*|error\s.*)",
    re.IGNORECASE | re.DOTALL,
)
_STAMP = re.compile(rb"^[ \t]*(\d{1,9})\.(\d{1,9})[ \t]", re.MULTILINE)
_START = re.compile(
    rb"(?:\xef\xbb\xbf)?(?:\s++|//[^\n]*+\n)*+"
    rb"(?:date\s+(?:[^\s\d]+\s+){1,2}\d{1,2}\s+\d{1,2}:\d\d:\d\d|base\s+(?:hex|dec)\b|begin\s+triggerblock\b|"
    rb"\d+\.\d+[ \t]+(?:canfd[ \t]+\d+[ \t]+[rt]x[ \t]|\d+[ \t]+(?:errorframe\b|[\da-f]+x?[ \t]+[rt]x[ \t]+[dr]\b)|"
    rb"start\s+of\s+measurement))",
    re.IGNORECASE,
)
_MONTHS = {
    name: number
    for number, names in enumerate(
        "jan feb mar|mär|mrz|mae apr may|mai jun jul aug sep oct|okt nov dec|dez".split(), start=1
    )
    for name in names.split("|")
}
_LEAST_STAMPS = 12
"""So many stamps make sure that a header which says `absolute` is wrong."""


@dataclass(frozen=True, slots=True)
class Asc:
    """A log of lines such as `0.100000 1  123x  Rx  d 2 01 AB` or `0.1 CANFD 1 Rx 123 1 0 9 12 …`.

    The header gives the base of identifiers and bytes (`base hex`, taken where it is missing, or `dec`; lengths behind
    a length code are always decimal) and what stamps count from: `timestamps absolute` from the start of the
    measurement, `relative` from the stamp before, whatever its line. Where it says `absolute`, but one stamp in ten
    goes back (of the first 64 KiB), they are taken as `relative`. Stamps from 10⁹ s (2001) on count from 1970.

    The start of the measurement is the header's `date`; a trigger block's own date replaces it if the block begins at
    stamp 0 or at an earlier one than the block before it ended with (python-can's `date` is only when its writer was
    made). **These dates are the logging computer's local time; no ASC file says in which zone: they are taken as UTC**,
    so that stamps may be off by whole hours, and the clock estimate or `sync.clock` has to know. Month names are
    English or German, hours of 12 (am, pm) or 24. Up to three digits behind the seconds are milliseconds: python-can
    writes 7 ms as `.7`. Without a date, stamps count from 1970-01-01.

    Channels keep their number as a name: `"1"`. Identifiers are extended when, and only when, they end in `x`. A CANFD
    line may hold a classic or a remote frame, as its flags say. Error frames have identifier 0. `TxRq` (the request to
    send what follows as `Tx`), statistics, bus states, J1939 TP (its parts stand as frames), other buses, system
    variables, comments and header lines are known and are no records; every other line is rejected.

    Attributes:
        path: The log, plain or compressed.
    """

    format: ClassVar[str] = "asc"
    kind: ClassVar[str] = "can"

    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether the first line of `head` that is neither blank nor a comment is a header or a frame of ASC."""
        return _START.match(head) is not None

    def batches(self, account: Account) -> Iterator[FrameBatch]:
        """Yield the frames in the order of the file, up to `text_log.BATCH` at a time; count them in `account`.

        A last line without line end is a frame if it surely is a whole one, else it is rejected and the file is
        `truncated`. A date that cannot be read is rejected as well; stamps then go on counting from what they did.

        Raises:
            InputError: The file cannot be read.
        """
        from .asc_lines import BLOCK_BEGINS, BLOCK_DATE, DECIMAL, DELTAS, START, scan

        stamps = _STAMP.findall(head(self.path))
        disguised = len(stamps) >= _LEAST_STAMPS and go_back(stamps)
        state = np.zeros(6, np.int64)
        state[DELTAS] = disguised

        def judge(code: int, line: bytes) -> str:
            line = line.removeprefix(_BOM)
            if code != OTHER:
                return REASONS[code]
            if _NO_RECORD.fullmatch(line):
                return ""
            if base := _BASE.fullmatch(line):
                state[DECIMAL] = base[1].lower() == b"dec"
                state[DELTAS] = disguised or (base[2] or b"").lower() == b"relative"
                return ""
            header = _DATED.fullmatch(line)
            if header is None:
                return REASONS[0]
            if header["date"] is None:
                return ""
            start = _nanoseconds(header["date"])
            if start is None:
                return "expected a date from 1970 to 2261 such as Mon Sep 30 15:06:13.191 2017 (am, pm or 24 hours)"
            if header["block"]:
                state[BLOCK_BEGINS], state[BLOCK_DATE] = 1, start
            if not header["block"] or not state[START]:
                state[START] = start
            return ""

        yield from read_frames(self.path, account, scan, judge, state)


def _nanoseconds(date: bytes) -> int | None:
    """Return a date such as `Sam Sep 30 03:06:13.191 pm 2017`, taken as UTC, in ns since 1970; None if it is none."""
    match = _DATE.fullmatch(date.strip())
    if match is None:
        return None
    name, *numbers, fraction, half, year = match.groups()
    text = name.decode("utf-8", "replace") if b"\xc3" in name else name.decode("latin-1")
    month = _MONTHS.get(text.lower()[:3])
    day, hour, minute, second = (int(number) for number in numbers)
    if half and hour <= 12:
        hour = hour % 12 + 12 * (half.lower() == b"pm")
    if month is None or not 1970 <= int(year) <= 2261:
        return None
    try:
        moment = datetime(int(year), month, day, hour, minute, second, tzinfo=UTC)
    except ValueError:
        return None
    fraction = fraction or b""
    below = int(fraction or b"0") * 10**6 if len(fraction) <= 3 else int(fraction.ljust(9, b"0"))
    return int(moment.timestamp()) * 10**9 + below
