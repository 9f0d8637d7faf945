"""A bicycle that follows a track, compiled: the driver's pure pursuit, a stable controller, and what lies between."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from .pure_pursuit import Line, foot_point, goal_point, pursuit_angle

FloatArray = npt.NDArray[np.float64]

PERIOD = 0.01
"""s of a step of the loop."""

STEPS_PER_ROW = 10
"""Steps for each row that is returned."""

TIME_CONSTANT = 1.2
"""s: at speed v the controller's tracking error falls to 1/e within so many seconds, once it is small."""

SHORTEST_REACH = 4.0
"""m, over which it does when the car is slow."""

TAKEOVER = 0.5
"""s, time constant with which the share of the driver follows what is known of the place."""

COLUMNS = (
    "time", "distance", "x", "y", "deviation", "speed", "steering_wheel_angle", "lookahead", "driver_share",
    "driver_angle",
)  # fmt: skip


class Way(NamedTuple):
    """What holds at the points of the line, each (n,).

    Attributes:
        course: rad, not wrapped.
        curvature: 1/m, positive to the left.
        speed: m/s.
        lookahead: m.
        driver_share: Share of the steering, 0 to 1: how far the driver's model is to be trusted here.
        angle: rad, largest road wheel angle of the driver, at most the lock.
        rate: rad/s, largest rate of it; infinite for none.
    """

    course: FloatArray
    curvature: FloatArray
    speed: FloatArray
    lookahead: FloatArray
    driver_share: FloatArray
    angle: FloatArray
    rate: FloatArray


class Chassis(NamedTuple):
    """The car, see `Bicycle`.

    Attributes:
        wheelbase: L, m.
        understeer: K, rad/(m/s²).
        lock: rad, of the road wheels.
        rate: rad/s, with which they can be turned; infinite for at once.
    """

    wheelbase: float
    understeer: float
    lock: float
    rate: float


@njit(cache=True, nogil=True)
def reach_at(speed: float) -> float:
    """Return ℓ = max(`TIME_CONSTANT`·v, `SHORTEST_REACH`), m, in which the tracking error falls to 1/e, v in m/s."""
    return max(TIME_CONSTANT * speed, SHORTEST_REACH)


@njit(cache=True, nogil=True)
def stable_curvature(deviation: float, astray: float, curvature: float, speed: float) -> float:
    """Return the curvature in 1/m that brings the car back to the path from wherever it is (Samson's path following).

    Per metre driven, a car e to the left of a path of curvature κ_p, and ψ to the left of its course, has

        e' = sin ψ,    ψ' = κ − κ_p cos ψ / (1 − κ_p e)

    and with κ = κ_p cos ψ / (1 − κ_p e) − k₁ e sin ψ / ψ − k₂ ψ the function V = (k₁ e² + ψ²) / 2 changes by

        V' = k₁ e sin ψ + ψ ψ' = −k₂ ψ² ≤ 0

    V stays only where ψ stays 0, which takes ψ' = −k₁ e = 0: so e → 0 and ψ → 0 from everywhere with κ_p e < 1 and
    |ψ| < π (LaSalle), at any constant speed, because nothing but the distance driven enters. Linearised, e'' + k₂ e' +
    k₁ e = 0; k₁ = 1/ℓ² and k₂ = 2/ℓ make both roots −1/ℓ, without overshoot, and ℓ = `TIME_CONSTANT`·v, at least
    `SHORTEST_REACH`, makes it as quick in seconds at every speed.

    Args:
        deviation: e, m, positive to the left.
        astray: ψ, rad, positive to the left, within ±π.
        curvature: κ_p, 1/m, positive to the left.
        speed: v, m/s.
    """
    reach = reach_at(speed)
    sinc = math.sin(astray) / astray if abs(astray) > 1e-6 else 1.0
    # Beyond a bend's centre there is no nearest point; short of that the path seems shorter than it is.
    along = curvature * math.cos(astray) / max(1.0 - curvature * deviation, 0.2)
    turned: float = along - deviation * sinc / reach**2 - 2.0 * astray / reach
    return turned


@njit(cache=True, nogil=True)
def share_on_path(deviation: float, astray: float, speed: float, tolerance: float) -> float:
    """Return how far a driver who keeps to the path within `tolerance` m is to be trusted so far off it, 1 to 0.

    What counts is d = √(e² + ℓ² ψ²), the root of `stable_curvature`'s 2 V ℓ². With u = d / `tolerance` − 1, from 0 to
    1, the share is 1 − u² (3 − 2u). From d = 2·`tolerance` on nothing of the driver is left, so that V falls: whatever
    the driver does within, d stays below, and |e| ≤ d.

    Args:
        deviation: e, m, positive to the left.
        astray: ψ, rad, positive to the left.
        speed: v, m/s.
        tolerance: m.
    """
    away = math.hypot(deviation, reach_at(speed) * astray)
    beyond = min(max(away / tolerance - 1.0, 0.0), 1.0)
    return 1.0 - beyond * beyond * (3.0 - 2.0 * beyond)


