"""What a driver has shown at each speed: the bounds of the bounded driver model that PP names as future work."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from .windows import Floats, Series

KNOTS = 9
"""Speeds that limits are told at; between them they are linear, beyond them held."""

FEWEST = 50
"""Samples without which a limit is that of all speeds."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits by speed, each (n,).

    Attributes:
        nearest: m, lookahead distance.
        farthest: m.
        angle: deg, of the steering wheel to either side.
        rate: deg/s, of the steering wheel to either side.
    """

    nearest: Floats
    farthest: Floats
    angle: Floats
    rate: Floats


@dataclass(frozen=True, slots=True)
class DriverLimits:
    """Limits of one driver at speeds (k,) in m/s, rising; see `Limits` for their units.

    The knots are quantiles of the speeds driven, equally far apart. At each stands a quantile of what the driver did
    between its two neighbours, so that nothing that is told between two knots is narrower than what was done there.
    """

    speed: Floats
    at_knots: Limits

    @classmethod
    def fit(cls, series: Series, step: float, lookahead_share: float = 0.98, steering_share: float = 0.998) -> Self:
        """Take the limits from what a driver did.

        Args:
            series: The driver's data.
            step: s between two rows of a stretch.
            lookahead_share: Share of the lookahead distances that lies within; as many beyond either end.
            steering_share: Share of the steering wheel's angles and rates, Δδ/step, that lies within.

        Raises:
            ValueError: There is no row with speed and steering, or none with a lookahead distance.
        """
        wheel = series.steering_wheel_angle
        rate = np.full(len(wheel), np.nan)
        rate[1:] = np.where(np.diff(series.stretch) == 0, np.diff(wheel) / step, np.nan)
        seen = np.isfinite(series.speed) & np.isfinite(wheel)
        known = seen & np.isfinite(series.lookahead)
        if not known.any():
            raise ValueError("limits need rows with speed, steering and lookahead distance, found none")
        speed = np.unique(np.quantile(series.speed[seen], np.linspace(0, 1, KNOTS)))
        bounds = np.concatenate([[-np.inf], speed, [np.inf]])

        def quantiles(values: Floats, rows: NDArray[Any], share: float) -> Floats:
            every = np.quantile(values[rows], share)
            told = []
            for low, high in zip(bounds[:-2], bounds[2:], strict=True):
                around = values[rows & (series.speed >= low) & (series.speed <= high)]
                told.append(np.quantile(around, share) if len(around) >= FEWEST else every)
            return np.array(told)

        beyond = (1 - lookahead_share) / 2
        turned = seen & np.isfinite(rate)
        return cls(
            speed,
            Limits(
                nearest=quantiles(series.lookahead, known, beyond),
                farthest=quantiles(series.lookahead, known, 1 - beyond),
                angle=quantiles(np.abs(wheel), seen, steering_share),
                rate=quantiles(np.abs(rate), turned if turned.any() else seen, steering_share),
            ),
        )

    def at(self, speed: Floats) -> Limits:
        """Return the limits, each (n,), at speeds (n,) in m/s: linear between the knots, held beyond them."""
        limits = (self.at_knots.nearest, self.at_knots.farthest, self.at_knots.angle, self.at_knots.rate)
        return Limits(*(np.interp(speed, self.speed, values) for values in limits))
