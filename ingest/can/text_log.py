"""CAN logs of lines: the whole lines in a file's blocks, frames into batches, everything else into the account."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from ...schemas.errors import InputError
from ..account import Account
from ..content import blocks
from .frames import FrameBatch

BLOCK = 1 << 20
"""Bytes of text looked at at once."""
LINES = 1 << 16
"""Lines looked at at once: as many frames can be in a batch."""
LONGEST_LINE = 1 << 16

ACCEPTED, NO_RECORD = 0, -1
"""`Rows.code` of a line that is a frame, and of one that is no record: blank, or a remark."""


class Rows(NamedTuple):
    """What the lines of a piece of text hold, a row for each (n,); frames as in `FrameBatch`.

    Attributes:
        time: int64, ns.
        bus: int16, number of the bus; it becomes the channel's name.
        id: uint32.
        extended: bool.
        fd: bool.
        kind: uint8.
        length: uint8.
        data: uint8 (n, 64).
        code: int16, `ACCEPTED`, `NO_RECORD`, or the index of the reason why the line is no frame.
        start: int64, where the line starts in the text, blanks passed over.
        stop: int64, where it ends, without blanks.
        reached: int64, where parsing a rejected line ended: at `stop` where the line may only lack its rest.
        open: bool, a frame that is known to be whole only if its line has an end.
    """

    time: npt.NDArray[np.int64]
    bus: npt.NDArray[np.int16]
    id: npt.NDArray[np.uint32]
    extended: npt.NDArray[np.bool_]
    fd: npt.NDArray[np.bool_]
    kind: npt.NDArray[np.uint8]
    length: npt.NDArray[np.uint8]
    data: npt.NDArray[np.uint8]
    code: npt.NDArray[np.int16]
    start: npt.NDArray[np.int64]
    stop: npt.NDArray[np.int64]
    reached: npt.NDArray[np.int64]
    open: npt.NDArray[np.bool_]


class Dialect(Protocol):
    """How the lines of one format are read; it lives as long as one file is read."""

    @property
    def reasons(self) -> tuple[str, ...]:
        """What is said of a rejected line, by `Rows.code`."""
        ...

    @property
    def bus(self) -> str | None:
        """Name of the only bus where the log names none; None: the numbers in `Rows.bus` are the names."""
        ...

    def scan(self, text: npt.NDArray[np.uint8], position: int, rows: Rows) -> tuple[int, int, bool]:
        """Fill `rows` from the lines of `text` (whole ones) from `position` on.

        Returns:
            Where it ended (a line starts there, or the text ends), how many rows are filled, and whether it ended
            because the next line is one for `enter`.
        """
        ...

    def enter(self, line: bytes) -> str:
        """Take note of a header line.

        Returns:
            Why it is rejected; empty if it is not.

        Raises:
            ValueError: Nothing after this line can be read; the message says why.
        """
        ...


@dataclass(slots=True)
class _Place:
    """Where in the file the text is: its first line, and whether its last line lacks its end."""

    line: int = 1
    ended: bool = False


def read_frames(path: Path, account: Account, dialect: Dialect) -> Iterator[FrameBatch]:
    """Yield the frames of a log in the order of its lines and count every line that is a record in `account`.

    A last line without line end is a frame if it is sure to be whole; else it is rejected, and the file is
    `truncated`.

    Args:
        path: The log, plain or compressed.
        account: Of the file.
        dialect: A new one: what it learns from the header is the file's.

    Raises:
        InputError: The file cannot be read, or its header says that its lines cannot.
    """
    rows, place = _rows(LINES), _Place()
    for content in _whole_lines(path, account, place):
        text, position = np.frombuffer(content, np.uint8), 0
        while position < len(text):
            position, count, header = dialect.scan(text, position, rows)
            if place.ended and count and position == len(text):
                _judge_last(rows, count - 1, account)
            _account(rows, count, content, dialect, place, account)
            accepted = np.flatnonzero(rows.code[:count] == ACCEPTED)
            if len(accepted):
                account.accepted += len(accepted)
                yield _batch(rows, accepted, dialect.bus)
            place.line += count
            if header:
                end = content.index(b"\n", position)
                _enter(dialect, content[position:end], path, place, account, last=end + 1 == len(content))
                position = end + 1
                place.line += 1


def _rows(n: int) -> Rows:
    return Rows(
        time=np.zeros(n, np.int64),
        bus=np.zeros(n, np.int16),
        id=np.zeros(n, np.uint32),
        extended=np.zeros(n, np.bool_),
        fd=np.zeros(n, np.bool_),
        kind=np.zeros(n, np.uint8),
        length=np.zeros(n, np.uint8),
        data=np.zeros((n, 64), np.uint8),
        code=np.zeros(n, np.int16),
        start=np.zeros(n, np.int64),
        stop=np.zeros(n, np.int64),
        reached=np.zeros(n, np.int64),
        open=np.zeros(n, np.bool_),
    )


def _whole_lines(path: Path, account: Account, place: _Place) -> Iterator[bytes]:
    """Yield the content in pieces that end with a line end; to the last line one is added.

    Lines that are longer than any can be are rejected here, so that not more than one block has to be held.
    """
    carry, skipping = b"", False
    content = blocks(path, account, BLOCK)
    while True:
        try:
            block = next(content)
        except StopIteration as end:
            whole = end.value
            break
        if skipping:
            found = block.find(b"\n")
            if found < 0:
                continue
            block, skipping = block[found + 1 :], False
            place.line += 1
        stop = block.rfind(b"\n") + 1
        if stop:
            yield carry + block[:stop]
            carry = b""
        carry += block[stop:]
        if len(carry) > LONGEST_LINE:
            account.reject(f"line {place.line}", f"too long for a line of such a log; found {quote(carry)}")
            carry, skipping = b"", True
    if whole and carry:
        place.ended = True
        yield carry + b"\n"
    elif carry.strip():
        account.truncated = True
        account.reject(f"line {place.line}", f"the file ends within this line; found {quote(carry.strip())}")


def _judge_last(rows: Rows, last: int, account: Account) -> None:
    """Mark the file as truncated where its last line, which has no line end, is or may be a part only."""
    if rows.code[last] == ACCEPTED and rows.open[last]:
        rows.code[last], rows.reached[last] = 1, rows.stop[last]
    if rows.code[last] > 0 and rows.reached[last] == rows.stop[last]:
        account.truncated = True


def _account(rows: Rows, count: int, content: bytes, dialect: Dialect, place: _Place, account: Account) -> None:
    for row in np.flatnonzero(rows.code[:count] > 0).tolist():
        start, stop = int(rows.start[row]), int(rows.stop[row])
        reason = dialect.reasons[rows.code[row]]
        # Only the last line can be looked at after the end, so what it lacks is what the file lacks.
        if place.ended and stop == rows.reached[row]:
            reason = (
                "the file ends within this line, or behind a byte of it that may not be its last"
                if rows.open[row]
                else f"the file ends within this line: {reason}"
            )
        account.reject(f"line {place.line + row}", f"{reason}; found {quote(content[start:stop])}")


def _enter(dialect: Dialect, line: bytes, path: Path, place: _Place, account: Account, *, last: bool) -> None:
    where, cut = f"line {place.line}", place.ended and last
    try:
        reason = dialect.enter(line.strip())
    except ValueError as error:
        if not cut:
            raise InputError(path, where, f"{error}; found {quote(line.strip())}") from None
        reason = str(error)
    if reason:
        if cut:
            account.truncated = True
            reason = f"the file ends within this line: {reason}"
        account.reject(where, f"{reason}; found {quote(line.strip())}")


def _batch(rows: Rows, accepted: npt.NDArray[np.intp], bus: str | None) -> FrameBatch:
    length = rows.length[accepted]
    numbers, channel = np.unique(rows.bus[accepted], return_inverse=True)
    return FrameBatch(
        time=rows.time[accepted],
        channel=channel.astype(np.int16),
        channels=tuple(str(number) for number in numbers.tolist()) if bus is None else (bus,),
        id=rows.id[accepted],
        extended=rows.extended[accepted],
        fd=rows.fd[accepted],
        kind=rows.kind[accepted],
        length=length,
        data=rows.data[:, : 8 if length.max() <= 8 else 64][accepted],
    )


def quote(line: bytes) -> str:
    """Return a line as a message shows it: its first 80 bytes, what cannot be printed escaped."""
    text = line[:80].decode("ascii", "backslashreplace")
    return f"{text!r}" if len(line) <= 80 else f"{text!r} and more"
