"""Driver, car and road in one loop at a fixed rate, compiled: imported only where a drive is simulated."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from ..pure_pursuit import Line, foot_point, goal_point, pursuit_angle

FloatArray = npt.NDArray[np.float64]

COMFORT_JERK = 4.0  # m/s³
EMERGENCY_JERK = 60.0  # m/s³
FREE, BRAKING, RELEASING, SWERVING, RECOVERING = 0, 1, 2, 3, 4
RECOVERY = 1.0  # s, after a swerve
COLUMNS = (
    "x", "y", "heading", "slip", "speed", "acceleration", "curvature", "road_wheel_angle", "road_wheel_speed",
    "pursuit_angle", "lookahead", "goal_x", "goal_y", "centre_x", "centre_y", "arc_length",
)  # fmt: skip


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
    """How the car answers, in the units of `Car`, but `steering_speed` in rad/s at the road wheels."""

    wheelbase: float
    understeer_gradient: float
    rear_slip: float
    steering_lag: float
    steering_speed: float
    acceleration: float
    deceleration: float


@njit(cache=True)
def swerve_shape(share: float) -> float:
    """Return the lateral acceleration of a swerve at a share u of its duration, as a share of that in its middle.

    It is the second derivative of u⁴(1 − u)⁴, −32 u² (1 − u)² (3 − 14u + 14u²): away, back and straight again, so that
    neither the heading nor the lateral position differs in the end.
    """
    u = share
    return -32 * u**2 * (1 - u) ** 2 * (3 - 14 * u + 14 * u**2)


class Reaction(NamedTuple):
    """What the driver makes of the hazards.

    Attributes:
        mode: `FREE`, `BRAKING`, `RELEASING`, `SWERVING` or `RECOVERING`.
        hazard: Index of the hazard that the driver reacts to, or reacted to last; -1 before the first one.
        elapsed: s since it appeared.
        released_at: m/s, below which the brake is released.
    """

    mode: int
    hazard: int
    elapsed: float
    released_at: float


@njit(cache=True)
def react(before: Reaction, hazards: Hazards, s: float, speed: float, acceleration: float) -> Reaction:
    """Return what the driver does now that a hazard appears at arc length `s`, or has been dealt with.

    Args:
        before: What the driver did so far.
        hazards: What appears, and where.
        s: m, where the car is along the centre line.
        speed: m/s.
        acceleration: m/s².
    """
    mode, hazard, elapsed, released_at = before
    if mode == FREE and hazard + 1 < len(hazards.s) and s >= hazards.s[hazard + 1]:
        hazard, elapsed = hazard + 1, 0.0
        mode = hazards.kind[hazard]
        released_at = hazards.extent[hazard] * speed
    elif mode == BRAKING and speed <= released_at:
        mode = RELEASING
    elif mode == RELEASING and acceleration > -1.5:
        mode = FREE
    elif mode == SWERVING and elapsed >= hazards.extent[hazard]:
        mode = RECOVERING
    elif mode == RECOVERING and elapsed >= hazards.extent[hazard] + RECOVERY:
        mode = FREE
    return Reaction(mode, hazard, elapsed, released_at)


@njit(cache=True)
def planned_acceleration(
    plan: Plan, manner: Manner, line: Line, s: float, speed: float, speed_noise: float, departed: float, stop: float
) -> float:
    """Return the acceleration in m/s² that follows the plan a third of a second ahead.

    It is a = a_plan + (v_plan (1 + `speed_noise`) − v) / 1.5 s there, no more than the driver asks for; up to a stop
    the car creeps.

    Args:
        plan: What is meant to be done.
        manner: How.
        line: Centre line that the plan is along.
        s: m, where the car is along it.
        speed: m/s.
        speed_noise: Share by which the speed is missed now.
        departed: m, where the car last stood.
        stop: m, where it will stand next, infinite for nowhere.
    """
    ahead = max(s + 0.3 * speed + 0.5, departed + 1.0)
    place = min(int(ahead / line.step), len(line.x) - 1)
    aim = max(plan.speed[place] * (1.0 + speed_noise), 0.8)
    # At walking pace the car creeps up to the line, however early the braking was.
    planned = plan.acceleration[place] if speed > 1.5 else max(plan.acceleration[place], 0.0)
    wanted: float = min(planned + (aim - speed) / 1.5, manner.acceleration)
    if speed < 2.0 and wanted < 0.0:
        wanted = max(wanted, -0.4 - 0.7 * speed)
    if stop - s < 0.3:
        wanted = -0.4 - 0.7 * speed
    return wanted


@njit(cache=True)
def brake_or_swerve(reaction: Reaction, hazards: Hazards, wanted: float) -> tuple[float, float]:
    """Return the acceleration (m/s²) in an emergency, or as wanted in none, and the jerk (m/s³) it may come with.

    Args:
        reaction: What the driver does.
        hazards: What for.
        wanted: m/s², without an emergency.
    """
    if reaction.mode == BRAKING:
        return -hazards.strength[reaction.hazard], EMERGENCY_JERK
    if reaction.mode == RELEASING:
        return wanted, EMERGENCY_JERK
    if reaction.mode == SWERVING:
        return -1.5, 20.0
    return wanted, COMFORT_JERK


@njit(cache=True)
def steering_rate(
    reaction: Reaction, hazards: Hazards, chassis: Chassis, held: float, angle: float, speed: float
) -> float:
    """Return the rate in rad/s at which the road wheels turn to the angle that is held; in a swerve a pulse is on it.

    It is (target − angle) / `steering_lag`, at most `steering_speed` either way; a swerve of lateral acceleration a
    adds a (L + K v²) / v² to the target, v of 5 m/s at least.

    Args:
        reaction: What the driver does.
        hazards: What for.
        chassis: The car's.
        held: rad, road wheel angle that the hands ask for.
        angle: rad, that of the road wheels.
        speed: m/s.
    """
    if speed <= 0.0:
        return 0.0
    target = held
    if reaction.mode == SWERVING:
        share = reaction.elapsed / hazards.extent[reaction.hazard]
        lateral = hazards.strength[reaction.hazard] * swerve_shape(share)
        target += lateral * (chassis.wheelbase + chassis.understeer_gradient * speed**2) / max(speed, 5.0) ** 2
    return min(max((target - angle) / chassis.steering_lag, -chassis.steering_speed), chassis.steering_speed)


@njit(cache=True)
def run(
    line: Line, plan: Plan, hazards: Hazards, manner: Manner, chassis: Chassis, period: float
) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Drive for as long as there is noise.

    The car begins at rest at the beginning of the centre line and stands for three seconds. Every row is the state at
    one instant and what the driver makes of it; the next one follows from it by one step of `period` seconds with
    trapezoidal integration. The driver steers by PP eq. 1, smoothed over `Manner.smoothing`; the car's heading turns at
    v κ, κ = tan δ / (L + K v²), and its course lags that by the slip, `rear_slip` · v² κ.

    Args:
        line: Centre line of the road.
        plan: What the driver means to do.
        hazards: What comes in between.
        manner: How the driver steers and presses the pedals.
        chassis: How the car answers.
        period: s.

    Returns:
        (n_samples, n_columns) as `COLUMNS` names them, in SI units and radians, where pursuit angle, lookahead and
        goal are NaN while the driver does not pursue: at standstill and in a swerve; and (n_samples,) the index of the
        hazard that the driver reacts to, -1 for none.
    """
    n, stops = len(manner.noise), len(plan.stop)
    states = np.empty((n, len(COLUMNS)))
    reactions = np.full(n, -1)
    foot, next_stop, x, y = 0, 0, line.x[0], line.y[0]
    heading = math.atan2(line.y[1] - y, line.x[1] - x)
    speed = acceleration = angle = smoothed = curvature = slip = 0.0
    standing, departed = 3.0, -1.0
    reaction = Reaction(FREE, -1, 0.0, 0.0)
    for k in range(n):
        foot, share = foot_point(x, y, line, foot)
        centre_x = line.x[foot] + share * (line.x[foot + 1] - line.x[foot])
        centre_y = line.y[foot] + share * (line.y[foot + 1] - line.y[foot])
        s = (foot + share) * line.step
        reaction = react(reaction, hazards, s, speed, acceleration)
        mode = reaction.mode
        if mode != FREE:
            reactions[k] = reaction.hazard
            reaction = Reaction(mode, reaction.hazard, reaction.elapsed + period, reaction.released_at)

        # Steering: PP eq. 1 towards the goal point on the centre line.
        lookahead = manner.lookahead_base + manner.lookahead_time * speed
        lookahead = min(max(lookahead, manner.lookahead_minimum), manner.lookahead_maximum)
        goal_x, goal_y = goal_point(x, y, lookahead, line, foot)
        pursuit = pursuit_angle(x, y, heading, goal_x, goal_y, lookahead, chassis.wheelbase)
        rate = steering_rate(reaction, hazards, chassis, smoothed, angle, speed)

        states[k, 0], states[k, 1], states[k, 2], states[k, 3] = x, y, heading, slip
        states[k, 4], states[k, 5], states[k, 6] = speed, acceleration, curvature
        states[k, 7], states[k, 8] = angle, rate
        states[k, 9:13] = np.nan
        if speed > 0.0 and mode != SWERVING:
            states[k, 9], states[k, 10], states[k, 11], states[k, 12] = pursuit, lookahead, goal_x, goal_y
        states[k, 13], states[k, 14], states[k, 15] = centre_x, centre_y, s

        # Pedals: wait at stops, follow the plan, brake for hazards.
        wanted = 0.0
        if standing > 0.0:
            standing, departed = standing - period, s
        else:
            stop = plan.stop[next_stop] if next_stop < stops else np.inf
            wanted = planned_acceleration(plan, manner, line, s, speed, manner.speed_noise[k], departed, stop)
        wanted, jerk = brake_or_swerve(reaction, hazards, wanted)
        wanted = min(max(wanted, -chassis.deceleration), chassis.acceleration)

        # One step on.
        next_acceleration = acceleration + min(max(wanted - acceleration, -jerk * period), jerk * period)
        next_speed = speed + period * (acceleration + next_acceleration) / 2
        if standing > 0.0 or next_speed <= 0.0:
            next_speed = next_acceleration = 0.0
            if standing <= 0.0 and next_stop < stops and plan.stop[next_stop] - s < 5.0:
                standing, departed = plan.standstill[next_stop], s
                next_stop += 1
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
        x, y = x + distance * math.cos(course), y + distance * math.sin(course)
        heading, slip, curvature = next_heading, next_slip, next_curvature
        speed, acceleration = next_speed, next_acceleration
    return states, reactions
