"""Expectation maximisation of Gaussian mixtures with full covariances: E and M step in one pass over chunks of rows."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .estimator import FloatArray

Rows = npt.NDArray[np.floating[Any]]

# Values in one array of a chunk: 512 kB of float64 stay in the cache from the E step to the M step.
CHUNK_VALUES = 2**16
# A responsibility below this vanishes in the rounding of the sums it would be added to.
NEGLIGIBLE = 1e-16


@dataclass(frozen=True, slots=True)
class Parameters:
    """Weights (k,), means (k, d), covariances Σ = L Lᵀ (k, d, d), their lower factors L and L⁻¹ (k, d, d)."""

    weights: FloatArray
    means: FloatArray
    covariances: FloatArray
    factors: FloatArray
    inverses: FloatArray


@dataclass(frozen=True, slots=True)
class Statistics:
    """What one pass over the rows leaves for the M step.

    The moments are those of y = L⁻¹(x − μ), L and μ of the pass: `first` is Σ r y (k, d), `second` the lower triangle
    of Σ r y yᵀ (k, d, d). In these coordinates every component is close to the unit ball whatever the units and the
    condition of the data, so that centring them afterwards cancels nothing.
    """

    log_likelihood: float
    counts: FloatArray
    first: FloatArray
    second: FloatArray


@dataclass(frozen=True, slots=True)
class Run:
    """What EM led to; the likelihoods are those of the fit since the last dropped component."""

    parameters: Parameters
    log_likelihoods: list[float]
    converged: bool


def parameters_of(weights: npt.ArrayLike, means: npt.ArrayLike, covariances: npt.ArrayLike) -> Parameters:
    """Return checked parameters of given arrays (k,), (k, d) and (k, d, d), the weights divided by their sum.

    Raises:
        ValueError: The shapes do not belong together, a weight is not positive or a covariance not positive definite.
    """
    weights, means, covariances = (np.array(values, dtype=np.float64) for values in (weights, means, covariances))
    if means.ndim != 2 or weights.shape != means.shape[:1] or covariances.shape != (*means.shape, means.shape[1]):
        raise ValueError(
            "expected weights (k,), means (k, n_features) and covariances (k, n_features, n_features), found "
            f"{weights.shape}, {means.shape} and {covariances.shape}"
        )
    if not (weights > 0).all():
        raise ValueError(f"weights must be positive, found {weights.min()}")
    singular = [str(number) for number, covariance in enumerate(covariances) if not _is_positive_definite(covariance)]
    if singular:
        raise ValueError(f"the covariance of component {', '.join(singular)} is not positive definite")
    return factorise(weights, means, covariances)


def factorise(weights: FloatArray, means: FloatArray, covariances: FloatArray) -> Parameters:
    """Return parameters of positive definite covariances, their factors and inverses computed once."""
    from scipy.linalg.lapack import dtrtri

    factors = np.linalg.cholesky(covariances)
    inverses = np.array([dtrtri(factor, lower=1)[0] for factor in factors])
    return Parameters(weights / weights.sum(), means, covariances, factors.astype(np.float64, copy=False), inverses)


def chunks(rows: Rows, components: int = 1) -> Iterator[slice]:
    """Yield slices over the rows so small that neither they nor their values by component exceed `CHUNK_VALUES`."""
    n, d = rows.shape
    step = max(CHUNK_VALUES // max(d, components), 64)
    for start in range(0, n, step):
        yield slice(start, min(start + step, n))


def log_sum(joint: FloatArray) -> FloatArray:
    """Return the log of the sum over the first axis of exponentials."""
    top = joint.max(axis=0)
    total: FloatArray = top + np.log(np.exp(joint - top).sum(axis=0))
    return total


def _is_positive_definite(matrix: FloatArray) -> bool:
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True


def variances_of(rows: Rows) -> FloatArray:
    """Return each channel's variance over all rows; 1 for a constant channel, which has no scale of its own."""
    origin = rows[0].astype(np.float64)
    mean = origin + sum((rows[part] - origin).sum(axis=0) for part in chunks(rows)) / len(rows)
    total = sum(np.square(rows[part] - mean).sum(axis=0) for part in chunks(rows))
    return np.where(total > 0, total / len(rows), 1.0)


def log_joint(rows: Rows, parameters: Parameters) -> tuple[FloatArray, list[FloatArray]]:
    """Return log p_k g_k(x) (k, n), and by component the whitened columns L⁻¹(x − μ), each (d, n).

    Samples are columns here: whatever is done to one row of such an array runs along memory.
    """
    from scipy.linalg.blas import dtrmm

    columns = np.ascontiguousarray(rows.T, dtype=np.float64)
    d, n = columns.shape
    joint = np.empty((len(parameters.weights), n))
    whitened: list[FloatArray] = []
    for k, inverse in enumerate(parameters.inverses):
        y = dtrmm(1.0, inverse.T, (columns - parameters.means[k][:, None]).T, side=1, overwrite_b=1).T
        whitened.append(y)
        log_determinant = -np.log(np.diagonal(inverse)).sum()
        constant = math.log(parameters.weights[k]) - 0.5 * d * math.log(2 * math.pi) - log_determinant
        joint[k] = constant - 0.5 * np.einsum("ij,ij->j", y, y)
    return joint, whitened


