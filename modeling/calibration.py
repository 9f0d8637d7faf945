"""Predictive distributions of each step, and what brings them into line with errors that were held out.

A mixture states a mean and a standard deviation. Its own are too small where driving differs from what it learnt, and
the errors have heavier tails than a Gaussian: no one factor makes both the 68 % and the 95 % band right. So the
distribution of an error is taken as Student's t with a scale and degrees of freedom for each step, fitted to errors on
blocks of the *training* data that were held out in turn. Both bands are quantiles of that one distribution.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FREEDOM = np.append(np.geomspace(2.2, 100.0, 200), np.inf)
"""Degrees of freedom to choose from; with 2 the variance would be infinite, infinitely many are a Gaussian."""

FARTHEST, NODES = 1e6, 1000
"""Where the distribution of |Z| is tabled: densely about 0, sparsely far out; beyond, it is 1 but for 1e-12."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """How the errors of a model are distributed, by step: scale · sd · Student's t with so many degrees of freedom.

    Attributes:
        scale: In standard deviations as the model states them (n_steps,).
        freedom: Degrees of freedom ν, pure numbers (n_steps,); infinite: Gaussian.
    """

    scale: Floats
    freedom: Floats

    @classmethod
    def gaussian(cls, steps: int) -> Self:
        """Return the distribution that a mean and a standard deviation stand for by themselves: scale 1, ν = ∞."""
        return cls(np.ones(steps), np.full(steps, np.inf))

    @classmethod
    def fit(cls, errors: Floats, sd: Floats) -> Self:
        """Let the central 68 % and 95 % bands hold just so much of held-out errors.

        With z₆₈ and z₉₅, the quantiles of |error| / sd, and t_ν(p), those of Student's t, ν is that of `FREEDOM` whose
        t_ν(0.975) / t_ν(0.84) is nearest to z₉₅ / z₆₈, and the scale = z₆₈ / t_ν(0.84), so that the narrower band is
        right exactly.

        Args:
            errors: What happened minus the predicted mean (n_samples, n_steps), on data that was not learnt from, in
                any unit; one sample at least.
            sd: Standard deviations that the model stated, above 0, like `errors`.
        """
        narrow, wide = np.quantile(np.abs(errors / sd), (0.68, 0.95), axis=0)
        narrow_of_t, wide_of_t = (_quantile(FREEDOM, quantile) for quantile in (0.84, 0.975))
        nearest = np.abs((wide / narrow)[:, None] - wide_of_t / narrow_of_t).argmin(axis=1)
        return cls(narrow / narrow_of_t[nearest], FREEDOM[nearest])

    def half_width(self, sd: Floats, share: float) -> Floats:
        """Return half the width w of the central band that holds a share: w = sd · scale · t_ν((1 + share) / 2).

        Args:
            sd: Standard deviations that the model stated (n_samples, n_steps).
            share: Between 0 and 1.

        Returns:
            Like `sd`, in its unit.
        """
        return sd * (self.scale * _quantile(self.freedom, (1.0 + share) / 2.0))

    def variance(self, sd: Floats) -> Floats:
        """Return the variance of the distribution, (sd · scale)² ν / (ν − 2).

        Args:
            sd: Standard deviations that the model stated (n_samples, n_steps), in any unit.

        Returns:
            Like `sd`, in the square of its unit.
        """
        heavier = 1.0 / (1.0 - 2.0 / self.freedom)
        return np.square(sd * self.scale) * heavier

    def probability(self, errors: Floats, sd: Floats) -> Floats:
        """Return the probability of a smaller error, u = F_ν(error / (sd · scale)): the probability integral transform.

        Args:
            errors: What happened minus the predicted mean (n_samples, n_steps), in any unit.
            sd: Standard deviations that the model stated, like `errors`.

        Returns:
            Shape (n_samples, n_steps), between 0 and 1.
        """
        return _distribution(self.freedom, errors / (sd * self.scale))

    def crps(self, errors: Floats, sd: Floats, probability: Floats | None = None) -> Floats:
        """Return the continuous ranked probability score in the unit of the errors (n_samples, n_steps).

        That is ∫ (F(y) − [y ≥ x])² dy in closed form: Gneiting and Raftery (2007) for the Gaussian, Jordan, Krüger and
        Lerch (2019) for Student's t. A forecast of one value without spread has its absolute error.

        Args:
            errors: What happened minus the predicted mean (n_samples, n_steps), in any unit.
            sd: Standard deviations that the model stated, like `errors`.
            probability: What `probability` says of them, like `errors`, where that is known already.
        """
        from scipy.special import beta

        width = sd * self.scale
        z = errors / width
        n = np.where(np.isinf(self.freedom), 3.0, self.freedom)
        constant = 1.0 / (np.sqrt(n) * beta(0.5, n / 2.0))
        density = constant * (1.0 + np.square(z) / n) ** (-(n + 1.0) / 2.0)
        peak = 2.0 * density * (n + np.square(z)) / (n - 1.0)
        spread = 2.0 * np.sqrt(n) / (n - 1.0) * beta(0.5, n - 0.5) / np.square(beta(0.5, n / 2.0))
        gaussian = 2.0 * np.exp(-np.square(z) / 2.0) / np.sqrt(2.0 * np.pi) - 1.0 / np.sqrt(np.pi)
        rest = np.where(np.isinf(self.freedom), gaussian, peak - spread)
        below = _distribution(self.freedom, z) if probability is None else probability
        score: Floats = width * (z * (2.0 * below - 1.0) + rest)
        return score

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what a file has to hold."""
        return {"scale": self.scale, "freedom": self.freedom}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """Return the calibration that `arrays` was taken from."""
        return cls(arrays["scale"], arrays["freedom"])


