"""Reader of CRTD logs, as the Open Vehicle Monitoring System (OVMS) writes them, plain or compressed."""

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

REASONS = (
    "",
    "expected a time, a type and an identifier: the line breaks off",
    "expected a time in seconds such as 1524311386.811100",
    "the time is beyond what 64-bit nanoseconds can hold",
    "expected a type: R11, R29, T11 or T29 of a frame, or that of a remark such as CXX, the bus before it or not",
    "expected an identifier of up to 8 hex digits",
    "the identifier is beyond 11 bits (7FF), and the type is R11 or T11",
    "the identifier is beyond 29 bits (1FFFFFFF)",
    "expected bytes of two hex digits as payload",
    "more than 8 bytes on a classic frame",
    "too long for a line of such a log",
)
"""What is said of a rejected line, by the codes of `crtd_lines`."""

_LINE = re.compile(rb"\s*\d+\.\d+[ \t]+\d{0,3}([RT](11|29)[ \t]+[0-9A-Fa-f]+|C[A-Z]{2})(\s|$)")


@dataclass(frozen=True, slots=True)
class Crtd:
    """Lines such as `1524311386.811100 1R11 7EC 03 41 05 7B`.

    They hold seconds since 1970 (UTC), the bus and the type, the identifier and the bytes. R11 and T11 are frames with
    11 bits of identifier, received and sent, R29 and T29 with 29; the direction is not kept. Channels are named by the
    number before the type, `1` where there is none. Lines of the types CXX, CEV, CST, CER and others of C and two
    letters are remarks of the logger, no records. A module whose clock was not set counts its seconds from its start:
    then the stamps count from 1970-01-01.

    The line does not say how many bytes it has: a last line without line end is a frame only if it has all eight.

    Attributes:
        path: The log, plain or compressed.
    """

    format: ClassVar[str] = "crtd"
    kind: ClassVar[str] = "can"

    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether the first line of `head` that is not blank is one of CRTD."""
        return _LINE.match(head) is not None

    def batches(self, account: Account) -> Iterator[FrameBatch]:
        """Yield the frames in the order of the file and count them in `account`.

        Raises:
            InputError: The file cannot be read.
        """
        from .crtd_lines import scan

        yield from read_frames(self.path, account, scan, lambda code, _line: REASONS[code], np.zeros(0, np.int64))
