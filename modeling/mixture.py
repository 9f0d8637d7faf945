"""Gaussian mixtures fitted by expectation maximisation (MP eqs. 4 to 7, PP eqs. 5 to 9)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self, get_args

import numpy as np
import numpy.typing as npt

from .densities import NOTHING, Parameters, bound_of, chunks, log_joint, log_sum
from .estimator import Estimator, FloatArray, RowSource, as_array, as_rows, as_sample_weights
from .expectation_maximisation import (
    CovarianceType,
    Sample,
    Settings,
    component_moments,
    in_double,
    maximise,
    moments_of,
    parameters_of,
    variances_of,
)
from .one_thread import one_blas_thread
from .starts import StartKind, search

if TYPE_CHECKING:
    from .wide_rows import Bound

ParameterCount = Literal["full", "paper"]
Precision = Literal["auto", "double"]


class GaussianMixture(Estimator):
    """A mixture of k Gaussians, Σ p_k g_k(x; μ_k, Σ_k) (MP eqs. 4 and 5).

    `fit` follows scikit-learn's conventions and gives its numbers from the same start. The start is found on at most
    20,000 rows, where each of `n_starts` k-means or random starts is followed by EM; the best three compete for a few
    steps on all rows. E and M step are one pass in chunks of rows, so that beside `X` some 30 megabytes are needed, and
    four bytes for each row and component where columns are many; `X` may be a `RowSource`, whose rows are made chunk by
    chunk.

    A component is dropped when it has collapsed: fewer effective rows (sum of responsibilities) than `n_features + 1`
    (2 where covariances are diagonal, 1 where they are tied), so that its covariance is made of regularisation alone in
    some direction, or a covariance that is not positive definite. `weights_` is then shorter than `n_components`; the
    last component is never dropped.

    With many columns and rows the products of a pass are computed in single precision, in coordinates where every
    component is the unit ball, and summed up in double precision. The log-likelihood is then right to 1e-7 or so; where
    the covariances are too ill-conditioned for that, or a likelihood falls, EM goes on in double precision.

    Args:
        n_components: Number k of components.
        covariance_type: "full"; "tied", the same for all components; or "diagonal". `covariances_` has one shape.
        covariance_regularisation: Added to each covariance's diagonal, in units of the variance of that channel over
            all rows (of 1 where a channel is constant): a change of units changes nothing.
        start: "k-means", or "random" responsibilities.
        n_starts: Number of starts.
        max_iterations: Most M steps, on the rows of the starts and on all rows each.
        tolerance: EM ends when the mean log-likelihood of a row rises by less, in nats.
        warm_start: Whether a further `fit` begins where the one before ended.
        precision: "double" allows no single precision.
        threads: Threads of a pass. They change the time, not the result.
        random_state: Seed or generator of the starts; None draws another start each time.

    Attributes:
        weights_: Weights p, shape (k,).
        means_: Means μ, shape (k, n_features), in the units of the data.
        covariances_: Covariances Σ, shape (k, n_features, n_features), in products of these units.
        converged_: False where `max_iterations` ended the fit.
        n_iterations_: M steps on all rows since the last dropped component.
        log_likelihoods_: Mean log-likelihood of a row before the first and after each M step since the last dropped
            component, shape (n_iterations_ + 1,); never falls, and the last one is `score` of the training rows. The
            regularisation can make an M step lower the likelihood: such a step is taken back and ends the fit.
        n_features_in_: Number of columns.
    """

    _estimator_type: ClassVar[str] = "density_estimator"

    weights_: FloatArray
    means_: FloatArray
    covariances_: FloatArray
    converged_: bool
    n_iterations_: int
    log_likelihoods_: FloatArray

    def __init__(
        self,
        n_components: int = 1,
        *,
        covariance_type: CovarianceType = "full",
        covariance_regularisation: float = 1e-6,
        start: StartKind = "k-means",
        n_starts: int = 1,
        max_iterations: int = 200,
        tolerance: float = 1e-5,
        warm_start: bool = False,
        precision: Precision = "auto",
        threads: int = 1,
        random_state: int | np.random.Generator | None = 0,
    ) -> None:
        self.n_components = n_components
        self.covariance_type = covariance_type
        self.covariance_regularisation = covariance_regularisation
        self.start = start
        self.n_starts = n_starts
        self.max_iterations = max_iterations
        self.tolerance = tolerance
        self.warm_start = warm_start
        self.precision = precision
        self.threads = threads
        self.random_state = random_state

    @classmethod
    def from_parameters(
        cls, weights: npt.ArrayLike, means: npt.ArrayLike, covariances: npt.ArrayLike, **settings: Any
    ) -> Self:
        """Return a fitted mixture of given parameters.

        Args:
            weights: Positive weights, shape (k,); divided by their sum.
            means: Shape (k, n_features), in any units.
            covariances: Symmetric and positive definite, shape (k, n_features, n_features), in products of these units.
            settings: Further arguments of the constructor.

        Raises:
            ValueError: The shapes do not belong together, or a weight or covariance is not positive.
        """
        return cls._of(parameters_of(weights, means, covariances), **settings)

    @classmethod
    def _of(cls, parameters: Parameters, **settings: Any) -> Self:
        mixture = cls(len(parameters.weights), **settings)
        mixture._keep(parameters)
        mixture.converged_, mixture.n_iterations_ = True, 0
        mixture.log_likelihoods_ = np.empty(0)
        return mixture

    def fit(
        self,
        X: npt.ArrayLike | RowSource,
        y: object = None,  # noqa: ARG002 - part of scikit-learn's protocol
        sample_weight: npt.ArrayLike | None = None,
        *,
        initial_responsibilities: npt.ArrayLike | None = None,
        initial_mixture: GaussianMixture | None = None,
    ) -> Self:
        """Fit the mixture by expectation maximisation: θ̂ = arg max log L(θ) (PP eq. 7), MP eq. 7 its E step.

        Args:
            X: Rows, shape (n_samples, n_features), float32 or float64 in any units; never copied as a whole.
            y: Ignored.
            sample_weight: How often each row counts, shape (n_samples,), zero or positive; only ratios matter.
            initial_responsibilities: Start from an M step with these, shape (n_samples, n_components), shares whose sum
                is 1 in every row.
            initial_mixture: Start from this fitted mixture.

        Raises:
            ValueError: A setting, shape or value is not usable; there are fewer rows than components; or, without
                regularisation, no component keeps a positive definite covariance.
        """
        self._check_settings()
        rows = as_rows(X, "X")
        n = len(rows)
        if n < max(self.n_components, 1):
            raise ValueError(
                f"Expected n_samples >= n_components but got n_components = {self.n_components}, n_samples = {n}: "
                f"a minimum of {self.n_components} is required."
            )
        if initial_mixture is None and self.warm_start and hasattr(self, "means_"):
            initial_mixture = self
        if initial_mixture is not None and initial_mixture.n_features_in_ != rows.shape[1]:
            raise ValueError(
                f"X has {rows.shape[1]} features, but initial_mixture has {initial_mixture.n_features_in_}"
            )
        responsibilities = None
        if initial_responsibilities is not None:
            responsibilities = self._check_responsibilities(initial_responsibilities, n)
        sample = Sample(rows, as_sample_weights(sample_weight, n))
        with one_blas_thread():
            variances = variances_of(sample)
            settings = Settings(
                self.covariance_regularisation * variances,
                self.covariance_type,
                self.max_iterations,
                self.tolerance,
                single=self.precision == "auto",
                threads=self.threads,
            )
            if initial_mixture is not None:
                start = parameters_of(initial_mixture.weights_, initial_mixture.means_, initial_mixture.covariances_)
                run = maximise(sample, start, settings)
            elif responsibilities is not None:
                run = maximise(sample, moments_of(sample, responsibilities, settings), settings)
            else:
                generator = np.random.default_rng(self.random_state)
                scale = np.sqrt(variances)
                run = search(sample, self.n_components, self.start, self.n_starts, scale, settings, generator)
        self._keep(in_double(run.parameters))
        self.log_likelihoods_, self.converged_ = np.array(run.log_likelihoods), run.converged
        self.n_iterations_ = len(self.log_likelihoods_) - 1
        return self

    def score_samples(self, X: npt.ArrayLike) -> FloatArray:
        """Return the log density of each row in nats (log of MP eq. 4), shape (n_samples,).

        Args:
            X: Rows, shape (n_samples, n_features), in the units of the data.

        Raises:
            ValueError: See `log_joint`.
        """
        return log_sum(self._log_joint(X, NOTHING))

    def score(
        self,
        X: npt.ArrayLike,
        y: object = None,  # noqa: ARG002 - part of scikit-learn's protocol
        sample_weight: npt.ArrayLike | None = None,
    ) -> float:
        """Return the mean log density of a row in nats, Σ w log G(x) / Σ w.

        Args:
            X: As for `score_samples`, shape (n_samples, n_features).
            y: Ignored.
            sample_weight: As for `fit`, shape (n_samples,).

        Raises:
            ValueError: See `log_joint`; or the weights cannot be used.
        """
        densities = self.score_samples(X)
        return float(np.average(densities, weights=as_sample_weights(sample_weight, len(densities))))

    def predict_proba(self, X: npt.ArrayLike) -> FloatArray:
        """Return each row's posterior responsibilities (MP eq. 7), shape (n_samples, k).

        Args:
            X: As for `score_samples`, shape (n_samples, n_features).

        Raises:
            ValueError: See `log_joint`.
        """
        joint = self._log_joint(X, NOTHING)
        return np.exp(joint - log_sum(joint)[:, None])

    def predict(self, X: npt.ArrayLike) -> npt.NDArray[np.intp]:
        """Return each row's most probable component from 0 (MP eq. 6, PP eq. 9), shape (n_samples,).

        Args:
            X: As for `score_samples`, shape (n_samples, n_features).

        Raises:
            ValueError: See `log_joint`.
        """
        labels: npt.NDArray[np.intp] = self._log_joint(X, NOTHING).argmax(axis=1)
        return labels

    def log_joint(self, X: npt.ArrayLike) -> FloatArray:
        """Return log p_k + log g_k(x) (MP eqs. 4 and 5) for each row and component in nats, shape (n_samples, k).

        Args:
            X: As for `score_samples`, shape (n_samples, n_features).

        Raises:
            ValueError: The mixture is not fitted, or the rows have another number of columns or missing values.
        """
        return self._log_joint(X, math.inf)

    def moments(self, X: npt.ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what rows say of each component: by their responsibilities ρ, what an M step takes from them.

        Args:
            X: Rows, shape (n_samples, n_features), in the units of the data.

        Returns:
            Counts n_k = Σ ρ_k (k,), means Σ ρ_k x / n_k (k, n_features), and covariances about them
            (k, n_features, n_features), in these units. Those of a component that no row belongs to mean nothing.

        Raises:
            ValueError: The mixture is not fitted, or the rows have another number of columns or missing values.
        """
        self._require_fit("means_")
        with one_blas_thread():
            return component_moments(self._rows(X), self._parameters)

    @property
    def factors(self) -> FloatArray:
        """Lower triangular F of each component, Σ = F Fᵀ (k, n_features, n_features), in the units of the data."""
        self._require_fit("means_")
        return self._parameters.factors

    @property
    def inverses(self) -> FloatArray:
        """Lower triangular W of each component, Wᵀ W = Σ⁻¹ (k, n_features, n_features), in inverse units."""
        self._require_fit("means_")
        return self._parameters.inverses

    def bound(self, columns: npt.NDArray[np.integer[Any]], precision: npt.DTypeLike = np.float64) -> Bound:
        """Return what bounds the log densities of components by some columns (m,), see `densities.bound_of`."""
        self._require_fit("means_")
        return bound_of(replace(self._parameters, precision=np.dtype(precision)), columns)

    def sample(
        self, n_samples: int = 1, random_state: int | np.random.Generator | None = 0
    ) -> tuple[FloatArray, npt.NDArray[np.intp]]:
        """Draw rows: a component k with probability p_k, then μ_k + F_k z, Σ_k = F_k F_kᵀ and z from N(0, I).

        Args:
            n_samples: How many.
            random_state: Seed or generator; None draws others each time.

        Returns:
            Rows in random order, shape (n_samples, n_features), in the units of the data, and the component each was
            drawn from, (n_samples,).

        Raises:
            ValueError: The mixture is not fitted.
        """
        self._require_fit("means_")
        generator = np.random.default_rng(random_state)
        labels = generator.choice(len(self.weights_), n_samples, p=self.weights_).astype(np.intp, copy=False)
        rows = generator.standard_normal((n_samples, self.n_features_in_))
        for component, factor in enumerate(self._parameters.factors):
            own = labels == component
            rows[own] = self.means_[component] + rows[own] @ factor.T
        return rows, labels

    def n_parameters(self, parameter_count: ParameterCount = "full") -> int:
        """Return the number of free parameters that BIC and AIC charge for.

        Args:
            parameter_count: "full" counts weights, means and covariances, k − 1 + kd + kd(d + 1)/2, where the last
                term is d(d + 1)/2 if covariances are tied and kd if they are diagonal; "paper" is 2k + kd of PP eq. 8,
                which charges one figure for a covariance.

        Raises:
            ValueError: The mixture is not fitted.
        """
        self._require_fit("means_")
        k, d = len(self.weights_), self.n_features_in_
        if parameter_count == "paper":
            return 2 * k + k * d
        triangle = d * (d + 1) // 2
        return k - 1 + k * d + {"full": k * triangle, "tied": triangle, "diagonal": k * d}[self.covariance_type]

    def bic(self, X: npt.ArrayLike, parameter_count: ParameterCount = "full") -> float:
        """Return −2 log L + p log n of rows (n, n_features), nats, −2 times PP eq. 8; the lower, the better.

        Args:
            X: As for `score_samples`, shape (n, n_features).
            parameter_count: What p counts, see `n_parameters`.

        Raises:
            ValueError: See `log_joint`.
        """
        scores = self.score_samples(X)
        return float(-2.0 * scores.sum() + self.n_parameters(parameter_count) * math.log(len(scores)))

    def aic(self, X: npt.ArrayLike, parameter_count: ParameterCount = "full") -> float:
        """Return −2 log L + 2 p of rows (n, n_features), nats; arguments and errors as for `bic`."""
        return float(-2.0 * self.score_samples(X).sum() + 2 * self.n_parameters(parameter_count))

    def marginal(self, dimensions: Sequence[int] | npt.NDArray[np.integer[Any]]) -> GaussianMixture:
        """Return the mixture that the given columns (n_columns,) follow, in the given order: their rows of μ and Σ.

        Raises:
            ValueError: The mixture is not fitted.
            IndexError: There is no such column.
        """
        self._require_fit("means_")
        index = np.asarray(dimensions, dtype=np.intp)
        m = len(index)
        if 0 < m <= self.n_features_in_ and (index == np.arange(m)).all():
            return GaussianMixture._of(self._parameters.of_leading(m), covariance_type=self.covariance_type)
        return GaussianMixture.from_parameters(
            self.weights_,
            self.means_[:, index],
            self.covariances_[:, index[:, None], index],
            covariance_type=self.covariance_type,
        )

    def _check_settings(self) -> None:
        wrong = [
            f"{name} must be {need}, found {getattr(self, name)!r}"
            for name, need, good in (
                ("n_components", "at least 1", self.n_components >= 1),
                ("covariance_type", "full, tied or diagonal", self.covariance_type in get_args(CovarianceType)),
                ("covariance_regularisation", "zero or positive", self.covariance_regularisation >= 0),
                ("start", "k-means or random", self.start in get_args(StartKind)),
                ("n_starts", "at least 1", self.n_starts >= 1),
                ("max_iterations", "zero or positive", self.max_iterations >= 0),
                ("tolerance", "zero or positive", self.tolerance >= 0),
                ("precision", "auto or double", self.precision in get_args(Precision)),
                ("threads", "at least 1", self.threads >= 1),
            )
            if not good
        ]
        if wrong:
            raise ValueError("; ".join(wrong))

    def _check_responsibilities(self, values: npt.ArrayLike, n: int) -> npt.NDArray[np.floating[Any]]:
        responsibilities = as_array(values, "initial_responsibilities")
        if responsibilities.shape != (n, self.n_components):
            raise ValueError(
                f"initial_responsibilities must have the shape {(n, self.n_components)}, found {responsibilities.shape}"
            )
        if (responsibilities < 0).any() or not np.allclose(responsibilities.sum(axis=1), 1.0, atol=1e-6):
            raise ValueError("initial_responsibilities must be positive, and their sum 1 in every row")
        return responsibilities

    def _log_joint(self, X: npt.ArrayLike, cutoff: float) -> FloatArray:
        self._require_fit("means_")
        rows = self._rows(X)
        joint = np.empty((len(rows), len(self.weights_)))
        for part in chunks(rows, len(self.weights_)):
            joint[part] = log_joint(rows[part], self._parameters, cutoff)
        return joint

    def _keep(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self.weights_, self.means_, self.covariances_ = parameters.weights, parameters.means, parameters.covariances
        self.n_features_in_ = parameters.means.shape[1]