def maximise(rows: Rows, start: Parameters, ridge: FloatArray, max_iterations: int, tolerance: float) -> Run:
    """Run EM from `start` until the mean log-likelihood of a row rises by less than `tolerance`.

    Args:
        rows: Shape (n, d).
        start: Where to start.
        ridge: Added to each covariance's diagonal, shape (d,).
        max_iterations: Most M steps.
        tolerance: In nats.
    """
    parameters, statistics = start, _pass(rows, start)
    log_likelihoods = [statistics.log_likelihood]
    for _ in range(max_iterations):
        candidate, dropped = _update(parameters, statistics, ridge)
        outcome = _pass(rows, candidate)
        if dropped:
            parameters, statistics, log_likelihoods = candidate, outcome, [outcome.log_likelihood]
            continue
        rise = outcome.log_likelihood - log_likelihoods[-1]
        if rise >= 0:
            parameters, statistics = candidate, outcome
            log_likelihoods.append(outcome.log_likelihood)
        if rise < tolerance:
            return Run(parameters, log_likelihoods, converged=True)
    return Run(parameters, log_likelihoods, converged=False)


def step(rows: Rows, parameters: Parameters, ridge: FloatArray) -> Parameters:
    """Return one E and M step from `parameters`."""
    return _update(parameters, _pass(rows, parameters), ridge)[0]


def _pass(rows: Rows, parameters: Parameters) -> Statistics:
    """Return the likelihood of the parameters and the sums that the next M step needs."""
    from scipy.linalg.blas import dsyrk

    n, d = rows.shape
    k = len(parameters.weights)
    log_likelihood, counts, first = 0.0, np.zeros(k), np.zeros((k, d))
    second = [np.zeros((d, d), order="F") for _ in range(k)]
    for part in chunks(rows, k):
        joint, whitened = log_joint(rows[part], parameters)
        totals = log_sum(joint)
        log_likelihood += float(totals.sum())
        for component, (responsibilities, y) in enumerate(zip(np.exp(joint - totals), whitened, strict=True)):
            own = np.flatnonzero(responsibilities > NEGLIGIBLE)
            if not own.size:  # BLAS takes no empty matrix
                continue
            r = responsibilities[own]
            root = np.sqrt(r)
            weighted = y[:, own] * root
            counts[component] += r.sum()
            first[component] += weighted @ root
            second[component] = dsyrk(1.0, weighted.T, beta=1.0, c=second[component], trans=1, lower=1, overwrite_c=1)
    return Statistics(log_likelihood / n, counts, first, np.array(second))


def _update(parameters: Parameters, statistics: Statistics, ridge: FloatArray) -> tuple[Parameters, int]:
    """Return the M step's parameters and the number of components dropped on the way.

    Of several components with fewer rows than a covariance needs only the smallest goes at a time: what it leaves may
    be what the others lack.
    """
    k, d = parameters.means.shape
    kept = statistics.counts >= 1
    if k > 1 and statistics.counts.min() < d + 1:
        kept[statistics.counts.argmin()] = False
    found: list[tuple[float, FloatArray, FloatArray]] = []
    for component in np.flatnonzero(kept):
        count, factor = statistics.counts[component], parameters.factors[component]
        shift = statistics.first[component] / count
        lower = np.tril(statistics.second[component])
        moment = (lower + np.tril(lower, -1).T) / count - np.outer(shift, shift)
        covariance = factor @ moment @ factor.T
        covariance = 0.5 * (covariance + covariance.T) + np.diag(ridge)
        if _is_positive_definite(covariance):
            found.append((count, parameters.means[component] + factor @ shift, covariance))
    if not found:
        raise ValueError(
            "no component has a positive definite covariance: columns depend on each other, or there are fewer rows "
            "than columns; raise covariance_regularisation or leave such columns out"
        )
    counts, means, covariances = (np.array(values) for values in zip(*found, strict=True))
    return factorise(counts, means, covariances), k - len(found)


def moments_of(rows: Rows, responsibilities: Rows, ridge: FloatArray) -> Parameters:
    """Return the M step from given responsibilities (n, k): each component's moments about its own mean."""
    (n, d), k = rows.shape, responsibilities.shape[1]
    counts = responsibilities.sum(axis=0, dtype=np.float64)
    occupied = counts > 0
    responsibilities, counts, k = responsibilities[:, occupied], counts[occupied], int(occupied.sum())
    means, second = np.zeros((k, d)), np.zeros((k, d, d))
    for part in chunks(rows):
        means += responsibilities[part].T @ rows[part].astype(np.float64) / counts[:, None]
    for part in chunks(rows):
        for component in range(k):
            centred = rows[part] - means[component]
            second[component] += (responsibilities[part, component, None] * centred).T @ centred
    unit = np.broadcast_to(np.eye(d), (k, d, d))
    start = Parameters(counts / n, means, unit, unit, unit)
    return _update(start, Statistics(math.nan, counts, np.zeros((k, d)), second), ridge)[0]


def k_means(rows: Rows, k: int, generator: np.random.Generator, iterations: int = 30) -> npt.NDArray[np.intp]:
    """Return the labels of k-means from 0, shape (n,): a k-means++ start, then Lloyd's steps until they settle."""
    rows = rows - rows.mean(axis=0)
    squares = np.einsum("ij,ij->i", rows, rows)
    centres = rows[[generator.integers(len(rows))]]
    nearest = np.full(len(rows), np.inf)
    for _ in range(1, k):
        nearest = np.minimum(nearest, np.square(rows - centres[-1]).sum(axis=1))
        far = np.cumsum(nearest)
        centres = np.vstack(
            [centres, rows[np.searchsorted(far, generator.random() * far[-1], side="right") % len(rows)]]
        )
    labels = np.full(len(rows), -1, dtype=np.intp)
    for _ in range(iterations):
        distances = squares[:, None] - 2.0 * rows @ centres.T + np.einsum("ij,ij->i", centres, centres)
        previous, labels = labels, distances.argmin(axis=1)
        if (labels == previous).all():
            break
        for cluster in range(k):
            own = labels == cluster
            if own.any():
                centres[cluster] = rows[own].mean(axis=0)
    return labels
