"""CAN logs of lines: the walk through a file, frames into batches, everything else into the account."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...schemas.errors import InputError
from ..account import Account
from ..content import blocks
from ..text import LONGEST_LINE, quote
from .frames import FrameBatch

BATCH = 1 << 19
"""Frames of a batch, at most."""
BLOCK = 1 << 18
"""Bytes of text looked at at once."""
LONGEST_NAME = 32
MOST_CHANNELS = 256

FRAME, NO_RECORD, OPEN, OTHER = 0, -1, -2, -3
"""What a line is, beside the format's own codes (1 and more) of why it is none: a frame; no record; a frame only if its
line has an end, which it lacks; a line for the format's `judge`, a header as a rule."""

FRAMES, CHANNELS, LINES, LONGEST = range(4)
"""The places of `Found.counts`: frames, names of channels, lines that are no frames, bytes of the longest payload."""

_SET_ASIDE = 1024
_ENDS = "the file ends within this line"

Scan = Callable[[npt.NDArray[np.uint8], npt.NDArray[np.int64], int, bool, "Found", npt.NDArray[np.int64]], int]
Judge = Callable[[int, bytes], str]


class Found(NamedTuple):
    """What the lines of a log hold, as far as it has not been passed on; see `text_fields` for how it is filled.

    Attributes:
        time: (`BATCH`,), this and the following ones as in `FrameBatch`.
        channel: (`BATCH`,), rows of `names`.
        id: (`BATCH`,).
        extended: (`BATCH`,).
        fd: (`BATCH`,).
        kind: (`BATCH`,).
        length: (`BATCH`,).
        data: uint64 (`BATCH`,), the first 8 bytes of the payloads.
        long_data: uint64 (`BATCH`, 8), payloads that are longer, 64 bytes. It takes memory only where there are some.
        names: (`MOST_CHANNELS`, 1 + `LONGEST_NAME`), a row is the length of a channel's name and its bytes.
        lines: int64 (n, 5), those that are no frames: number (0 is the first of the text), code, where the line starts
            and stops in the text without blanks, and where parsing ended: at the stop where it may only lack its rest.
        counts: int64 (4,), see `FRAMES`.
    """

    time: npt.NDArray[np.int64]
    channel: npt.NDArray[np.int16]
    id: npt.NDArray[np.uint32]
    extended: npt.NDArray[np.bool_]
    fd: npt.NDArray[np.bool_]
    kind: npt.NDArray[np.uint8]
    length: npt.NDArray[np.uint8]
    data: npt.NDArray[np.uint64]
    long_data: npt.NDArray[np.uint64]
    names: npt.NDArray[np.uint8]
    lines: npt.NDArray[np.int64]
    counts: npt.NDArray[np.int64]


def read_frames(
    path: Path, account: Account, scan: Scan, judge: Judge, state: npt.NDArray[np.int64]
) -> Iterator[FrameBatch]:
    """Yield the frames of a log in the order of its lines, up to `BATCH` at a time, and count all records in `account`.

    Payloads have 8 columns, or 64 where the batch met a longer one. A last line without line end is a frame if it is
    sure to be a whole one; if it only lacks its rest it is rejected and the file is `truncated`. So is a compressed
    file that ends early; of a damaged one everything before the damage is delivered.

    Args:
        path: The log, plain or compressed.
        account: Of the log.
        scan: The format's lines, compiled: `scan(text, ends, number, final, found, state)` parses whole lines from
            `number` on into `found` until it is full or after a line that may change the `state`; returns the next
            number. `ends` are the places of the line ends; `final` says that the (only) line's own is not in the file.
        judge: Tells by code and line why it is rejected, "" if it is no record. It raises ValueError with a reason if
            nothing after this line can be read, and may change the `state`.
        state: What the lines so far tell about those that follow.

    Raises:
        InputError: The file cannot be read, or its header says that its lines cannot.
    """
    from .text_words import line_ends

    found, first, carry = _nothing_found(), 1, b""
    for block in _pieces(path, account):
        if block is None:
            if carry.strip():
                account.truncated = True
                account.reject(f"line {first}", f"{_ENDS}; found {quote(carry.strip())}")
            break
        content, final = carry + (block or b"\n"), not block
        text = np.frombuffer(content, np.uint8)
        ends, number = line_ends(text), 0
        while number < len(ends):
            number = scan(text, ends, number, final, found, state)
            for line, code, start, stop, reached in found.lines[: found.counts[LINES]].tolist():
                where, cut = f"line {first + line}", final and reached == stop
                reason = _reason(path, where, judge, code, content[start:stop], cut)
                if reason:
                    account.truncated |= cut
                    account.reject(where, reason)
            found.counts[LINES] = 0
            if found.counts[FRAMES] == BATCH:
                yield _take(found, account)
                found = _nothing_found(found)
        # Of a line that is too long enough is kept to reject it when its end comes.
        carry = content[ends[-1] + 1 if len(ends) else 0 :][:LONGEST_LINE]
        first += len(ends)
    if found.counts[FRAMES]:
        yield _take(found, account)


