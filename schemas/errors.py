"""The one exception family for bad input."""

from __future__ import annotations

from pathlib import Path


class InputError(Exception):
    """Something the user gave cannot be used as it is.

    It is raised where nothing can go on, and kept as a value in lists of problems where other work goes on.

    Attributes:
        path: The file or folder concerned.
        where: Line, byte offset, packet, row or config key within it; empty for the file as a whole.
        reason: What was expected, what was found, the likely cause and the next step, in one or more sentences.
    """

    def __init__(self, path: str | Path, where: str, reason: str) -> None:
        super().__init__(str(path), where, reason)
        self.path = str(path)
        self.where = where
        self.reason = reason

    def as_problem(self) -> InputError:
        """Return it as a value to keep, without its traceback, which would keep all that its reader held in memory."""
        return InputError(self.path, self.where, self.reason)

    def __str__(self) -> str:
        return f"{self.path}: {self.where}: {self.reason}" if self.where else f"{self.path}: {self.reason}"
