"""How often something comes: its rate, and the gaps in which it does not, told in bounded memory."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ..schemas.times import iso_utc

SECOND = 1_000_000_000
STEPS = 4
"""Classes of lengths in an octave: each is 19 % longer than the one before."""
SHORTEST_GAP = 0.5
"""s; shorter ones are bridged when signals are brought to the grid (`sync.max_gap`)."""
_EDGES = SHORTEST_GAP * SECOND * 2.0 ** (np.arange(-2 * STEPS, 16 * STEPS) / STEPS)
_BRIDGED = 2 * STEPS
_THREEFOLD = 7
"""So many classes are more than a factor of three."""


@dataclass(slots=True)
class Cadence:
    """The times at which something came, in the order of the file.

    A gap is an interval longer than half a second and than three times the usual one (the median, known to a fifth).

    Attributes:
        count: How often it came.
        start: The earliest time, ns; None before the first.
        stop: The latest.
        longest: The longest time between two, ns.
        longest_at: The time before that, ns.
    """

    count: int = 0
    start: int | None = None
    stop: int | None = None
    longest: int = 0
    longest_at: int | None = None
    _last: int | None = None
    _counts: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(_EDGES) + 1, np.int64))
    _sums: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(len(_EDGES) + 1))

    def add(self, time: npt.NDArray[np.int64]) -> None:
        """Add the next times, (n,) ns; where they go back, nothing lies between."""
        if not len(time):
            return
        self.count += len(time)
        self.start = min(int(time.min()), int(time[0]) if self.start is None else self.start)
        self.stop = max(int(time.max()), int(time[0]) if self.stop is None else self.stop)
        before = np.concatenate(([time[0] if self._last is None else self._last], time[:-1]))
        later = time > before
        intervals = time[later] - before[later]
        if len(intervals):
            longest = int(np.argmax(intervals))
            if intervals[longest] > self.longest:
                self.longest, self.longest_at = int(intervals[longest]), int(before[later][longest])
            kinds = np.searchsorted(_EDGES, intervals)
            self._counts += np.bincount(kinds, minlength=len(self._counts))
            self._sums += np.bincount(kinds, intervals, len(self._sums))
        self._last = int(time[-1])

    @property
    def _usual(self) -> slice:
        """The classes that hold no gaps."""
        median = int(np.searchsorted(np.cumsum(self._counts), (self._counts.sum() + 1) // 2))
        return slice(0, max(_BRIDGED, median + _THREEFOLD) + 1)

    @property
    def gaps(self) -> int:
        """How many there are."""
        return int(self._counts.sum() - self._counts[self._usual].sum())

    @property
    def rate(self) -> float | None:
        """Hz outside of gaps; None where there are not two."""
        seconds = float(self._sums[self._usual].sum()) / SECOND
        return float(self._counts[self._usual].sum()) / seconds if seconds else None

    def facts(self) -> dict[str, Any]:
        """Return all this for the manifest and for JSON."""
        rate = self.rate
        return {
            "count": self.count,
            "start": None if self.start is None else iso_utc(self.start),
            "stop": None if self.stop is None else iso_utc(self.stop),
            "rate_hz": None if rate is None else round(rate, 3),
            "gaps": self.gaps,
            "longest_interval_s": self.longest / SECOND,
            "longest_interval_at": None if self.longest_at is None else iso_utc(self.longest_at),
        }
