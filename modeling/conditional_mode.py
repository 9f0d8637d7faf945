"""The most probable output of a mixture regression: PP's eq. 10 read as printed, an arg max and not a mean."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .estimator import FloatArray
from .regression import MixtureRegression

Labels = npt.NDArray[np.integer]

NEGLIGIBLE = 1e-2
"""Components whose own peak is lower than this share of the row's highest one are no place to start from."""

STEPS = 100
NEAR = 1e-6
"""An ascent ends when it moves by less, in standard deviations of the narrowest component."""


def conditional_mode(regression: MixtureRegression, inputs: FloatArray) -> FloatArray:
    """Return where p(y | x) is highest, for a regression of one output.

    From the mean m_k of every component that matters the fixed point

        y ← Σ r_k m_k / C_k / Σ r_k / C_k,    r_k ∝ β_k N(y; m_k, C_k)

    climbs to a maximum (Carreira-Perpiñán 2000); the highest of them is the mode.

    Args:
        regression: A fitted regression with one output.
        inputs: Shape (n_samples, n_inputs), in the units of the data.

    Returns:
        Shape (n_samples,), in the output's unit.

    Raises:
        ValueError: The regression has more than one output, or the inputs another number of columns or missing values.
    """
    if regression.n_outputs_ != 1:
        raise ValueError(f"the mode is found for one output, and this regression has {regression.n_outputs_}")
    beta = regression.responsibilities(inputs)
    mean_in, mean_out = regression.mixture_.means_[:, :-1], regression.mixture_.means_[:, -1]
    slopes = regression.matrices_[:, 0, :]
    means = inputs @ slopes.T + (mean_out - (slopes * mean_in).sum(axis=1))
    variances = regression.conditional_covariances_[:, 0, 0]
    peak = beta / np.sqrt(variances)
    row, component = np.nonzero(peak >= NEGLIGIBLE * peak.max(axis=1, keepdims=True))
    y = means[row, component]
    moving = np.arange(len(row))
    for _ in range(STEPS):
        density = _densities(peak, means, variances, row[moving], y[moving])
        precision = density / variances
        climbed = (precision * means[row[moving]]).sum(axis=1) / precision.sum(axis=1)
        step = np.abs(climbed - y[moving])
        y[moving] = climbed
        moving = moving[step > NEAR * np.sqrt(variances.min())]
        if not len(moving):
            break
    height = _densities(peak, means, variances, row, y).sum(axis=1)
    highest = np.lexsort((-height, row))
    first = np.flatnonzero(np.diff(row[highest], prepend=-1))
    mode: FloatArray = y[highest[first]]
    return mode


def _densities(peak: FloatArray, means: FloatArray, variances: FloatArray, row: Labels, y: FloatArray) -> FloatArray:
    """Return β_k N(y; m_k, C_k) √(2π) of rows at their y, shape (n, k)."""
    density: FloatArray = peak[row] * np.exp(-0.5 * np.square(y[:, None] - means[row]) / variances)
    return density
