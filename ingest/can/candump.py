"""Reader of `candump -l` and `candump -L` logs, plain or compressed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from ..account import Account
from ..content import blocks
from .frames import FrameBatch

BATCH = 1 << 18
"""Frames of a batch, at most."""
BLOCK = 1 << 20
"""Bytes of text looked at at once."""

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
        """Yield the frames in the order of the file, up to `BATCH` at a time, and count them in `account`.

        Payloads have 8 columns, or 64 where the batch met a longer one. A last line without line end is a frame if it
        is a whole one (that a cut fell right behind a byte of its payload cannot be known); if it only lacks its rest
        it is rejected and the file is `truncated`. So is a gzip stream that ends early; of a damaged one everything
        before the damage is delivered.

        Raises:
            InputError: The file cannot be read.
        """
        from .candump_lines import CUT, FULL, LONGEST_LINE, LONGEST_NAME, MOST_CHANNELS, WIDE, scan

        names, known = np.zeros((MOST_CHANNELS, 1 + LONGEST_NAME), np.uint8), 0
        rejected = np.empty((1024, 5), np.int64)
        arrays, count, line, carry = _empty_batch(), 0, 1, b""
        for block in self._pieces(account):
            ended = not block
            content = carry + (block or b"\n")
            if block is None and carry.strip():
                account.truncated = True
                account.reject(f"line {line}", f"the file ends within this line; found {_quote(carry.strip())}")
                content = b"\n"
            text, position, why = np.frombuffer(content, np.uint8), 0, FULL
            while why != CUT:
                position, line, count, known, rejections, why = scan(
                    text, position, line, count, *arrays, names, known, rejected
                )
                for number, code, start, stop, reached in rejected[:rejections].tolist():
                    reason = REASONS[code]
                    # Only the last line can be looked at after the end, so what it lacks is what the file lacks.
                    if ended and reached == stop:
                        account.truncated = True
                        reason = f"the file ends within this line: {reason}"
                    account.reject(f"line {number}", f"{reason}; found {_quote(content[start:stop])}")
                if why == WIDE:
                    narrow = arrays[-1]
                    arrays = (*arrays[:-1], np.zeros((BATCH, 64), np.uint8))
                    arrays[-1][:, : narrow.shape[1]] = narrow
                elif count and (why == FULL or (ended and why == CUT)):
                    channels = tuple(
                        row[1 : 1 + row[0]].tobytes().decode("utf-8", "backslashreplace") for row in names[:known]
                    )
                    time, channel, *others = (array[:count] for array in arrays)
                    account.accepted += count
                    yield FrameBatch(time, channel, channels, *others)
                    arrays, count = _empty_batch(), 0
            # Of an overlong line (nothing of candump's is) enough is kept to reject it when its end comes.
            carry = content[position:][:LONGEST_LINE]

    def _pieces(self, account: Account) -> Iterator[bytes | None]:
        """Yield the log's text, then nothing: `b""` at the end of the log, None where it breaks off."""
        whole = yield from blocks(self.path, account, BLOCK)
        yield b"" if whole else None


def _empty_batch() -> tuple[np.ndarray, ...]:
    kinds = (np.int64, np.int16, np.uint32, np.bool_, np.bool_, np.uint8, np.uint8)
    return (*(np.zeros(BATCH, kind) for kind in kinds), np.zeros((BATCH, 8), np.uint8))


def _quote(line: bytes) -> str:
    text = line[:80].decode("ascii", "backslashreplace")
    return f"{text!r}" if len(line) <= 80 else f"{text!r} and more"
