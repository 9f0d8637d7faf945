"""The lookahead distance as a trajectory: between path points, lag undone, continuous where the steering is silent."""

from __future__ import annotations

import numpy as np

from ..schemas.config import Lookahead
from .lookahead import spread_of
from .path import Floats
from .steering_lag import Sight, without_lag

STEP = 0.02
"""Of the logarithm of the distance between the candidates: 2 % apart."""

CHANGE = 0.1
"""Share by which the distance wanders within a second, standard deviation: about what 2 m/s² of braking makes of it."""

MEMORY_S = 0.4
"""s; a driver's unsteadiness lasts, and misfits within that time count as one."""

_MOST_NOISES = 3.0
"""A misfit says no more against a distance than at so many noises; distances within them may be the driver's."""

_FASTEST = 8


def refined_lookahead(
    sight: Sight, wheelbase: float, settings: Lookahead, period: int, lag: float, noise: float
) -> tuple[Floats, Floats]:
    """Return the most likely trajectory of the lookahead distance, and how well the steering alone determines it.

    Candidates are distances 2 % apart; the goal point of each lies on the path where it first gets that far away,
    between its points. A position that is e off across the path turns the steering towards it by 2 L e / h², so that
    the noise σ of a misfit is that of the steering and this one. A trajectory costs (misfit / σ)² / 2 + log σ for every
    `MEMORY_S`, where the misfit counts as three σ at most, and (change of log h)² / (2 `CHANGE`² per second); dynamic
    programming finds the cheapest of each run. Where the steering crosses that of a candidate and its neighbour, the
    distance is that of the crossing.

    Args:
        sight: The recording, n samples.
        wheelbase: L, m.
        settings: Range of distances.
        period: ns between samples.
        lag: s that the road wheels lag what the driver sees.
        noise: deg at the road wheels.

    Returns:
        The lookahead distance (n,) in m, NaN where no candidate has a steering; and the spread in m, a third of the
        range of the distances within three σ of the best one (`spread_of`): what one σ makes of it where the steering
        changes evenly with the distance, and much more where some other distance explains it nearly as well.
    """
    from .pursuit import most_likely_path

    lowest = max(settings.minimum, 0.1)
    count = int(np.log(settings.maximum / lowest) / STEP) + 1
    h = lowest * np.exp(STEP * np.arange(count))
    samples = len(sight.x)
    pursuit = sight.pursuit(np.broadcast_to(h, (samples, count)), wheelbase)
    misfit = without_lag(sight.road_wheel_angle, sight.run, lag, period)[:, np.newaxis] - pursuit
    known = np.isfinite(misfit)
    error = np.where(known, np.abs(misfit), np.inf)
    second = period / 1e9
    of_misfit = np.hypot(noise, np.degrees(2.0 * wheelbase * settings.position_noise / h**2))
    cost = np.minimum(error / of_misfit, _MOST_NOISES) ** 2 / 2 + np.log(of_misfit / noise)
    cost *= min(second / MEMORY_S, 1.0)
    cost[~known.any(axis=1)] = 0.0
    change = (STEP * np.arange(_FASTEST + 1)) ** 2 / (2 * CHANGE**2 * second)
    chosen = most_likely_path(cost, np.asarray(sight.run, np.int32), change)

    rows = np.arange(samples)
    distance = h[chosen]
    own = misfit[rows, chosen]
    for neighbour in (chosen - 1, chosen + 1):
        other = misfit[rows, np.clip(neighbour, 0, count - 1)]
        crosses = (own * other < 0) & (neighbour >= 0) & (neighbour < count)
        share = np.divide(own, own - other, out=np.zeros(samples), where=crosses)
        distance = np.where(crosses, h[chosen] + share * (h[np.clip(neighbour, 0, count - 1)] - h[chosen]), distance)
    spread = spread_of(h, error, _MOST_NOISES * of_misfit) / _MOST_NOISES
    return np.where(known.any(axis=1), distance, np.nan), spread
