"""The 24-bit fields of NCOM packets, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from .ncom_layout import ACCELERATION, ANGULAR_RATE, INVALID, ORIENTATION, VELOCITY

_FIELDS = ((3, ACCELERATION), (12, ANGULAR_RATE), (43, VELOCITY), (52, ORIENTATION))
"""Where each vector begins, and its counts per unit."""


@njit(cache=True, nogil=True)
def vectors(raw: npt.NDArray[np.uint8]) -> npt.NDArray[np.float64]:
    """Return acceleration, angular rate, velocity and orientation of packets (n, 72).

    Returns:
        (4, n, 3) in m/s², rad/s, m/s and rad, NaN where invalid.
    """
    values = np.empty((4, len(raw), 3), np.float64)
    for packet in range(len(raw)):
        octets = raw[packet]
        for field in range(4):
            begin, per_unit = _FIELDS[field]
            for axis in range(3):
                place = begin + 3 * axis
                low, middle = np.int32(octets[place]), np.int32(octets[place + 1])
                count = low | middle << 8 | np.int32(np.int8(octets[place + 2])) << 16
                values[field, packet, axis] = np.nan if count == INVALID else count / per_unit
    return values
