"""Driver, car and road in one loop at a fixed rate, compiled: imported only where a drive is simulated."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]

COMFORT_JERK = 4.0  # m/s³
EMERGENCY_JERK = 60.0  # m/s³
FREE, BRAKING, RELEASING, SWERVING, RECOVERING = 0, 1, 2, 3, 4
RECOVERY = 1.0  # s, after a swerve
COLUMNS = (
    "x", "y", "heading", "slip", "speed", "acceleration", "curvature", "road_wheel_angle", "road_wheel_speed",
    "pursuit_angle", "lookahead", "goal_x", "goal_y", "centre_x", "centre_y", "arc_length",
)  # fmt: skip


class Line(NamedTuple):
    """Centre line, equally spaced: m (n,), and the spacing."""

    x: FloatArray
    y: FloatArray
    step: float


class Plan(NamedTuple):
    """What the driver means to do along the centre line.

    Attributes:
        speed: m/s (n,), at the samples of the line.
        acceleration: m/s² (n,), that keeps to it.
        stop: m (k,), arc lengths of the stops.
        standstill: s (k,), how long the car stands there.
    """

    speed: FloatArray
    acceleration: FloatArray
    stop: FloatArray
    standstill: FloatArray


class Hazards(NamedTuple):
    """What makes the driver brake or swerve, in the order of the road.

    Attributes:
        s: m (k,), where.
        kind: int64 (k,), `BRAKING` or `SWERVING`.
        strength: m/s² (k,), deceleration, or lateral acceleration of the swerve's middle (positive to the left).
        extent: (k,), share of the speed that is left after braking, or duration of the swerve in s.
    """

    s: FloatArray
    kind: npt.NDArray[np.int64]
    strength: FloatArray
    extent: FloatArray


class Manner(NamedTuple):
    """How the driver steers and presses the pedals: see `Driver`.

    Attributes:
        lookahead_base: m.
        lookahead_time: s.
        lookahead_minimum: m.
        lookahead_maximum: m.
        smoothing: s.
        acceleration: m/s², the most the driver asks for.
        noise: rad (n_samples,), of the angle of the road wheels.
        speed_noise: (n_samples,), share by which the speed is missed.
    """

    lookahead_base: float
    lookahead_time: float
    lookahead_minimum: float
    lookahead_maximum: float
    smoothing: float
    acceleration: float
    noise: FloatArray
    speed_noise: FloatArray


class Chassis(NamedTuple):
    """How the car answers: see `Car`; `steering_speed` is rad/s at the road wheels."""

    wheelbase: float
    understeer_gradient: float
    rear_slip: float
    steering_lag: float
    steering_speed: float
    acceleration: float
    deceleration: float


@njit(cache=True)
def swerve_shape(share: float) -> float:
    """Return the lateral acceleration of a swerve at a share of its duration, 1 in its middle.

    It is the second derivative of u⁴(1 - u)⁴: away, back and straight again, so that neither the heading nor the
    lateral position differs in the end.
    """
    u = share
    return -32 * u**2 * (1 - u) ** 2 * (3 - 14 * u + 14 * u**2)


@njit(cache=True)
def goal_point(x: float, y: float, distance: float, line: Line, first: int) -> tuple[float, float]:
    """Return the first point of the line at or behind sample `first` that is `distance` away from (x, y)."""
    i = first
    last = len(line.x) - 1
    while i < last and math.hypot(line.x[i] - x, line.y[i] - y) < distance:
        i += 1
    if i == first:
        return line.x[i], line.y[i]
    from_x, from_y = line.x[i - 1] - x, line.y[i - 1] - y
    along_x, along_y = line.x[i] - line.x[i - 1], line.y[i] - line.y[i - 1]
    square = along_x**2 + along_y**2
    half = from_x * along_x + from_y * along_y
    root = math.sqrt(max(half**2 - square * (from_x**2 + from_y**2 - distance**2), 0.0))
    share = min(max((root - half) / square, 0.0), 1.0)
    return x + from_x + share * along_x, y + from_y + share * along_y


@njit(cache=True)
def run(
    line: Line, plan: Plan, hazards: Hazards, manner: Manner, chassis: Chassis, period: float
) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Drive for as long as there is noise.

    The car begins at rest at the beginning of the centre line and stands for three seconds. Every row is the state at
    one instant and what the driver makes of it; the next one follows from it by one step of `period` seconds with
    trapezoidal integration.

    Returns:
        (n_samples, n_columns) as `COLUMNS` names them, in SI units and radians, where pursuit angle, lookahead and
        goal are NaN while the driver does not pursue: at standstill and in a swerve; and (n_samples,) the index of the
        hazard that the driver reacts to, -1 for none.
    """
    n = len(manner.noise)
    last = len(line.x) - 1
    states = np.empty((n, len(COLUMNS)))
    reactions = np.full(n, -1)
    foot = 0
    x, y = line.x[0], line.y[0]
    heading = math.atan2(line.y[1] - y, line.x[1] - x)
    speed = acceleration = angle = smoothed = 0.0
    curvature = slip = 0.0
    standing = 3.0
    next_stop = next_hazard = 0
    departed = -1.0
    mode, reaction, elapsed, released_at = FREE, -1, 0.0, 0.0
    for k in range(n):
        # Where the car is along the centre line.
        while True:
            along_x, along_y = line.x[foot + 1] - line.x[foot], line.y[foot + 1] - line.y[foot]
            share = ((x - line.x[foot]) * along_x + (y - line.y[foot]) * along_y) / (along_x**2 + along_y**2)
            if share < 1.0 or foot + 2 > last:
                break
            foot += 1
        share = min(max(share, 0.0), 1.0)
        centre_x, centre_y = line.x[foot] + share * along_x, line.y[foot] + share * along_y
        s = (foot + share) * line.step

        # A hazard appears, or has been dealt with.
        if mode == FREE and next_hazard < len(hazards.s) and s >= hazards.s[next_hazard]:
            reaction, elapsed = next_hazard, 0.0
            next_hazard += 1
            mode = hazards.kind[reaction]
            released_at = hazards.extent[reaction] * speed
        elif mode == BRAKING and speed <= released_at:
            mode = RELEASING
        elif mode == RELEASING and acceleration > -1.5:
            mode = FREE
        elif mode == SWERVING and elapsed >= hazards.extent[reaction]:
            mode = RECOVERING
        elif mode == RECOVERING and elapsed >= hazards.extent[reaction] + RECOVERY:
            mode = FREE
        if mode != FREE:
            reactions[k] = reaction
            elapsed += period

        # Steering: PP eq. 1 towards the goal point on the centre line; in a swerve a pulse on top of what was before.
        lookahead = manner.lookahead_base + manner.lookahead_time * speed
        lookahead = min(max(lookahead, manner.lookahead_minimum), manner.lookahead_maximum)
        goal_x, goal_y = goal_point(x, y, lookahead, line, foot)
        bearing = math.atan2(goal_y - y, goal_x - x) - heading
        pursuit = math.atan(2 * chassis.wheelbase * math.sin(bearing) / lookahead)
        target = smoothed
        if mode == SWERVING:
            lateral = hazards.strength[reaction] * swerve_shape(elapsed / hazards.extent[reaction])
            target += lateral * (chassis.wheelbase + chassis.understeer_gradient * speed**2) / max(speed, 5.0) ** 2
        rate = 0.0
        if speed > 0.0:
            rate = min(max((target - angle) / chassis.steering_lag, -chassis.steering_speed), chassis.steering_speed)

        states[k, 0], states[k, 1], states[k, 2], states[k, 3] = x, y, heading, slip
        states[k, 4], states[k, 5], states[k, 6] = speed, acceleration, curvature
        states[k, 7], states[k, 8] = angle, rate
        states[k, 9:13] = np.nan
        if speed > 0.0 and mode != SWERVING:
            states[k, 9], states[k, 10], states[k, 11], states[k, 12] = pursuit, lookahead, goal_x, goal_y
        states[k, 13], states[k, 14], states[k, 15] = centre_x, centre_y, s

        # Pedals: follow the plan a third of a second ahead; wait at stops; brake for hazards.
        jerk = COMFORT_JERK
        if standing > 0.0:
            wanted = 0.0
            standing -= period
            departed = s
        else:
            ahead = max(s + 0.3 * speed + 0.5, departed + 1.0)
            place = min(int(ahead / line.step), last)
            aim = max(plan.speed[place] * (1.0 + manner.speed_noise[k]), 0.8)
            # At walking pace the car creeps up to the line, however early the braking was.
            planned = plan.acceleration[place] if speed > 1.5 else max(plan.acceleration[place], 0.0)
            wanted = min(planned + (aim - speed) / 1.5, manner.acceleration)
            if speed < 2.0 and wanted < 0.0:
                wanted = max(wanted, -0.4 - 0.7 * speed)
            if next_stop < len(plan.stop) and plan.stop[next_stop] - s < 0.3:
                wanted = -0.4 - 0.7 * speed
        if mode == BRAKING:
            wanted, jerk = -hazards.strength[reaction], EMERGENCY_JERK
        elif mode == RELEASING:
            jerk = EMERGENCY_JERK
        elif mode == SWERVING:
            wanted = -1.5
            jerk = 20.0
        wanted = min(max(wanted, -chassis.deceleration), chassis.acceleration)

        # One step on.
        step = min(max(wanted - acceleration, -jerk * period), jerk * period)
        next_acceleration = acceleration + step
        next_speed = speed + period * (acceleration + next_acceleration) / 2
        if standing > 0.0 or next_speed <= 0.0:
            next_speed = next_acceleration = 0.0
            if standing <= 0.0 and next_stop < len(plan.stop) and plan.stop[next_stop] - s < 5.0:
                standing = plan.standstill[next_stop]
                next_stop += 1
                departed = s
        if mode != SWERVING and speed > 0.0:
            # After a swerve the driver takes hold of the lane again by and by.
            time = manner.smoothing if mode != RECOVERING else 3 * manner.smoothing
            smoothed += (pursuit + manner.noise[k] - smoothed) * (1 - math.exp(-period / time))
        angle += rate * period
        next_curvature = math.tan(angle) / (chassis.wheelbase + chassis.understeer_gradient * next_speed**2)
        next_slip = -chassis.rear_slip * next_speed**2 * next_curvature
        next_heading = heading + period * (speed * curvature + next_speed * next_curvature) / 2
        course = (heading + slip + next_heading + next_slip) / 2
        distance = period * (speed + next_speed) / 2
        x += distance * math.cos(course)
        y += distance * math.sin(course)
        heading, slip, speed, acceleration = next_heading, next_slip, next_speed, next_acceleration
        curvature = next_curvature
    return states, reactions
