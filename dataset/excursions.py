"""Where a quantity goes beyond a threshold and comes back, never across the end of a run."""

from __future__ import annotations

import numpy as np

from .path import Floats, Runs, begins_run

Rows = list[slice]


def excursions(amount: Floats, run: Runs, enter: float, leave: float, least: int) -> Rows:
    """Return where a quantity is beyond `leave`, and in between for at least so many samples beyond `enter`.

    The two thresholds are a hysteresis: what swings about one of them is one excursion, not many, and it lasts for as
    long as the quantity is large.

    Args:
        amount: (n_samples,); NaN is beyond nothing.
        run: Number of the run of every sample.
        enter: In the unit of the quantity.
        leave: Not above `enter`.
        least: Samples beyond `enter`, together.

    Returns:
        The rows of each excursion, ascending.
    """
    mask = amount > leave
    first = begins_run(run)
    begins = np.flatnonzero(mask & (first | ~np.roll(mask, 1)))
    ends = np.flatnonzero(mask & np.roll(first | ~mask, -1)) + 1
    beyond = np.concatenate(([0], np.cumsum(amount > enter)))
    kept = beyond[ends] - beyond[begins] >= max(least, 1)
    return [slice(a, b) for a, b in zip(begins[kept].tolist(), ends[kept].tolist(), strict=True)]


def risen_threshold(
    amount: Floats, run: Runs, at_least: float, share: float, leave: float, least: int, shortest: int
) -> float:
    """Return the lowest threshold, not below `at_least`, whose excursions hold at most a share of the known samples.

    Args:
        amount: (n_samples,) of all the driving of one driver; NaN where nothing is known.
        run: Number of the run of every sample.
        at_least: In the unit of the quantity.
        share: Of the known samples.
        leave: Share of the threshold at which excursions end.
        least: Samples beyond the threshold that make an excursion.
        shortest: Of fewer known samples than these the share is taken of these.

    Returns:
        The threshold; infinity where none serves, and where nothing is positive.
    """
    beyond: Floats = np.unique(amount[amount > at_least])
    known = int(np.count_nonzero(~np.isnan(amount)))
    allowed = int(share * max(known, shortest))

    def holds(threshold: float) -> bool:
        found = excursions(amount, run, threshold, leave * threshold, least)
        held: int = sum(rows.stop - rows.start for rows in found)
        return held <= allowed

    if holds(at_least):
        return at_least if at_least > 0 else np.inf
    low, high = -1, len(beyond) - 1
    # Beyond the largest amount there is nothing, so the highest place always serves.
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(float(beyond[middle])) else (middle, high)
    return float(beyond[high])
