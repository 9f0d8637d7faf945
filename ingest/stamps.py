"""What a log's own stamps show: where they go back, stand still, or leave time out."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..schemas.errors import InputError
from ..schemas.times import iso_utc

Times = npt.NDArray[np.int64]

GAP = 1_000_000_000
"""ns; no bus and no navigation unit of a car on the road is silent for so long."""
STEP_BACK = 100_000_000
"""ns; loggers write frames of several buses out of order by less, and that is no harm."""
STRETCH = 1 << 15
"""Stamps looked at at once: what is made of them stays in the cache."""
MOST_ALIKE = 250
"""Records; more on one stamp than a bus carries in 10 ms, the coarsest stamps of any logger."""


@dataclass(slots=True)
class Finding:
    """One kind of irregularity.

    Attributes:
        count: How often.
        worst: ns, or records on one stamp.
        at: The stamp before the worst one, ns; None where there is none.
    """

    count: int = 0
    worst: int = 0
    at: int | None = None

    def see(self, count: int, worst: int, at: int) -> None:
        """Add so many; the first of equally bad ones is kept."""
        self.count += count
        if worst > self.worst:
            self.worst, self.at = worst, at


@dataclass(slots=True)
class Stamps:
    """The stamps of a log, looked at batch by batch in the order of the file.

    Attributes:
        start: The earliest, ns; None before the first record.
        stop: The latest, ns.
        backwards: Records stamped before the record that stands before them.
        repeated: Records with the stamp of the record before them; `worst` is the most records on one stamp.
        gaps: Times of more than `GAP` between one record and the next.
    """

    start: int | None = None
    stop: int | None = None
    backwards: Finding = field(default_factory=Finding)
    repeated: Finding = field(default_factory=Finding)
    gaps: Finding = field(default_factory=Finding)
    _last: int = 0
    _alike: int = 0

    def add(self, time: Times) -> None:
        """Look at the next stamps, (n,) ns."""
        for begin in range(0, len(time), STRETCH):
            self._add(time[begin : begin + STRETCH])

    def _add(self, time: Times) -> None:
        first = self.start is None
        if self._goes_on(time):
            self.start, self.stop = int(time[0]) if self.start is None else self.start, int(time[-1])
            self._last, self._alike = int(time[-1]), 1
            return
        self.start = int(time.min()) if self.start is None else min(self.start, int(time.min()))
        self.stop = int(time.max()) if self.stop is None else max(self.stop, int(time.max()))
        before = np.concatenate((time[:1] if first else np.array([self._last], np.int64), time[:-1]))
        steps = time - before
        self._see(self.backwards, -steps, before, steps < 0)
        self._see(self.gaps, steps, before, steps > GAP)
        self._see_repeated(time, steps == 0, first=first)
        self._last = int(time[-1])

    def _goes_on(self, time: Times) -> bool:
        """Tell whether these stamps follow all others, each later than the one before it, without a gap."""
        if self.stop is not None and (self._last < self.stop or not 0 < int(time[0]) - self._last <= GAP):
            return False
        steps = np.diff(time)
        return len(time) == 1 or bool(steps.min() > 0 and steps.max() <= GAP)

    @staticmethod
    def _see(finding: Finding, sizes: Times, before: Times, found: npt.NDArray[np.bool_]) -> None:
        if found.any():
            worst = int(np.argmax(np.where(found, sizes, 0)))
            finding.see(int(np.count_nonzero(found)), int(sizes[worst]), int(before[worst]))

    def _see_repeated(self, time: Times, same: npt.NDArray[np.bool_], *, first: bool) -> None:
        if first:
            same[0] = False
        begins = np.flatnonzero(~same)
        runs = np.diff(np.concatenate(([0], begins, [len(time)])))  # The first one goes on from the batch before.
        runs[0] += self._alike
        longest = int(np.argmax(runs))
        count = int(np.count_nonzero(same))
        if count:
            stamp = time[begins[longest - 1]] if longest else self._last
            self.repeated.see(count, int(runs[longest]), int(stamp))
        self._alike = int(runs[-1])

    def facts(self) -> dict[str, Any]:
        """Return the findings for the manifest and for JSON; times in s, places as ISO 8601."""

        def told(finding: Finding, worst: str, unit: float) -> dict[str, Any]:
            at = None if finding.at is None else iso_utc(finding.at)
            return {"count": finding.count, worst: finding.worst / unit if unit != 1 else finding.worst, "at": at}

        return {
            "backwards": told(self.backwards, "worst_s", 1e9),
            "repeated": told(self.repeated, "most_on_one_stamp", 1),
            "gaps": told(self.gaps, "longest_s", 1e9),
        }

    def problems(self, path: Path) -> list[InputError]:
        """Return what shows that the log's clock was set, or stood still, while it recorded."""
        problems = []
        if self.backwards.worst > STEP_BACK and self.backwards.at is not None:
            reason = (
                f"{_times(self.backwards.count)} a stamp is before that of the record before it, by up to "
                f"{self.backwards.worst / 1e9:.3f} s (after {iso_utc(self.backwards.at)}); the logger's clock was set "
                "back, or two recordings stand in one file: then divide it there"
            )
            problems.append(InputError(path, "stamps", reason))
        if self.repeated.worst > MOST_ALIKE and self.repeated.at is not None:
            reason = (
                f"{self.repeated.worst} records in a row have the stamp {iso_utc(self.repeated.at)}; the logger's "
                "clock stood still or counts too coarsely: export the log with stamps of 1 ms or finer"
            )
            problems.append(InputError(path, "stamps", reason))
        return problems


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
