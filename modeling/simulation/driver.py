"""Drivers: how far ahead they look, how fast they go, what makes them brake, and the drive that results."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from .car import Car
from .road import KINDS, STEP, Road

RATE = 100  # Hz

FloatArray = npt.NDArray[np.float64]
Emergency = Literal["braking", "swerve"]


@dataclass(frozen=True, slots=True)
class Driver:
    """What tells one driver from another.

    The driver steers by pure pursuit (PP eq. 1) towards the point of the centre line that is h(v) away,
    h(v) = `lookahead_base` + `lookahead_time`·v within the bounds, taking the car for a kinematic bicycle: understeer
    is not compensated, so that the eq. 1 holds for the centre line and a fast curve is driven somewhat wide.

    Attributes:
        name: Also the name of the folder of the driver's recordings.
        lookahead_base: m, h at standstill.
        lookahead_time: s, growth of h with speed.
        lookahead_minimum: m, lower bound of h.
        lookahead_maximum: m, upper bound of h.
        lateral_comfort: m/s², the lateral acceleration that curves are taken with.
        acceleration: m/s², after a stop or a slow stretch.
        deceleration: m/s², before one.
        speed_factor: Share of the speed limit that the driver likes.
        steering_noise: deg at the steering wheel, standard deviation of the driver's slow unsteadiness.
        steering_smoothing: s, time constant with which the hands follow the eye.
    """

    name: str
    lookahead_base: float = 4.5
    lookahead_time: float = 0.7
    lookahead_minimum: float = 4.0
    lookahead_maximum: float = 30.0
    lateral_comfort: float = 2.2
    acceleration: float = 1.5
    deceleration: float = 1.8
    speed_factor: float = 1.0
    steering_noise: float = 0.6
    steering_smoothing: float = 0.1

    def lookahead(self, speed: FloatArray) -> FloatArray:
        """Return h = `lookahead_base` + `lookahead_time` · v, m (n,), within its bounds, for speeds v, m/s (n,)."""
        bounded: FloatArray = np.clip(
            self.lookahead_base + self.lookahead_time * speed, self.lookahead_minimum, self.lookahead_maximum
        )
        return bounded


def coloured_noise(
    generator: np.random.Generator, samples: int, deviation: float, time: float, smoothing: float = 0.0
) -> FloatArray:
    """Return noise (samples,) at `RATE` that forgets itself with a time constant.

    With white noise w of variance 1 it is n_i = a n_i−1 + √(1 − a²) σ w_i, a = exp(−1 / (`RATE` τ)), in the unit of σ.

    Args:
        generator: Source of the noise.
        samples: How many.
        deviation: σ, standard deviation before the smoothing, in any unit.
        time: τ, s, time constant of the memory.
        smoothing: s, time constant of a low-pass over the result.
    """
    from scipy.signal import lfilter

    kept = np.exp(-1 / (RATE * time))
    white = generator.standard_normal(samples)
    white[1:] *= np.sqrt(1 - kept**2)
    noise: FloatArray = deviation * lfilter([1.0], [1.0, -kept], white)
    if smoothing:
        kept = np.exp(-1 / (RATE * smoothing))
        noise = lfilter([1 - kept], [1.0, -kept], noise)
    return noise


@dataclass(frozen=True, slots=True)
class Intentions:
    """What a driver means to do on a road, and what will come in between.

    Attributes:
        speed: m/s (n,), at the samples of the road.
        acceleration: m/s² (n,), that keeps to it.
        stops: m (k,), arc lengths where a red light stops the car.
        standstills: s (k,), how long each lasts.
        emergencies: What happens, in the order of the road.
        hazards: m (j,), arc lengths at which they begin.
        strengths: m/s² (j,), deceleration, or lateral acceleration in the middle of the swerve, positive to the left.
        extents: Share of the speed that is left after braking, or duration of the swerve in s (j,).
    """

    speed: FloatArray
    acceleration: FloatArray
    stops: FloatArray
    standstills: FloatArray
    emergencies: tuple[Emergency, ...]
    hazards: FloatArray
    strengths: FloatArray
    extents: FloatArray


def plan_speed(road: Road, driver: Driver, stops: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the speed (m/s) a driver means to have along a road, and the acceleration (m/s²) that keeps to it.

    The speed is the greatest that respects the driver's share of the limit, the lateral comfort in curves (v² |κ|) and
    the comfortable acceleration and deceleration (d(v²)/ds / 2), and that is zero at the stops.

    Args:
        road: With n samples.
        driver: Whose comfort counts.
        stops: m (k,), arc lengths.

    Returns:
        Two arrays (n,).
    """
    square = np.minimum(
        (road.limit * driver.speed_factor) ** 2,
        driver.lateral_comfort / np.maximum(np.abs(road.curvature), 1e-9),
    )
    square[np.searchsorted(road.s, stops)] = 0.0
    # v² may fall by 2·a per metre and no faster: the lowest of all cones that open backwards, then forwards.
    braking = 2 * driver.deceleration * road.s
    square = np.minimum.accumulate((square + braking)[::-1])[::-1] - braking
    gaining = 2 * driver.acceleration * road.s
    square = np.minimum.accumulate(square - gaining) + gaining
    square = np.maximum(square, 0.0)
    return np.sqrt(square), np.gradient(square, STEP) / 2


