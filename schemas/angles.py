"""Angles on the circle, in degrees."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def wrap_degrees(angle: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return angles in [-180, 180), of the same shape; what is there already comes back bit for bit, NaN stays NaN."""
    angle = np.asarray(angle, np.float64)
    wrapped = angle - 360.0 * np.floor((angle + 180.0) / 360.0)
    inside = (angle >= -180.0) & (angle < 180.0)
    # Within a rounding error of the ends the formula may leave the range.
    beyond = (wrapped < -180.0) | (wrapped >= 180.0)
    return np.where(inside, angle, np.where(beyond, -180.0, wrapped))


def unwrap_degrees(angle: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return angles (n,) without the jumps of the circle: each differs by at most 180 deg from the one before.

    NaN stays NaN; the angles on both sides of it are taken as neighbours.
    """
    unwrapped = np.array(angle, np.float64)
    present = np.isfinite(unwrapped)
    unwrapped[present] = np.unwrap(unwrapped[present], period=360.0)
    return unwrapped
