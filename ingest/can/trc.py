"""Reader of PEAK traces (TRC 1.0 to 2.1), plain or compressed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from ..account import Account
from .frames import FrameBatch
from .text_log import OTHER, read_frames

REASONS = (
    "",
    "expected more columns: the line breaks off",
    "expected the number of the message, such as 17) or 17",
    "expected a time offset in ms such as 1059.900",
    "expected a type: Rx, Tx, Warng, Error (versions 1) or DT, FD, FB, FE, BI, RR, ST, ER, EC, EV (versions 2)",
    "expected the number of the bus, 0 to 255",
    "expected an identifier of up to 8 hex digits",
    "the identifier is beyond 11 bits (7FF); identifiers of 29 bits have more than 4 digits",
    "the identifier is beyond 29 bits (1FFFFFFF)",
    "expected the direction Rx or Tx",
    "expected a data length",
    "more than 8 bytes on a classic frame; CAN FD frames have the type FD, FB, FE or BI",
    "no CAN FD frame has this many bytes (only 0 to 8, 12, 16, 20, 24, 32, 48, 64)",
    "expected bytes of two hex digits as payload",
    "fewer bytes than the data length says",
    "more bytes than the data length says",
    "too long for a line of such a log",
)
"""What is said of a rejected line, by the codes of `trc_lines`."""

VERSIONS = {
    "1.0": "N,O,I,L,D",
    "1.1": "N,O,T,I,L,D",
    "1.2": "N,O,B,T,I,L,D",
    "1.3": "N,O,B,T,I,R,L,D",
    "2.0": "N,O,T,I,d,l,D",
    "2.1": "N,O,T,B,I,d,R,L,D",
}
"""Columns of the versions; a file of versions 2 says them itself in `$COLUMNS`."""

_DAY = 86_400 * 10**9
_EPOCH_DAYS = 25_569
"""Days from 1899-12-30 to 1970-01-01."""
_LATEST = 1 << 62

_VERSION = re.compile(rb";\$FILEVERSION\s*=\s*(\S*)", re.IGNORECASE)
_START = re.compile(rb";\$STARTTIME\s*=\s*(.*)", re.IGNORECASE)
_COLUMNS = re.compile(rb";\$COLUMNS\s*=\s*(.*)", re.IGNORECASE)
_DAYS = re.compile(r"(\d{1,7})(?:[.,](\d*))?")
_WRITTEN_START = re.compile(
    rb";\s*Start time:\s*(?:(\d{1,2})\.(\d{1,2})\.(\d{4})|(\d{4})-(\d{1,2})-(\d{1,2}))"
    rb"[ T]+(\d{1,2}):(\d{1,2}):(\d{1,2})((?:\.\d+)*)",
    re.IGNORECASE,
)
_MARK = re.compile(rb";\$(FILEVERSION|STARTTIME|COLUMNS)\s*=", re.IGNORECASE)
_FIRST_LINE = re.compile(rb"\d+\)[ \t]+-?\d+(\.\d+)?[ \t]+(\S+[ \t]+){0,3}[0-9A-Fa-f]{4,8}[ \t]+(-[ \t]+)?\d{1,2}\s")


@dataclass(frozen=True, slots=True)
class Trc:
    """A trace such as PCAN-View, PCAN-Explorer and PEAK's loggers write, its lines after the file's version.

    `     1)      1059.9  Rx         0300  7  00 00 00 00 04 00 00` (1.1),
    `      1      1059.900 DT 1      0300 Rx -  7    00 00 00 00 04 00 00` (2.1). Identifiers are extended when, and
    only when, they have more than 4 digits. Channels are named by the number of the bus; versions without it have
    one bus, `1`.

    What the interface says of the bus is a frame of kind `error` with identifier 0 and the bytes of the line: ER,
    ST (status) and EC (error counters); Warng and lines with the identifier FFFFFFFF, their text left out; Error too,
    its identifier being the kind of error. Lines with EV (text of a user) and those that begin with a semicolon are
    no records. Direction, bit rate switch and requested lengths are not kept.

    `$STARTTIME` counts days since 1899-12-30 by the clock of the computer that recorded, which is local time as a
    rule, without zone: it is taken as UTC, so that the stamps can be off by whole hours (the estimate of the clock's
    offset does not mend this; name the offset in the configuration). Without it the start written in the remark
    `Start time:` is taken, and without that the stamps count from 1970-01-01.

    Attributes:
        path: The trace, plain or compressed.
    """

    format: ClassVar[str] = "trc"
    kind: ClassVar[str] = "can"

    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether the file has a header of PEAK's, or, without any, its first line is one of versions 1."""
        for line in map(bytes.strip, head.splitlines()):
            if line.startswith(b";"):
                if _MARK.match(line) or b"Start time:" in line:
                    return True
            elif line:
                return _FIRST_LINE.match(line + b"\n") is not None
        return False

    def batches(self, account: Account) -> Iterator[FrameBatch]:
        """Yield the frames in the order of the file and count them in `account`.

        Raises:
            InputError: The file cannot be read; its version is none of 1.0 to 2.1, its start or its columns cannot
                be understood.
        """
        from .trc_lines import scan

        header = _Header()
        yield from read_frames(self.path, account, scan, header.judge, header.state)


