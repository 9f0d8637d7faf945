"""Pure pursuit along any path, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@njit(cache=True, nogil=True)
def steering_towards(
    x: FloatArray,
    y: FloatArray,
    heading: FloatArray,
    distances: FloatArray,
    path_x: FloatArray,
    path_y: FloatArray,
    first: IntArray,
    stop: IntArray,
    wheelbase: float,
) -> FloatArray:
    """Return the steering of PP eq. 1 towards the points of a path that are given distances away.

    The goal point of a distance is where the path, followed from point `first`, first gets that far from the car,
    interpolated between the path's points.

    Args:
        x: East of the cars (n,), m.
        y: North of the cars, m.
        heading: Where the cars point, rad anticlockwise from east.
        distances: h (n, k), m, ascending in each row.
        path_x: East of the path's points (m,), m.
        path_y: North of the path's points, m.
        first: Point of the path (n,) that is not ahead of each car any more.
        stop: Point before which the path ends for each car; `first` or less where there is none.
        wheelbase: L, m.

    Returns:
        Road wheel angles (n, k), deg, positive to the left; NaN where the path does not get that far, where it is
        farther away from the beginning, and where anything is NaN.
    """
    angles = np.full(distances.shape, np.nan)
    for t in range(len(x)):
        i = first[t]
        if i >= stop[t] or math.isnan(heading[t]):
            continue
        cosine, sine = math.cos(heading[t]), math.sin(heading[t])
        east, north = path_x[i] - x[t], path_y[i] - y[t]
        far = math.hypot(east, north)
        before_east, before_north, near = east, north, far
        for k in range(distances.shape[1]):
            h = distances[t, k]
            if not near <= h:
                continue
            while far < h and i + 1 < stop[t]:
                i += 1
                before_east, before_north, near = east, north, far
                east, north = path_x[i] - x[t], path_y[i] - y[t]
                far = math.hypot(east, north)
            if not far >= h:
                break
            along_east, along_north = east - before_east, north - before_north
            square = along_east**2 + along_north**2
            share = 1.0
            if square > 0.0:
                half = before_east * along_east + before_north * along_north
                root = math.sqrt(max(half**2 - square * (near**2 - h**2), 0.0))
                share = min(max((root - half) / square, 0.0), 1.0)
            goal_east, goal_north = before_east + share * along_east, before_north + share * along_north
            sideways = cosine * goal_north - sine * goal_east  # h sin α
            angles[t, k] = math.degrees(math.atan(2.0 * wheelbase * sideways / h**2))
    return angles


@njit(cache=True, nogil=True)
def _nearest(
    x: float, y: float, course: float, path_x: FloatArray, path_y: FloatArray, first: int, segments: int, closed: bool
) -> tuple[float, int, float]:
    """Return distance, segment and share of it of the nearest point of some segments that go the car's way."""
    n = len(path_x) - 1
    best, place, along = np.inf, -1, 0.0
    for k in range(segments):
        i = first + k
        if closed:
            i %= n
        elif not 0 <= i < n:
            continue
        east, north = path_x[i + 1] - path_x[i], path_y[i + 1] - path_y[i]
        if not math.cos(course) * east + math.sin(course) * north > 0.0:
            continue
        share = ((x - path_x[i]) * east + (y - path_y[i]) * north) / (east**2 + north**2)
        share = min(max(share, 0.0), 1.0)
        distance = math.hypot(path_x[i] + share * east - x, path_y[i] + share * north - y)
        if distance < best:
            best, place, along = distance, i, share
    return best, place, along


@njit(cache=True, nogil=True)
def follow(
    x: FloatArray,
    y: FloatArray,
    course: FloatArray,
    run: npt.NDArray[np.int32],
    path_x: FloatArray,
    path_y: FloatArray,
    spacing: float,
    closed: bool,
    farthest: float,
) -> FloatArray:
    """Return where along a path a car is: the number of the point behind it plus the share of the way to the next.

    The nearest point in the direction of travel is sought on the whole path once, then near the last one, so that a
    path may cross itself.

    Args:
        x: East of the car (n,), m.
        y: North, m.
        course: Direction of travel, rad.
        run: Number of the run of every sample.
        path_x: East of the path's points (m,), `spacing` apart, the first one again as the last one where it is closed.
        path_y: North of them, m.
        spacing: m.
        closed: The path begins anew where it ends.
        farthest: m, NaN is returned where the path is farther away.

    Returns:
        (n,).
    """
    places = np.full(len(x), np.nan)
    last = -1
    for t in range(len(x)):
        if t == 0 or run[t] != run[t - 1] or not farthest >= 0.0:
            last = -1
        distance, place, share = np.inf, -1, 0.0
        if last >= 0:
            moved = math.hypot(x[t] - x[t - 1], y[t] - y[t - 1])
            if not math.isnan(moved):
                behind, ahead = int(5.0 / spacing) + 1, int((2.0 * moved + 5.0) / spacing) + 1
                distance, place, share = _nearest(
                    x[t], y[t], course[t], path_x, path_y, last - behind, behind + ahead + 1, closed
                )
        if not distance <= farthest:
            distance, place, share = _nearest(x[t], y[t], course[t], path_x, path_y, 0, len(path_x) - 1, closed)
        last = -1
        if distance <= farthest:
            last = place
            # The last point is the end of its segment, not the beginning of one that is not there.
            places[t] = place + min(share, 1.0 - 1e-9)
    return places


@njit(cache=True, nogil=True)
def most_likely_path(cost: FloatArray, run: npt.NDArray[np.int32], change: FloatArray) -> IntArray:
    """Return the states whose cost and cost of change sum to the least, run by run (Viterbi).

    Args:
        cost: Of every state at every sample (n, k), finite.
        run: Number of the run of every sample; nothing is carried from one to the next.
        change: Cost of going up or down by 0, 1, … states between samples; farther is not allowed.

    Returns:
        The state of every sample (n,).
    """
    n, states = cost.shape
    came_from = np.zeros((n, states), np.int64)
    total = np.empty((2, states))
    chosen = np.zeros(n, np.int64)
    begin = 0
    for t in range(n):
        now, before = total[t % 2], total[(t + 1) % 2]
        if t == 0 or run[t] != run[t - 1]:
            begin = t
            now[:] = cost[t]
        else:
            for k in range(states):
                best, source = np.inf, k
                for i in range(max(k - len(change) + 1, 0), min(k + len(change), states)):
                    candidate = before[i] + change[abs(i - k)]
                    if candidate < best:
                        best, source = candidate, i
                now[k] = best + cost[t, k]
                came_from[t, k] = source
        if t == n - 1 or run[t + 1] != run[t]:
            chosen[t] = np.argmin(now)
            for u in range(t, begin, -1):
                chosen[u - 1] = came_from[u, chosen[u]]
    return chosen
