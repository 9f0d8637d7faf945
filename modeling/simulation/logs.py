"""What the car's bus and the navigation unit record of a drive: the truth with noise, quantisation, gaps and clocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ...ingest.can.database import Database, MessageLayout
from ...ingest.can.encode import byd_checksum, encode_payloads
from ...ingest.can.frames import DATA, ERROR, FrameBatch
from ...ingest.navigation import remove_gravity
from ...ingest.oxts.can_writer import encode_oxts
from .car import Car
from .driver import coloured_noise
from .truth import Origin, geodetic

FloatArray = npt.NDArray[np.float64]
SECOND = 1_000_000_000
MICROSECOND = 1000
GRAVITY = 9.80665  # m/s²

DATABASE, OXTS_DATABASE = "byd_tang", "oxts"
MAPPING = {
    "steering_wheel_angle": "STEER.ANGLE",
    "steering_wheel_speed": "STEER.ANGLE_RATE",
    "speed": "MOTION.Speed",
    "accelerator_pedal": "PEDALS.ACCELERATOR",
    "brake_pressure": "BRAKES.PRESSURE",
    "yaw_rate": "INERTIA.YAW_RATE",
    "longitudinal_acceleration": "INERTIA.LONGITUDINAL_ACCELERATION",
    "lateral_acceleration": "INERTIA.LATERAL_ACCELERATION",
    "gear": "DRIVE_STATE.GEAR",
}
"""Canonical signals and where the shipped database has them."""

MESSAGE_RATES = {
    "STEER": 100,
    "INERTIA": 100,
    "WHEEL_SPEEDS": 50,
    "MOTION": 50,
    "PEDALS": 50,
    "BRAKES": 50,
    "DRIVE_STATE": 20,
}
"""Hz."""

UNKNOWN_RATES = {0x0D5: 20, 0x2B6: 10, 0x496: 2}
"""Hz; identifiers that no database of this car explains, as every real bus has many."""

OXTS_LATENCY = 4_000_000
"""ns from a measurement of the navigation unit to its first message on the bus."""
OXTS_SPACING = 250_000
"""ns between the messages of a cycle, at 500 kbit/s."""

ERROR_ID = 0x088
ERROR_PAYLOAD = np.array([0, 0, 0x02, 0, 0, 0, 0, 0], np.uint8)
"""As SocketCAN has it: a bus error (0x080), a violation of the protocol (0x008) in its form (0x02 in byte 2)."""


@dataclass(frozen=True, slots=True)
class Sensors:
    """Noise of the sensors: standard deviations, unless it says otherwise.

    Attributes:
        jitter: s, no CAN stamp is farther than this from what the logger's clock should say.
        error_interval: s, mean time between error frames on the bus.
        steering_wheel_angle: deg.
        speed: m/s, of vehicle and wheel speeds while the wheels turn.
        yaw_rate: deg/s, of the car's own sensor.
        yaw_rate_bias: deg/s, what the car's own sensor reads when the car does not turn.
        acceleration: m/s², of the car's own sensors.
        brake_pressure: bar.
        position: m, in each of east and north, slowly varying, with a tenth of it as white noise.
        velocity: m/s, in each of north, east and down, of navigation.
        attitude: deg, of heading, pitch and roll of navigation.
        nav_yaw_rate: deg/s, in each axis of navigation's gyroscopes.
        nav_acceleration: m/s², in each axis of navigation's accelerometers.
    """

    jitter: float = 0.0003
    error_interval: float = 60.0
    steering_wheel_angle: float = 0.03
    speed: float = 0.01
    yaw_rate: float = 0.1
    yaw_rate_bias: float = 0.15
    acceleration: float = 0.05
    brake_pressure: float = 0.2
    position: float = 0.015
    velocity: float = 0.006
    attitude: float = 0.04
    nav_yaw_rate: float = 0.03
    nav_acceleration: float = 0.03


@dataclass(frozen=True, slots=True)
class NavigationLog:
    """What the navigation unit measures, in its own axes: north-east-down, and forward-right-down.

    Attributes:
        time: int64 (n,), ns since 1970, UTC.
        latitude: deg (n,), WGS 84.
        longitude: deg (n,).
        altitude: m (n,).
        velocity: m/s (n, 3), north, east, down.
        orientation: rad (n, 3), heading clockwise from north, pitch, roll.
        acceleration: m/s² (n, 3), forward, right, down, gravity included.
        angular_rate: rad/s (n, 3), about forward, right, down.
    """

    time: npt.NDArray[np.int64]
    latitude: FloatArray
    longitude: FloatArray
    altitude: FloatArray
    velocity: FloatArray
    orientation: FloatArray
    acceleration: FloatArray
    angular_rate: FloatArray


@dataclass(frozen=True, slots=True)
class CanClock:
    """The clock of the CAN logger: a stamp is UTC + `offset` + `drift`·1e-6·(UTC − start of the recording) ± jitter.

    Attributes:
        offset: s, CAN stamp − UTC at the start of the recording.
        drift: ppm.
    """

    offset: float = 0.0
    drift: float = 0.0

    def stamp(self, time: npt.NDArray[np.int64], start: int) -> npt.NDArray[np.int64]:
        """Return the stamps in ns (n,), see the class, of UTC times in ns (n,); the recording begins at `start`, ns."""
        gained = np.rint(1e-6 * self.drift * (time - start)).astype(np.int64)
        stamps: npt.NDArray[np.int64] = time + round(self.offset * SECOND) + gained
        return stamps


def outside(time: npt.NDArray[np.int64], start: int, gaps: Sequence[tuple[float, float]]) -> npt.NDArray[np.bool_]:
    """Return which times (n,) in ns are in no gap; gaps are s after `start` and s of duration, half-open."""
    kept = np.ones(len(time), bool)
    for begin, duration in gaps:
        first = start + round(begin * SECOND)
        kept &= (time < first) | (time >= first + round(duration * SECOND))
    return kept


def bus_signals(truth: pa.Table, car: Car, sensors: Sensors) -> dict[str, tuple[npt.NDArray[Any], float]]:
    """Return what the car's control units send: "Message.Signal", values of n samples in its unit, noise.

    Angles in deg with the sensor's offset, rates in deg/s, accelerations in m/s², speeds in km/h, pedals in %, pressure
    in bar, positive to the left and forwards. Integers are states, held between the samples.

    Args:
        truth: The drive, in the schema `TRUTH`, n samples.
        car: Whose ratio, offset and track count.
        sensors: Their noise.
    """
    true = {name: truth[name].to_numpy() for name in truth.column_names}
    kmh = 3.6
    wheels = kmh * car.wheel_speeds(true["speed"], np.radians(true["yaw_rate"]), np.radians(true["road_wheel_angle"]))
    pressure = true["brake_pressure"]
    speed_noise = kmh * sensors.speed
    return {
        "STEER.ANGLE": (true["steering_wheel_angle"] + car.steering_offset, sensors.steering_wheel_angle),
        "STEER.ANGLE_RATE": (true["steering_wheel_speed"], 0.0),
        "INERTIA.YAW_RATE": (true["yaw_rate"] + sensors.yaw_rate_bias, sensors.yaw_rate),
        "INERTIA.LATERAL_ACCELERATION": (true["lateral_acceleration"], sensors.acceleration),
        "INERTIA.LONGITUDINAL_ACCELERATION": (true["longitudinal_acceleration"], sensors.acceleration),
        "WHEEL_SPEEDS.FRONT_LEFT": (wheels[0], speed_noise),
        "WHEEL_SPEEDS.FRONT_RIGHT": (wheels[1], speed_noise),
        "WHEEL_SPEEDS.REAR_LEFT": (wheels[2], speed_noise),
        "WHEEL_SPEEDS.REAR_RIGHT": (wheels[3], speed_noise),
        "MOTION.Speed": (kmh * true["speed"], speed_noise),
        "PEDALS.ACCELERATOR": (true["accelerator_pedal"], 0.0),
        "PEDALS.BRAKE": (np.minimum(pressure, 100.0), 0.0),
        "BRAKES.PRESSURE": (pressure, sensors.brake_pressure),
        "DRIVE_STATE.BRAKE_SWITCH": ((pressure > 1.0).astype(np.int64), 0.0),
        "DRIVE_STATE.GEAR": (true["gear"].astype(np.int64), 0.0),
    }


def can_log(
    generator: np.random.Generator,
    truth: pa.Table,
    car: Car,
    sensors: Sensors,
    clock: CanClock,
    gaps: Sequence[tuple[float, float]],
    database: Database,
) -> FrameBatch:
    """Return the frames that a logger on the car's bus writes, in the order of their stamps.

    Args:
        generator: Source of noise and jitter.
        truth: The drive, in the schema `TRUTH`.
        car: What was driven.
        sensors: Their noise.
        clock: The logger's.
        gaps: (start, duration) in s since the start of the drive: the logger writes nothing.
        database: With the messages of `MESSAGE_RATES`.

    Raises:
        KeyError: A message is not in the database, or a signal of one is not simulated.
    """
    signals = bus_signals(truth, car, sensors)
    sampled = truth["time"].cast(pa.int64()).to_numpy()
    start, stop = int(sampled[0]), int(sampled[-1])
    streams = [
        (time, layout.id, _payloads(generator, layout, signals, sampled, time))
        for name, rate in MESSAGE_RATES.items()
        for layout in [database.by_name[name]]
        for time in [_cycle(generator, start, stop, rate)]
    ]
    for identifier, rate in UNKNOWN_RATES.items():
        time = _cycle(generator, start, stop, rate)
        payload = np.zeros((len(time), 8), np.uint8)
        payload[:, 0] = np.arange(len(time)) % 16
        payload[:, 1:4] = generator.integers(0, 256, 3)
        payload[:, 4] = np.cumsum(generator.integers(-1, 2, len(time))) % 256
        payload[:, 7] = byd_checksum(payload)
        streams.append((time, identifier, payload))
    errors = generator.integers(start, stop, generator.poisson((stop - start) / SECOND / sensors.error_interval))
    streams.append((errors, ERROR_ID, np.tile(ERROR_PAYLOAD, (len(errors), 1))))

    time = np.concatenate([time for time, _, _ in streams])
    jitter = np.rint(generator.uniform(-1, 1, len(time)) * (sensors.jitter * SECOND)).astype(np.int64)
    stamps = (clock.stamp(time, start) + jitter) // MICROSECOND * MICROSECOND
    kept = np.flatnonzero(outside(time, start, gaps))
    order = kept[np.argsort(stamps[kept], kind="stable")]
    counts = [len(time) for time, _, _ in streams]
    kind = np.repeat([DATA] * (len(streams) - 1) + [ERROR], counts)[order].astype(np.uint8)
    return FrameBatch(
        time=stamps[order],
        channel=np.zeros(len(order), np.int16),
        channels=("can0",),
        id=np.repeat([identifier for _, identifier, _ in streams], counts)[order].astype(np.uint32),
        extended=kind == ERROR,
        fd=np.zeros(len(order), bool),
        kind=kind,
        length=np.repeat([payload.shape[1] for _, _, payload in streams], counts)[order].astype(np.uint8),
        data=np.concatenate([np.pad(p, ((0, 0), (0, 8 - p.shape[1]))) for _, _, p in streams])[order],
    )


def _payloads(
    generator: np.random.Generator,
    layout: MessageLayout,
    signals: Mapping[str, tuple[npt.NDArray[Any], float]],
    sampled: npt.NDArray[np.int64],
    time: npt.NDArray[np.int64],
) -> npt.NDArray[np.uint8]:
    """Return a message's payloads (n, length) at times (n,) in ns, from signals sampled at other times."""
    physical: dict[str, npt.NDArray[Any]] = {}
    for signal in layout.signals:
        if signal.name == "CHECKSUM":
            continue
        values, noise = signals[f"{layout.name}.{signal.name}"]
        if values.dtype == np.int64:
            physical[signal.name] = values[np.searchsorted(sampled, time, side="right") - 1]
            continue
        value = np.interp(time - sampled[0], sampled - sampled[0], values)
        # Wheels that stand and pipes without pressure make no noise.
        physical[signal.name] = value + np.where(
            signal.signed | (value > 0), generator.normal(0, noise, len(time)), 0.0
        )
    payload: npt.NDArray[np.uint8] = encode_payloads(layout, physical)
    if layout.signals[-1].name == "CHECKSUM":
        payload[:, 7] = byd_checksum(payload)
    return payload


