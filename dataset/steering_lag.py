"""How much a driver's steering lags what the driver sees, and how unsteady it is, told by a reference path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..schemas.config import Lookahead
from .path import Floats, Runs
from .reference import Reference

MINIMUM_S = 60.0
"""s of driving along the reference; with less nothing is estimated."""

LONGEST_LAG = 1.0
"""s."""

UNCERTAIN = 0.1
"""s, a standard error above which a lag is not to be trusted."""

SLOWEST = 2.0
"""m/s; slower driving is manoeuvring."""

_BLOCK_S = 10.0
_ROUNDS = 60
_DERIVATIVE_NS = 100_000_000
_PREVIEWS = np.arange(0.0, 3.1, 0.5)
"""s ahead, where the road's curvature is taken to tell the road's part in the steering from the driver's noise."""


@dataclass(frozen=True, slots=True)
class Sight:
    """What a driver had before the eyes on one recording.

    Attributes:
        x: East of the car (n_samples,), m.
        y: North, m.
        heading: Where the car points, deg.
        speed: m/s.
        road_wheel_angle: deg, positive to the left.
        run: Number of the run of every sample.
        path_x: East of the points of the path that is followed (n_points,), m.
        path_y: North of them, m.
        first: The point of the path that the car has reached (n_samples,).
        stop: One past the last point that counts as ahead.
        reference: The path, where it is not the driven one.
        place: Where on the reference the car is (n_samples,), m; NaN where it does not follow it.
    """

    x: Floats
    y: Floats
    heading: Floats
    speed: Floats
    road_wheel_angle: Floats
    run: Runs
    path_x: Floats
    path_y: Floats
    first: NDArray[np.int64]
    stop: NDArray[np.int64]
    reference: Reference | None = None
    place: Floats | None = None

    def pursuit(self, distances: Floats, wheelbase: float) -> Floats:
        """Return PP's δ0 in deg towards the path at distances (n_samples, k) in m; NaN where it does not get there."""
        from .pursuit import steering_towards

        angles: Floats = steering_towards(
            self.x, self.y, np.radians(self.heading), distances, self.path_x, self.path_y, self.first, self.stop,
            wheelbase,
        )  # fmt: skip
        return angles


@dataclass(frozen=True, slots=True)
class Manner:
    """How a driver steers along a reference.

    Attributes:
        lag: s that the road wheels lag what the driver sees.
        lag_standard_error: s; None where the lag was not estimated.
        noise: deg at the road wheels, standard deviation of what pure pursuit does not explain.
        base: m, of the law h = base + time · speed that was fitted on the way; None where it was not.
        time: s, of the law.
        samples: That the estimate rests on.
        reason: Why nothing could be estimated; empty where it could.
    """

    lag: float
    lag_standard_error: float | None
    noise: float
    base: float | None
    time: float | None
    samples: int
    reason: str = ""


def without_lag(angle: Floats, run: Runs, lag: float, period: int) -> Floats:
    """Return what the driver wanted: the angle with its lag undone.

    Arms follow eyes, wheels follow hands: two first-order lags of half the time each, whose inverse is
    δ + τ δ' + (τ/2)² δ''. The derivatives are taken over 0.1 s on either side.

    Args:
        angle: δ (n_samples,), deg.
        run: Number of the run of every sample.
        lag: τ, s.
        period: ns between samples.

    Returns:
        (n_samples,), deg; NaN within 0.1 s of the ends of a run, unless the lag is 0.
    """
    if lag == 0.0:
        return angle
    wanted = np.full(len(angle), np.nan)
    reach = max(1, round(_DERIVATIVE_NS / period))
    if len(angle) > 2 * reach:
        step = reach * period / 1e9
        before, now, after = angle[: -2 * reach], angle[reach:-reach], angle[2 * reach :]
        ahead = now + lag * (after - before) / (2 * step) + (lag / 2) ** 2 * (after + before - 2 * now) / step**2
        wanted[reach:-reach] = np.where(run[2 * reach :] == run[: -2 * reach], ahead, np.nan)
    return wanted


