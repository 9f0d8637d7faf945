"""A CSV file that several pages, programs and people change at once, without overwriting each other."""

from __future__ import annotations

import hashlib
import itertools
import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from ...schemas.store import locked
from ..stretches import Stretch

Row = TypeVar("Row", bound=Stretch)


@dataclass(frozen=True, slots=True)
class Change(Generic[Row]):
    """One row before and after; None where there was or is none."""

    number: int
    before: Row | None
    after: Row | None


class Conflict(Exception, Generic[Row]):  # noqa: N818  not an error of anybody
    """The row is no longer what the change was made on; `current` is what it is now, None where it is gone."""

    def __init__(self, number: int, current: Row | None) -> None:
        super().__init__(number, current)
        self.number = number
        self.current = current


class Ledger(Generic[Row]):
    """The rows of a file, each under a number that stays while the process lives, and the changes made to them.

    A change names the row and the version that it was made on. The file is read again before every change, and
    nothing but that one row differs in what is written; so whoever else wrote in the meantime loses nothing. Other
    processes that change files in this way are waited for (`flock` on the folder).

    Args:
        path: The file.
        read: Reads it; no file, no rows.
        write: Publishes rows as a whole new file.
    """

    def __init__(
        self, path: Path, read: Callable[[Path], list[Row]], write: Callable[[Path, Iterable[Row]], None]
    ) -> None:
        self.path = path
        self._read = read
        self._write = write
        self._lock = threading.RLock()
        self._numbers = itertools.count(1)
        self._rows: dict[int, Row] = {}
        self._state = ""
        self._journal: dict[str, Change[Row]] = {}

    def rows(self) -> tuple[str, dict[int, Row]]:
        """Return the state of the file, a hash, and its rows by number in the order of the file.

        A row that somebody else changed keeps its number if it still overlaps with what it was.

        Raises:
            InputError: The file is wrong.
        """
        with self._lock:
            # Were the file replaced between these two lines, the next call would see another state and read it again.
            state = hashlib.sha256(self.path.read_bytes() if self.path.exists() else b"").hexdigest()[:24]
            if state != self._state:
                self._rows = dict(self._numbered(self._read(self.path)))
                self._state = state
            return self._state, dict(self._rows)

    def put(
        self, key: str, number: int | None, version: str | None, edit: Callable[[Row | None], Row | None]
    ) -> Change[Row]:
        """Change one row, add one or remove one, and publish the file.

        Args:
            key: Name of the change. One that was made already is not made again, so that it can be sent again.
            number: Which row; None: a new one.
            version: Of the row that the change was made on.
            edit: Returns the new row for the old one; None stands for no row.

        Raises:
            Conflict: The row is no longer of this version.
            InputError: The file is wrong.
        """
        with self._lock, locked(self.path.parent):
            if key in self._journal:
                return self._journal[key]
            _, rows = self.rows()
            before = None if number is None else rows.get(number)
            if number is None:
                number = next(self._numbers)
            elif before is None or version_of(before) != version:
                raise Conflict(number, before)
            return self._commit(key, Change(number, before, edit(before)))

    def reverse(self, key: str, of: str) -> Change[Row]:
        """Take a change back, also one that took another one back.

        Raises:
            Conflict: The row is no longer what that change made of it.
            KeyError: No change of this name was made here.
            InputError: The file is wrong.
        """
        with self._lock, locked(self.path.parent):
            if key in self._journal:
                return self._journal[key]
            undone = self._journal[of]
            current = self.rows()[1].get(undone.number)
            if current != undone.after:
                raise Conflict(undone.number, current)
            return self._commit(key, Change(undone.number, undone.after, undone.before))

    def _commit(self, key: str, change: Change[Row]) -> Change[Row]:
        rows = {number: row for number, row in self._rows.items() if number != change.number}
        if change.after is not None:
            rows[change.number] = change.after
        self._write(self.path, rows.values())
        self._rows = rows
        self._journal[key] = change
        self.rows()
        return change

    def _numbered(self, rows: list[Row]) -> Iterator[tuple[int, Row]]:
        """Yield the rows with the numbers of equal ones, else of those that they overlap most with, else new ones."""
        left: dict[Row, list[int]] = {}
        for number, row in self._rows.items():
            left.setdefault(row, []).append(number)
        equal = [left[row].pop(0) if left.get(row) else None for row in rows]
        free = {number: row for row, numbers in left.items() for number in numbers}
        for known, row in zip(equal, rows, strict=True):
            if known is not None:
                yield known, row
                continue
            shares = {one: share for one, other in free.items() if (share := _overlap(other, row)) > 0}
            if shares:
                nearest = max(shares, key=lambda one: shares[one])
                del free[nearest]
                yield nearest, row
            else:
                yield next(self._numbers), row


def version_of(row: Stretch) -> str:
    """Return a hash of the row's content."""
    return hashlib.sha256(repr(row).encode()).hexdigest()[:16]


def _overlap(one: Stretch, other: Stretch) -> float:
    """Return the share that both have in common of what either covers."""
    if one.recording != other.recording:
        return 0.0
    common = min(one.stop, other.stop) - max(one.start, other.start)
    return max(0.0, common / (max(one.stop, other.stop) - min(one.start, other.start)))
