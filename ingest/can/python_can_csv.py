"""Reader of the CSV files that python-can writes, plain or compressed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from ..account import Account
from .frames import FrameBatch
from .text_log import OTHER, read_frames

HEADER = b"timestamp,arbitration_id,extended,remote,error,dlc,data"

REASONS = (
    "",
    f"expected seven columns, {HEADER.decode()}: the line breaks off",
    "expected a time in seconds such as 1436509052.249713",
    "the time is beyond what 64-bit nanoseconds can hold",
    "expected an identifier in hex digits such as 0x44",
    "the identifier is beyond 11 bits (7FF), and extended is 0",
    "the identifier is beyond 29 bits (1FFFFFFF)",
    "expected 0 or 1 as extended, remote and error",
    "expected 0 to 64 as dlc",
    "expected as many bytes in base64 as dlc says",
    "expected nothing after the payload",
    "more than 8 bytes on a remote or error frame",
    "no CAN FD frame has this many bytes (only 0 to 8, 12, 16, 20, 24, 32, 48, 64)",
    "a frame cannot be remote frame and error frame at once",
    "too long for a line of such a log",
)
"""What is said of a rejected line, by the codes of `csv_lines`."""


@dataclass(frozen=True, slots=True)
class PythonCanCsv:
    """Lines such as `1436509052.249713,0x44,0,0,0,5,KjZsK7o=` after the header that names their columns.

    Stamps are seconds since 1970, UTC, or whatever the interface counted from: python-can does not say. They are read
    by their decimals, also where Python wrote `5e-07`, and rounded to ns. The log names no bus: the channel's name
    is empty. It does not say either which frames are CAN FD: those of more than 8 bytes must be, others are taken
    as classic. Requested lengths of remote frames are not kept.

    Attributes:
        path: The log, plain or compressed.
    """

    format: ClassVar[str] = "python-can csv"
    kind: ClassVar[str] = "can"

    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether the first line of `head` that is not blank is the header."""
        return head.lstrip().split(b"\n", 1)[0].strip() == HEADER

    def batches(self, account: Account) -> Iterator[FrameBatch]:
        """Yield the frames in the order of the file and count them in `account`.

        Raises:
            InputError: The file cannot be read.
        """
        from .csv_lines import scan_python_can

        def judge(code: int, line: bytes) -> str:
            if code != OTHER:
                return REASONS[code]
            return "" if line == HEADER else f"expected a row of numbers, or the header {HEADER.decode()}"

        yield from read_frames(self.path, account, scan_python_can, judge, np.zeros(0, np.int64))
