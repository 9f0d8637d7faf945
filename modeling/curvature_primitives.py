"""A better mixture than the papers': curvature instead of course deviation, the change of the angle, few coordinates.

Three things lower its error, each by cross-validation on racing drivers (`docs/method.md` has the numbers):

    what goes in     κ, κv² and κv²a of the path, in principal components (`curvature`)
    what comes out   the change from the current angle, in principal components; what they leave is noise of each step.
                     So a covariance is V C Vᵀ + diag, that of a factor analysis with given factors
    tying            a component's covariance is drawn towards that of all components together. Where they are few
                     windows, or other windows than were learnt, a component of its own extrapolates wildly

How far the covariances are tied is chosen on blocks of the windows learnt from, and so is the calibration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from .curvature import OUTPUT_RANK, CurvatureCoordinates, principal_directions
from .held_out import blocks_of, calibrate
from .mixture import GaussianMixture
from .motion_primitives import EVERYTHING, N1, OUTPUT_NOISE, MotionPrimitives, adapt_to_path_types, windows_needed
from .regression import MixtureRegression
from .windows import Floats, Rows

TIED = (0.1, 0.3, 0.6)
"""Shares of the common covariance to choose from; without windows enough to choose, the last one."""

INPUT_NOISE = 1e-3
"""Of each coordinate's variance, added to its own: a ridge penalty within each component."""

TOLERANCE = 0.02
"""EM ends when the mean log-likelihood of a window rises by less, in nats."""


def fit_curvature_primitives(
    inputs: Floats,
    outputs: Floats,
    path_types: NDArray[Any],
    centres: Rows,
    *,
    n1: N1,
    components: int,
    past_steps: int,
    step: float,
    levels: Sequence[N1] = (),
    starts: int = 1,
    seed: int = 0,
) -> tuple[MotionPrimitives, float]:
    """Fit a driver's motion primitives in curvature coordinates.

    With the share τ that is chosen, the covariances of the mixture of all windows become

        Σ_k ← (1 − τ) Σ_k + τ Σ_j p_j Σ_j + D,    D = `INPUT_NOISE` times the variances of the inputs' coordinates

    and those of inputs x and changes y of the angle at every step V Σ_k Vᵀ + diag(rest), V from coordinates to these.

    Args:
        inputs: Shape (n_windows, n_inputs), as `windows.cut_windows` lays them out.
        outputs: Shape (n_windows, n₃), deg.
        path_types: Path type of each window, such as `1-3-2` (n_windows,).
        centres: Row t of each window, rising (n_windows,).
        n1: Path types that are told apart.
        components: n₄, components of each regression's mixture.
        past_steps: n₂.
        step: s between two samples.
        levels: n₁ to calibrate; none: the bands stay those of the mixture.
        starts: k-means starts of each mixture; the most likely one is kept.
        seed: Of the starts.

    Returns:
        The motion primitives, and τ, the share of the common covariance that was chosen.

    Raises:
        ValueError: There are fewer windows than `windows_needed`.
    """
    length = max(past_steps, 0) + 1 + outputs.shape[1]

    def begin(rows: Rows) -> _Latent:
        return _Latent.fit(inputs[rows], outputs[rows], components, past_steps, step, starts, seed)

    whole = begin(np.arange(len(inputs)))
    blocks = blocks_of(centres, length, windows_needed(whole.joint.shape[1], components))
    parts = [begin(learnt) for learnt, _ in blocks]
    errors = np.zeros(len(TIED))
    for part, (_, block) in zip(parts, blocks, strict=True):
        given = part.coordinates.transform(inputs[block])
        change = outputs[block] - part.coordinates.origin(inputs[block])
        for place, tied in enumerate(TIED):
            predicted = part.regression(part.tie(tied)).predict(given)
            errors[place] += np.abs(predicted - change).sum()
    tied = TIED[errors.argmin()] if blocks else TIED[-1]
    fitted = iter(parts)
    calibrations = calibrate(
        lambda learnt: next(fitted).primitives(path_types[learnt], n1, tied),
        inputs,
        outputs,
        path_types,
        blocks if levels else (),
        levels,
    )
    return replace(whole.primitives(path_types, n1, tied), calibrations=calibrations), tied


