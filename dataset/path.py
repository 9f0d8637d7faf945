"""Quantities of the driven path: course deviation and distance, never across the end of a run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..schemas.angles import wrap_degrees

Floats = NDArray[np.float64]
Runs = NDArray[np.int32] | NDArray[np.int64]


def begins_run(run: Runs) -> NDArray[np.bool_]:
    """Return which samples (n_samples,) are the first of a run; `run` numbers the runs, equal within each."""
    first = np.ones(len(run), dtype=np.bool_)
    first[1:] = run[1:] != run[:-1]
    return first


def course_deviation(course: Floats, run: Runs) -> Floats:
    """Return Δθ_t = θ_t − θ_(t−1) in deg, positive to the left, NaN for the first sample of a run (PP II-B, MP II).

    Args:
        course: Direction of travel (n_samples,), deg.
        run: Number of the run of every sample.

    Returns:
        (n_samples,), within [-180, 180).
    """
    deviation = np.full(len(course), np.nan)
    deviation[1:] = wrap_degrees(np.diff(course))
    deviation[begins_run(run)] = np.nan
    return deviation


def distance(x: Floats, y: Floats, run: Runs) -> float:
    """Return the length in m of the path through the positions `x`, `y` in m, gaps between runs not counted."""
    within = ~begins_run(run)[1:]
    return float(np.nansum(np.hypot(np.diff(x), np.diff(y))[within]))
