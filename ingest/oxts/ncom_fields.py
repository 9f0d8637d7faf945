"""The fields of NCOM packets, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from ..motion import DEGREES, set_inertial
from ..words import double_at, single_at, word_at
from .ncom_layout import (
    ACCELERATION,
    ANGULAR_RATE,
    HOLDS_CHANNEL,
    INVALID,
    LENGTH,
    ORIENTATION,
    PACKET,
    POSITION_ACCURACY_CHANNEL,
    TOO_OLD,
    VELOCITY,
)

Values = npt.NDArray[np.float64]


def _place(field: str) -> int:
    return int(PACKET.fields[field][1])  # type: ignore[index]  # it has fields


_VECTORS = np.repeat([_place(name) for name in ("acceleration", "angular_rate", "velocity", "orientation")], 3)
_BEGINS = _VECTORS + np.tile((0, 3, 6), 4)
"""Where each component of each vector begins; below, its counts per unit."""
_PER_UNIT = np.repeat((ACCELERATION, ANGULAR_RATE, VELOCITY, ORIENTATION), 3).astype(np.float64)
_MEASURED = np.array([0, 1, 5, 6, 7, 9, 10, 11])
"""What is made signals of: acceleration forwards and to the right, yaw rate, velocity north and east, heading, pitch
and roll; as `components` counts them."""
_LATITUDE, _LONGITUDE, _ALTITUDE, _BATCH = map(_place, ("latitude", "longitude", "altitude", "batch"))
_STRETCH = 256
"""Packets at a time: they stay in the nearest cache."""


@njit(cache=True, nogil=True, error_model="numpy")
def _set_components(
    octets: npt.NDArray[np.uint8], begin: int, stop: int, wanted: npt.NDArray[np.int64], values: Values, column: int
) -> None:
    """Set `values` from `column` on to these components, see `components`, of the packets from `begin` to `stop`."""
    size = stop - begin
    counts = np.empty(size, np.int32)
    for row in range(len(wanted)):
        place = np.uint64(LENGTH * begin + _BEGINS[wanted[row]])
        for k in range(size):
            counts[k] = np.int32(np.uint32(word_at(octets, place + np.uint64(LENGTH * k))) << np.uint32(8))
        component, per_unit = values[row, column : column + size], _PER_UNIT[wanted[row]]
        for k in range(size):
            count = counts[k] >> np.int32(8)
            component[k] = np.nan if count == INVALID else count / per_unit


@njit(cache=True, nogil=True)
def components(raw: npt.NDArray[np.uint8], wanted: npt.NDArray[np.int64]) -> Values:
    """Return components of the vectors of packets (n, 72).

    Args:
        raw: The packets.
        wanted: (k,) which: 0 to 2 are those of the acceleration, 3 to 5 of the angular rate, 6 to 8 of the velocity, 9
            to 11 of the orientation.

    Returns:
        (k, n) in m/s², rad/s, m/s and rad, NaN where invalid.
    """
    values, octets = np.empty((len(wanted), len(raw))), raw.ravel()
    for begin in range(0, len(raw), _STRETCH):
        _set_components(octets, begin, min(begin + _STRETCH, len(raw)), wanted, values, begin)
    return values


@njit(cache=True, nogil=True)
def held_position_accuracy(
    raw: npt.NDArray[np.uint8], status: npt.NDArray[np.uint8], channel: npt.NDArray[np.uint8], held: float
) -> Values:
    """Return for each packet the horizontal accuracy, m, that status channel 3 told last; `held` before the first.

    Args:
        raw: The packets, (n, 72).
        status: (n,), navigation status.
        channel: (n,), status channel.
        held: m, of the packets before these.
    """
    accuracies = np.empty(len(status))
    begin = 0
    for k in range(len(status)):
        if channel[k] == POSITION_ACCURACY_CHANNEL and HOLDS_CHANNEL[status[k]]:
            accuracies[begin:k] = held
            told, begin = raw[k, _BATCH : _BATCH + 8], k
            north, east = np.int64(told[0]) | np.int64(told[1]) << 8, np.int64(told[2]) | np.int64(told[3]) << 8
            held = 1e-3 * math.sqrt(north * north + east * east) if told[6] < TOO_OLD else math.nan
    accuracies[begin:] = held
    return accuracies


@njit(cache=True, nogil=True)
def _set_positions(octets: npt.NDArray[np.uint8], begin: int, stop: int, values: Values, per_radian: float) -> None:
    """Set the first three rows of `values` to the positions of packets; `per_radian` is 1 for rad."""
    for packet in range(begin, stop):
        place = np.uint64(LENGTH * packet)
        values[0, packet] = per_radian * double_at(octets, place + np.uint64(_LATITUDE))
        values[1, packet] = per_radian * double_at(octets, place + np.uint64(_LONGITUDE))
        values[2, packet] = single_at(octets, place + np.uint64(_ALTITUDE))


@njit(cache=True, nogil=True)
def positions(raw: npt.NDArray[np.uint8]) -> Values:
    """Return latitude, rad, longitude, rad, and altitude, m, of packets (n, 72), as (3, n)."""
    values = np.empty((3, len(raw)))
    _set_positions(raw.ravel(), 0, len(raw), values, 1.0)
    return values


@njit(cache=True, nogil=True)
def navigation(raw: npt.NDArray[np.uint8], valid: npt.NDArray[np.bool_], slowest: float, gravity: float) -> Values:
    """Return what packets (n, 72) tell of position and motion, with Wheelprint's axes and units.

    A stretch of packets at a time, since what lies between them and their signals stays in the nearest cache so.

    Args:
        raw: The packets.
        valid: (n,), whether position, velocity and orientation are.
        slowest: m/s, and
        gravity: m/s²; see `motion.set_inertial`.

    Returns:
        (9, n): latitude and longitude, deg, altitude, m, and the rows of `motion.set_inertial`.
    """
    signals, measured, octets = np.empty((9, len(raw))), np.empty((len(_MEASURED), _STRETCH)), raw.ravel()
    for begin in range(0, len(raw), _STRETCH):
        stop = min(begin + _STRETCH, len(raw))
        _set_components(octets, begin, stop, _MEASURED, measured, 0)
        _set_positions(octets, begin, stop, signals, DEGREES)
        for k in range(begin, stop):
            if not valid[k]:
                signals[:3, k] = measured[3:, k - begin] = np.nan
        set_inertial(measured, slowest, gravity, signals, 3, begin, stop)
    return signals
