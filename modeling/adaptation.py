"""Adaptation of a mixture to the rows of one driver, or of one type of path: relevance MAP (Reynolds et al. 2000).

A few minutes of one driver are too little for a mixture of many channels, but enough to say how the driver differs from
the mixture of all. With responsibilities ρ of the prior mixture's components for the rows x, n_k = Σ ρ_k,
E_k[x] = Σ ρ_k x / n_k, E_k[xxᵀ] likewise, and the relevance r, a number of rows:

    α_k = n_k / (n_k + r)
    μ̂_k = α_k E_k[x] + (1 − α_k) μ_k                                   (Reynolds eqs. 11, 12)
    Σ̂_k = α_k E_k[xxᵀ] + (1 − α_k) (Σ_k + μ_k μ_kᵀ) − μ̂_k μ̂_kᵀ          (eq. 13, whole matrices instead of diagonals)
    p̂_k ∝ n_k + r K p_k

It is as though r rows that follow the prior's component stood beside the driver's own in each component: a driver with
few rows stays close to the prior, one with many becomes their own. Reynolds weights p by α_k as well, which maximises
nothing; here the r K rows are shared out by the prior's weights (a Dirichlet prior), so that every step raises the
posterior. He takes the responsibilities of the prior once; repeated steps take those of the adapted mixture.

D. A. Reynolds, T. F. Quatieri, R. B. Dunn: Speaker verification using adapted Gaussian mixture models. Digital Signal
Processing 10 (2000).
"""

from __future__ import annotations

import numpy as np

from .estimator import FloatArray
from .mixture import GaussianMixture

STEPS = 3
"""EM steps of an adaptation; one changes little less, five no more."""


def adapt(
    prior: GaussianMixture,
    rows: FloatArray,
    relevance: float,
    *,
    weights: bool = True,
    covariances: bool = True,
    noise: FloatArray | float = 0.0,
    steps: int = STEPS,
) -> GaussianMixture:
    """Adapt a mixture to rows by EM with the mixture as conjugate prior, by the formulas of the module.

    Args:
        prior: Mixture with K components of d channels.
        rows: What to adapt to (n_rows, d), in the units of the prior.
        relevance: r above 0, number of rows that the prior stands for in each component.
        weights: Adapt the weights; without, they stay the prior's.
        covariances: Adapt the covariances; without, they stay the prior's.
        noise: Sum of squares of further rows of noise, a figure or (d,), in the squared units of the prior; divided by
            n_k + r it is added to the diagonal of each Σ̂_k.
        steps: EM steps; 1 is Reynolds' adaptation.

    Returns:
        A mixture of as many components; the prior itself where there are no rows.

    Raises:
        ValueError: The relevance is not positive, or the rows do not have the prior's channels, or hold missing values.
    """
    if not relevance > 0:
        raise ValueError(f"relevance must be positive, found {relevance!r}")
    if not len(rows):
        return prior
    k, d = prior.means_.shape
    of_noise = np.diag(np.broadcast_to(noise, d))
    mixture = prior
    for _ in range(steps):
        own, of_rows, spread = mixture.moments(rows)
        counts = own + relevance
        means = (own[:, None] * of_rows + relevance * prior.means_) / counts[:, None]
        adapted = prior.covariances_
        if covariances:
            moved, shifted = (of[:, :, None] * of[:, None, :] for of in (of_rows - means, prior.means_ - means))
            of_prior = relevance * (prior.covariances_ + shifted)
            adapted = (own[:, None, None] * (spread + moved) + of_prior + of_noise) / counts[:, None, None]
        shares = own + relevance * k * prior.weights_ if weights else prior.weights_
        mixture = GaussianMixture.from_parameters(shares, means, adapted)
    return mixture
