"""The moving average of MP IV-B and PP IV-B, within runs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..schemas.angles import unwrap_degrees, wrap_degrees
from .path import Floats, Runs, begins_run


def moving_average(values: Floats, run: Runs, window: int) -> Floats:
    """Return the centred moving average of every stretch of values.

    A stretch is what lies between the ends of a run and between NaNs; NaN stays NaN. Towards the end of a stretch
    the window shrinks on both sides alike, so that nothing is shifted in time: the outermost samples are averages of
    one, and constants and straight lines come back as they are.

    Args:
        values: (n_samples,) at equal steps within a run; NaN is missing.
        run: Number of the run of every sample.
        window: Samples averaged, odd.

    Returns:
        (n_samples,).
    """
    reach = np.minimum(_room(values, run), window // 2)
    # Averaging differences to the centre keeps constants bit for bit and positions far from the origin exact.
    excess = np.zeros(len(values))
    for step in range(1, window // 2 + 1):
        wide = np.flatnonzero(reach >= step)
        excess[wide] += (values[wide - step] - values[wide]) + (values[wide + step] - values[wide])
    smoothed: Floats = values + excess / (2 * reach + 1)
    return smoothed


def moving_average_of_angles(angle: Floats, run: Runs, window: int) -> Floats:
    """Return the moving average of angles in deg on the circle, within [-180, 180); else as `moving_average`."""
    return wrap_degrees(moving_average(unwrap_degrees(angle), run, window))


def _room(values: Floats, run: Runs) -> NDArray[np.int64]:
    """Return how many samples of its own stretch every sample has on its shorter side."""
    index = np.arange(len(values))
    missing = np.isnan(values)
    begins = begins_run(run) | missing
    begins[1:] |= missing[:-1]
    ends = np.append(begins[1:], True)
    first = np.maximum.accumulate(np.where(begins, index, 0))
    last = np.minimum.accumulate(np.where(ends, index, len(values))[::-1])[::-1]
    return np.minimum(index - first, last - index)
