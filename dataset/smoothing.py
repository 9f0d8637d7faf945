"""Smoothing within runs: the moving average of MP IV-B and PP IV-B, and its alternatives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..schemas.angles import unwrap_degrees, wrap_degrees
from ..schemas.config import Smoothing
from .path import Floats, Runs, begins_run


def smooth(values: Floats, run: Runs, window: int, manner: Smoothing = "moving average") -> Floats:
    """Return every stretch of values smoothed by itself.

    A stretch is what lies between the ends of a run and between NaNs; NaN stays NaN, and a stretch of any length is
    allowed. Constants come back bit for bit. With the half window r = (window − 1) / 2:

    - `moving average`: the mean of t − r … t + r, as in the papers.
    - `zero-phase`: the value at t of the parabola through t − r … t + r by least squares (Savitzky and Golay). It
      keeps the height of peaks that an average flattens, and takes less of the noise out: compare it at about twice
      the window.
    - `causal`: the mean of t − window + 1 … t. No sample knows what comes after it, but all of them are r samples late.

    Towards the ends of a stretch the first two shrink r on both sides alike, so that nothing is shifted in time: the
    outermost samples stay as they are. `causal` averages what there is since the stretch's begin.

    Args:
        values: (n_samples,) at equal steps within a run; NaN is missing.
        run: Number of the run of every sample.
        window: Samples that one sample is smoothed over, odd unless `causal`.
        manner: See above.

    Returns:
        (n_samples,).
    """
    since, until = _room(values, run)
    is_causal = manner == "causal"
    most = window - 1 if is_causal else window // 2
    reach = np.minimum(since if is_causal else np.minimum(since, until), most)
    weights = _weights(most, manner)
    # Averaging differences to the sample itself keeps constants bit for bit and positions far from the origin exact.
    excess = np.zeros(len(values))
    for step in range(1, most + 1):
        wide = np.flatnonzero(reach >= step)
        own = values[wide]
        difference = values[wide - step] - own
        if not is_causal:
            difference += values[wide + step] - own
        excess[wide] += weights[reach[wide], step] * difference
    smoothed: Floats = values + excess
    return smoothed


def smooth_angles(angle: Floats, run: Runs, window: int, manner: Smoothing = "moving average") -> Floats:
    """Return angles in deg smoothed on the circle, within [-180, 180); else as `smooth`."""
    return wrap_degrees(smooth(unwrap_degrees(angle), run, window, manner))


def _weights(most: int, manner: Smoothing) -> Floats:
    """Return the weight of the neighbour k steps away where r samples are within reach, (`most` + 1, `most` + 1)."""
    r, k = np.ogrid[: most + 1, : most + 1]
    if manner == "causal":
        return np.broadcast_to(1.0 / (r + 1), (most + 1, most + 1))
    if manner == "moving average":
        return np.broadcast_to(1.0 / (2 * r + 1), (most + 1, most + 1))
    parabola: Floats = 3.0 * (3 * r**2 + 3 * r - 1 - 5 * k**2) / ((2 * r - 1) * (2 * r + 1) * (2 * r + 3))
    return parabola


def _room(values: Floats, run: Runs) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return how many samples of its own stretch every sample has before and after it."""
    index = np.arange(len(values))
    missing = np.isnan(values)
    begins = begins_run(run) | missing
    begins[1:] |= missing[:-1]
    ends = np.append(begins[1:], True)
    first = np.maximum.accumulate(np.where(begins, index, 0))
    last = np.minimum.accumulate(np.where(ends, index, len(values))[::-1])[::-1]
    return index - first, last - index
