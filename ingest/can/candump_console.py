"""Reader of what candump writes to a terminal, kept in a file, plain or compressed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from ..account import Account
from ..content import head
from .frames import FrameBatch
from .text_log import go_back, read_frames

REASONS = (
    "",
    "expected a time at the start: (1436509052.249713) as of candump -ta, or (2015-07-10 06:17:32.249713) as of -tA",
    "no time: candump was started without one of -ta, -tA, -tz, -td; frames without time cannot be used, record again",
    "the time is beyond the year 2262, the last that 64-bit nanoseconds can hold",
    "expected an interface such as can0 (up to 32 characters) before the identifier",
    "expected B or -, then E or -, behind RX or TX",
    "expected an identifier of 3 hex digits (11 bits) or 8 hex digits (29 bits)",
    "the identifier is beyond 11 bits (7FF); identifiers of 29 bits have 8 digits",
    "the identifier is beyond 29 bits (1FFFFFFF), and not an error frame's (20000000 added)",
    "expected a length: [8], two digits for CAN FD such as [12], or {F} as of candump -8",
    "no CAN FD frame has this many bytes (only 0 to 8, 12, 16, 20, 24, 32, 48, 64)",
    "fewer bytes than the line's own length",
    "expected bytes of 2 hex digits (candump -i and -S write others, which are not read)",
    "expected nothing behind the payload but its characters '…', or ERRORFRAME of an error frame",
    "what follows the length may be cut",
    "longer than 65536 bytes, no line of this format",
    "one channel more than the 256 that a log may have",
)
"""What is said of a rejected line, by the codes of `candump_console_lines`."""

_LINE = re.compile(
    rb"\s*+(?:\((?:\d+|\d{4}-\d\d-\d\d \d\d:\d\d:\d\d)\.\d{1,9}\)[ \t]+)?[^\s(]\S*[ \t]+(?:[RT]X [-B] [-E][ \t]+)?"
    rb"(?:[\dA-F]{3}|[\dA-F]{8})[ \t]+(?:\[\d{1,2}\]|\{[\dA-F]\})(?:\s|$)",
    re.IGNORECASE,
)
_STAMP = re.compile(rb"^[ \t]*\((\d{1,9})\.(\d{1,9})\)", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class CandumpConsole:
    """Lines such as ` (1436509052.249713)  can0  123   [8]  11 22 33 44 55 66 77 88`.

    Stamps of `candump -ta` are UTC. Those of `-tA` are **local time without a zone and taken as UTC**, so that they may
    be off by whole hours. Those of `-tz` (from the first frame) and `-td` (from the frame before) are relative and
    count from 1970-01-01; both look alike, so they are taken as `-td`'s where one in ten goes back (of the first
    64 KiB); from 10⁹ s (2001) on they are never relative. A frame without any stamp is rejected.

    Between interface and identifier may stand direction and flags (`-x`: `RX B E`), behind the payload its characters
    (`-a`: `'.3..'`); neither is kept. Two digits of length are CAN FD, `{F}` a raw length code (`-8`), `remote request`
    a remote frame; identifiers are extended when, and only when, they have 8 digits. Error frames have the bit
    0x20000000 in their identifier and `ERRORFRAME` behind; the indented lines by which `-e` explains them are no
    records.

    Attributes:
        path: The log, plain or compressed.
    """

    format: ClassVar[str] = "candump-console"
    kind: ClassVar[str] = "can"

    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether the first line of `head` that is not blank is one of candump's, with or without a time."""
        return _LINE.match(head) is not None

    def batches(self, account: Account) -> Iterator[FrameBatch]:
        """Yield the frames in the order of the file, up to `text_log.BATCH` at a time; count them in `account`.

        A last line without line end is a frame if it is a whole one, else it is rejected and the file is `truncated`.

        Raises:
            InputError: The file cannot be read.
        """
        from .candump_console_lines import DELTAS, scan

        state = np.zeros(3, np.int64)
        state[DELTAS] = go_back(_STAMP.findall(head(self.path)))
        yield from read_frames(self.path, account, scan, lambda code, _line: REASONS[code], state)