def intend(
    generator: np.random.Generator, road: Road, driver: Driver, emergencies: tuple[Emergency, ...], duration: float
) -> Intentions | None:
    """Draw the red lights and the places of the emergencies, and plan the speed.

    Args:
        generator: Source of all choices.
        road: Where.
        driver: Who.
        emergencies: What has to happen, in any order.
        duration: s, of the drive.

    Returns:
        The intentions, or None where the road has no room for the emergencies: they need speed, little curvature, no
        traffic light near by, and 14 s between them.
    """
    red = generator.random(len(road.stop_lines)) < 0.5
    stops = road.stop_lines[red] - 1.0
    standstills = generator.uniform(2, 6, len(stops))
    speed, acceleration = plan_speed(road, driver, stops)
    time = np.cumsum(STEP / np.maximum(speed, 1.0))
    time += np.concatenate(([0.0], np.cumsum(standstills)))[np.searchsorted(stops, road.s)]
    suitable = (time > 12) & (time < duration - 20)
    for stop in stops:
        suitable &= np.abs(road.s - stop) > 40
    chosen: list[tuple[float, Emergency, float, float]] = []
    free = suitable.copy()
    for kind in emergencies:
        if kind == "swerve":
            strength = generator.uniform(7.0, 8.5) * generator.choice([-1.0, 1.0])
            extent = generator.uniform(2.0, 2.4)
            straight = _stays(road.kind == KINDS.index("straight"), 10.0, 75.0)
            candidates = np.flatnonzero(free & straight & (speed > 12) & (speed < 22))
        else:
            strength, extent = generator.uniform(7.0, 9.0), generator.uniform(0.2, 0.5)
            gentle = _stays(np.abs(road.curvature) < 0.003, 10.0, 40.0)
            candidates = np.flatnonzero(free & gentle & (speed > 10))
        if len(candidates) == 0:
            return None
        place = generator.choice(candidates)
        free &= np.abs(time - time[place]) > 14
        chosen.append((float(road.s[place]), kind, strength, extent))
    chosen.sort()
    return Intentions(
        speed=speed,
        acceleration=acceleration,
        stops=stops,
        standstills=standstills,
        emergencies=tuple(kind for _, kind, _, _ in chosen),
        hazards=np.array([s for s, _, _, _ in chosen]),
        strengths=np.array([strength for _, _, strength, _ in chosen]),
        extents=np.array([extent for _, _, _, extent in chosen]),
    )


def _stays(condition: npt.NDArray[np.bool_], behind: float, ahead: float) -> npt.NDArray[np.bool_]:
    """Return where a condition of the road holds from `behind` m before to `ahead` m after."""
    failures = np.concatenate(([0], np.cumsum(~condition)))
    index = np.arange(len(condition))
    first = np.maximum(index - round(behind / STEP), 0)
    last = np.minimum(index + round(ahead / STEP), len(condition))
    kept: npt.NDArray[np.bool_] = failures[last] == failures[first]
    return kept


