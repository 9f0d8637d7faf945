"""What the drivers' models have to beat: the angle stays as it is, and ridge regression on the same inputs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

PENALTIES = tuple(10.0**exponent for exponent in np.arange(-4.0, 5.5, 0.5).tolist())
"""Penalties that ridge regression chooses from: half decades, far beyond what was ever chosen at both ends."""

ENOUGH = 500
"""Samples of a block that choose the penalty: of more, every so many, as neighbours are nearly equal."""


@dataclass(frozen=True, slots=True)
class Persistence:
    """Nothing changes: every future value is the current one.

    Attributes:
        variances: Mean square error of each step on the training data (n_outputs,), of a Gaussian band, in the square
            of the data's unit.
    """

    variances: Floats

    @classmethod
    def fit(cls, current: Floats, outputs: Floats) -> Persistence:
        """Measure the errors: the variance of step j is the mean of (y_j − current)².

        Args:
            current: Current value of every sample (n_samples,), in any unit.
            outputs: Values that follow (n_samples, n_outputs), in the same unit.
        """
        return cls(np.square(outputs - current[:, None]).mean(axis=0))

    def predict(self, current: Floats) -> tuple[Floats, Floats]:
        """Return means and variances, each (n_samples, n_outputs), of current values (n_samples,).

        They are in the unit of the data and its square.
        """
        shape = (len(current), len(self.variances))
        return np.broadcast_to(current[:, None], shape), np.broadcast_to(self.variances, shape)


@dataclass(frozen=True, slots=True)
class Ridge:
    """Ridge regression in closed form: coefficients B of min ‖Y − ZB‖² + α‖B‖², inputs Z standardised, Y centred.

    Attributes:
        penalty: α, for inputs of variance 1: a number of rows.
        coefficients: B in the units of the data (n_inputs, n_outputs).
        intercept: In the outputs' units (n_outputs,).
        variances: Mean square error of each output in the cross-validation that chose α (n_outputs,), in the squares of
            the outputs' units.
    """

    penalty: float
    coefficients: Floats
    intercept: Floats
    variances: Floats

    @classmethod
    def fit(
        cls, inputs: Floats, outputs: Floats, *, blocks: int = 10, gap: int = 0, penalties: Sequence[float] = PENALTIES
    ) -> Ridge:
        """Choose the penalty by cross-validation and fit all samples with it, B = (ZᵀZ + αI)⁻¹ZᵀY.

        Neighbouring windows are nearly equal, so that leaving out single samples, or generalised cross-validation,
        would choose next to no penalty. Whole blocks are left out instead, with a gap on both sides. The penalty of
        the smallest mean absolute error is taken: it is what the evaluation measures.

        Args:
            inputs: Shape (n_samples, n_inputs), in any units, finite, in the order of time.
            outputs: Shape (n_samples, n_outputs), in any units, finite.
            blocks: Contiguous blocks that are left out in turn.
            gap: Samples left out of the fit on both sides of each block.
            penalties: Values of α to choose from, numbers of rows above 0; the order does not matter.

        Raises:
            ValueError: There are fewer samples than two blocks need.
        """
        n = len(inputs)
        if n < 2 * blocks:
            raise ValueError(f"ridge regression with {blocks} blocks needs at least {2 * blocks} samples, found {n}")
        mean, scale = inputs.mean(axis=0), inputs.std(axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        Z, level = (inputs - mean) / scale, outputs.mean(axis=0)
        Y = outputs - level
        gram, moments = Z.T @ Z, Z.T @ Y
        absolute, solvers = np.zeros(len(penalties)), []
        parts = [slice(block[0], block[-1] + 1) for block in np.array_split(np.arange(n), blocks)]
        for part in parts:
            away = slice(max(part.start - gap, 0), part.stop + gap)
            solve = _solver(gram - Z[away].T @ Z[away], moments - Z[away].T @ Y[away])
            asked = slice(part.start, part.stop, max((part.stop - part.start) // ENOUGH, 1))
            absolute += [np.abs(Z[asked] @ solve(penalty) - Y[asked]).sum() for penalty in penalties]
            solvers.append(solve)
        penalty = penalties[int(absolute.argmin())]
        errors = [Z[part] @ solve(penalty) - Y[part] for part, solve in zip(parts, solvers, strict=True)]
        coefficients = _solver(gram, moments)(penalty) / scale[:, None]
        variances = np.square(np.concatenate(errors)).mean(axis=0)
        return cls(penalty, coefficients, level - mean @ coefficients, variances)

    def predict(self, inputs: Floats) -> tuple[Floats, Floats]:
        """Return means ŷ = XB + intercept and variances, each (n_samples, n_outputs), of X (n_samples, n_inputs).

        They are in the units of the data and their squares.
        """
        mean: Floats = inputs @ self.coefficients + self.intercept
        return mean, np.broadcast_to(self.variances, mean.shape)


def _solver(gram: Floats, moments: Floats) -> Callable[[float], Floats]:
    """Return the solution of (gram + α I) B = moments as a function of α, from one eigendecomposition."""
    values, vectors = np.linalg.eigh(gram)
    # Rounding leaves the eigenvalues of dependent inputs slightly negative.
    values, projected = np.maximum(values, 0.0), vectors.T @ moments
    return lambda penalty: vectors @ (projected / (values + penalty)[:, None])