def estimate_manner(
    sights: Sequence[Sight], wheelbase: float, settings: Lookahead, period: int, typical_noise: float
) -> Manner:
    """Estimate lag and noise of a driver's steering by the law h = base + time · speed.

    The three are fitted together so that the steering with its lag undone is that of PP eq. 1. Least squares would not
    do: the driver's noise moves the car, the car's place enters eq. 1, and so the noise is not independent of what it
    is to be told from (it would lengthen lag and distance). But it is independent of the road. So the changes of the
    misfit with the three parameters enter as what the road's curvature ahead says of them (two-stage least squares,
    the curvature 0 to 3 s ahead, with and without the speed, as instruments), robustly weighted. The standard error is
    from blocks of ten seconds.

    Args:
        sights: The driver's recordings, each with a reference.
        wheelbase: L, m.
        settings: The range of distances; a lag that is a number there is taken as it is.
        period: ns between samples.
        typical_noise: deg, returned where none can be estimated.
    """
    given = None if settings.steering_lag == "estimate" else settings.steering_lag

    def nothing(samples: int, reason: str) -> Manner:
        return Manner(given or 0.0, None, typical_noise, None, None, samples, reason)

    if not sights:
        return nothing(0, "no recording has a reference")
    speed = np.concatenate([sight.speed for sight in sights])

    def misfit(parameters: Floats) -> Floats:
        base, time, lag = parameters
        parts = []
        for sight in sights:
            h = np.clip(base + time * sight.speed, max(settings.minimum, 0.1), settings.maximum)
            pursuit = sight.pursuit(h[:, np.newaxis], wheelbase)[:, 0]
            parts.append(without_lag(sight.road_wheel_angle, sight.run, lag, period) - pursuit)
        return np.concatenate(parts)

    curvature = np.concatenate([_curvature_ahead(sight) for sight in sights])
    instruments = np.concatenate([curvature, curvature * speed[:, np.newaxis]], axis=1)
    steps = np.diag([0.1, 0.01, 0.02])[: 2 if given is not None else 3]
    free = len(steps)
    parameters = np.array([5.0, 0.7, 0.2 if given is None else given])
    for _ in range(_ROUNDS):
        error = misfit(parameters)
        slopes = np.stack(
            [(misfit(parameters + step) - misfit(parameters - step)) / (2 * step.max()) for step in steps], axis=1
        )
        used = np.isfinite(error) & np.isfinite(slopes).all(axis=1) & (speed > SLOWEST)
        samples = int(used.sum())
        if samples * period < MINIMUM_S * 1e9:
            return nothing(samples, f"{samples * period / 1e9:.0f} s along the reference, {MINIMUM_S:g} s are needed")
        noise = 1.4826 * float(np.median(np.abs(error[used])))
        weight = 1.0 / np.maximum(1.0, np.abs(error[used]) / max(3.0 * noise, 1e-12))
        root = np.sqrt(weight)[:, np.newaxis]
        of_road = instruments[used]
        told = of_road @ np.linalg.lstsq(of_road * root, slopes[used] * root, rcond=None)[0]
        weighted = told * weight[:, np.newaxis]
        normal = weighted.T @ slopes[used]
        if np.linalg.cond(normal) > 1e12:
            return nothing(samples, "the reference does not bend enough")
        inverse = np.linalg.inv(normal)
        change = np.clip(-inverse @ (weighted.T @ error[used]), -1.0, 1.0)
        before = parameters.copy()
        parameters[:free] += change
        parameters[2] = min(max(parameters[2], 0.0), LONGEST_LAG)
        if np.all(np.abs(parameters - before) < [1e-4, 1e-5, 1e-5]):
            break
    else:
        return nothing(samples, "lag and distance cannot be told apart")
    base, time, lag = map(float, parameters)
    if given is not None:
        return Manner(given, None, noise, base, time, samples)
    blocks = np.arange(samples) // max(1, round(_BLOCK_S * 1e9 / period))
    score = np.stack([np.bincount(blocks, column) for column in (weighted * error[used, np.newaxis]).T])
    standard_error = float(np.sqrt((inverse @ score @ score.T @ inverse.T)[2, 2]))
    if not standard_error <= UNCERTAIN or lag >= LONGEST_LAG:
        return nothing(samples, f"the lag would be {lag:.2f} ± {standard_error:.2f} s, which says nothing")
    return Manner(lag, standard_error, noise, base, time, samples)


def _curvature_ahead(sight: Sight) -> Floats:
    """Return the reference's curvature (n_samples, n_previews), 1/m, at `_PREVIEWS` s ahead; 0 where it is unknown."""
    if sight.reference is None or sight.place is None:
        raise ValueError("a sight without a reference says nothing about lag")
    places = sight.place[:, np.newaxis] + sight.speed[:, np.newaxis] * _PREVIEWS
    return sight.reference.curvature(places)
