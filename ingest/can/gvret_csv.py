"""Reader of the CSV files of SavvyCAN and GVRET loggers, plain or compressed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from ..account import Account
from .frames import FrameBatch
from .text_log import OTHER, read_frames

REASONS = (
    "",
    "expected all columns of the header: the line breaks off",
    "expected a time stamp in whole microseconds such as 166064000",
    "the time stamp is beyond the year 2112",
    "expected an identifier in hex digits such as 0000021A or 0x21A",
    "the identifier is beyond 11 bits (7FF), and Extended says false",
    "the identifier is beyond 29 bits (1FFFFFFF)",
    "expected true or false as Extended",
    "expected a length that a frame can have (0 to 8, 12, 16, 20, 24, 32, 48, 64)",
    "expected bytes of one or two hex digits as payload, without gaps",
    "more bytes than LEN says, and not zeros that only fill the columns",
    "expected the direction Rx or Tx, or nothing",
    "expected the number of the bus, 0 to 255",
    "too long for a line of such a log",
)
"""What is said of a rejected line, by the codes of `csv_lines`."""


@dataclass(frozen=True, slots=True)
class GvretCsv:
    """Lines such as `166064000,0000021A,false,Rx,0,8,FE,36,12,FE,69,05,07,AD,` after a header that names their columns.

    The header's columns may stand in any order before `D1`, `Dir` and `Bus` may be absent; identifiers and bytes may
    be unpadded, identifiers may have 0x, a comma may stand at the end. Of a row with fewer bytes than `LEN` those
    that are there are the payload; zeros beyond `LEN` are not. Frames longer than 8 bytes are CAN FD, others are
    taken as classic: the log does not say. Channels are named by the number of the bus, `0` where there is none.
    The direction is not kept.

    Stamps are µs since 1970 if the logger knew the date (SavvyCAN's option of system time), else since it was
    started: then they count from 1970-01-01. They are of 32 bits in many loggers, signed or not: where such a counter
    passes its end, within a minute, the stamps go on.

    Attributes:
        path: The log, plain or compressed.
    """

    format: ClassVar[str] = "gvret csv"
    kind: ClassVar[str] = "can"

    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether the first line of `head` that is not blank is a header with the columns of these files."""
        names = _column_names(head.removeprefix(b"\xef\xbb\xbf").lstrip().split(b"\n", 1)[0])
        return {"time stamp", "id", "len", "d1"} <= {*names}

    def batches(self, account: Account) -> Iterator[FrameBatch]:
        """Yield the frames in the order of the file and count them in `account`.

        Raises:
            InputError: The file cannot be read, or its header lacks columns.
        """
        from .csv_lines import ABSENT, GVRET_COLUMNS, scan_gvret

        state = np.array([*range(len(GVRET_COLUMNS)), 0, 0, 1])

        def judge(code: int, line: bytes) -> str:
            if code != OTHER:
                return REASONS[code]
            names = _column_names(line.removeprefix(b"\xef\xbb\xbf"))
            if not {"time stamp", "id", "len"} & {*names}:
                return "expected a row that starts with a time stamp, or the header"
            missing = [name for name in GVRET_COLUMNS if name not in names and name not in {"dir", "bus"}]
            if missing:
                raise ValueError(
                    f"the header lacks the columns {', '.join(missing)}; expected one such as "
                    "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8"
                )
            place = [names.index(name) if name in names else ABSENT for name in GVRET_COLUMNS]
            if place[-1] < max(place):
                raise ValueError("the header has columns behind D1 that are not bytes; put them before it")
            state[: len(place)] = place
            return _strange_tail(names[place[-1] :])

        yield from read_frames(self.path, account, scan_gvret, judge, state)


def _strange_tail(names: list[str]) -> str:
    """Return what is wrong with the columns from `D1` on: after a lost line end they go on with the first row."""
    for number, name in enumerate(names, start=1):
        if name != f"d{number}" and any(names[number - 1 :]):
            return f"expected the column D{number}, or the header's end: a row has joined it, or it has other columns"
    return ""


def _column_names(line: bytes) -> list[str]:
    names = (name.strip(' "\t\r').lower() for name in line.decode("ascii", "replace").split(","))
    return ["time stamp" if name == "timestamp" else name for name in names]
