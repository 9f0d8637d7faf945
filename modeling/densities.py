"""Log densities of a mixture's components over rows, and the parameters that they are computed from."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .estimator import FloatArray, Rows

if TYPE_CHECKING:
    from .wide_rows import Bound

NARROW = 8
"""Columns up to which a compiled loop is faster than BLAS and LAPACK."""

CHUNK_VALUES = 2**18
"""Values in one array of a chunk."""

BLOCK = 1024
"""Most rows of many columns in a chunk: enough for BLAS to be fast, few enough for the nearer caches."""

LEADING = 24
"""Columns that log densities are bounded by. With 12, 24 and 48 of 153 columns of simulated windows 2.0, 1.7 and 1.6 of
9 components are left to compute, and 1.1 matter."""

FEWEST_TO_BOUND = 2 * LEADING
"""Columns from which on the bound costs less than it saves."""

NOTHING = 40.0
"""Nats below the most likely component from which on a component changes no sum of doubles."""


def negligible(precision: npt.DTypeLike) -> float:
    """Return the nats below a row's likelihood from which on what a component adds vanishes in the rounding of sums.

    The responsibility exp(−nats) is about u = 2⁻⁵³ ≈ 1e-16 in double and 2⁻²⁴ ≈ 6e-8 in single precision.
    """
    return 16.0 if np.dtype(precision) == np.float32 else 37.0


@dataclass(frozen=True, slots=True)
class Parameters:
    """Weights (k,), means μ (k, d), covariances Σ = F Fᵀ (k, d, d), lower factors F, and W = F⁻¹ (k, d, d).

    Means and factors are in the units of the data. W is rounded to the precision that is computed in, and F is the
    inverse of the rounded W: a pass works with exactly these parameters, so that rounding them leads no M step astray.
    """

    weights: FloatArray
    means: FloatArray
    covariances: FloatArray
    factors: FloatArray
    inverses: FloatArray
    precision: np.dtype[Any]

    def of_leading(self, m: int) -> Parameters:
        """Return those of the first m columns: factors of leading columns are the leading parts of the factors."""
        square = (slice(None), slice(m), slice(m))
        covariances, factors, inverses = (
            plain(matrices[square]) for matrices in (self.covariances, self.factors, self.inverses)
        )
        return Parameters(self.weights, plain(self.means[:, :m]), covariances, factors, inverses, self.precision)


def factorise(
    weights: FloatArray, means: FloatArray, covariances: FloatArray, precision: npt.DTypeLike = np.float64
) -> Parameters:
    """Return parameters with their factors and inverses, computed once: Σ = F Fᵀ (Cholesky), W = F⁻¹.

    Args:
        weights: Positive weights (k,); divided by their sum.
        means: Shape (k, d), in the units of the data.
        covariances: Positive definite (k, d, d), in the square of these units.
        precision: What W is rounded to.

    Raises:
        numpy.linalg.LinAlgError: A covariance is not positive definite.
    """
    if means.shape[1] <= NARROW and precision == np.float64:
        from .narrow_rows import lower_factors

        factors, inverses, fine = lower_factors(plain(covariances))
        if not fine:
            raise np.linalg.LinAlgError("a covariance is not positive definite")
        return Parameters(weights / weights.sum(), means, covariances, factors, inverses, np.dtype(precision))
    from scipy.linalg.lapack import dtrtri

    factors = np.linalg.cholesky(covariances).astype(np.float64, copy=False)
    inverses = np.array([dtrtri(factor, lower=1)[0] for factor in factors])
    if precision != np.float64:
        inverses = inverses.astype(precision).astype(np.float64)
        factors = np.array([dtrtri(inverse, lower=1)[0] for inverse in inverses])
    return Parameters(weights / weights.sum(), means, covariances, factors, inverses, np.dtype(precision))


def rounding_noise(parameters: Parameters) -> float:
    """Return by how much rounding x − μ to float32 raises a row's squared Mahalanobis distance, on average.

    Each difference is off by up to u = 2⁻²⁴ of itself either way, with a variance of u²/3 of its own square: it is
    Σ_k p_k Σ_ij W_ij² Σ_jj u²/3, a number without a unit, half of which are nats.
    """
    spread = np.diagonal(parameters.covariances, axis1=1, axis2=2)
    raised = np.einsum("kij,kj->k", np.square(parameters.inverses), spread)
    return float(parameters.weights @ raised) * (2.0**-24) ** 2 / 3.0


def chunks(rows: Rows, components: int = 1, most: int = CHUNK_VALUES) -> Iterator[slice]:
    """Yield slices of at most so many rows (n, d) that neither they nor their values by component are too many."""
    n, d = rows.shape
    step = min(max(CHUNK_VALUES // max(d, components), 64), most)
    for start in range(0, n, step):
        yield slice(start, min(start + step, n))


def plain(rows: npt.ArrayLike) -> FloatArray:
    """Return rows (n, d), of any units, as compiled code takes them, for one kind of array; uncopied where they are."""
    return np.require(rows, np.float64, ["C", "W"])


def log_sum(joint: FloatArray) -> FloatArray:
    """Return log Σ_k exp j_k of each row j of `joint` (n, k), nats, shape (n,)."""
    top = joint.max(axis=1)
    total: FloatArray = top + np.log(np.exp(joint - top[:, None]).sum(axis=1))
    return total


def log_constants(weights: FloatArray, inverses: FloatArray) -> FloatArray:
    """Return each component's log p_k g_k at its mean (MP eq. 5), log p_k − d/2 log 2π + log |W_k|, nats (k,).

    Args:
        weights: Positive weights p (k,).
        inverses: W (k, d, d), lower triangular, in the inverse units of the data.
    """
    log_determinants = np.log(np.diagonal(inverses, axis1=1, axis2=2)).sum(axis=1)
    constants: FloatArray = np.log(weights) - 0.5 * inverses.shape[1] * math.log(2 * math.pi) + log_determinants
    return constants


def evenly_spread(d: int) -> npt.NDArray[np.intp]:
    """Return which of d columns log densities are bounded by, (m,): few, evenly spread; none where rows are short."""
    return np.linspace(0, d - 1, LEADING if d >= FEWEST_TO_BOUND else 0).astype(np.intp)


def bound_of(parameters: Parameters, columns: npt.NDArray[np.integer[Any]]) -> Bound:
    """Return what bounds the log densities by some of the columns (m,), or none where there is nothing to choose.

    Over columns m alone |W_m (x − μ)_m|², with W_m = F_m⁻¹ of their covariance, is at most that over all columns.
    """
    from .wide_rows import Bound

    k = len(parameters.weights)
    m = len(columns) if k > 1 else 0
    chosen = columns[:m].astype(np.uint32)
    centre = (parameters.weights @ parameters.means)[chosen]
    inverses = np.linalg.inv(np.linalg.cholesky(parameters.covariances[:, chosen[:, None], chosen]))
    offsets = np.einsum("kij,kj->ki", inverses, parameters.means[:, chosen] - centre)
    return Bound(
        chosen,
        centre,
        inverses.reshape(k * m, m).astype(parameters.precision),
        offsets.ravel().astype(parameters.precision),
        log_constants(parameters.weights, inverses),
    )


def log_joint(rows: npt.NDArray[np.floating[Any]], parameters: Parameters, cutoff: float = math.inf) -> FloatArray:
    """Return log p_k g_k(x) = log p_k g_k(μ_k) − ½ |W_k (x − μ_k)|² (MP eq. 5), nats (n, k).

    Args:
        rows: x (n, d), in the units of the parameters.
        parameters: The mixture.
        cutoff: nats; −inf stands where a component is certain to lie further below the top.
    """
    constants = log_constants(parameters.weights, parameters.inverses)
    joint = np.empty((len(rows), len(constants)))
    if cutoff == math.inf or rows.shape[1] < FEWEST_TO_BOUND:
        for component, (mean, inverse) in enumerate(zip(parameters.means, parameters.inverses, strict=True)):
            y = (rows - mean) @ inverse.T
            joint[:, component] = constants[component] - 0.5 * np.einsum("ij,ij->i", y, y)
    else:
        from .panels import packed
        from .wide_rows import Components, wide_log_joint

        inverses, bound = packed(parameters.inverses), bound_of(parameters, evenly_spread(rows.shape[1]))
        components = Components(parameters.means, inverses, constants, bound, cutoff)
        wide_log_joint(plain(rows), components, joint)
    return joint
