"""The driver's lookahead distance, found backwards from what was driven (PP eq. 1 to 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..schemas.config import Lookahead
from .path import Floats, Runs

_CELLS = 200_000
# Deg: far above the rounding of these formulas and far below any steering. Without it, rounding would choose among
# the equally good points of a straight road.
_EQUAL = 1e-12


def lookahead_distance(
    x: Floats,
    y: Floats,
    heading: Floats,
    road_wheel_angle: Floats,
    run: Runs,
    wheelbase: float,
    settings: Lookahead,
) -> tuple[Floats, Floats]:
    """Return the lookahead distance that explains the steering best, and how well it is determined.

    Of the next N = `settings.points` points of the driven path within the run, those at a straight-line distance h
    within [`minimum`, `maximum`] are candidates. Pure pursuit steers δ0 = atan(2 L sin α / h) towards a candidate,
    α being the angle from the heading to it; the candidate with the smallest |δ − δ0| gives the lookahead distance,
    the earliest one among equals.

    Args:
        x: East of the origin (n_samples,), m.
        y: North of the origin, m.
        heading: Where the car points, deg anticlockwise from east.
        road_wheel_angle: δ, deg, positive to the left.
        run: Number of the run of every sample; equal only within one run.
        wheelbase: L, m.
        settings: Candidates, their range, and the noise of the road wheel angle.

    Returns:
        The lookahead distance (n_samples,) in m, NaN where there is no candidate or an input is NaN; and the spread
        in m: largest minus smallest h of the candidates with |δ − δ0| ≤ the best + `steering_noise`.
    """
    best = np.full(len(x), np.nan)
    spread = np.full(len(x), np.nan)
    block = max(1, _CELLS // settings.points)
    for start in range(0, len(x), block):
        rows = np.arange(start, min(start + block, len(x)))
        best[rows], spread[rows] = _of_rows(rows, x, y, heading, road_wheel_angle, run, wheelbase, settings)
    return best, spread


def _of_rows(
    rows: NDArray[np.int64],
    x: Floats,
    y: Floats,
    heading: Floats,
    road_wheel_angle: Floats,
    run: Runs,
    wheelbase: float,
    settings: Lookahead,
) -> tuple[Floats, Floats]:
    ahead = rows[:, np.newaxis] + np.arange(1, settings.points + 1)
    exists = ahead < len(x)
    ahead[~exists] = len(x) - 1
    own = rows[:, np.newaxis]
    east, north = x[ahead] - x[own], y[ahead] - y[own]
    h = np.hypot(east, north)
    psi = np.radians(heading[own])
    sideways = np.cos(psi) * north - np.sin(psi) * east  # h sin α, without the angle
    with np.errstate(divide="ignore", invalid="ignore"):
        pursuit = np.degrees(np.arctan(2.0 * wheelbase * sideways / h**2))
    error = np.abs(road_wheel_angle[own] - pursuit)
    is_candidate = exists & (run[ahead] == run[own]) & (h >= settings.minimum) & (h <= settings.maximum) & (h > 0)
    error[~is_candidate | np.isnan(error)] = np.inf

    smallest = error.min(axis=1, keepdims=True)
    found = np.isfinite(smallest[:, 0])
    choice = np.argmax(error <= smallest + _EQUAL, axis=1)
    explains = np.isfinite(error) & (error <= smallest + settings.steering_noise)
    farthest = np.where(explains, h, -np.inf).max(axis=1)
    nearest = np.where(explains, h, np.inf).min(axis=1)
    return (
        np.where(found, h[np.arange(len(rows)), choice], np.nan),
        np.subtract(farthest, nearest, out=np.full(len(rows), np.nan), where=found),
    )
