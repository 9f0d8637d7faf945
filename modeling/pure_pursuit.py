"""The geometry of pure pursuit along a line, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]


class Line(NamedTuple):
    """The line to follow, equally spaced.

    Attributes:
        x: East, m (n,).
        y: North, m (n,).
        step: Spacing, m.
    """

    x: FloatArray
    y: FloatArray
    step: float


@njit(cache=True, nogil=True)
def foot_point(x: float, y: float, line: Line, first: int) -> tuple[int, float]:
    """Return where along the line a car is: a sample, and the share of the way to the next one, within [0, 1].

    From sample p_i on the share is (p − p_i) · (p_i+1 − p_i) / |p_i+1 − p_i|², the foot of the perpendicular.

    Args:
        x: East of the car, m.
        y: North, m.
        line: The line.
        first: Sample that the car was at before; it goes forwards.
    """
    last = len(line.x) - 1
    foot = first
    while True:
        along_x, along_y = line.x[foot + 1] - line.x[foot], line.y[foot + 1] - line.y[foot]
        share = ((x - line.x[foot]) * along_x + (y - line.y[foot]) * along_y) / (along_x**2 + along_y**2)
        if share < 1.0 or foot + 2 > last:
            break
        foot += 1
    return foot, min(max(share, 0.0), 1.0)


@njit(cache=True, nogil=True)
def goal_point(x: float, y: float, distance: float, line: Line, first: int) -> tuple[float, float]:
    """Return the first point, m, of the line at or behind sample `first` that is `distance` away from (x, y).

    On the piece from p_i to p_i+1 it solves |p_i + u (p_i+1 − p_i) − (x, y)|² = distance², a quadratic equation in u.
    Where the line does not get that far it is its last point, and where `first` is farther away already, that one.

    Args:
        x: East of the car, m.
        y: North, m.
        distance: m, the lookahead distance.
        line: The line.
        first: Sample to begin with.

    Returns:
        East and north, m.
    """
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


@njit(cache=True, nogil=True)
def pursuit_angle(
    x: float, y: float, heading: float, goal_x: float, goal_y: float, lookahead: float, wheelbase: float
) -> float:
    """Return the road wheel angle of PP eq. 1, δ = atan(2 L sin α / h), in rad, positive to the left.

    Args:
        x: East of the car's rear axle, m.
        y: North, m.
        heading: Where the car points, rad anticlockwise from east.
        goal_x: East of the goal point, m.
        goal_y: North, m.
        lookahead: h, m.
        wheelbase: L, m.
    """
    bearing = math.atan2(goal_y - y, goal_x - x) - heading
    return math.atan(2 * wheelbase * math.sin(bearing) / lookahead)
