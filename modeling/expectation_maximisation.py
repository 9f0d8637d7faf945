"""Expectation maximisation of Gaussian mixtures: E and M step in one pass over chunks of rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from .densities import (
    BLOCK,
    NARROW,
    Parameters,
    bound_of,
    chunks,
    evenly_spread,
    factorise,
    log_constants,
    negligible,
    plain,
    rounding_noise,
)
from .distances import Distances
from .estimator import FloatArray, Rows

Work = Callable[[list[slice]], "Statistics"]

CovarianceType = Literal["full", "tied", "diagonal"]

SINGLE_ROWS = 20_000
"""Rows from which on single precision pays."""

TOGETHER, MOST_PARTS = 16, 16
"""Fewest chunks of many columns that go into the same sums, which are large, and most sums of all rows."""

SINGLE_NOISE = 1e-6
"""Nats that rounding rows to float32 may change a row's log-likelihood by on average; beyond that it is float64."""


@dataclass(frozen=True, slots=True)
class Settings:
    """How to run EM.

    Attributes:
        ridge: Added to each covariance's diagonal (d,), in the squared units of the rows.
        covariance_type: As `GaussianMixture` has it.
        max_iterations: Most M steps.
        tolerance: EM ends when the mean log-likelihood of a row rises by less, in nats.
        single: Whether float32 may be used where it is precise enough.
        threads: Threads of a pass; the result is the same with any number.
    """

    ridge: FloatArray
    covariance_type: CovarianceType = "full"
    max_iterations: int = 200
    tolerance: float = 1e-5
    single: bool = False
    threads: int = 1

    def steps(self, most: int) -> Settings:
        """Return the same with fewer M steps."""
        return replace(self, max_iterations=min(most, self.max_iterations))


@dataclass(frozen=True, slots=True)
class Sample:
    """Rows (n, d), in any units, and how often each counts (n,), 1 on average; None counts each once."""

    rows: Rows
    weights: FloatArray | None = None

    def weights_of(self, part: slice) -> FloatArray:
        """Return the weights of some of the rows (n,); none (0,) where each counts once."""
        return np.empty(0) if self.weights is None else self.weights[part]


@dataclass(slots=True)
class Statistics:
    """What one pass over the rows leaves for the M step.

    The log-likelihood is that of a row on average, nats, and `counts` is Σ r (k,), with the responsibilities r of MP
    eq. 7. The moments are those of y = W(x − μ), W and μ of the pass: `first` is Σ r y (k, d), `second` the lower
    triangle of Σ r y yᵀ (k, d, d). In these coordinates every component is close to the unit ball whatever the units
    and the condition of the data, so that centring them afterwards cancels nothing, and float32 is enough for the
    products.
    """

    log_likelihood: float
    counts: FloatArray
    first: FloatArray
    second: FloatArray

    @classmethod
    def zeros(cls, k: int, d: int) -> Statistics:
        """Return those of no rows."""
        return cls(0.0, np.zeros(k), np.zeros((k, d)), np.zeros((k, d, d)))

    def add(self, other: Statistics) -> None:
        """Add those of other rows."""
        self.log_likelihood += other.log_likelihood
        self.counts += other.counts
        self.first += other.first
        self.second += other.second


@dataclass(frozen=True, slots=True)
class Run:
    """What EM led to; the likelihoods, nats a row, are those of the fit since the last dropped component."""

    parameters: Parameters
    log_likelihoods: list[float]
    converged: bool