def go_back(seconds: list[tuple[bytes, bytes]]) -> bool:
    """Tell whether stamps go back so often (at one step in ten) that each must count from the one before it.

    Args:
        seconds: The stamps in the order of the file: digits before and behind the point.
    """
    stamps = np.array([int(whole) * 10**9 + int(fraction.ljust(9, b"0")) for whole, fraction in seconds], np.int64)
    return len(stamps) > 1 and bool(np.mean(np.diff(stamps) < 0) > 0.1)


def _pieces(path: Path, account: Account) -> Iterator[bytes | None]:
    """Yield the log's text, then nothing: `b""` at the end of the log, None where it breaks off."""
    whole = yield from blocks(path, account, BLOCK)
    yield b"" if whole else None


def _nothing_found(before: Found | None = None) -> Found:
    """Return an empty `Found`, which goes on with the channels of the one `before`."""
    names = np.zeros((MOST_CHANNELS, 1 + LONGEST_NAME), np.uint8) if before is None else before.names
    counts = np.zeros(4, np.int64) if before is None else before.counts
    counts[[FRAMES, LONGEST]] = 0
    return Found(
        time=np.empty(BATCH, np.int64),
        channel=np.empty(BATCH, np.int16),
        id=np.empty(BATCH, np.uint32),
        extended=np.empty(BATCH, np.bool_),
        fd=np.zeros(BATCH, np.bool_),
        kind=np.zeros(BATCH, np.uint8),
        length=np.empty(BATCH, np.uint8),
        data=np.empty(BATCH, np.uint64),
        long_data=np.zeros((BATCH, 8), np.uint64),
        names=names,
        lines=np.empty((_SET_ASIDE, 5), np.int64),
        counts=counts,
    )


def _reason(path: Path, where: str, judge: Judge, code: int, line: bytes, cut: bool) -> str:
    """Return why a line is rejected, with the line itself; "" if it is not.

    Only the last line can be looked at after the end, so what it lacks is what the file lacks.
    """
    if code == OPEN:
        return f"{_ENDS}, or behind a byte of it that may not be its last; found {quote(line)}"
    try:
        reason = judge(code, line)
    except ValueError as error:
        reason = str(error)
        if not cut:
            raise InputError(path, where, f"{reason}; found {quote(line)}") from None
    return reason and f"{_ENDS}: " * cut + f"{reason}; found {quote(line)}"


def _take(found: Found, account: Account) -> FrameBatch:
    """Return the frames that were found as a batch."""
    count = int(found.counts[FRAMES])
    account.accepted += count
    data = found.data[:count, None]
    if found.counts[LONGEST] > 8:
        found.long_data[:count, 0] = found.data[:count]
        data = found.long_data[:count]
    names = found.names[: found.counts[CHANNELS]]
    return FrameBatch(
        time=found.time[:count],
        channel=found.channel[:count],
        channels=tuple(row[1 : 1 + row[0]].tobytes().decode("utf-8", "backslashreplace") for row in names),
        id=found.id[:count],
        extended=found.extended[:count],
        fd=found.fd[:count],
        kind=found.kind[:count],
        length=found.length[:count],
        data=data.view(np.uint8),
    )
