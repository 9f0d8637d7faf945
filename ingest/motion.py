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


@njit(cache=True, nogil=True)
def horizontal(north: Values, east: Values, slowest: float) -> tuple[Values, Values]:
    """Return speed, and course in deg anticlockwise from east where the speed is not below `slowest`."""
    speed, course = np.empty(len(north)), np.empty(len(north))
    for k in range(len(north)):
        speed[k] = math.sqrt(north[k] * north[k] + east[k] * east[k])
        angle = math.atan2(north[k], east[k]) * DEGREES
        course[k] = math.nan if not speed[k] >= slowest else -180.0 if angle >= 180.0 else angle
    return speed, course


@njit(cache=True, nogil=True)
def without_gravity(
    along: Values, across: Values, pitch: Values, roll: Values, gravity: float
) -> tuple[Values, Values]:
    """Return acceleration forwards and to the left of specific forces; NaN among the angles means level."""
    forward, left = np.empty(len(along)), np.empty(len(along))
    for k in range(len(along)):
        level = math.isnan(pitch[k]) or math.isnan(roll[k])
        up, down = (0.0, 0.0) if level else (pitch[k], roll[k])
        forward[k] = along[k] - gravity * math.sin(up)
        left[k] = -(across[k] + gravity * math.cos(up) * math.sin(down))
    return forward, left


@njit(cache=True, nogil=True)
def geocentric(latitude: float, longitude: float, altitude: float) -> tuple[float, float, float]:
    """Return the Cartesian coordinates, m, of a place (rad, rad, m above the ellipsoid): first to 0° E, last north."""
    sine, cosine = math.sin(latitude), math.cos(latitude)
    curvature = SEMI_MAJOR**2 / math.sqrt((SEMI_MAJOR * cosine) ** 2 + (SEMI_MINOR * sine) ** 2)
    out = (curvature + altitude) * cosine
    return (
        out * math.cos(longitude),
        out * math.sin(longitude),
        (curvature * (SEMI_MINOR / SEMI_MAJOR) ** 2 + altitude) * sine,
    )


@njit(cache=True, nogil=True)
def east_north(
    latitude: Values, longitude: Values, altitude: Values, origin: tuple[float, float, float]
) -> tuple[Values, Values]:
    """Return m east and north of `origin` (deg, deg, m) on its tangent plane; without altitude the origin's counts."""
    here, there = origin[0] / DEGREES, origin[1] / DEGREES
    first = geocentric(here, there, origin[2])
    sine, cosine, sine_there, cosine_there = math.sin(here), math.cos(here), math.sin(there), math.cos(there)
    east, north = np.empty(len(latitude)), np.empty(len(latitude))
    for k in range(len(latitude)):
        height = origin[2] if math.isnan(altitude[k]) else altitude[k]
        u, v, w = geocentric(latitude[k] / DEGREES, longitude[k] / DEGREES, height)
        u, v, w = u - first[0], v - first[1], w - first[2]
        east[k] = cosine_there * v - sine_there * u
        north[k] = cosine * w - sine * (cosine_there * u + sine_there * v)
    return east, north
