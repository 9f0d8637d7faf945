"""Gaussian mixture regression: the conditional distribution of some columns given the others (MP section III-C)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self, overload

import numpy as np
import numpy.typing as npt

from .densities import CHUNK_VALUES, NOTHING, chunks, log_constants, log_sum, negligible, plain
from .estimator import Estimator, FloatArray, Rows, as_array
from .input_order import spread, telling_first
from .mixture import GaussianMixture, Precision
from .one_thread import one_blas_thread
from .starts import StartKind

if TYPE_CHECKING:
    from .conditional import Conditional

FIRST = 8
"""Inputs by which the components are chosen that a prediction begins with."""

Indices = Sequence[int] | npt.NDArray[np.integer[Any]]


class MixtureRegression(Estimator):
    """Regression of Y on X by a Gaussian mixture of both.

    Each component k gives a linear regression with the matrix A_k = Σ_yx Σ_xx⁻¹: mean μ_y + A_k (x − μ_x) (MP eq. 18)
    and covariance Σ_yy − A_k Σ_xy (eq. 19). They are mixed with the posterior responsibilities β_k of the components
    given x, priors included, and the covariance of the prediction follows from the law of total covariance:

        mean = Σ β_k m_k,    covariance = Σ β_k (C_k + (m_k − mean)(m_k − mean)ᵀ)

    With `faithful` it is as the paper prints it: responsibilities without the priors (eq. 20), covariance Σ β_k² C_k
    (eq. 22), which is too small wherever components mix.

    Args:
        n_components: Number k of components.
        covariance_regularisation: As in `GaussianMixture`.
        start: As in `GaussianMixture`.
        n_starts: As in `GaussianMixture`.
        max_iterations: As in `GaussianMixture`.
        tolerance: As in `GaussianMixture`.
        precision: As in `GaussianMixture`.
        threads: As in `GaussianMixture`.
        random_state: As in `GaussianMixture`.
        faithful: Equations 20 and 22 as printed.

    Attributes:
        mixture_: The mixture of [x, y], inputs first.
        matrices_: A_k, shape (k, n_outputs, n_inputs), in the outputs' units over the inputs'.
        conditional_covariances_: C_k, shape (k, n_outputs, n_outputs), in products of the outputs' units.
        n_features_in_: Number of inputs.
        n_outputs_: Number of outputs.
    """

    _estimator_type: ClassVar[str] = "regressor"

    mixture_: GaussianMixture
    matrices_: FloatArray
    conditional_covariances_: FloatArray
    n_outputs_: int
    _predict_row: Callable[[FloatArray, FloatArray, FloatArray], float] | None

    def __init__(
        self,
        n_components: int = 1,
        *,
        covariance_regularisation: float = 1e-6,
        start: StartKind = "k-means",
        n_starts: int = 1,
        max_iterations: int = 200,
        tolerance: float = 1e-5,
        precision: Precision = "auto",
        threads: int = 1,
        random_state: int | np.random.Generator | None = 0,
        faithful: bool = False,
    ) -> None:
        self.n_components = n_components
        self.covariance_regularisation = covariance_regularisation
        self.start = start
        self.n_starts = n_starts
        self.max_iterations = max_iterations
        self.tolerance = tolerance
        self.precision = precision
        self.threads = threads
        self.random_state = random_state
        self.faithful = faithful

    @classmethod
    def from_mixture(
        cls,
        mixture: GaussianMixture,
        inputs: Indices,
        outputs: Indices,
        *,
        faithful: bool = False,
        single_output: bool = False,
    ) -> Self:
        """Return the regression that a fitted mixture holds (MP eqs. 16 and 17).

        Args:
            mixture: A fitted mixture, or one of given arrays (`GaussianMixture.from_parameters`).
            inputs: Its columns that are x (n_inputs,), in the order that `predict` takes them.
            outputs: Its columns that are y (n_outputs,); columns in neither are marginalised.
            faithful: As in the constructor.
            single_output: Predict arrays of shape (n_samples,), as after `fit` with a y of that shape.

        Raises:
            ValueError: A column is out of range or named twice, or there is none.
        """
        chosen = [int(column) for column in (*inputs, *outputs)]
        range_ = range(mixture.n_features_in_)
        times = Counter(chosen)
        wrong = [str(column) for column in chosen if column not in range_ or times[column] > 1]
        if wrong or not len(inputs) or not len(outputs):
            raise ValueError(
                f"inputs and outputs must each name some of the columns 0 to {len(range_) - 1}, each column once, "
                f"found {list(map(int, inputs))} and {list(map(int, outputs))}"
            )
        known = cls._parameter_names()
        settings = {name: value for name, value in mixture.get_params().items() if name in known[1:]}
        regression = cls(len(mixture.weights_), **settings, faithful=faithful)
        regression._condition(mixture.marginal(chosen), len(inputs), single_output=single_output)
        return regression

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> Self:
        """Return the regression that `arrays` was taken from.

        Raises:
            KeyError: An array is missing.
            ValueError: They do not belong together.
        """
        joint = GaussianMixture.from_parameters(arrays["weights"], arrays["means"], arrays["covariances"])
        regression = cls(len(joint.weights_), faithful=bool(arrays["faithful"]))
        single_output = bool(arrays["single_output"])
        regression._condition(joint, joint.n_features_in_ - int(arrays["outputs"]), single_output=single_output)
        return regression

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return what a file has to hold: the mixture of [x, y], inputs first, and the number of outputs."""
        self._require_fit("matrices_")
        return {
            "weights": self.mixture_.weights_,
            "means": self.mixture_.means_,
            "covariances": self.mixture_.covariances_,
            "outputs": np.array(self.n_outputs_),
            "single_output": np.array(self._single_output),
            "faithful": np.array(self.faithful),
        }

    def fit(self, X: npt.ArrayLike, y: npt.ArrayLike) -> Self:
        """Fit the mixture of [x, y].

        Args:
            X: Inputs, shape (n_samples, n_inputs), in any units.
            y: Outputs, shape (n_samples, n_outputs), or (n_samples,) for predictions of that shape, in any units.

        Raises:
            ValueError: See `GaussianMixture.fit`; or X and y differ in their number of rows.
        """
        if y is None:
            raise ValueError("requires y to be passed, but the target y is None")
        inputs = as_array(X, "X")
        targets = np.asarray(y)
        outputs = as_array(targets[:, None] if targets.ndim == 1 else targets, "y")
        if len(inputs) != len(outputs):
            raise ValueError(f"X and y must have the same number of rows, found {len(inputs)} and {len(outputs)}")
        settings = {name: value for name, value in self.get_params().items() if name != "faithful"}
        joint = np.concatenate([inputs, outputs], axis=1)
        self._condition(GaussianMixture(**settings).fit(joint), inputs.shape[1], single_output=targets.ndim == 1)
        return self

    @overload
    def predict(
        self,
        X: npt.ArrayLike,
        *,
        return_sd: Literal[False] = ...,
        return_covariance: Literal[False] = ...,
        single: bool = ...,
    ) -> FloatArray: ...
    @overload
    def predict(
        self, X: npt.ArrayLike, *, return_sd: Literal[True], return_covariance: Literal[False] = ..., single: bool = ...
    ) -> tuple[FloatArray, FloatArray]: ...
    @overload
    def predict(
        self, X: npt.ArrayLike, *, return_sd: Literal[False] = ..., return_covariance: Literal[True], single: bool = ...
    ) -> tuple[FloatArray, FloatArray]: ...
    def predict(
        self, X: npt.ArrayLike, *, return_sd: bool = False, return_covariance: bool = False, single: bool = False
    ) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Predict y (MP eqs. 18 to 22, see the class).

        Args:
            X: Inputs, shape (n_samples, n_inputs), in the units of the data.
            return_sd: Return the standard deviation of each output too.
            return_covariance: Return the covariance of the outputs too, instead.
            single: Compute in single precision, right to about 1e-4 standard deviations and twice as fast where there
                are many inputs; covariances are in double precision always.

        Returns:
            The means, shape (n_samples, n_outputs), or (n_samples,) after a fit with such a y. With `return_sd` also
            the standard deviations, of the same shape; with `return_covariance` also the covariances, shape
            (n_samples, n_outputs, n_outputs). All are in the units of the data.

        Raises:
            ValueError: X has another number of columns or missing values, the regression is not fitted, or both
                spreads are asked for.
        """
        if return_sd and return_covariance:
            raise ValueError("ask for return_sd or return_covariance, not for both")
        self._require_fit("matrices_")
        rows = self._rows(X)
        if return_covariance:
            mean, spread = self._mean_and_covariance(rows)
        else:
            mean, spread = self._mean_and_sd(rows, single=single)
        if self._single_output:
            mean, spread = mean[:, 0], spread if return_covariance else spread[:, 0]
        return (mean, spread) if return_sd or return_covariance else mean

    def predict_one(self, x: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Predict y of one row, unchecked and at once: what `predict` says of it takes longer than the computation.

        See `predict` for the formulas.

        Args:
            x: Finite inputs, float64 (n_inputs,), in the units of the data.

        Returns:
            Means and standard deviations, each (n_outputs,), in the units of the data, and the domain score in nats.
        """
        if self._predict_row is None:
            self._predict_row = self._prepare_row()
        mean, sd = np.empty((2, self.n_outputs_))
        return mean, sd, self._predict_row(x, mean, sd)

    def _mean_and_sd(self, rows: Rows, *, single: bool) -> tuple[FloatArray, FloatArray]:
        from .conditional import predict_rows

        mean, sd = np.empty((2, len(rows), self.n_outputs_))
        conditional = self._conditional(np.float32 if single else np.float64)
        with one_blas_thread():
            for part in chunks(rows):
                predict_rows(plain(rows[part]), conditional, mean[part], sd[part])
        return mean, sd

    def _mean_and_covariance(self, rows: Rows) -> tuple[FloatArray, FloatArray]:
        n, m = len(rows), self.n_outputs_
        mean, covariance = np.empty((n, m)), np.empty((n, m, m))
        step = max(CHUNK_VALUES // (m * m), 64)
        for start in range(0, n, step):
            part = slice(start, start + step)
            beta = self.responsibilities(rows[part])
            own = self._component_means(rows[part])
            mean[part] = np.einsum("nk,knm->nm", beta, own)
            # Both terms of the law of total covariance; eq. 22 squares the weights of the first and lacks the second.
            mixed = np.square(beta) if self.faithful else beta
            covariance[part] = np.tensordot(mixed, self.conditional_covariances_, axes=1)
            if not self.faithful:
                offset = np.sqrt(beta.T)[..., None] * (own - mean[part])
                covariance[part] += np.matmul(offset.transpose(1, 2, 0), offset.transpose(1, 0, 2))
        return mean, covariance

    def responsibilities(self, X: npt.ArrayLike) -> FloatArray:
        """Return β_k of each row: how probable each component is given x.

        It is p_k N(x; μ_k, Σ_k) / Σ_j p_j N(x; μ_j, Σ_j) (PP eq. 11), with `faithful` MP eq. 20, without the p.

        Args:
            X: Inputs as for `predict`, shape (n_samples, n_inputs).

        Returns:
            Shape (n_samples, k), shares whose sum is 1 in every row.

        Raises:
            ValueError: X has another number of columns or missing values, or the regression is not fitted.
        """
        self._require_fit("matrices_")
        if not self.faithful:
            return self._input_mixture.predict_proba(X)
        densities = self._input_mixture.log_joint(X) - np.log(self._input_mixture.weights_)
        densities = np.exp(densities - densities.max(axis=1, keepdims=True))
        beta: FloatArray = densities / densities.sum(axis=1, keepdims=True)
        return beta

    def domain_score(self, X: npt.ArrayLike) -> FloatArray:
        """Return the log density of the inputs alone, log Σ p_k N(x; μ_k, Σ_k), nats: low where little was learnt.

        It ranks inputs, and has no scale of its own; `domain_probability` has.

        Args:
            X: Inputs as for `predict`, shape (n_samples, n_inputs).

        Returns:
            Shape (n_samples,).

        Raises:
            ValueError: As for `responsibilities`.
        """
        self._require_fit("matrices_")
        return self._input_mixture.score_samples(X)

    def domain_probability(self, X: npt.ArrayLike) -> FloatArray:
        """Return which share of the inputs learnt from would lie further out than each row, shape (n_samples,).

        The mean over components, by responsibility, of the probability that a row of the component has a larger
        Mahalanobis distance D_k: Σ β_k Q(d/2, D_k²/2), Q the regularised upper incomplete gamma function. It is uniform
        from 0 to 1 for rows that follow the mixture; below 0.001 an input lies outside what was learnt, and the
        prediction is an extrapolation.

        Args:
            X: Inputs as for `predict`, shape (n_samples, n_inputs).

        Raises:
            ValueError: As for `responsibilities`.
        """
        from scipy.special import gammaincc

        self._require_fit("matrices_")
        inputs = self._input_mixture
        joint = inputs.log_joint(X)
        constants = log_constants(inputs.weights_, inputs.inverses)
        beta = np.exp(joint - log_sum(joint)[:, None])
        tails = gammaincc(0.5 * self.n_features_in_, np.maximum(constants - joint, 0.0))
        shares: FloatArray = np.einsum("nk,nk->n", beta, tails)
        return shares

    def log_likelihood(self, X: npt.ArrayLike, y: npt.ArrayLike) -> FloatArray:
        """Return log p(y | x) = log p(x, y) − log p(x) of each row in nats, shape (n_samples,).

        They are those of the mixture: `faithful` changes nothing.

        Args:
            X: Inputs as for `predict`, shape (n_samples, n_inputs).
            y: What happened, shape (n_samples, n_outputs) or (n_samples,), in the units of the data.

        Raises:
            ValueError: As for `responsibilities`; or y has another shape or missing values.
        """
        self._require_fit("matrices_")
        rows = self._rows(X)
        targets = np.asarray(y).reshape(len(rows), self.n_outputs_)
        return self.mixture_.score_samples(np.concatenate([rows, targets], axis=1)) - self.domain_score(rows)

    def score(self, X: npt.ArrayLike, y: npt.ArrayLike) -> float:
        """Return the coefficient of determination R² = 1 − Σ (y − ŷ)² / Σ (y − ȳ)², averaged over the outputs.

        Args:
            X: Inputs as for `predict`, shape (n_samples, n_inputs).
            y: What happened, shape (n_samples, n_outputs) or (n_samples,), in the units of the data.

        Returns:
            A ratio, 1 at best; an output that never changes makes it −∞ or NaN.

        Raises:
            ValueError: As for `responsibilities`; or y has another shape.
        """
        mean = self.predict(X).reshape(-1, self.n_outputs_)
        targets = np.asarray(y, dtype=np.float64).reshape(mean.shape)
        residual = np.square(targets - mean).sum(axis=0)
        total = np.square(targets - targets.mean(axis=0)).sum(axis=0)
        return float(np.mean(1.0 - residual / total))

    def _condition(self, joint: GaussianMixture, n_inputs: int, *, single_output: bool) -> None:
        """Keep A_k and C_k of a mixture whose first `n_inputs` columns are x.

        Both come from the Cholesky factor of the whole covariance, [[L_x, 0], [M, L_c]]: A = M L_x⁻¹ and C = L_c L_cᵀ,
        which stays positive definite where Σ_yy − A Σ_xy would cancel.
        """
        gains, conditional = np.split(joint.factors[:, n_inputs:], [n_inputs], axis=2)
        self.mixture_ = joint
        self.matrices_ = gains @ joint.inverses[:, :n_inputs, :n_inputs]
        self.conditional_covariances_ = conditional @ conditional.transpose(0, 2, 1)
        self.n_features_in_, self.n_outputs_ = n_inputs, joint.n_features_in_ - n_inputs
        self._input_mixture = joint.marginal(range(n_inputs))
        self._single_output = single_output
        self._conditional_variances = np.diagonal(self.conditional_covariances_, axis1=1, axis2=2).copy()
        self._prepared: dict[np.dtype[Any], Conditional] = {}
        self._predict_row = None

    def _conditional(self, precision: npt.DTypeLike) -> Conditional:
        """Return what predictions in a precision need, computed once."""
        from .conditional import Conditional
        from .panels import packed
        from .wide_rows import Components

        kind, n = np.dtype(precision), self.n_features_in_
        if kind not in self._prepared:
            order = spread(n)
            inputs, weights = self.mixture_.marginal(order), self.mixture_.weights_
            gains = self.mixture_.covariances_[:, n:, order] @ inputs.inverses.transpose(0, 2, 1)
            constants = log_constants(weights, inputs.inverses)
            self._prepared[kind] = Conditional(
                order,
                Components(
                    plain(inputs.means_),
                    packed(inputs.inverses, kind),
                    constants - np.log(weights) if self.faithful else constants,
                    inputs.bound(np.arange(FIRST if n >= 2 * FIRST else 0), kind),
                    negligible(kind),
                ),
                plain(self.mixture_.means_[:, n:]),
                packed(gains, kind),
                self._conditional_variances,
                np.sqrt(self._conditional_variances),
                self.faithful,
            )
        return self._prepared[kind]

    def _prepare_row(self) -> Callable[[FloatArray, FloatArray, FloatArray], float]:
        """Return what writes the mean and sd of one row and returns its domain score, everything else computed once."""
        from .one_row import OneRow, filled, predict_row

        joint, n = self.mixture_, self.n_features_in_
        order = telling_first(joint.covariances_[:, :n, :n])
        columns = np.append(order, np.arange(n, joint.n_features_in_))
        ordered = joint.marginal(columns)
        factors, inputs = ordered.factors, ordered.marginal(range(n))
        log_weights = np.log(joint.weights_)
        row = OneRow(
            order,
            plain(inputs.means_),
            filled(inputs.inverses),
            log_constants(joint.weights_, inputs.inverses),
            log_weights,
            plain(joint.means_[:, n:]),
            filled(plain(factors[:, n:, :n])),
            self._conditional_variances,
            # Without its weight a component may count for more.
            NOTHING + (float(np.ptp(log_weights)) if self.faithful else 0.0),
            self.faithful,
        )
        return partial(predict_row, *row)

    def _component_means(self, rows: Rows) -> FloatArray:
        """Return m_k of each row (MP eq. 18), shape (k, n_samples, n_outputs)."""
        means_in, means_out = np.split(self.mixture_.means_, [self.n_features_in_], axis=1)
        return np.array(
            [
                mean_out + (rows - mean_in) @ matrix.T
                for mean_in, mean_out, matrix in zip(means_in, means_out, self.matrices_, strict=True)
            ]
        )
