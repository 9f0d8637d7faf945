"""What a log's own stamps show: where they go back, stand still, or leave time out."""

from __future__ import annotations

from dataclasses import dataclass
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
MOST_ALIKE = 250
"""Records; more on one stamp than a bus carries in 10 ms, the coarsest stamps of any logger."""


@dataclass(slots=True)
class Finding:
    """One kind of irregularity.

    Attributes:
        count: How often.
        worst: ns, or records on one stamp.
        at: The stamp before the worst one, ns, the first of equally bad ones; None where there is none.
    """

    count: int = 0
    worst: int = 0
    at: int | None = None


class Stamps:
    """The stamps of a log, looked at batch by batch in the order of the file.

    Attributes:
        start: The earliest, ns; None before the first record.
        stop: The latest, ns.
        backwards: Records stamped before the record that stands before them.
        repeated: Records with the stamp of the record before them; `worst` is the most records on one stamp.
        gaps: Times of more than `GAP` between one record and the next.
    """

    def __init__(self) -> None:
        self.start: int | None = None
        self.stop: int | None = None
        self.backwards, self.repeated, self.gaps = Finding(), Finding(), Finding()
        self._reach = np.zeros(4, np.int64)
        self._findings = np.zeros((3, 3), np.int64)

    def add(self, time: Times) -> None:
        """Look at the next stamps, (n,) ns."""
        from .stamp_steps import START, STOP, see_steps

        if len(time) == 0:
            return
        following = np.ascontiguousarray(time)
        if self.start is None:
            self._reach[:] = time[0], time[0], time[0], 1
            following = following[1:]
        see_steps(following, GAP, self._reach, self._findings)
        self.start, self.stop = int(self._reach[START]), int(self._reach[STOP])
        self.backwards, self.repeated, self.gaps = (
            Finding(count, worst, at if count else None) for count, worst, at in self._findings.tolist()
        )

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