@dataclass(frozen=True, slots=True)
class Forecast:
    """What a model says of the steps ahead of each window.

    Attributes:
        mean: deg (n_windows, n_steps).
        sd: Standard deviation as the model states it, deg, like `mean`.
        calibration: How the errors are distributed in units of it.
    """

    mean: Floats
    sd: Floats
    calibration: Calibration

    @classmethod
    def gaussian(cls, mean: Floats, variance: Floats) -> Self:
        """Return a forecast of Gaussians with means, deg, and variances, deg², each (n_windows, n_steps); sd = √var."""
        return cls(mean, np.sqrt(variance), Calibration.gaussian(mean.shape[1]))


def _distribution(freedom: Floats, z: Floats) -> Floats:
    """Return P(Z ≤ z) of Student's t, of the Gaussian where the degrees of freedom (n_steps,) are infinite."""
    from scipy.special import ndtr

    below = np.empty(z.shape)
    for step, own in enumerate(freedom.tolist()):
        values = z[:, step]
        if math.isinf(own):
            below[:, step] = ndtr(values)
        else:
            of_size = _upper_half(own)(np.minimum(np.abs(values), FARTHEST))
            below[:, step] = np.where(values < 0, 1.0 - of_size, of_size)
    return below


@cache
def _upper_half(freedom: float) -> Callable[[Floats], Floats]:
    """Return P(Z ≤ z) of Student's t as a function of z from 0 to `FARTHEST`, right to 1e-9.

    It is cubic between `NODES` values, whose slopes are the density: `stdtr` takes 200 ns a value, and evaluations ask
    for half a million of each forecast.
    """
    from scipy.interpolate import CubicHermiteSpline
    from scipy.special import beta, stdtr

    z = np.sinh(np.linspace(0.0, math.asinh(FARTHEST), NODES))
    density = (1.0 + np.square(z) / freedom) ** (-(freedom + 1.0) / 2.0) / (math.sqrt(freedom) * beta(0.5, freedom / 2))
    spline: Callable[[Floats], Floats] = CubicHermiteSpline(z, stdtr(freedom, z), density)
    return spline


def _quantile(freedom: Floats, probability: float) -> Floats:
    """Return the inverse of `_distribution` at one probability, like `freedom`."""
    from scipy.special import ndtri, stdtrit

    of_t = stdtrit(np.where(np.isinf(freedom), 1.0, freedom), probability)
    quantile: Floats = np.where(np.isinf(freedom), ndtri(probability), of_t)
    return quantile
