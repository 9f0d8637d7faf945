"""The 24-bit fields of NCOM packets, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from ..words import word_at
from .ncom_layout import ACCELERATION, ANGULAR_RATE, INVALID, LENGTH, ORIENTATION, VELOCITY

_BEGINS = np.repeat((3, 12, 43, 52), 3) + np.tile((0, 3, 6), 4)
"""Where each component of each vector begins; below, its counts per unit."""
_PER_UNIT = np.repeat((ACCELERATION, ANGULAR_RATE, VELOCITY, ORIENTATION), 3)
_STRETCH = 256
"""Packets at a time: they stay in the nearest cache."""


@njit(cache=True, nogil=True)
def vectors(raw: npt.NDArray[np.uint8]) -> npt.NDArray[np.float64]:
    """Return acceleration, angular rate, velocity and orientation of packets (n, 72).

    Returns:
        (4, 3, n) in m/s², rad/s, m/s and rad, NaN where invalid.
    """
    values, octets = np.empty((12, len(raw)), np.float64), raw.ravel()
    for begin in range(0, len(raw), _STRETCH):
        for field in range(12):
            for packet in range(begin, min(begin + _STRETCH, len(raw))):
                word = word_at(octets, np.uint64(LENGTH * packet + _BEGINS[field]))
                count = np.int64(word << np.uint64(40)) >> np.int64(40)
                values[field, packet] = np.nan if count == INVALID else count / _PER_UNIT[field]
    return values.reshape(4, 3, len(raw))
