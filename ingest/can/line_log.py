"""The walk through a text log line by line, common to the readers whose lines are parsed by a compiled `scan`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..account import Account
from ..content import blocks
from .frames import FrameBatch

BATCH = 1 << 18
"""Frames of a batch, at most."""
BLOCK = 1 << 20
"""Bytes of text looked at at once."""
LONGEST_LINE = 1 << 16
"""Bytes; of a longer line, which no logger writes, only its start is kept."""
LONGEST_NAME = 32
MOST_CHANNELS = 256

FINAL = 0
"""Where a `state` says that the line looked at is the last one and has no line end."""

CUT, FULL, LONG, CHANNELS = -1, -2, -3, -4
"""Why a `scan` came back, beside the format's own codes (0 and more): no whole line is left, the batch is full,
the line is too long, or it has one channel too many."""

_REASONS = {
    LONG: f"longer than {LONGEST_LINE} bytes, no line of this format",
    CHANNELS: f"one channel more than the {MOST_CHANNELS} that a log may have",
}
_ENDS = "the file ends within this line"


def frame_batches(
    path: Path,
    account: Account,
    scan: Callable[..., tuple[int, int, int, int, int, int, int]],
    state: npt.NDArray[np.int64],
    judge: Callable[[int, bytes], str],
) -> Iterator[FrameBatch]:
    """Yield the frames of a log in the order of its lines, and count them and what is rejected in `account`.

    A last line without line end is a frame if it is a whole one; if not, it is rejected and the file is `truncated`.

    Args:
        path: The log, plain or compressed.
        account: Of the log.
        scan: Parses lines into the arrays of a batch until one is no frame:
            `scan(text, position, line, count, *arrays, names, known, state)` returns the next position and line, the
            frames and channels there are now, why it came back, and where that line starts and stops in `text`.
        state: What `scan` remembers from line to line; `judge` may change it.
        judge: Tells by `scan`'s code and the line itself why a line is rejected; "" if it is known, but no record.

    Raises:
        InputError: The file cannot be read.
    """
    names, known = np.zeros((MOST_CHANNELS, 1 + LONGEST_NAME), np.uint8), 0
    arrays, count, line, carry = _empty_batch(), 0, 1, b""
    for block in _pieces(path, account):
        state[FINAL] = block == b""
        content = carry + (block or b"\n")
        if block is None:
            if carry.strip():
                account.truncated = True
                account.reject(f"line {line}", f"{_ENDS}; found {_quote(carry.strip())}")
            content = b""
        text, position, code = np.frombuffer(content, np.uint8), 0, FULL
        while code != CUT:
            position, line, count, known, code, start, stop = scan(
                text, position, line, count, *arrays, names, known, state
            )
            if code == FULL or (code == CUT and count and not block):
                account.accepted += count
                yield _batch(arrays, count, names[:known])
                arrays, count = _empty_batch(), 0
            elif code != CUT and (reason := _REASONS.get(code) or judge(code, content[start:stop])):
                if state[FINAL]:
                    account.truncated = True
                    reason = f"{_ENDS}: {reason}"
                account.reject(f"line {line - 1}", f"{reason}; found {_quote(content[start:stop])}")
        carry = content[position:][:LONGEST_LINE]


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


def _empty_batch() -> tuple[np.ndarray, ...]:
    kinds = (np.int64, np.int16, np.uint32, np.bool_, np.bool_, np.uint8, np.uint8)
    return (*(np.zeros(BATCH, kind) for kind in kinds), np.zeros((BATCH, 64), np.uint8))


def _batch(arrays: tuple[np.ndarray, ...], count: int, names: npt.NDArray[np.uint8]) -> FrameBatch:
    channels = tuple(row[1 : 1 + row[0]].tobytes().decode("utf-8", "backslashreplace") for row in names)
    time, channel, identifier, extended, fd, kind, length, data = (array[:count] for array in arrays)
    if length.max(initial=0) <= 8:
        data = data[:, :8].copy()
    return FrameBatch(time, channel, channels, identifier, extended, fd, kind, length, data)


def _quote(line: bytes) -> str:
    text = line[:80].decode("ascii", "backslashreplace")
    return f"{text!r}" if len(line) <= 80 else f"{text!r} and more"