@dataclass(frozen=True, slots=True)
class _Latent:
    """The mixture of all windows in coordinates, before it is tied and adapted to path types.

    Attributes:
        coordinates: Of the inputs.
        joint: Coordinates of inputs and outputs of the windows (n_windows, n_coordinates).
        mixture: Fitted to them.
        level: Mean change (n₃,).
        directions: From coordinates of the outputs to changes (n₃, n_output_coordinates).
        rest: Variance of the changes that the coordinates leave (n₃,).
        noise: The diagonal of D of `fit_curvature_primitives`, none of the outputs (n_coordinates,).
    """

    coordinates: CurvatureCoordinates
    joint: Floats
    mixture: GaussianMixture
    level: Floats
    directions: Floats
    rest: Floats
    noise: Floats

    @classmethod
    def fit(
        cls, inputs: Floats, outputs: Floats, components: int, past_steps: int, step: float, starts: int, seed: int
    ) -> Self:
        steps = outputs.shape[1]
        coordinates = CurvatureCoordinates.fit(inputs, past_steps, steps, step)
        change = outputs - coordinates.origin(inputs)
        level = change.mean(axis=0)
        directions = principal_directions(change - level, min(OUTPUT_RANK, steps))
        latent = (change - level) @ directions
        rest = (change - level - latent @ directions.T).var(axis=0) + OUTPUT_NOISE * change.var(axis=0)
        joint = np.concatenate([coordinates.transform(inputs), latent], axis=1)
        if len(joint) < (needed := windows_needed(joint.shape[1], components)):
            reason = f"{components} components of {joint.shape[1]} coordinates need {needed} windows, not {len(joint)}"
            raise ValueError(reason)
        mixture = GaussianMixture(
            components, n_starts=starts, max_iterations=100, tolerance=TOLERANCE, random_state=seed
        ).fit(joint)
        noise = INPUT_NOISE * joint.var(axis=0)
        noise[-latent.shape[1] :] = 0.0
        return cls(coordinates, joint, mixture, level, directions, rest, noise)

    def primitives(self, path_types: NDArray[Any], n1: N1, tied: float) -> MotionPrimitives:
        """Return the motion primitives; the path types (n_windows,) of the windows matter for n₁ > 1 alone."""
        everything = self.tie(tied)
        mixtures, samples = {EVERYTHING: everything}, {EVERYTHING: len(self.joint)}
        if n1 > 1:
            rows = self.noise * len(self.joint) / len(self.mixture.weights_)
            mixtures, samples = adapt_to_path_types(everything, self.joint, path_types, n1=n1, noise=rows)
        regressions = {name: self.regression(mixture) for name, mixture in mixtures.items()}
        return MotionPrimitives(n1, regressions, samples, self.coordinates)

    def tie(self, tied: float) -> GaussianMixture:
        """Return the mixture with a share τ of its common covariance and the noise, see `fit_curvature_primitives`."""
        covariances = self.mixture.covariances_
        common = np.tensordot(self.mixture.weights_, covariances, axes=1)
        covariances = (1.0 - tied) * covariances + tied * common + np.diag(self.noise)
        return GaussianMixture.from_parameters(self.mixture.weights_, self.mixture.means_, covariances)

    def regression(self, mixture: GaussianMixture) -> MixtureRegression:
        """Return the regression of the change at every step on the coordinates of the inputs."""
        V, (steps, rank) = self.directions, self.directions.shape
        n = mixture.n_features_in_ - rank
        means_in, means_out = np.split(mixture.means_, [n], axis=1)
        own, crossed = mixture.covariances_[:, n:, n:], V @ mixture.covariances_[:, n:, :n]
        covariances = np.empty((len(means_in), n + steps, n + steps))
        covariances[:, :n, :n] = mixture.covariances_[:, :n, :n]
        covariances[:, n:, :n], covariances[:, :n, n:] = crossed, crossed.transpose(0, 2, 1)
        covariances[:, n:, n:] = V @ own @ V.T + np.diag(self.rest)
        means = np.concatenate([means_in, means_out @ V.T + self.level], axis=1)
        lifted = GaussianMixture.from_parameters(mixture.weights_, means, covariances)
        return MixtureRegression.from_mixture(lifted, range(n), range(n, n + steps))
