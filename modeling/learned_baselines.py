"""What general-purpose learners make of the papers' inputs: gradient-boosted trees and a small neural network.

Both predict the change from the current angle (for n₂ = −1, where none is seen, the angle itself), as principal
components. A network or boosted tree for every step of 5 s would take many times as long and share nothing between
neighbouring steps.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, Literal, Self

import numpy as np

from .baselines import Floats
from .curvature import principal_directions

OUTPUT_RANK = 6
"""Principal components of the change that are learnt."""

EVERY = 3
"""Of every so many windows one is learnt from: neighbours, 0.1 s apart, are nearly equal."""

HELD_OUT = 5
"""One of so many blocks is left out of a first fit, whose errors there are the variances."""


@dataclass(frozen=True, slots=True)
class LearnedBaseline:
    """Principal components of the change, each predicted by an estimator of scikit-learn.

    With the estimators' components c of the standardised inputs z the angles are level + V c(z), and the angle seen
    last.

    Attributes:
        estimators: One for all components, or one for each.
        seen: Whether the last input is the current angle.
        mean: Of the inputs (n_inputs,), in their units.
        scale: Standard deviations of the inputs (n_inputs,), in their units.
        level: Mean change, deg (n_outputs,).
        directions: V, from components to changes, deg (n_outputs, n_components).
        variances: Mean square error of each output on windows that were left out, deg² (n_outputs,).
    """

    estimators: tuple[Any, ...]
    seen: bool
    mean: Floats
    scale: Floats
    level: Floats
    directions: Floats
    variances: Floats

    @classmethod
    def fit(
        cls,
        kind: Literal["trees", "network"],
        inputs: Floats,
        outputs: Floats,
        *,
        past_steps: int,
        gap: int = 0,
        seed: int = 0,
    ) -> Self:
        """Fit to all windows, after a first fit whose mean square errors on a block left out are the variances.

        Args:
            kind: `trees`, histogram gradient boosting with scikit-learn's settings; `network`, two layers of 64 units
                with early stopping.
            inputs: Shape (n_windows, n_inputs), as `windows.cut_windows` lays them out, in the order of time.
            outputs: Shape (n_windows, n₃), deg.
            past_steps: n₂.
            gap: Windows left out on both sides of the block that is held out.
            seed: Of the estimators.
        """
        n = len(inputs)
        start, stop = n // HELD_OUT, 2 * n // HELD_OUT
        outside = np.r_[0 : max(start - gap, 0), min(stop + gap, n) : n]
        first = cls._learn(kind, inputs[outside], outputs[outside], past_steps, seed)
        errors = first.predict(inputs[start:stop])[0] - outputs[start:stop]
        final = cls._learn(kind, inputs, outputs, past_steps, seed)
        final.variances[:] = np.square(errors).mean(axis=0)
        return final

    @classmethod
    def _learn(cls, kind: str, inputs: Floats, outputs: Floats, past_steps: int, seed: int) -> Self:
        from sklearn.ensemble import HistGradientBoostingRegressor
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.neural_network import MLPRegressor

        mean, scale = inputs.mean(axis=0), inputs.std(axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        change = outputs - inputs[:, -1:] if past_steps >= 0 else outputs
        level = change.mean(axis=0)
        directions = principal_directions(change - level, min(OUTPUT_RANK, outputs.shape[1]))
        # In units of the first component's deviation; so the network weighs the components by what they contribute.
        unit = max(((change - level) @ directions[:, 0]).std(), 1e-12)
        directions = directions * unit
        components = (change - level) @ directions / unit**2
        given, components = (inputs[::EVERY] - mean) / scale, components[::EVERY]
        if kind == "network":
            network = MLPRegressor(hidden_layer_sizes=(64, 64), early_stopping=True, random_state=seed, max_iter=100)
            with warnings.catch_warnings():
                # Whether it converged within these passes shows in its error.
                warnings.simplefilter("ignore", ConvergenceWarning)
                estimators: tuple[Any, ...] = (network.fit(given, components),)
        else:
            estimators = tuple(
                HistGradientBoostingRegressor(random_state=seed).fit(given, component) for component in components.T
            )
        return cls(estimators, past_steps >= 0, mean, scale, level, directions, np.zeros(outputs.shape[1]))

    def predict(self, inputs: Floats) -> tuple[Floats, Floats]:
        """Return means in deg and variances in deg², each (n_windows, n_outputs), of windows (n_windows, n_inputs).

        See the class for the formula; windows are as `windows.cut_windows` lays them out.
        """
        given = (inputs - self.mean) / self.scale
        parts = [np.asarray(estimator.predict(given)).reshape(len(given), -1) for estimator in self.estimators]
        mean: Floats = self.level + np.concatenate(parts, axis=1) @ self.directions.T
        if self.seen:
            mean = mean + inputs[:, -1:]
        return mean, np.broadcast_to(self.variances, mean.shape)