@dataclass(slots=True)
class _Header:
    """What the header has said so far, and the `state` that `trc_lines` has of it."""

    columns: list[str] = field(default_factory=lambda: VERSIONS["1.0"].split(","))
    version: str = "1.0"
    start: int = 0
    exact_start: bool = False
    state: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(12, np.int64))

    def __post_init__(self) -> None:
        self._tell()

    def _tell(self) -> None:
        from .trc_lines import ABSENT, COLUMNS

        letters = [letter.replace("l", "L") for letter in self.columns]
        place = [letters.index(letter) if letter in letters else ABSENT for letter in COLUMNS]
        self.state[:] = (*place, "L" in self.columns, self.version.startswith("1."), self.start)

    def judge(self, code: int, line: bytes) -> str:
        """Return why a line is rejected; of a line of the header take note."""
        if code != OTHER:
            return REASONS[code]
        self._enter(line)
        self._tell()
        return ""

    def _enter(self, line: bytes) -> None:
        if match := _VERSION.match(line):
            self.version = match[1].decode("ascii", "backslashreplace")
            if self.version not in VERSIONS:
                raise ValueError(f"expected $FILEVERSION to be one of {', '.join(VERSIONS)}; export the trace as one")
            self.columns, self.start, self.exact_start = VERSIONS[self.version].split(","), 0, False
        elif match := _START.match(line):
            self.start, self.exact_start = _parse_days(match[1].decode("ascii", "backslashreplace")), True
        elif match := _COLUMNS.match(line):
            self.columns = _parse_columns(match[1].decode("ascii", "backslashreplace"))
            if self.version.startswith("1."):
                self.version = "2.0"
        elif not self.exact_start and (match := _WRITTEN_START.match(line)):
            self.start = _parse_written_start(match)


def _parse_days(days: str) -> int:
    """Return ns since 1970 of `$STARTTIME`, rounded to ns, by integers."""
    match = _DAYS.fullmatch(days)
    if match is None:
        raise ValueError("expected $STARTTIME as days since 1899-12-30, such as 43008.920986342592; correct it")
    fraction = (match[2] or "")[:40]
    unit: int = 10 ** len(fraction)
    start = (int(match[1]) - _EPOCH_DAYS) * _DAY + (2 * int(fraction or 0) * _DAY + unit) // (2 * unit)
    if abs(start) >= _LATEST:
        raise ValueError("expected $STARTTIME before the year 2116, in days since 1899-12-30; correct it")
    return start


def _parse_columns(columns: str) -> list[str]:
    letters = [letter.strip() for letter in columns.split(",")]
    unknown = [letter for letter in letters if letter not in {*"NOTBIdRLlD"}]
    missing = [letter for letter in "OTI" if letter not in letters]
    missing += [] if {"l", "L"} & {*letters} else ["l or L"]
    twice = sorted({letter for letter in letters if letters.count(letter) > 1})
    if unknown or missing or twice or {"l", "L"} <= {*letters} or letters[-1] != "D":
        faults = [f"unknown: {', '.join(unknown)}"] if unknown else []
        faults += [f"missing: {', '.join(missing)}"] if missing else []
        faults += [f"twice: {', '.join(twice)}"] if twice else []
        faults += ["both l and L"] if {"l", "L"} <= {*letters} else []
        faults += ["the payload, D, is not the last"] if letters[-1] != "D" else []
        raise ValueError(f"expected $COLUMNS such as N,O,T,B,I,d,R,L,D ({'; '.join(faults)})")
    return letters


def _parse_written_start(match: re.Match[bytes]) -> int:
    """Return ns since 1970 of `Start time: 24.03.2003 12:52:32.484.5`, or of a date as ISO 8601.

    0 if it is no date, or none that 64-bit nanoseconds hold.
    """
    day, month, year = match.group(1, 2, 3) if match[1] else match.group(6, 5, 4)
    try:
        seconds = datetime(
            int(year), int(month), int(day), int(match[7]), int(match[8]), int(match[9]), tzinfo=UTC
        ) - datetime(1970, 1, 1, tzinfo=UTC)
    except ValueError:
        return 0
    fraction = match[10].replace(b".", b"")[:9].ljust(9, b"0")
    start = (seconds.days * 86_400 + seconds.seconds) * 10**9 + int(fraction)
    return start if abs(start) < _LATEST else 0
