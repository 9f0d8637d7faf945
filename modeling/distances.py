"""What is still known of the distances between rows and components after the components have moved.

Between one pass of expectation maximisation and the next, y = W(x − μ) becomes y' = A y + b with A = W' W⁻¹ and
b = W'(μ − μ'), whatever the row. With the smallest singular value s of A

    |y'| ≥ s |y| − |b|

so that a component which was far from a row is known to be far without being computed, and the more precisely the less
it has moved. It is the triangle inequality that Elkan (2003) speeds k-means up by, for a metric that changes, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .densities import Parameters
from .estimator import FloatArray

WORTH_KEEPING = 4
"""Columns for each component from which on distances take little memory beside what rows take."""


@dataclass(slots=True)
class Distances:
    """Lower bounds of the Mahalanobis distances |y| between rows and components, from pass to pass.

    Attributes:
        least: The bounds (n, k); (0, k) where none are kept.
        parameters: Of the components that they are distances to; None before the first pass.
    """

    least: npt.NDArray[np.float32]
    parameters: Parameters | None = None

    @classmethod
    def unknown(cls, n: int, parameters: Parameters) -> Distances:
        """Return room for those of n rows, where it is worth it."""
        k, d = parameters.means.shape
        return cls(np.empty((n if 1 < k <= d // WORTH_KEEPING else 0, k), dtype=np.float32))

    def move(self, parameters: Parameters) -> tuple[FloatArray, FloatArray]:
        """Go over to new components: s |y| − |b| ≤ |y'|.

        Returns:
            s and |b| of each component, both (k,) and without a unit, or both (0,) where nothing is known.
        """
        before, self.parameters = self.parameters, parameters
        if before is None or not len(self.least):
            return np.empty(0), np.empty(0)
        turned = parameters.inverses @ before.factors
        squares = np.linalg.eigvalsh(turned @ turned.transpose(0, 2, 1))
        # Rounding errors of the smallest one are in proportion to the largest.
        shrinks = np.sqrt(np.maximum(squares[:, 0] - 1e-12 * squares[:, -1], 0.0))
        shifts = np.einsum("kij,kj->ki", parameters.inverses, before.means - parameters.means)
        return shrinks, np.sqrt(np.square(shifts).sum(axis=1))
