"""What an OxTS unit sends on CAN: the inverse of the shipped database `oxts` and its default mapping."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..can.database import Database
from ..can.encode import encode_payloads
from .leap_seconds import GPS_EPOCH, utc_to_gps

Values = npt.NDArray[np.float64]
Stream = tuple[int, npt.NDArray[np.intp], npt.NDArray[np.uint8]]
"""Identifier, numbers of the samples it is sent for, payloads (n, 8)."""

UTC_OFFSET = -18
"""s, UTC - GPS since 2017."""


def encode_oxts(
    database: Database,
    *,
    time: npt.NDArray[np.int64],
    latitude: npt.ArrayLike,
    longitude: npt.ArrayLike,
    altitude: npt.ArrayLike,
    velocity: npt.ArrayLike,
    orientation: npt.ArrayLike,
    level_acceleration: npt.ArrayLike,
    angular_rate: npt.ArrayLike,
    position_accuracy: npt.ArrayLike = 0.02,
    milliseconds: bool = True,
) -> list[Stream]:
    """Encode samples as the messages of an RT3000, in the order in which a cycle sends them.

    Args:
        database: With the messages of `oxts`.
        time: (n,) ns since 1970, UTC.
        latitude: (n,) deg, WGS 84.
        longitude: (n,) deg.
        altitude: (n,) m.
        velocity: (n, 3) m/s, north, east, down.
        orientation: (n, 3) rad, heading (clockwise from north), pitch (nose up), roll (right side down).
        level_acceleration: (n, 2) m/s², forward and right, in level axes.
        angular_rate: (n, 3) rad/s about forward, right, down.
        position_accuracy: (n,) m, horizontal standard deviation √(σ_north² + σ_east²).
        milliseconds: Whether the unit sends `MilliTime` too; all send `DateTime`.

    Returns:
        A stream for each message. The accuracy comes with every fifth sample, as the status channels take turns.
    """
    n = len(time)
    every = np.arange(n)
    gps = utc_to_gps(np.asarray(time, np.int64))
    days, of_day = np.divmod(gps + GPS_EPOCH, 86_400_000_000_000)
    date = days.astype("datetime64[D]")
    month = date.astype("datetime64[M]")
    year = date.astype("datetime64[Y]").astype(np.int64) + 1970
    of_minute = of_day % 60_000_000_000
    north, east, down = np.asarray(velocity, np.float64).T
    heading, pitch, roll = np.degrees(np.asarray(orientation, np.float64)).T
    forward, right = np.asarray(level_acceleration, np.float64).T
    rates = np.degrees(np.asarray(angular_rate, np.float64)).T
    deviation = np.broadcast_to(np.asarray(position_accuracy, np.float64) / np.sqrt(2), (n,))
    messages: dict[str, dict[str, npt.ArrayLike]] = {
        "DateTime": {
            "TimeYear": year % 100,
            "TimeCentury": year // 100 * 100,
            "TimeMonth": month.astype(np.int64) % 12 + 1,
            "TimeDay": (date - month.astype("datetime64[D]")).astype(np.int64) + 1,
            "TimeHour": of_day // 3_600_000_000_000,
            "TimeMinute": of_day // 60_000_000_000 % 60,
            "TimeSecond": of_minute // 1_000_000_000,
            "TimeHSecond": of_minute % 1_000_000_000 // 10_000_000 / 100,
        },
        "MilliTime": {"MilliTime": gps // 1_000_000, "UtcOffset": np.full(n, UTC_OFFSET)},
        "LatitudeLongitude": {"PosLat": latitude, "PosLon": longitude},
        "Altitude": {"Altitude": altitude},
        "Velocity": {"VelNorth": north, "VelEast": east, "VelDown": down, "Speed2D": np.hypot(north, east)},
        "AccelLevel": {"AccelForward": forward, "AccelLateral": right},
        "HeadingPitchRoll": {"AngleHeading": heading % 360, "AnglePitch": pitch, "AngleRoll": roll},
        "RateVehicle": dict(zip(("AngRateX", "AngRateY", "AngRateZ"), rates, strict=True)),
        "StatusPositionAccuracy": {"AccuracyNorth": deviation, "AccuracyEast": deviation},
    }
    if not milliseconds:
        del messages["MilliTime"]
    streams = []
    for name, signals in messages.items():
        layout = database.by_name[name]
        rows = every[::5] if name == "StatusPositionAccuracy" else every
        payload = encode_payloads(layout, {signal: np.asarray(values)[rows] for signal, values in signals.items()})
        streams.append((layout.id, rows, np.pad(payload, ((0, 0), (0, 8 - payload.shape[1])))))
    return streams
