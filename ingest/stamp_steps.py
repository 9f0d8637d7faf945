"""The steps from each stamp of a log to the next, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

Numbers = npt.NDArray[np.int64]

START, STOP, LAST, ALIKE = range(4)
"""The places of `reach`: the earliest and the latest stamp, the last one, and how many records up to it have it."""
COUNT, WORST, AT = range(3)
"""The columns of `findings`."""
BACKWARDS, REPEATED, GAPS = range(3)
"""The rows of `findings`."""


@njit(cache=True, nogil=True)
def _see(finding: Numbers, size: int, at: int) -> None:
    finding[COUNT] += 1
    if size > finding[WORST]:
        finding[WORST], finding[AT] = size, at


@njit(cache=True, nogil=True)
def see_steps(time: Numbers, longest: int, reach: Numbers, findings: Numbers) -> None:
    """Look at the next stamps of a log.

    Args:
        time: (n,), ns.
        longest: A step beyond it is a gap, ns.
        reach: (4,), of the stamps before these, at least one; brought up to date.
        findings: (3, 3), how often the stamps went back, stayed, and left time out; the worst of each: the step in ns,
            or how many records in a row had one stamp; and the stamp before it. Brought up to date.
    """
    start, stop, last, alike = reach[START], reach[STOP], reach[LAST], reach[ALIKE]
    for stamp in time:
        step = stamp - last
        if step == 0:
            alike += 1
            _see(findings[REPEATED], alike, stamp)
            continue
        if step < 0:
            _see(findings[BACKWARDS], -step, last)
            start = min(start, stamp)
        else:
            if step > longest:
                _see(findings[GAPS], step, last)
            stop = max(stop, stamp)
        last, alike = stamp, 1
    reach[START], reach[STOP], reach[LAST], reach[ALIKE] = start, stop, last, alike