def oxts_log(
    generator: np.random.Generator,
    measured: NavigationLog,
    sensors: Sensors,
    clock: CanClock,
    start: int,
    database: Database,
) -> FrameBatch:
    """Return the frames that the logger writes of a navigation unit on its second bus, in the order of their stamps.

    Every sample is a cycle of messages: the first comes `OXTS_LATENCY` after it was measured, the others follow at
    `OXTS_SPACING`.

    Args:
        generator: Source of jitter.
        measured: What the unit measures.
        sensors: With the jitter of the stamps.
        clock: The logger's.
        start: Of the recording, ns, UTC.
        database: With the messages of `oxts`.
    """
    heading, pitch, roll = measured.orientation.T
    forward, left = remove_gravity(measured.acceleration, pitch, roll)
    streams = encode_oxts(
        database,
        time=measured.time,
        latitude=measured.latitude,
        longitude=measured.longitude,
        altitude=measured.altitude,
        velocity=measured.velocity,
        orientation=np.column_stack((heading, pitch, roll)),
        level_acceleration=np.column_stack((forward, -left)),
        angular_rate=measured.angular_rate,
    )
    time = np.concatenate(
        [measured.time[rows] + OXTS_LATENCY + k * OXTS_SPACING for k, (_, rows, _) in enumerate(streams)]
    )
    jitter = np.rint(generator.uniform(-1, 1, len(time)) * (sensors.jitter * SECOND)).astype(np.int64)
    stamps = (clock.stamp(time, start) + jitter) // MICROSECOND * MICROSECOND
    order = np.argsort(stamps, kind="stable")
    n = len(order)
    identifiers = np.concatenate([np.full(len(rows), identifier) for identifier, rows, _ in streams])
    lengths = {message.id: message.length for message in database.messages}
    return FrameBatch(
        time=stamps[order],
        channel=np.zeros(n, np.int16),
        channels=("can1",),
        id=identifiers[order].astype(np.uint32),
        extended=np.zeros(n, bool),
        fd=np.zeros(n, bool),
        kind=np.full(n, DATA, np.uint8),
        length=np.array([lengths[identifier] for identifier in identifiers[order].tolist()], np.uint8),
        data=np.concatenate([payload for _, _, payload in streams])[order],
    )


