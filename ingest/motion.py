"""Where a car is, where it goes and what it feels, compiled: import it where it is used, numba is heavy.

What is wanted of each of these, its axes, and where its formulas come from, `navigation` says.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

Values = npt.NDArray[np.float64]

DEGREES = 180.0 / math.pi
SEMI_MAJOR, SEMI_MINOR = 6_378_137.0, 6_356_752.314245179
"""m, axes of the WGS 84 ellipsoid."""

_S3, _S5, _S7, _S9, _S11, _S13, _S15, _S17 = ((-1.0) ** (n // 2) / math.factorial(n) for n in range(3, 18, 2))
_C4, _C6, _C8, _C10, _C12, _C14, _C16, _C18 = ((-1.0) ** (n // 2) / math.factorial(n) for n in range(4, 19, 2))

_BLOCK = 256
"""Numbers at a time: they stay in the nearest cache."""

# Taylor series of sin a / a, cos a and arctan a / a in powers of a², the highest first. They end where what follows is
# below the rounding of doubles: for a up to a quarter of π, and up to tan π/8.
_SINE = np.array([(-1.0) ** n / math.factorial(2 * n + 1) for n in range(8, -1, -1)])
_COSINE = np.array([(-1.0) ** n / math.factorial(2 * n) for n in range(9, -1, -1)])
_ARC_TANGENT = np.array([(-1.0) ** n / (2 * n + 1) for n in range(21, -1, -1)])
_TAN_22_5 = math.sqrt(2.0) - 1.0


@njit(cache=True, nogil=True)
def polynomial(coefficients: Values, z: Values) -> Values:
    """Return the polynomial of `z` (n,) with these coefficients, that of the highest power first, by Horner's rule.

    Term by term for many numbers, since so vector units take several of them at once.
    """
    total = np.empty(len(z))
    for begin in range(0, len(z), _BLOCK):
        part, powers = total[begin : begin + _BLOCK], z[begin : begin + _BLOCK]
        part[:] = coefficients[0]
        for coefficient in coefficients[1:]:
            for k in range(len(part)):
                part[k] = part[k] * powers[k] + coefficient
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def horizontal(north: Values, east: Values, slowest: float) -> tuple[Values, Values]:
    """Return speed, and course in deg anticlockwise from east where the speed is not below `slowest`.

    The arc tangent is taken of the ratio of the smaller to the larger component, and where that is above tan π/8 of the
    ratio that belongs to π/4 less.
    """
    speed, course, ratio = np.empty(len(north)), np.empty(len(north)), np.empty(len(north))
    for k in range(len(north)):
        along, across = abs(east[k]), abs(north[k])
        less, more = (along, across) if across > along else (across, along)
        ratio[k] = (less - more) / (less + more) if less > _TAN_22_5 * more else less / more
        speed[k] = math.sqrt(along * along + across * across)
    series = polynomial(_ARC_TANGENT, ratio * ratio)
    for k in range(len(north)):
        along, across = abs(east[k]), abs(north[k])
        less, more = (along, across) if across > along else (across, along)
        angle = DEGREES * ratio[k] * series[k] + (45.0 if less > _TAN_22_5 * more else 0.0)
        angle = 90.0 - angle if across > along else angle
        angle = 180.0 - angle if east[k] < 0.0 else angle
        angle = -angle if north[k] < 0.0 else angle
        angle = -180.0 if angle >= 180.0 else angle
        course[k] = angle if speed[k] >= slowest else math.nan
    return speed, course


@njit(cache=True, nogil=True)
def sines_and_cosines(angle: Values) -> tuple[Values, Values]:
    """Return the sines and cosines of angles (n,) in rad; up to a quarter of π by their series, which is faster."""
    small = True
    for k in range(len(angle)):
        small &= not abs(angle[k]) > math.pi / 4
    if not small:
        return np.sin(angle), np.cos(angle)
    square = angle * angle
    return angle * polynomial(_SINE, square), polynomial(_COSINE, square)


@njit(cache=True, nogil=True)
def without_gravity(
    along: Values, across: Values, pitch: Values, roll: Values, gravity: float
) -> tuple[Values, Values]:
    """Return acceleration forwards and to the left of specific forces; NaN among the angles means level."""
    up, down = np.empty(len(along)), np.empty(len(along))
    for k in range(len(along)):
        level = math.isnan(pitch[k]) | math.isnan(roll[k])
        up[k], down[k] = 0.0 if level else pitch[k], 0.0 if level else roll[k]
    sine_up, cosine_up = sines_and_cosines(up)
    sine_down, _ = sines_and_cosines(down)
    forward, left = np.empty(len(along)), np.empty(len(along))
    for k in range(len(along)):
        forward[k] = along[k] - gravity * sine_up[k]
        left[k] = -(across[k] + gravity * cosine_up[k] * sine_down[k])
    return forward, left


@njit(cache=True, nogil=True, error_model="numpy")
def inertial(
    velocity: tuple[Values, Values],
    orientation: tuple[Values, Values, Values],
    force: tuple[Values, Values],
    yaw_rate: Values,
    slowest: float,
    gravity: float,
) -> Values:
    """Return what `navigation.inertial_signals` makes of an inertial unit's axes, a stretch at a time.

    Args:
        velocity: North and east, (n,) m/s each, as all that follows.
        orientation: Heading, pitch and roll, rad.
        force: Specific force forwards and to the right, m/s².
        yaw_rate: rad/s, positive to the right.
        slowest: m/s; see `horizontal`.
        gravity: m/s².

    Returns:
        (6, n): speed, course, heading, yaw rate, acceleration forwards and to the left, with Wheelprint's axes.
    """
    signals = np.empty((6, len(yaw_rate)))
    for begin in range(0, len(yaw_rate), _BLOCK):
        here = slice(begin, begin + _BLOCK)
        signals[0, here], signals[1, here] = horizontal(velocity[0][here], velocity[1][here], slowest)
        heading, bearing, rate = signals[2, here], orientation[0][here], yaw_rate[here]
        for k in range(len(heading)):
            heading[k] = wrapped(90.0 - DEGREES * bearing[k])
        signals[3, here] = -(DEGREES * rate)
        signals[4, here], signals[5, here] = without_gravity(
            force[0][here], force[1][here], orientation[1][here], orientation[2][here], gravity
        )
    return signals


@njit(cache=True, nogil=True)
def wrapped(angle: float) -> float:
    """Return an angle in [-180, 180) deg, as `schemas.angles.wrap_degrees` does."""
    if not (angle < -180.0 or angle >= 180.0):
        return angle
    turned = angle - 360.0 * math.floor((angle + 180.0) / 360.0)
    return -180.0 if turned < -180.0 or turned >= 180.0 else turned


@njit(cache=True, nogil=True, error_model="numpy")
def normal_radius(sine: float, cosine: float) -> float:
    """Return how far, in m, the polar axis is from the ellipsoid's surface, straight down, at a latitude."""
    return SEMI_MAJOR**2 / math.sqrt((SEMI_MAJOR * cosine) ** 2 + (SEMI_MINOR * sine) ** 2)


