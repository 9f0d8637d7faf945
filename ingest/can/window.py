"""A place in the content of a binary log, from which one looks forward as far as is needed."""

from __future__ import annotations

from pathlib import Path

from ..account import Account
from ..content import blocks


class Window:
    """The bytes of a log from a place on; what was passed is forgotten.

    Attributes:
        offset: The place, in bytes from the start of the content.
    """

    def __init__(self, path: Path, account: Account) -> None:
        self.offset = 0
        self._blocks = blocks(path, account)
        self._content = b""
        self._position = 0

    def available(self, size: int) -> int:
        """Return how many bytes can be looked at: at least `size`, fewer only before the end of the content.

        Raises:
            InputError: The file cannot be read.
        """
        length = len(self._content) - self._position
        if length >= size:
            return length
        pieces = [self._content[self._position :]]
        while length < size and (block := next(self._blocks, b"")):
            pieces.append(block)
            length += len(block)
        self._content, self._position = b"".join(pieces), 0
        return length

    def peek(self, size: int) -> bytes:
        """Return the next `size` bytes, fewer only before the end of the content."""
        self.available(size)
        return self._content[self._position : self._position + size]

    def view(self, size: int) -> memoryview:
        """Return what `peek` does, without copying it; it keeps all the window's content in memory."""
        self.available(size)
        return memoryview(self._content)[self._position : self._position + size]

    def skip(self, size: int) -> None:
        """Go forward by `size` bytes, at most as many as are available without reading."""
        size = min(size, len(self._content) - self._position)
        self._position += size
        self.offset += size

    def seek(self, pattern: bytes) -> bool:
        """Go forward to the next place where `pattern` stands, or to the end; tell whether it was found."""
        while self.available(len(pattern)) >= len(pattern):
            place = self._content.find(pattern, self._position)
            if place >= 0:
                self.skip(place - self._position)
                return True
            self.skip(len(self._content) - self._position - len(pattern) + 1)
            if self.available(len(pattern)) < len(pattern):
                break
        self.skip(len(self._content))
        return False