def _cycle(generator: np.random.Generator, start: int, stop: int, rate: int) -> npt.NDArray[np.int64]:
    """Return the times (n,) of a message sent at a rate from some moment of the first period on."""
    period = SECOND // rate
    first = start + int(generator.integers(period))
    return np.arange(first, stop, period, dtype=np.int64)


def navigation_log(
    generator: np.random.Generator,
    truth: pa.Table,
    sensors: Sensors,
    origin: Origin,
    gaps: Sequence[tuple[float, float]],
) -> NavigationLog:
    """Return what the navigation unit measures on a drive.

    East of the origin meridians lean: north is turned by (λ − λ₀) sin φ against the y axis, with longitude λ and
    latitude φ. The course θ has the azimuth α = 90° + that − θ, clockwise from north.

    Args:
        generator: Source of noise.
        truth: The drive, in the schema `TRUTH`.
        sensors: Their noise.
        origin: Of the drive.
        gaps: (start, duration) in s since the start of the drive: no packets.
    """
    true = {name: truth[name].to_numpy() for name in truth.column_names}
    time = truth["time"].cast(pa.int64()).to_numpy()
    n = len(time)

    def noise(deviation: float, memory: float) -> FloatArray:
        return np.stack([coloured_noise(generator, n, deviation, memory) for _ in range(3)], axis=1)

    offset = noise(sensors.position, 30.0) + generator.normal(0, sensors.position / 10, (n, 3))
    latitude, longitude, altitude = geodetic(true["x"] + offset[:, 0], true["y"] + offset[:, 1], origin)
    # North is not where it was at the origin: meridians meet at the pole.
    convergence = (true["longitude"] - origin.longitude) * np.sin(np.radians(true["latitude"]))
    north = 90.0 + convergence
    azimuth = np.radians(north - true["course"])
    velocity = true["speed"][:, None] * np.stack((np.cos(azimuth), np.sin(azimuth), np.zeros(n)), axis=1)
    orientation = noise(sensors.attitude, 5.0)
    orientation[:, 0] += north - true["heading"]
    acceleration = np.stack(
        (true["longitudinal_acceleration"], -true["lateral_acceleration"], np.full(n, -GRAVITY)), axis=1
    )
    angular_rate = np.stack((np.zeros(n), np.zeros(n), -true["yaw_rate"]), axis=1)
    kept = outside(time, int(time[0]), gaps)
    return NavigationLog(
        time=time[kept],
        latitude=latitude[kept],
        longitude=longitude[kept],
        altitude=(altitude + offset[:, 2])[kept],
        velocity=(velocity + noise(sensors.velocity, 0.5))[kept],
        orientation=np.radians(orientation)[kept],
        acceleration=(acceleration + generator.normal(0, sensors.nav_acceleration, (n, 3)))[kept],
        angular_rate=np.radians(angular_rate + generator.normal(0, sensors.nav_yaw_rate, (n, 3)))[kept],
    )