@dataclass(frozen=True, slots=True)
class Motion:
    """A drive at `RATE` samples a second, the reference point being the middle of the rear axle.

    All arrays are (n,), in SI units and radians, positive to the left; angles are not wrapped. Pursuit angle, lookahead
    and goal point are NaN while the driver does not pursue: at standstill and in a swerve.

    Attributes:
        x: East of where the drive begins.
        y: North of where the drive begins.
        heading: Where the car points, anticlockwise from east.
        course: Where the reference point moves, the heading while it stands.
        speed: Along the course.
        acceleration: Rate of the speed.
        curvature: Of the path: rate of the course over speed, and its limit at standstill.
        yaw_rate: Rate of the heading.
        longitudinal_acceleration: Along the heading.
        lateral_acceleration: Across the heading.
        road_wheel_angle: Of the bicycle's front wheel.
        road_wheel_speed: Rate of the road wheel angle.
        pursuit_angle: Road wheel angle that PP eq. 1 asks for.
        lookahead: The driver's h(v).
        goal_x: East of the goal point on the centre line.
        goal_y: North of the goal point.
        centre_x: East of the nearest point of the centre line.
        centre_y: North of the nearest point.
        arc_length: Of the nearest point.
        emergency: int64, index into the driver's emergencies, -1 for none.
    """

    x: FloatArray
    y: FloatArray
    heading: FloatArray
    course: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    curvature: FloatArray
    yaw_rate: FloatArray
    longitudinal_acceleration: FloatArray
    lateral_acceleration: FloatArray
    road_wheel_angle: FloatArray
    road_wheel_speed: FloatArray
    pursuit_angle: FloatArray
    lookahead: FloatArray
    goal_x: FloatArray
    goal_y: FloatArray
    centre_x: FloatArray
    centre_y: FloatArray
    arc_length: FloatArray
    emergency: npt.NDArray[np.int64]


def drive(
    generator: np.random.Generator, road: Road, car: Car, driver: Driver, intentions: Intentions, duration: float
) -> Motion:
    """Let a driver drive a car along a road: `closed_loop.run`, and what its states mean for the motion.

    At slip β = −`rear_slip` v² κ the path's curvature is κ + dβ/ds; along and across the heading the accelerations are
    v̇ cos β − v² κ_path sin β and v̇ sin β + v² κ_path cos β.

    Args:
        generator: Source of the driver's unsteadiness.
        road: Long enough for the duration.
        car: What is driven.
        driver: Who drives.
        intentions: Of this driver on this road.
        duration: s.

    Returns:
        `duration` × `RATE` samples.
    """
    from ..pure_pursuit import Line
    from .closed_loop import BRAKING, COLUMNS, SWERVING, Chassis, Hazards, Manner, Plan, run

    samples = round(duration * RATE)
    steering_noise = np.radians(driver.steering_noise / car.steering_ratio)
    states, emergency = run(
        Line(road.x, road.y, STEP),
        Plan(intentions.speed, intentions.acceleration, intentions.stops, intentions.standstills),
        Hazards(
            intentions.hazards,
            np.array([SWERVING if kind == "swerve" else BRAKING for kind in intentions.emergencies], np.int64),
            intentions.strengths,
            intentions.extents,
        ),
        Manner(
            driver.lookahead_base,
            driver.lookahead_time,
            driver.lookahead_minimum,
            driver.lookahead_maximum,
            driver.steering_smoothing,
            1.2 * driver.acceleration,
            coloured_noise(generator, samples, steering_noise, 0.8),
            coloured_noise(generator, samples, 0.04, 10.0, 3.0),
        ),
        Chassis(
            car.wheelbase,
            car.understeer_gradient,
            car.rear_slip,
            car.steering_lag,
            np.radians(car.steering_speed / car.steering_ratio),
            car.acceleration,
            car.deceleration,
        ),
        1 / RATE,
    )
    state = dict(zip(COLUMNS, np.ascontiguousarray(states.T), strict=True))
    speed, acceleration, slip = state["speed"], state["acceleration"], state.pop("slip")
    # The wheel turns at a constant rate between samples; at a sample it is the mean of both sides.
    angle_rate = state["road_wheel_speed"]
    angle_rate = (angle_rate + np.concatenate((angle_rate[:1], angle_rate[:-1]))) / 2
    length = car.wheelbase + car.understeer_gradient * speed**2
    angle, curvature = state["road_wheel_angle"], state["curvature"]
    curvature_rate = angle_rate / np.cos(angle) ** 2 / length - curvature * (
        2 * car.understeer_gradient * speed * acceleration / length
    )
    slip_gradient = -car.rear_slip * (2 * acceleration * curvature + speed * curvature_rate)
    path_curvature = curvature + slip_gradient
    across = speed**2 * path_curvature
    return Motion(
        **(state | {"road_wheel_speed": angle_rate, "curvature": path_curvature}),
        course=state["heading"] + slip,
        yaw_rate=speed * curvature,
        longitudinal_acceleration=acceleration * np.cos(slip) - across * np.sin(slip),
        lateral_acceleration=acceleration * np.sin(slip) + across * np.cos(slip),
        emergency=emergency,
    )
