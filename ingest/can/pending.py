"""The frames that a binary reader has found and not yet passed on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .frames import FrameBatch

BATCH = 1 << 19
"""Frames of a batch, at most."""


class PendingFrames:
    """The arrays of a batch that is being filled.

    Attributes:
        arrays: time, channel, id, extended, fd, kind, length (`BATCH`,) and data (`BATCH`, 8) or (`BATCH`, 64), as in
            `FrameBatch`; data are zeros from row `count` on.
        count: Rows that are filled.
    """

    def __init__(self) -> None:
        self.arrays = _empty_arrays()
        self.count = 0

    def widen(self) -> None:
        """Make room for payloads of CAN FD."""
        narrow = self.arrays[-1]
        self.arrays = (*self.arrays[:-1], np.zeros((BATCH, 64), np.uint8))
        self.arrays[-1][: self.count, : narrow.shape[1]] = narrow[: self.count]

    def take(self, channels: Sequence[str]) -> FrameBatch:
        """Return the rows that are filled as a batch and begin anew."""
        time, channel, *others = (array[: self.count] for array in self.arrays)
        self.arrays, self.count = _empty_arrays(), 0
        return FrameBatch(time, channel, tuple(channels), *others)


def _empty_arrays() -> tuple[np.ndarray, ...]:
    kinds = (np.int64, np.int16, np.uint32, np.bool_, np.bool_, np.uint8, np.uint8)
    return (*(np.empty(BATCH, kind) for kind in kinds), np.zeros((BATCH, 8), np.uint8))
