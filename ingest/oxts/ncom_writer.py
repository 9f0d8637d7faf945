"""Writer of NCOM logs: what an OxTS unit in a simulated car would record."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from ...schemas.angles import wrap_degrees
from ...schemas.store import publish
from . import ncom_layout as layout
from .leap_seconds import GPS_EPOCH, utc_to_gps

CYCLE = (
    layout.TIME_CHANNEL,
    layout.POSITION_ACCURACY_CHANNEL,
    layout.VELOCITY_ACCURACY_CHANNEL,
    layout.ORIENTATION_ACCURACY_CHANNEL,
    layout.UTC_CHANNEL,
)
"""The status channels that packets carry in turn."""
SATELLITES = 14
RTK_INTEGER = 6
"""Position, velocity and dual-antenna mode."""
VELOCITY_ACCURACY = 0.02
"""m/s"""
ORIENTATION_ACCURACY = 0.001
"""rad"""


def write_ncom(
    path: Path,
    *,
    time: npt.NDArray[np.int64],
    latitude: npt.ArrayLike,
    longitude: npt.ArrayLike,
    altitude: npt.ArrayLike,
    velocity: npt.ArrayLike,
    orientation: npt.ArrayLike,
    acceleration: npt.ArrayLike,
    angular_rate: npt.ArrayLike,
    status: npt.ArrayLike = layout.LOCKED,
    position_accuracy: npt.ArrayLike = 0.02,
    leading: int = 0,
) -> int:
    """Write one packet for each sample, in the order given; NaN is written as invalid where NCOM can say so.

    Everything has the unit's own axes and units; what does not change may be given once. The packets carry status
    channels 0 (minute, satellites, modes), 3, 4, 5 (accuracies) and 16 (UTC - GPS) in turn.

    Args:
        path: The file; it appears when it is whole.
        time: (n,) ns since 1970, UTC; NCOM keeps whole milliseconds, to which it is rounded.
        latitude: (n,) deg, WGS 84.
        longitude: (n,) deg.
        altitude: (n,) m.
        velocity: (n, 3) m/s, north, east, down.
        orientation: (n, 3) rad, heading (clockwise from north), pitch (nose up), roll (right side down).
        acceleration: (n, 3) m/s², forward, right, down, with gravity: a level car at rest has (0, 0, -9.8).
        angular_rate: (n, 3) rad/s about forward, right, down.
        status: (n,) navigation status.
        position_accuracy: (n,) m, horizontal standard deviation √(σ_north² + σ_east²); NaN where not known.
        leading: So many packets come before the first one with the GPS minute.

    Returns:
        The number of packets.

    Raises:
        ValueError: A value does not fit into its field.
    """
    count = len(time)
    # Rounded to the nearest: a stamp that was cut off at its milliseconds would be early by half of one.
    milliseconds = (utc_to_gps(np.asarray(time, np.int64)) + 500_000) // 1_000_000
    packets = np.zeros(count, layout.PACKET)
    packets["sync"] = layout.SYNC
    packets["milliseconds"] = milliseconds % 60_000
    packets["status"] = status
    packets["latitude"] = np.radians(latitude)
    packets["longitude"] = np.radians(longitude)
    packets["altitude"] = altitude
    angles = np.array(np.broadcast_to(np.asarray(orientation, np.float64), (count, 3)))
    angles[:, 0] = np.radians(wrap_degrees(np.degrees(angles[:, 0])))
    for name, values, per_unit in (
        ("acceleration", acceleration, layout.ACCELERATION),
        ("angular_rate", angular_rate, layout.ANGULAR_RATE),
        ("velocity", velocity, layout.VELOCITY),
        ("orientation", angles, layout.ORIENTATION),
    ):
        packets[name] = layout.to_int24(np.asarray(values, np.float64), per_unit)

    turn = np.arange(count) - leading
    packets["channel"] = np.where(
        turn >= 0, np.take(CYCLE, turn % len(CYCLE)), np.take(CYCLE[1:], np.arange(count) % (len(CYCLE) - 1))
    )
    packets["batch"] = _batches(packets["channel"], milliseconds, np.asarray(time, np.int64), position_accuracy)

    raw = packets.view(np.uint8).reshape(count, layout.LENGTH)
    packets["checksum1"] = layout.checksum(raw, 22)
    packets["checksum2"] = layout.checksum(raw, 61)
    packets["checksum3"] = layout.checksum(raw, 71)
    with publish(path) as draft:
        draft.write_bytes(packets.tobytes())
    return count


def _batches(
    channel: npt.NDArray[np.uint8],
    milliseconds: npt.NDArray[np.int64],
    time: npt.NDArray[np.int64],
    position_accuracy: npt.ArrayLike,
) -> npt.NDArray[np.uint8]:
    """Return the eight bytes that each packet's status channel holds."""
    batches = np.zeros((len(channel), 8), np.uint8)
    timing = channel == layout.TIME_CHANNEL
    batches[timing, :4] = (milliseconds[timing] // 60_000).astype("<i4")[:, None].view(np.uint8)
    batches[timing, 4:] = (SATELLITES, RTK_INTEGER, RTK_INTEGER, RTK_INTEGER)

    for code, accuracy, unit in (
        (layout.POSITION_ACCURACY_CHANNEL, np.asarray(position_accuracy, np.float64) / np.sqrt(2), 1e-3),
        (layout.VELOCITY_ACCURACY_CHANNEL, np.float64(VELOCITY_ACCURACY), 1e-3),
        (layout.ORIENTATION_ACCURACY_CHANNEL, np.float64(ORIENTATION_ACCURACY), 1e-5),
    ):
        telling = channel == code
        counts = np.broadcast_to(accuracy / unit, channel.shape)[telling]
        known = np.isfinite(counts)
        octets = np.clip(np.rint(np.where(known, counts, 0.0)), 0, 65_535).astype("<u2").view(np.uint8)
        batches[telling, :6] = np.tile(octets.reshape(-1, 2), 3)
        batches[telling, 6] = np.where(known, 0, 255)

    telling = channel == layout.UTC_CHANNEL
    offset = (time - utc_to_gps(time) - GPS_EPOCH) // 1_000_000_000
    batches[telling, 7] = (offset[telling] << 1 | 1) & 0xFF
    return batches
