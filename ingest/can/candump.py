"""Reader of `candump -l` and `candump -L` logs, plain or compressed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from ..account import Account
from .frames import FrameBatch
from .text_log import read_frames

_LINE = re.compile(rb"\s*\(\d+\.\d{1,9}\)[ \t]+\S+[ \t]+([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#")

REASONS = (
    "",
    "expected a time such as (1436509052.249713) at the start: seconds, a point, 1 to 9 digits",
    "the time is beyond the year 2262, the last that 64-bit nanoseconds can hold",
    "expected an interface such as can0 (up to 32 characters) between time and identifier",
    "expected an identifier of 3 hex digits (11 bits) or 8 hex digits (29 bits), then #",
    "the identifier is beyond 11 bits (7FF); identifiers of 29 bits have 8 digits",
    "the identifier is beyond 29 bits (1FFFFFFF), and not an error frame's (20000000 added)",
    "odd number of hex digits: half a byte of the payload is lost",
    "expected pairs of hex digits as payload",
    "more than 8 bytes on a classic frame; CAN FD frames have ## and a flags digit",
    "expected one hex digit of flags after ##",
    "no CAN FD frame has this many bytes (only 0 to 8, 12, 16, 20, 24, 32, 48, 64)",
    "expected 0 to 8 as requested length of a remote frame",
    "expected nothing after the payload but the direction R or T",
    "too long for a line of candump",
    "one interface more than the 256 that a log may have",
)
"""What is said of a rejected line, by the codes of `candump_lines`."""


@dataclass(frozen=True, slots=True)
class Candump:
    """A log of lines such as `(1436509052.249713) can0 044#2A366C2BBA`.

    Data frames have up to 8 bytes; CAN FD frames `##`, a flags digit and up to 64 bytes; remote frames `#R` with or
    without a length; error frames the bit 0x20000000 in their identifier. Identifiers are extended when, and only when,
    they have 8 hex digits. A direction (`R`, `T`) may stand at the end; it is not kept, nor are flags and requested
    lengths, for which `FrameBatch` has no place. Blank lines are no records, lines may end in CR LF.

    Attributes:
        path: The log, plain or compressed.
    """

    format: ClassVar[str] = "candump"
    kind: ClassVar[str] = "can"

    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether the first line of `head` that is not blank is one of candump."""
        return _LINE.match(head) is not None

    def batches(self, account: Account) -> Iterator[FrameBatch]:
        """Yield the frames in the order of the file and count them in `account`; see `text_log.read_frames`.

        That a last line without line end was cut right behind a byte of its payload cannot be known: it is a frame.

        Raises:
            InputError: The file cannot be read.
        """
        from .candump_lines import scan

        yield from read_frames(self.path, account, scan, lambda code, _line: REASONS[code], np.zeros(0, np.int64))