@njit(cache=True, nogil=True, error_model="numpy")
def east_north(
    latitude: Values, longitude: Values, altitude: Values, origin: tuple[float, float, float]
) -> tuple[Values, Values]:
    """Return m east and north of `origin` (deg, deg, m) on its tangent plane; without altitude the origin's counts.

    Both places are put into the coordinates of the origin's meridian: `out` from the polar axis, `up` from the equator.
    """
    shrunk = (SEMI_MINOR / SEMI_MAJOR) ** 2
    sine, cosine = math.sin(origin[0] / DEGREES), math.cos(origin[0] / DEGREES)
    radius = normal_radius(sine, cosine)
    first_out, first_up = (radius + origin[2]) * cosine, (radius * shrunk + origin[2]) * sine
    east, north = np.empty(len(latitude)), np.empty(len(latitude))
    for begin in range(0, len(latitude), _BLOCK):
        here = slice(begin, begin + _BLOCK)
        sine_north, cosine_north = sines_and_cosines((latitude[here] - origin[0]) / DEGREES)
        sine_east, cosine_east = sines_and_cosines((longitude[here] - origin[1]) / DEGREES)
        x, y, z = east[here], north[here], altitude[here]
        for k in range(len(z)):
            height = origin[2] if math.isnan(z[k]) else z[k]
            sine_here = sine * cosine_north[k] + cosine * sine_north[k]
            cosine_here = cosine * cosine_north[k] - sine * sine_north[k]
            radius = normal_radius(sine_here, cosine_here)
            out, up = (radius + height) * cosine_here, (radius * shrunk + height) * sine_here
            x[k] = out * sine_east[k]
            y[k] = cosine * (up - first_up) - sine * (out * cosine_east[k] - first_out)
    return east, north
