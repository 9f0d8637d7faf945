"""Where a car is, where it goes and what it feels, compiled: import it where it is used, numba is heavy.

What is wanted of each of these, its axes, and where its formulas come from, `navigation` says.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from .series import series

Values = npt.NDArray[np.float64]

DEGREES = 180.0 / math.pi
SEMI_MAJOR, SEMI_MINOR = 6_378_137.0, 6_356_752.314245179
"""m, axes of the WGS 84 ellipsoid."""

_TAN_22_5 = math.sqrt(2.0) - 1.0

# Taylor series of sin a / a, cos a and arctan a / a in powers of a². They end where what follows is below the rounding
# of doubles: for a up to a quarter of π, and up to tan π/8.
_sine = series([(-1.0) ** n / math.factorial(2 * n + 1) for n in range(8, -1, -1)])
_cosine = series([(-1.0) ** n / math.factorial(2 * n) for n in range(9, -1, -1)])
_arc_tangent = series([(-1.0) ** n / (2 * n + 1) for n in range(21, -1, -1)])


# The loops below are over plain numbers without jumps, so that vector units take several of them at once.


@njit(cache=True, nogil=True, error_model="numpy")
def _direction(north: float, east: float) -> float:
    """Return the direction of a vector, deg anticlockwise from east in [-180, 180).

    The arc tangent is taken of the ratio of the smaller to the larger component, and where that is above tan π/8 of the
    ratio that belongs to π/4 less.
    """
    along, across = abs(east), abs(north)
    steep = across > along
    less, more = along if steep else across, across if steep else along
    beyond = less > _TAN_22_5 * more
    ratio = (less - more if beyond else less) / (less + more if beyond else more)
    angle = DEGREES * ratio * _arc_tangent(ratio * ratio) + (45.0 if beyond else 0.0)
    angle = 90.0 - angle if steep else angle
    angle = 180.0 - angle if east < 0.0 else angle
    angle = -angle if north < 0.0 else angle
    return -180.0 if angle >= 180.0 else angle


@njit(cache=True, nogil=True, error_model="numpy")
def _set_horizontal(north: Values, east: Values, slowest: float, speed: Values, course: Values) -> None:
    for k in range(len(north)):
        size = math.sqrt(east[k] * east[k] + north[k] * north[k])
        speed[k] = size
        course[k] = _direction(north[k], east[k]) if size >= slowest else math.nan


@njit(cache=True, nogil=True)
def horizontal(north: Values, east: Values, slowest: float) -> tuple[Values, Values]:
    """Return speed, and course in deg anticlockwise from east where the speed is not below `slowest`."""
    speed, course = np.empty(len(north)), np.empty(len(north))
    _set_horizontal(north, east, slowest, speed, course)
    return speed, course


@njit(cache=True, nogil=True)
def near_sine(angle: float) -> float:
    """Return the sine of an angle in rad up to a quarter of π by its series, which is faster."""
    sine: float = angle * _sine(angle * angle)
    return sine


@njit(cache=True, nogil=True)
def near_cosine(angle: float) -> float:
    """Return the cosine of an angle in rad up to a quarter of π by its series, which is faster."""
    cosine: float = _cosine(angle * angle)
    return cosine


@njit(cache=True, nogil=True)
def _none_beyond(limit: float, angles: Values, middle: float) -> bool:
    """Tell whether no angle is further from `middle` than `limit`; NaN is nowhere."""
    beyond = False
    for k in range(len(angles)):
        beyond |= abs(angles[k] - middle) > limit
    return not beyond


@njit(cache=True, nogil=True)
def _tilt(pitch: float, roll: float) -> tuple[float, float]:
    """Return pitch and roll, 0 where one of them is NaN."""
    level = math.isnan(pitch) | math.isnan(roll)
    return 0.0 if level else pitch, 0.0 if level else roll


@njit(cache=True, nogil=True)
def _set_without_gravity(
    along: Values, across: Values, pitch: Values, roll: Values, gravity: float, forward: Values, left: Values
) -> None:
    near = _none_beyond(math.pi / 4, pitch, 0.0) & _none_beyond(math.pi / 4, roll, 0.0)
    for k in range(len(along) if near else 0):
        up, down = _tilt(pitch[k], roll[k])
        forward[k] = along[k] - gravity * near_sine(up)
        left[k] = -(across[k] + gravity * near_cosine(up) * near_sine(down))
    for k in range(0 if near else len(along)):
        up, down = _tilt(pitch[k], roll[k])
        forward[k] = along[k] - gravity * math.sin(up)
        left[k] = -(across[k] + gravity * math.cos(up) * math.sin(down))


@njit(cache=True, nogil=True)
def without_gravity(
    along: Values, across: Values, pitch: Values, roll: Values, gravity: float
) -> tuple[Values, Values]:
    """Return acceleration forwards and to the left of specific forces; NaN among the angles means level."""
    forward, left = np.empty(len(along)), np.empty(len(along))
    _set_without_gravity(along, across, pitch, roll, gravity, forward, left)
    return forward, left


@njit(cache=True, nogil=True)
def set_inertial(
    measured: Values, slowest: float, gravity: float, signals: Values, row: int, begin: int, stop: int
) -> None:
    """Set what `navigation.inertial_signals` makes of an inertial unit's axes.

    Args:
        measured: (8, at least stop - begin), each row as long as is needed: specific force forwards and to the right,
            m/s², yaw rate, rad/s, positive to the right, velocity north and east, m/s, heading, pitch and roll, rad.
        slowest: m/s; see `horizontal`.
        gravity: m/s².
        signals: (row + 6 or more, stop or more), whose rows from `row` on are set between the columns `begin` and
            `stop`: speed, course, heading, yaw rate, acceleration forwards and to the left, with Wheelprint's axes.
        row: The first row.
        begin: The first column.
        stop: The column after the last.
    """
    count = stop - begin
    north, east, pitch, roll = measured[3, :count], measured[4, :count], measured[6, :count], measured[7, :count]
    _set_horizontal(north, east, slowest, signals[row, begin:stop], signals[row + 1, begin:stop])
    bearing, rate = measured[5, :count], measured[2, :count]
    heading, yaw_rate = signals[row + 2, begin:stop], signals[row + 3, begin:stop]
    for k in range(count):
        heading[k] = wrapped(90.0 - DEGREES * bearing[k])
        yaw_rate[k] = -(DEGREES * rate[k])
    along, across = measured[0, :count], measured[1, :count]
    forward, left = signals[row + 4, begin:stop], signals[row + 5, begin:stop]
    _set_without_gravity(along, across, pitch, roll, gravity, forward, left)


@njit(cache=True, nogil=True)
def wrapped(angle: float) -> float:
    """Return an angle in [-180, 180) deg, as `schemas.angles.wrap_degrees` does."""
    turned = angle - 360.0 * np.floor((angle + 180.0) / 360.0)
    turned = -180.0 if (turned < -180.0) | (turned >= 180.0) else turned
    return turned if (angle < -180.0) | (angle >= 180.0) else angle


@njit(cache=True, nogil=True, error_model="numpy")
def normal_radius(sine: float, cosine: float) -> float:
    """Return how far, in m, the polar axis is from the ellipsoid's surface, straight down, at a latitude."""
    return SEMI_MAJOR**2 / math.sqrt((SEMI_MAJOR * cosine) ** 2 + (SEMI_MINOR * sine) ** 2)


