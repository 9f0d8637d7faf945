"""The truth of a simulated drive as a table: what no log says exactly."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ...schemas.angles import wrap_degrees
from ...schemas.tables import TIME, field
from .car import Car
from .driver import RATE, Motion
from .road import KINDS, Road

FloatArray = npt.NDArray[np.float64]


PARK, DRIVE = 1, 4
PERIOD = 1_000_000_000 // RATE  # ns
EARTH_RADIUS = 6.371e6  # m


@dataclass(frozen=True, slots=True)
class Origin:
    """Where the plane of x and y touches the earth: WGS 84 deg, deg and m."""

    latitude: float
    longitude: float
    altitude: float


def _column(name: str, unit: str, description: str, kind: pa.DataType | None = None) -> pa.Field:
    return field(name, kind or pa.float64(), unit, description)


TRUTH = pa.schema(
    [
        _column("time", "", "UTC", TIME),
        _column("x", "m", "east of the origin, in the plane that touches the earth there"),
        _column("y", "m", "north of the origin, in the same plane"),
        _column("latitude", "deg", "WGS 84 latitude of (x, y)"),
        _column("longitude", "deg", "WGS 84 longitude of (x, y)"),
        _column("altitude", "m", "height of (x, y) above the ellipsoid"),
        _column("course", "deg", "direction of travel in the plane, anticlockwise from east"),
        _column("heading", "deg", "where the car points in the plane, anticlockwise from east"),
        _column("speed", "m/s", "of the middle of the rear axle"),
        _column("curvature", "1/m", "of the driven path, positive to the left"),
        _column("yaw_rate", "deg/s", "rate of the heading, positive to the left"),
        _column("longitudinal_acceleration", "m/s²", "along the heading, positive forwards"),
        _column("lateral_acceleration", "m/s²", "across the heading, positive to the left"),
        _column("steering_wheel_angle", "deg", "without the sensor's offset, positive to the left"),
        _column("steering_wheel_speed", "deg/s", "rate of the steering wheel angle"),
        _column("road_wheel_angle", "deg", "steering wheel angle over the steering ratio"),
        _column("pursuit_angle", "deg", "road wheel angle of PP eq. 1; null while the driver does not follow it"),
        _column("lookahead", "m", "distance of the goal point; null while the driver does not follow eq. 1"),
        _column("goal_x", "m", "goal point on the centre line"),
        _column("goal_y", "m", "goal point on the centre line"),
        _column("centre_x", "m", "point of the centre line nearest to the car"),
        _column("centre_y", "m", "point of the centre line nearest to the car"),
        _column("arc_length", "m", "of that point, along the centre line"),
        _column("accelerator_pedal", "%", "accelerator pedal position"),
        _column("brake_pressure", "bar", "brake pressure"),
        _column("gear", "", "1 park, 4 drive", pa.int16()),
        _column("road", "", f"part of the road: {', '.join(KINDS)}", pa.dictionary(pa.int8(), pa.string())),
        _column("emergency", "", "braking or swerving for a hazard", pa.bool_()),
    ]
)
"""One row per 10 ms; metadata `origin`: latitude, longitude, altitude."""


CENTRE_LINE = pa.schema(
    [
        _column("latitude", "deg", "WGS 84 latitude of a point of the centre line"),
        _column("longitude", "deg", "WGS 84 longitude of it"),
    ]
)
"""The road that was driven, every `road.STEP` metres, as `[lookahead] reference` takes it."""

BEYOND = 200.0
"""m of centre line that are written beyond where the drive ends."""


def centre_line_table(motion: Motion, road: Road, origin: Origin) -> pa.Table:
    """Return the centre line of what was driven and of what could be seen from there in the schema `CENTRE_LINE`.

    Args:
        motion: The drive.
        road: Where it went.
        origin: Where the drive begins.
    """
    stop = np.searchsorted(road.s, float(motion.arc_length[-1]) + BEYOND, side="right")
    latitude, longitude, _ = geodetic(road.x[:stop], road.y[:stop], origin)
    return pa.table([latitude, longitude], schema=CENTRE_LINE)


def geodetic(x: FloatArray, y: FloatArray, origin: Origin) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return WGS 84 latitude, longitude (deg) and altitude (m) of a level road (n,) at the origin's altitude.

    It lies (x² + y²) / 2R below the plane, R = `EARTH_RADIUS`.

    Args:
        x: m (n,), east in the plane that touches the earth at the origin.
        y: m (n,), north in that plane.
        origin: Where it touches.
    """
    from pymap3d import enu2geodetic

    drop = (x**2 + y**2) / (2 * EARTH_RADIUS)
    latitude, longitude, altitude = enu2geodetic(x, y, -drop, origin.latitude, origin.longitude, origin.altitude)
    return latitude, longitude, altitude


def truth_table(motion: Motion, road: Road, car: Car, start: int, origin: Origin) -> pa.Table:
    """Return a drive in the schema `TRUTH`.

    Args:
        motion: The drive, n samples.
        road: Where it went.
        car: What was driven.
        start: ns since 1970, UTC, of the first sample.
        origin: Where the drive begins.

    Returns:
        n rows; the pedals are low-passed with a time constant of 0.1 s, see `Car.pedals`.
    """
    from scipy.signal import lfilter

    n = len(motion.x)
    latitude, longitude, altitude = geodetic(motion.x, motion.y, origin)
    # The foot is not faster than a tenth of a second.
    kept = np.exp(-1 / (0.1 * RATE))
    pedal, pressure = (lfilter([1 - kept], [1, -kept], v) for v in car.pedals(motion.speed, motion.acceleration))
    wheel = np.degrees(motion.road_wheel_angle)
    element = np.searchsorted(road.s, motion.arc_length, side="right") - 1
    columns: dict[str, npt.NDArray[Any] | pa.Array] = {
        "time": start + np.arange(n, dtype=np.int64) * PERIOD,
        "x": motion.x,
        "y": motion.y,
        "latitude": latitude,
        "longitude": longitude,
        "altitude": altitude,
        "course": wrap_degrees(np.degrees(motion.course)),
        "heading": wrap_degrees(np.degrees(motion.heading)),
        "speed": motion.speed,
        "curvature": motion.curvature,
        "yaw_rate": np.degrees(motion.yaw_rate),
        "longitudinal_acceleration": motion.longitudinal_acceleration,
        "lateral_acceleration": motion.lateral_acceleration,
        "steering_wheel_angle": car.steering_ratio * wheel,
        "steering_wheel_speed": car.steering_ratio * np.degrees(motion.road_wheel_speed),
        "road_wheel_angle": wheel,
        "pursuit_angle": np.degrees(motion.pursuit_angle),
        "lookahead": motion.lookahead,
        "goal_x": motion.goal_x,
        "goal_y": motion.goal_y,
        "centre_x": motion.centre_x,
        "centre_y": motion.centre_y,
        "arc_length": motion.arc_length,
        "accelerator_pedal": pedal,
        "brake_pressure": pressure,
        # The lever goes from P to D a second after the recording begins.
        "gear": np.where(np.arange(n) < RATE, PARK, DRIVE).astype(np.int16),
        "road": pa.DictionaryArray.from_arrays(road.kind[element].astype(np.int8), pa.array(KINDS)),
        "emergency": motion.emergency >= 0,
    }
    arrays = [
        value if isinstance(value, pa.Array) else pa.array(value, TRUTH.field(name).type, from_pandas=True)
        for name, value in columns.items()
    ]
    metadata = {"origin": json.dumps(asdict(origin))}
    return pa.Table.from_arrays(arrays, schema=TRUTH.with_metadata(metadata))