@njit(cache=True, nogil=True)
def between(values: FloatArray, foot: int, share: float) -> float:
    """Return values (n,) of any unit interpolated at a share of the way from sample i = `foot` to the next one.

    That is v_i + share · (v_i+1 − v_i), in the unit of the values.
    """
    found: float = values[foot] + share * (values[foot + 1] - values[foot])
    return found


@njit(cache=True, nogil=True)
def tracking_error(
    x: float, y: float, heading: float, line: Line, way: Way, foot: int, share: float
) -> tuple[float, float]:
    """Return how far to the left of the line a car is, m, and points, rad within ±π, at its foot point.

    At its point (x_p, y_p) of course θ they are e = cos θ (y − y_p) − sin θ (x − x_p) and ψ = heading − θ, wrapped.

    Args:
        x: East of the car, m.
        y: North, m.
        heading: Where it points, rad anticlockwise from east.
        line: The path.
        way: What holds along it.
        foot: Sample behind the foot point.
        share: Share of the way from there to the next one, 0 to 1.
    """
    course = between(way.course, foot, share)
    east, north = x - between(line.x, foot, share), y - between(line.y, foot, share)
    astray = (heading - course + math.pi) % (2 * math.pi) - math.pi
    return math.cos(course) * north - math.sin(course) * east, astray


@njit(cache=True, nogil=True)
def follow(
    line: Line, way: Way, chassis: Chassis, tolerance: float, deviation: float, astray: float, angle: float
) -> FloatArray:
    """Drive along a line to where it does not reach as far ahead as the driver looks.

    The driver's angle is that of PP eq. 1, within the limits of angle and rate. The car steers that and the angle
    atan(κ (L + K v²)) of `stable_curvature`'s κ in shares: the driver's is `share_on_path` times `driver_share` of the
    place, which is followed with `TAKEOVER`. Speed is that of the place.

    Args:
        line: The path.
        way: What holds along it; the limit of the angle falls no faster than the limit of the rate allows.
        chassis: The car.
        tolerance: m, see `share_on_path`; infinite for a driver without a controller.
        deviation: m to the left of the line's first point, where the car begins.
        astray: rad to the left of its course, where the car points.
        angle: rad, road wheel angle before the first step.

    Returns:
        (n_rows, n_columns) as `COLUMNS` names them, a row every `STEPS_PER_ROW` steps, in s, m, m/s and rad at the road
        wheels; the driver's angle is the one that the driver alone would steer.
    """
    last = len(line.x) - 1
    rows = np.empty((int(2.0 * (line.step / way.speed).sum() / (PERIOD * STEPS_PER_ROW)) + 100, len(COLUMNS)))
    sine, cosine = math.sin(way.course[0]), math.cos(way.course[0])
    x, y, heading = line.x[0] - deviation * sine, line.y[0] + deviation * cosine, way.course[0] + astray
    driver = steered = min(max(angle, -way.angle[0]), way.angle[0])
    foot, count, trusted = 0, 0, 1.0
    while count < len(rows) * STEPS_PER_ROW:
        foot, share = foot_point(x, y, line, foot)
        place, lookahead = (foot + share) * line.step, between(way.lookahead, foot, share)
        if place + lookahead > last * line.step:
            break
        speed = between(way.speed, foot, share)
        deviation, astray = tracking_error(x, y, heading, line, way, foot, share)

        goal_x, goal_y = goal_point(x, y, lookahead, line, foot)
        wanted = pursuit_angle(x, y, heading, goal_x, goal_y, lookahead, chassis.wheelbase)
        most, largest = min(way.rate[foot], way.rate[foot + 1]) * PERIOD, between(way.angle, foot, share)
        driver = min(max(wanted, driver - most), driver + most)
        driver = min(max(driver, -largest), largest)

        known = between(way.driver_share, foot, share)
        trusted = known if count == 0 else trusted + (known - trusted) * PERIOD / TAKEOVER
        driver_share = trusted * share_on_path(deviation, astray, speed, tolerance)
        length = chassis.wheelbase + chassis.understeer * speed**2
        target = driver
        if driver_share < 1.0:
            back = stable_curvature(deviation, astray, between(way.curvature, foot, share), speed)
            back = min(max(math.atan(length * back), -chassis.lock), chassis.lock)
            target = driver_share * driver + (1.0 - driver_share) * back
        steered = min(max(target, steered - chassis.rate * PERIOD), steered + chassis.rate * PERIOD)
        if count % STEPS_PER_ROW == 0:
            row = rows[count // STEPS_PER_ROW]
            row[0], row[1], row[2], row[3], row[4] = count * PERIOD, place, x, y, deviation
            row[5], row[6], row[7], row[8], row[9] = speed, steered, lookahead, driver_share, driver
        turn = speed * PERIOD * math.tan(steered) / length
        x += speed * PERIOD * math.cos(heading + turn / 2)
        y += speed * PERIOD * math.sin(heading + turn / 2)
        heading += turn
        count += 1
    return rows[: (count + STEPS_PER_ROW - 1) // STEPS_PER_ROW]
