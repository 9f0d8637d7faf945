"""A mixture regression as plain arrays: the few formulas that every export writes down in its own language."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from ..calibration import Calibration
from ..curvature import CurvatureCoordinates
from ..estimator import FloatArray, as_array
from ..input_order import telling_first
from ..lookahead_models import SPEED, VelocityLookahead
from ..mixture import GaussianMixture
from ..regression import MixtureRegression
from ..windows import Rows


@dataclass(frozen=True, slots=True)
class SpeedClasses:
    """Which components predict at a speed: those of the class c with the largest a_c + b_c v + q_c v² (PP eq. 19).

    Attributes:
        polynomials: (a, b, q) of each class, the log of weight times density of the speed, shape (n_classes, 3), in
            nats for speeds in m/s.
        of_component: Class of each component, from 0, shape (k,).
    """

    polynomials: FloatArray
    of_component: Rows


@dataclass(frozen=True, slots=True)
class PlainRegression:
    """A mixture regression of m outputs on n inputs, its k components in arrays.

    For an input x, with d = x − origin:

        z_k = W_k d[order] + s_k               W_k = L_k⁻¹, lower triangular; Σ_xx = L_k L_kᵀ of component k
        j_k = c_k − ½ |z_k|²                   log of weight times density of x
        domain score = log Σ exp j_k           log density of the inputs, nats
        β_k = exp(j_k − domain score)          posterior responsibilities
        m_k = o_k + A_k d                      A_k = Σ_yx Σ_xx⁻¹
        mean = Σ β_k m_k
        covariance = Σ β_k (C_k + (m_k − mean)(m_k − mean)ᵀ)

    `faithful` (MP eqs. 20 and 22 as printed): β_k ∝ exp(j_k − log weight), covariance = Σ β_k² C_k.

    With classes of speed only the components of the class at hand take part; the others count as j_k = −∞.

    With curvature coordinates x is what they make of the given window (`curvature.CurvatureCoordinates.transform`), and
    the mean is the change from the angle given last, which is added to it. Where the bands were calibrated, variances
    are multiplied by `variance_factors` f_i, and covariances by √(f_i f_j).

    Inputs and outputs are in the units of the model, z has none.

    Attributes:
        order: In which the inputs are whitened (n,): those first that tell components apart.
        origin: About the middle of the inputs (n,): numbers stay small where a program computes in float32.
        whitening: W (k, n, n).
        shifts: s (k, n).
        constants: c, nats (k,).
        log_weights: log p, nats (k,).
        matrices: A (k, m, n).
        offsets: o (k, m).
        covariances: C (k, m, m).
        variance_factors: f, ratios (m,), 1 without calibration.
        faithful: See above.
        classes: See above.
        coordinates: See above; None: x is what is given.
    """

    order: Rows
    origin: FloatArray
    whitening: FloatArray
    shifts: FloatArray
    constants: FloatArray
    log_weights: FloatArray
    matrices: FloatArray
    offsets: FloatArray
    covariances: FloatArray
    variance_factors: FloatArray
    faithful: bool = False
    classes: SpeedClasses | None = None
    coordinates: CurvatureCoordinates | None = None

    @classmethod
    def of(
        cls,
        regressions: Sequence[MixtureRegression],
        classes: GaussianMixture | None = None,
        *,
        coordinates: CurvatureCoordinates | None = None,
        calibration: Calibration | None = None,
    ) -> Self:
        """Take a regression, or one for each class of speed, apart; see the class for the formulas.

        Args:
            regressions: One; with `classes` as many as it has components, in their order.
            classes: Mixture of the speed, the input column `lookahead_models.SPEED`.
            coordinates: What the regression's inputs are made by.
            calibration: Of its bands.
        """
        weights = np.concatenate([one.mixture_.weights_ for one in regressions])
        means = np.concatenate([one.mixture_.means_ for one in regressions])
        covariances = np.concatenate([one.mixture_.covariances_ for one in regressions])
        matrices = np.concatenate([one.matrices_ for one in regressions])
        n = regressions[0].n_features_in_
        inputs, outputs = np.split(means, [n], axis=1)
        origin = np.average(inputs, axis=0, weights=weights)
        order = telling_first(covariances[:, :n, :n])
        whitening = np.tril(np.linalg.inv(np.linalg.cholesky(covariances[:, order[:, None], order])))
        shifts = np.einsum("kij,kj->ki", whitening, (origin - inputs)[:, order])
        log_determinants = -np.log(np.diagonal(whitening, axis1=1, axis2=2)).sum(axis=1)
        return cls(
            order=order,
            origin=origin,
            whitening=whitening,
            shifts=shifts,
            constants=np.log(weights) - 0.5 * n * math.log(2 * math.pi) - log_determinants,
            log_weights=np.log(weights),
            matrices=matrices,
            offsets=outputs + np.einsum("kij,kj->ki", matrices, origin - inputs),
            covariances=np.concatenate([one.conditional_covariances_ for one in regressions]),
            variance_factors=(calibration or Calibration.gaussian(outputs.shape[1])).variance(
                np.ones(outputs.shape[1])
            ),
            faithful=regressions[0].faithful,
            classes=None if classes is None else _speed_classes(regressions, classes),
            coordinates=coordinates,
        )

    @property
    def components(self) -> int:
        """Number k of components."""
        return len(self.constants)

    @property
    def inputs(self) -> int:
        """Number n of inputs of the regression."""
        return len(self.origin)

    @property
    def given(self) -> int:
        """Number of inputs that a program gives: those of the regression, or of the window they are made from."""
        return self.inputs if self.coordinates is None else self.coordinates.window_inputs

    @property
    def outputs(self) -> int:
        """Number m of outputs."""
        return int(self.offsets.shape[1])


def domain_score(model: MixtureRegression | VelocityLookahead, inputs: FloatArray) -> FloatArray:
    """Return what exports call the domain score: the log density of the inputs where the model learnt, in nats.

    It is log Σ_k p_k N(x; μ_k, Σ_k) of the inputs' marginal of the mixture that predicts, nothing added and nothing
    scaled; for a velocity-based model the mixture of the class of speed at hand. Compare it with the scores of the
    golden vectors, which are ordinary driving: an input far below their smallest lies outside what was learnt.

    Args:
        model: The regression.
        inputs: Shape (n_samples, n_inputs), in the units of the model.

    Returns:
        Shape (n_samples,).

    Raises:
        ValueError: The inputs have another number of columns or missing values.
    """
    if isinstance(model, MixtureRegression):
        return model.domain_score(inputs)
    rows = as_array(inputs, "inputs")
    score = np.empty(len(rows))
    own_class = model.classes.predict(rows[:, [SPEED]])
    for number in np.unique(own_class).tolist():
        own = own_class == number
        score[own] = model.regressions[number].domain_score(rows[own])
    return score


def _speed_classes(regressions: Sequence[MixtureRegression], classes: GaussianMixture) -> SpeedClasses:
    mean, variance = classes.means_[:, 0], classes.covariances_[:, 0, 0]
    constant = np.log(classes.weights_) - 0.5 * np.log(2 * math.pi * variance) - 0.5 * np.square(mean) / variance
    of_component = np.repeat(np.arange(len(regressions)), [len(one.mixture_.weights_) for one in regressions])
    return SpeedClasses(np.column_stack([constant, mean / variance, -0.5 / variance]), of_component)
