"""The driver's lookahead distance, found backwards from what was driven (PP eq. 1 to 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..schemas.config import Lookahead
from .path import Floats, Runs, begins_run

TYPICAL_NOISE = 0.1
"""deg at the road wheels, where the noise is neither given nor can be estimated."""

Integers = NDArray[np.int64]

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
    noise: float = TYPICAL_NOISE,
) -> tuple[Floats, Floats]:
    """Return the lookahead distance that explains the steering best, and how well it is determined.

    Candidates are the next N = `settings.points` points of the driven path within the run; else as `among_points`.

    Args:
        x: East of the origin (n_samples,), m.
        y: North of the origin, m.
        heading: Where the car points, deg anticlockwise from east.
        road_wheel_angle: δ, deg, positive to the left.
        run: Number of the run of every sample; equal only within one run.
        wheelbase: L, m.
        settings: N and the range of the candidates.
        noise: Of the road wheel angle, deg.

    Returns:
        The lookahead distance (n_samples,) in m, and the spread in m.
    """
    first, stop = points_ahead(run, settings.points)
    return among_points(x, y, heading, road_wheel_angle, x, y, first, stop, wheelbase, settings, noise)


def points_ahead(run: Runs, points: int) -> tuple[Integers, Integers]:
    """Return the next and the end of the next `points` samples (n_samples,) of every sample within its run."""
    index = np.arange(len(run))
    ends = np.append(begins_run(run)[1:], True) if len(run) else np.zeros(0, np.bool_)
    end = np.minimum.accumulate(np.where(ends, index + 1, len(run))[::-1])[::-1]
    return index + 1, np.minimum(end, index + points + 1)


def among_points(
    x: Floats,
    y: Floats,
    heading: Floats,
    road_wheel_angle: Floats,
    path_x: Floats,
    path_y: Floats,
    first: Integers,
    stop: Integers,
    wheelbase: float,
    settings: Lookahead,
    noise: float,
) -> tuple[Floats, Floats]:
    """Return which point of a path explains the steering best (PP eq. 3), and how well that is determined.

    Of the points `first` to `stop` of the path, those at a straight-line distance h within [`minimum`, `maximum`] are
    candidates. Pure pursuit steers δ0 = atan(2 L sin α / h) towards a candidate, α being the angle from the heading to
    it; the candidate with the smallest |δ − δ0| gives the lookahead distance, the earliest one among equals.

    Args:
        x: East of the car (n_samples,), m.
        y: North, m.
        heading: Where the car points, deg anticlockwise from east.
        road_wheel_angle: δ, deg, positive to the left.
        path_x: East of the path's points (n_points,), m.
        path_y: North of them, m.
        first: Of the candidates (n_samples,).
        stop: One past the last candidate; `first` or less where there is none.
        wheelbase: L, m.
        settings: Range of the candidates.
        noise: Of the road wheel angle, deg.

    Returns:
        The lookahead distance (n_samples,) in m, NaN where there is no candidate or an input is NaN; and the spread
        in m: largest minus smallest h of the candidates with |δ − δ0| ≤ the best + `noise`.
    """
    best = np.full(len(x), np.nan)
    spread = np.full(len(x), np.nan)
    most = max(int((stop - first).max(initial=0)), 1)
    block = max(1, _CELLS // most)
    for start in range(0, len(x), block):
        rows = slice(start, start + block)
        ahead = first[rows, np.newaxis] + np.arange(most)
        exists = ahead < stop[rows, np.newaxis]
        ahead[~exists] = 0
        east, north = path_x[ahead] - x[rows, np.newaxis], path_y[ahead] - y[rows, np.newaxis]
        h = np.hypot(east, north)
        psi = np.radians(heading[rows, np.newaxis])
        sideways = np.cos(psi) * north - np.sin(psi) * east  # h sin α, without the angle
        with np.errstate(divide="ignore", invalid="ignore"):
            pursuit = np.degrees(np.arctan(2.0 * wheelbase * sideways / h**2))
        error = np.abs(road_wheel_angle[rows, np.newaxis] - pursuit)
        is_candidate = exists & (h >= settings.minimum) & (h <= settings.maximum) & (h > 0)
        error[~is_candidate | np.isnan(error)] = np.inf

        smallest = error.min(axis=1)
        found = np.isfinite(smallest)
        choice = np.argmax(error <= smallest[:, np.newaxis] + _EQUAL, axis=1)
        best[rows] = np.where(found, h[np.arange(len(choice)), choice], np.nan)
        spread[rows] = spread_of(h, error, noise)
    return best, spread


def spread_of(h: Floats, error: Floats, noise: Floats | float) -> Floats:
    """Return the range in m of the distances that explain the steering as well as the best one, but for its noise.

    Args:
        h: Distances (n_samples, n_candidates) or (n_candidates,), m.
        error: |δ − δ0| of each (n_samples, n_candidates), deg; infinite where it is no candidate.
        noise: deg, one for all or of each candidate (n_candidates,).

    Returns:
        Largest minus smallest distance (n_samples,), NaN where no error is finite.
    """
    explains = np.isfinite(error) & (error <= error.min(axis=1, keepdims=True) + noise)
    farthest = np.where(explains, h, -np.inf).max(axis=1)
    nearest = np.where(explains, h, np.inf).min(axis=1)
    found = np.isfinite(farthest)
    spread: Floats = np.subtract(farthest, nearest, out=np.full(len(error), np.nan), where=found)
    return spread