def parameters_of(weights: npt.ArrayLike, means: npt.ArrayLike, covariances: npt.ArrayLike) -> Parameters:
    """Return checked parameters of given arrays (k,), (k, d) and (k, d, d), the weights divided by their sum.

    Means are in the units of the data, covariances in their squares.

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
    try:
        return factorise(weights, means, covariances)
    except np.linalg.LinAlgError:
        singular = [str(number) for number, own in enumerate(covariances) if not _is_positive_definite(own)]
        raise ValueError(f"the covariance of component {', '.join(singular)} is not positive definite") from None


def _is_positive_definite(matrix: FloatArray) -> bool:
    try:
        factorise(np.ones(1), np.zeros((1, len(matrix))), matrix[None])
    except np.linalg.LinAlgError:
        return False
    return True


def variances_of(sample: Sample) -> FloatArray:
    """Return each channel's variance over all rows (d,), Σ w x²/n − (Σ w x/n)² about the first row, in squared units.

    It is 1 for a constant channel, which has no scale of its own.
    """
    rows, n = sample.rows, len(sample.rows)
    origin = rows[:1][0].astype(np.float64)  # within a few deviations of the mean, so that little cancels
    first, second = np.zeros_like(origin), np.zeros_like(origin)
    for part in chunks(rows):
        centred, weights = rows[part] - origin, sample.weights_of(part)
        first += weights @ centred if len(weights) else centred.sum(axis=0)
        np.square(centred, out=centred)
        second += weights @ centred if len(weights) else centred.sum(axis=0)
    variances = second / n - np.square(first / n)
    return np.where(variances > 0, variances, 1.0)


def maximise(sample: Sample, start: Parameters, settings: Settings) -> Run:
    """Run EM from `start` until the mean log-likelihood of a row (PP eq. 7) rises by less than the tolerance.

    With responsibilities r_k of a row (MP eq. 7), n_k = Σ r_k, the M step is p_k = n_k / n, μ_k = Σ r_k x / n_k and
    Σ_k = Σ r_k (x − μ_k)(x − μ_k)ᵀ / n_k + diag(ridge).

    It begins in single precision where that is allowed and pays, and goes over to double precision as soon as
    rounding would show: where covariances are too ill-conditioned, or a likelihood fell.

    Raises:
        ValueError: No component keeps a positive definite covariance.
    """
    single = settings.single and sample.rows.shape[1] > NARROW and len(sample.rows) >= SINGLE_ROWS
    parameters = _rounded(start) if single else start
    single = parameters.precision == np.float32
    distances = Distances.unknown(len(sample.rows), parameters)
    statistics = _pass(sample, parameters, settings.threads, distances)
    log_likelihoods = [statistics.log_likelihood]
    for _ in range(settings.max_iterations):
        candidate, dropped = _update(parameters, statistics, settings)
        if single:
            candidate = _rounded(candidate)
            single = candidate.precision == np.float32
        if dropped:
            distances = Distances.unknown(len(sample.rows), candidate)
        outcome = _pass(sample, candidate, settings.threads, distances)
        if dropped:
            parameters, statistics, log_likelihoods = candidate, outcome, [outcome.log_likelihood]
            continue
        rise = outcome.log_likelihood - log_likelihoods[-1]
        if rise < 0 and single:
            single, parameters = False, in_double(parameters)
            statistics = _pass(sample, parameters, settings.threads, distances)
            log_likelihoods[-1] = statistics.log_likelihood
            continue
        if rise >= 0:
            parameters, statistics = candidate, outcome
            log_likelihoods.append(outcome.log_likelihood)
        if rise < settings.tolerance:
            return Run(parameters, log_likelihoods, converged=True)
    return Run(parameters, log_likelihoods, converged=False)


def step(sample: Sample, parameters: Parameters, settings: Settings) -> Parameters:
    """Return one E and M step from `parameters`; formulas and errors are those of `maximise`."""
    return _update(parameters, _pass(sample, parameters, settings.threads), settings)[0]


def component_moments(rows: Rows, parameters: Parameters) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what `GaussianMixture.moments` does of rows (n, d), in their units; in single precision if it will do."""
    if rows.shape[1] > NARROW and len(rows) >= SINGLE_ROWS:
        parameters = _rounded(parameters)
    sums = _pass(Sample(rows), parameters, 1)
    return sums.counts, *_means_and_covariances(parameters, sums, np.maximum(sums.counts, np.finfo(np.float64).tiny))


def moments_of(sample: Sample, responsibilities: npt.NDArray[np.floating[Any]], settings: Settings) -> Parameters:
    """Return the M step from given responsibilities (n, k), moments about each component's own mean; see `maximise`.

    Raises:
        ValueError: No component has a positive definite covariance.
    """
    rows = sample.rows
    if sample.weights is not None:
        responsibilities = responsibilities * sample.weights[:, None]
    counts = responsibilities.sum(axis=0, dtype=np.float64)
    occupied = counts > 0
    responsibilities, counts = responsibilities[:, occupied], counts[occupied]
    k, d = len(counts), rows.shape[1]
    means, second = np.zeros((k, d)), np.zeros((k, d, d))
    for part in chunks(rows):
        means += responsibilities[part].T @ rows[part].astype(np.float64) / counts[:, None]
    for part in chunks(rows):
        chunk = rows[part]
        for component in range(k):
            own = np.flatnonzero(responsibilities[part, component])
            centred = chunk[own] - means[component]
            second[component] += (responsibilities[part][own, component, None] * centred).T @ centred
    unit = np.broadcast_to(np.eye(d), (k, d, d))
    start = Parameters(counts / counts.sum(), means, unit, unit, unit, np.dtype(np.float64))
    return _update(start, Statistics(math.nan, counts, np.zeros((k, d)), second), settings)[0]


def _rounded(parameters: Parameters) -> Parameters:
    """Return the parameters in single precision, or as they are where that is not precise enough for the data."""
    single = factorise(parameters.weights, parameters.means, parameters.covariances, np.float32)
    return single if 0.5 * rounding_noise(single) < SINGLE_NOISE else parameters


def in_double(parameters: Parameters) -> Parameters:
    """Return the parameters with factors of double precision."""
    if parameters.precision == np.float64:
        return parameters
    return factorise(parameters.weights, parameters.means, parameters.covariances)


