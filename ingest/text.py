"""Lines of text logs, and what readers of them say and parse alike."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from .account import Account
from .content import blocks

LONGEST_LINE = 1 << 16
"""Bytes of a line that are kept; no line of a log that is read so is longer."""
BLOCK = 1 << 20
LARGEST_NUMBER = 1e15
"""Beyond what any unit measures, and far below where its square overflows."""


@dataclass(frozen=True, slots=True)
class Line:
    """A line of a log.

    Attributes:
        number: From 1.
        text: Without blanks at its ends, and without a byte order mark.
        ended: Whether a line end follows; if not, the log may have been cut off within it.
    """

    number: int
    text: bytes
    ended: bool


def lines(path: Path, account: Account) -> Iterator[Line]:
    """Yield all lines of a log, plain or compressed, blank ones too; they end in LF or CR LF.

    Raises:
        InputError: The file is missing or cannot be read.
    """
    number, carry = 0, b""
    for block in blocks(path, account, BLOCK):
        *whole, rest = block.split(b"\n")
        if whole:
            whole[0] = carry + whole[0]
            carry = b""
        for text in whole:
            number += 1
            yield Line(number, _strip(text, number), ended=True)
        carry = (carry + rest)[:LONGEST_LINE]
    if carry:
        yield Line(number + 1, _strip(carry, number + 1), ended=False)


def _strip(text: bytes, number: int) -> bytes:
    return (text.removeprefix(b"\xef\xbb\xbf") if number == 1 else text).strip(b" \t\r")


def time_of(day: str, clock: str, fraction: str = "") -> int | None:
    """Return ns since 1970 of a date `2011-09-26`, a time of day `13:02:25` and up to nine digits of its fraction.

    None where there is no such date or time, or where it does not fit into 64 bits. A second 60 is that which follows.
    """
    try:
        days = date.fromisoformat(day).toordinal() - date(1970, 1, 1).toordinal()
    except ValueError:
        return None
    hour, minute, second = (int(part) for part in clock.split(":"))
    if hour > 23 or minute > 59 or second > 60:
        return None
    time = (days * 86_400 + hour * 3600 + minute * 60 + second) * 1_000_000_000 + int(f"{fraction:0<9}"[:9])
    return time if -(1 << 63) < time < 1 << 63 else None


def number_of(text: bytes) -> float:
    """Return a number written in decimal digits; NaN where that is written.

    Raises:
        ValueError: It is none, or a larger one than `LARGEST_NUMBER`.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.inf
    # Python takes underscores between digits, and infinity.
    if abs(value) > LARGEST_NUMBER or b"_" in text:
        raise ValueError(f"expected a number; found {quote(text)}")
    return value


def quote(text: bytes) -> str:
    """Return the beginning of a piece of a log as it is shown in a reason."""
    shown = text[:80].decode("ascii", "backslashreplace")
    return f"{shown!r}" if len(text) <= 80 else f"{shown!r} and more"
