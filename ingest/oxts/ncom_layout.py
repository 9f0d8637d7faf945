"""The NCOM packet of OxTS: 72 bytes, little-endian (NCOM manual, revision 150615)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

SYNC = 0xE7
LENGTH = 72
INVALID = -(1 << 23)
"""What a 24-bit field holds when the unit does not know it."""

PACKET = np.dtype(
    [
        ("sync", "u1"),
        ("milliseconds", "<u2"),
        ("acceleration", "u1", (3, 3)),
        ("angular_rate", "u1", (3, 3)),
        ("status", "u1"),
        ("checksum1", "u1"),
        ("latitude", "<f8"),
        ("longitude", "<f8"),
        ("altitude", "<f4"),
        ("velocity", "u1", (3, 3)),
        ("orientation", "u1", (3, 3)),
        ("checksum2", "u1"),
        ("channel", "u1"),
        ("batch", "u1", (8,)),
        ("checksum3", "u1"),
    ]
)
"""The packet byte by byte; a 24-bit integer is three bytes."""

ACCELERATION = 10_000
"""Counts per m/s²."""
ANGULAR_RATE = 100_000
"""Counts per rad/s."""
VELOCITY = 10_000
"""Counts per m/s."""
ORIENTATION = 1_000_000
"""Counts per rad."""

RAW_IMU, INITIALISING, LOCKING, LOCKED, STATUS_ONLY = 1, 2, 3, 4, 10
"""The navigation statuses that say something here; every other one is passed over."""

TIME_CHANNEL, POSITION_ACCURACY_CHANNEL, VELOCITY_ACCURACY_CHANNEL = 0, 3, 4
ORIENTATION_ACCURACY_CHANNEL, UTC_CHANNEL = 5, 16
FIRST_VALID_MINUTE = 1000
"""A smaller count of minutes since GPS began means that the unit does not know the time."""
LAST_VALID_MINUTE = 100_000_000
"""In the year 2170; a larger count is damage (and from 2262 on ns since 1970 do not fit into 64 bits)."""
TOO_OLD = 150
"""An age (byte 6 of a status channel) from which on its content is not valid."""

HOLDS_CHANNEL: npt.NDArray[np.bool_] = np.isin(np.arange(256), (RAW_IMU, INITIALISING, LOCKING, LOCKED, STATUS_ONLY))
"""By navigation status (256,): whether such a packet's status channel is to be decoded."""


def to_int24(values: npt.NDArray[np.float64], per_unit: int) -> npt.NDArray[np.uint8]:
    """Return the nearest 24-bit integers (…, 3 bytes) to `values` times `per_unit`; NaN becomes the invalid one.

    Raises:
        ValueError: A value does not fit.
    """
    missing = np.isnan(values)
    counts = np.rint(np.where(missing, 0.0, values) * per_unit)
    if counts.size and np.abs(counts).max() > -INVALID - 1:
        worst = float(values.flat[np.abs(counts).argmax()])
        largest = (-INVALID - 1) / per_unit
        raise ValueError(f"{worst} does not fit into 24 bits of {per_unit} counts a unit; the largest is {largest}")
    counts = np.where(missing, INVALID, counts).astype("<i4")
    return counts[..., None].view(np.uint8)[..., :3]


def checksum(raw: npt.NDArray[np.uint8], stop: int) -> npt.NDArray[np.uint8]:
    """Return for each packet (n, 72) the sum of its bytes from 1 up to `stop`, excluded, modulo 256."""
    total: npt.NDArray[np.uint8] = raw[:, 1:stop].sum(axis=1, dtype=np.uint8)
    return total