def _pass(sample: Sample, parameters: Parameters, threads: int, distances: Distances | None = None) -> Statistics:
    """Return the mean log-likelihood of a row under the parameters and the sums that the next M step needs.

    Where distances are given, those of the pass before are used, and replaced.
    """
    k, d = parameters.means.shape
    if d <= NARROW:
        work, parts, together = _narrow_work(sample, parameters), list(chunks(sample.rows, k)), 1
    else:
        work, parts = _wide_work(sample, parameters, distances), list(chunks(sample.rows, k, BLOCK))
        together = max(TOGETHER, -(-len(parts) // MOST_PARTS))
    total = Statistics.zeros(k, d)
    for sums in _in_order(work, [parts[start : start + together] for start in range(0, len(parts), together)], threads):
        total.add(sums)
    total.log_likelihood /= len(sample.rows)
    return total


def _narrow_work(sample: Sample, parameters: Parameters) -> Work:
    """Return what sums up parts of rows of few columns."""
    from .narrow_rows import narrow_pass

    constants = log_constants(parameters.weights, parameters.inverses)
    model = (plain(parameters.means), plain(parameters.inverses), constants, negligible(np.float64))

    def work(parts: list[slice]) -> Statistics:
        sums = Statistics.zeros(*parameters.means.shape)
        into = (sums.counts, sums.first, sums.second)
        for part in parts:
            rows, weights = plain(sample.rows[part]), plain(sample.weights_of(part))
            sums.log_likelihood += narrow_pass(rows, weights, *model, *into)
        return sums

    return work


def _wide_work(sample: Sample, parameters: Parameters, distances: Distances | None) -> Work:
    """Return what sums up parts of rows of many columns."""
    from .panels import packed
    from .wide_rows import Components, add_collected, buffers_of, moments_into, wide_pass

    k, d = parameters.means.shape
    components = Components(
        parameters.means,
        packed(parameters.inverses, parameters.precision),
        log_constants(parameters.weights, parameters.inverses),
        bound_of(parameters, evenly_spread(d)),
        negligible(parameters.precision),
    )
    distances = distances or Distances.unknown(0, parameters)
    changes = distances.move(parameters)

    def work(parts: list[slice]) -> Statistics:
        sums = Statistics.zeros(k, d)
        buffers = buffers_of(components, parts[0].stop - parts[0].start)
        moments = moments_into(sums.counts, sums.first, sums.second, components.inverses)
        for part in parts:
            rows, weights = plain(sample.rows[part]), plain(sample.weights_of(part))
            sums.log_likelihood += wide_pass(
                rows, weights, components, distances.least[part], *changes, buffers, moments
            )
        for c in range(k):
            add_collected(c, moments)
        return sums

    return work


def _in_order(work: Work, parts: list[list[slice]], threads: int) -> Iterator[Statistics]:
    """Yield the results in the order of the parts, so that sums of them are the same with any number of threads."""
    if threads == 1 or len(parts) == 1:
        yield from map(work, parts)
        return
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(threads) as pool:
        yield from pool.map(work, parts)


def _means_and_covariances(
    parameters: Parameters, statistics: Statistics, counts: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return each component's mean (k, d) and covariance about it (k, d, d), for the counts that are to divide."""
    if parameters.means.shape[1] <= NARROW:
        from .narrow_rows import moments_about_means

        of_pass = plain(parameters.means), plain(parameters.factors)
        means, covariances = moments_about_means(*of_pass, plain(counts), statistics.first, statistics.second)
        return means, covariances
    shifts = statistics.first / counts[:, None]
    lower, second = np.tri(shifts.shape[1], dtype=np.bool_), statistics.second
    moments = np.where(lower, second, second.transpose(0, 2, 1)) / counts[:, None, None]
    moments -= shifts[:, :, None] * shifts[:, None, :]
    means = parameters.means + np.einsum("kij,kj->ki", parameters.factors, shifts)
    covariances = parameters.factors @ moments @ parameters.factors.transpose(0, 2, 1)
    return means, 0.5 * (covariances + covariances.transpose(0, 2, 1))


def _update(parameters: Parameters, statistics: Statistics, settings: Settings) -> tuple[Parameters, int]:
    """Return the M step's parameters and the number of components dropped on the way.

    Of several components with fewer rows than a covariance needs only the smallest goes at a time: what it leaves may
    be what the others lack.
    """
    k, d = parameters.means.shape
    counts = statistics.counts
    kept = counts >= 1
    if k > 1 and counts.min() < {"full": d + 1, "diagonal": 2, "tied": 1}[settings.covariance_type]:
        kept[counts.argmin()] = False
    means, covariances = _means_and_covariances(parameters, statistics, np.maximum(counts, 1.0))
    if settings.covariance_type == "diagonal":
        covariances *= np.eye(d)
    elif settings.covariance_type == "tied" and kept.any():
        pooled = np.tensordot(counts[kept], covariances[kept], axes=1) / counts[kept].sum()
        covariances = np.repeat(pooled[None], k, axis=0)
    covariances += np.diag(settings.ridge)
    with suppress(np.linalg.LinAlgError):
        return factorise(counts[kept], means[kept], covariances[kept]), k - int(kept.sum())
    kept &= [_is_positive_definite(covariance) for covariance in covariances]
    if not kept.any():
        raise ValueError(
            "no component has a positive definite covariance: columns depend on each other, or there are fewer rows "
            "than columns; raise covariance_regularisation or leave such columns out"
        )
    return factorise(counts[kept], means[kept], covariances[kept]), k - int(kept.sum())
