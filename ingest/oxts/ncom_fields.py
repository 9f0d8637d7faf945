"""The fields of NCOM packets, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from ..motion import DEGREES, inertial
from ..words import word_at
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
def components(raw: npt.NDArray[np.uint8], wanted: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
    """Return components of the vectors of packets (n, 72).

    Args:
        raw: The packets.
        wanted: (k,) which: 0 to 2 are those of the acceleration, 3 to 5 of the angular rate, 6 to 8 of the velocity, 9
            to 11 of the orientation.

    Returns:
        (k, n) in m/s², rad/s, m/s and rad, NaN where invalid.
    """
    values, octets = np.empty((len(wanted), len(raw)), np.float64), raw.ravel()
    counts = np.empty(_STRETCH, np.int32)
    for begin in range(0, len(raw), _STRETCH):
        size = min(_STRETCH, len(raw) - begin)
        for row in range(len(wanted)):
            place = np.uint64(LENGTH * begin + _BEGINS[wanted[row]])
            for k in range(size):
                counts[k] = np.int32(np.uint32(word_at(octets, place + np.uint64(LENGTH * k))) << np.uint32(8))
            column, per_unit = values[row, begin : begin + size], _PER_UNIT[wanted[row]]
            for k in range(size):
                count = counts[k] >> np.int32(8)
                column[k] = np.nan if count == INVALID else count / per_unit
    return values


@njit(cache=True, nogil=True)
def held_position_accuracy(
    raw: npt.NDArray[np.uint8], status: npt.NDArray[np.uint8], channel: npt.NDArray[np.uint8], held: float
) -> npt.NDArray[np.float64]:
    """Return for each packet the horizontal accuracy, m, that status channel 3 told last; `held` before the first.

    Args:
        raw: The packets, (n, 72).
        status: (n,), navigation status.
        channel: (n,), status channel.
        held: m, of the packets before these.
    """
    accuracies = np.empty(len(status))
    for k in range(len(status)):
        if channel[k] == POSITION_ACCURACY_CHANNEL and HOLDS_CHANNEL[status[k]]:
            told = raw[k, _BATCH : _BATCH + 8]
            north, east = np.int64(told[0]) | np.int64(told[1]) << 8, np.int64(told[2]) | np.int64(told[3]) << 8
            held = math.hypot(north * 1e-3, east * 1e-3) if told[6] < TOO_OLD else math.nan
        accuracies[k] = held
    return accuracies


@njit(cache=True, nogil=True)
def positions(
    raw: npt.NDArray[np.uint8],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float32]]:
    """Return latitude, rad, longitude, rad, and altitude, m, of packets (n, 72), (n,) each."""
    latitude, longitude = np.empty(len(raw), np.uint64), np.empty(len(raw), np.uint64)
    altitude, octets = np.empty(len(raw), np.uint32), raw.ravel()
    for packet in range(len(raw)):
        begin = np.uint64(LENGTH * packet)
        latitude[packet] = word_at(octets, begin + np.uint64(_LATITUDE))
        longitude[packet] = word_at(octets, begin + np.uint64(_LONGITUDE))
        altitude[packet] = word_at(octets, begin + np.uint64(_ALTITUDE)) & np.uint64(0xFFFFFFFF)
    return latitude.view(np.float64), longitude.view(np.float64), altitude.view(np.float32)


@njit(cache=True, nogil=True, error_model="numpy")
def navigation(
    raw: npt.NDArray[np.uint8], valid: npt.NDArray[np.bool_], slowest: float, gravity: float
) -> npt.NDArray[np.float64]:
    """Return what packets (n, 72) tell of position and motion, with Wheelprint's axes and units.

    A stretch of packets at a time, since what lies between them and their signals stays in the nearest cache so.

    Args:
        raw: The packets.
        valid: (n,), whether position, velocity and orientation are.
        slowest: m/s, and
        gravity: m/s²; see `motion.inertial`.

    Returns:
        (9, n): latitude and longitude, deg, altitude, m, and the rows of `motion.inertial`.
    """
    signals = np.empty((9, len(raw)))
    for begin in range(0, len(raw), _STRETCH):
        here = slice(begin, begin + _STRETCH)
        measured, place = components(raw[here], _MEASURED), positions(raw[here])
        latitude, longitude, altitude = signals[0, here], signals[1, here], signals[2, here]
        for k in range(len(altitude)):
            latitude[k], longitude[k], altitude[k] = DEGREES * place[0][k], DEGREES * place[1][k], place[2][k]
            if not valid[begin + k]:
                latitude[k] = longitude[k] = altitude[k] = np.nan
                measured[3:, k] = np.nan
        along, across, yaw_rate, north, east, heading, pitch, roll = measured
        signals[3:, here] = inertial((north, east), (heading, pitch, roll), (along, across), yaw_rate, slowest, gravity)
    return signals