@njit(cache=True, nogil=True, error_model="numpy")
def _out_and_up(sine: float, cosine: float, height: float) -> tuple[float, float]:
    """Return how far, in m, a place at a latitude is from the polar axis, and from the plane of the equator."""
    radius = normal_radius(sine, cosine)
    return (radius + height) * cosine, (radius * (SEMI_MINOR / SEMI_MAJOR) ** 2 + height) * sine


@njit(cache=True, nogil=True, error_model="numpy")
def east_north(
    latitude: Values, longitude: Values, altitude: Values, origin: tuple[float, float, float]
) -> tuple[Values, Values]:
    """Return m east and north of `origin` (deg, deg, m) on its tangent plane; without altitude the origin's counts.

    Both places are put into the coordinates of the origin's meridian: `out` from the polar axis, `up` from the equator.
    """
    sine, cosine = math.sin(origin[0] / DEGREES), math.cos(origin[0] / DEGREES)
    first_out, first_up = _out_and_up(sine, cosine, origin[2])
    east, north = np.empty(len(latitude)), np.empty(len(latitude))
    near = _none_beyond(45.0, latitude, origin[0]) & _none_beyond(45.0, longitude, origin[1])
    for k in range(len(latitude) if near else 0):
        to_north, to_east = (latitude[k] - origin[0]) / DEGREES, (longitude[k] - origin[1]) / DEGREES
        sine_north, cosine_north = near_sine(to_north), near_cosine(to_north)
        height = origin[2] if math.isnan(altitude[k]) else altitude[k]
        out, up = _out_and_up(
            sine * cosine_north + cosine * sine_north, cosine * cosine_north - sine * sine_north, height
        )
        east[k] = out * near_sine(to_east)
        north[k] = cosine * (up - first_up) - sine * (out * near_cosine(to_east) - first_out)
    for k in range(0 if near else len(latitude)):
        to_east = (longitude[k] - origin[1]) / DEGREES
        height = origin[2] if math.isnan(altitude[k]) else altitude[k]
        out, up = _out_and_up(math.sin(latitude[k] / DEGREES), math.cos(latitude[k] / DEGREES), height)
        east[k] = out * math.sin(to_east)
        north[k] = cosine * (up - first_up) - sine * (out * math.cos(to_east) - first_out)
    return east, north


@njit(cache=True, nogil=True)
def within_limits(
    latitude: Values, longitude: Values, altitude: Values, altitudes: tuple[float, float]
) -> npt.NDArray[np.bool_]:
    """Tell which positions (deg, deg, m) are on earth, and not below or above two altitudes; NaN is not."""
    inside = np.empty(len(latitude), np.bool_)
    for k in range(len(latitude)):
        level = (altitude[k] >= altitudes[0]) & (altitude[k] <= altitudes[1])
        inside[k] = (abs(latitude[k]) <= 90.0) & (abs(longitude[k]) <= 180.0) & level
    return inside
