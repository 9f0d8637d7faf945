"""Windows in the terms of vehicle dynamics: curvature of the path, lateral acceleration, its product with braking.

A car in a steady curve needs, to first order, the steering wheel angle (ratio) (L κ + K κv²); braking or accelerating
moves load between the axles and so changes K, whence κv²a. None of the three is linear in the papers' inputs. Along a
path the curvature says what the papers' course deviation says at one speed only.

The channels of a window of n₂ past and n₃ future steps (p = max(n₂, 0)), each block in the order of time:

    κ      at t − p … t + n₃     1/km, course deviation over distance
    κv²    at t − p … t + n₃     m/s²
    κv²a   at t − p … t + n₃     m²/s⁴, a the rate of the speed
    δ      at t − n₂ … t         deg, the steering wheel angle that was seen
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SLOWEST = 2.0
"""m/s; slower samples count as this fast: at a standstill the course deviation is noise, and its curvature infinite."""

PATH_RANK = 14
"""Principal components that are kept of each block of the path.

On the even folds of two racing drivers (κ, κv², change from the current angle, K = 3) 8, 14 and 20 components came to
5.44, 5.50 and 5.63 deg and 6.49, 6.99 and 7.17 deg; with the channels and tying of today 14 and 20 differ by less than
starts do. A window of 52 steps of smooth path has not much more to say.
"""

OUTPUT_RANK = 12
"""Principal components of the future steering that are learnt together; the rest is noise of each step by itself."""


def curvature_blocks(inputs: Floats, past_steps: int, future_steps: int, step: float) -> list[Floats]:
    """Return κ, κv², κv²a and δ of windows in the units of the module, positive to the left.

    κ = Δθ / (max(v, `SLOWEST`) Δt), a by central differences of v, one-sided at the ends of a window.

    Args:
        inputs: Shape (n_windows, n_inputs), as `windows.cut_windows` lays them out: deg per sample, m/s, deg.
        past_steps: n₂.
        future_steps: n₃.
        step: s between two samples.

    Returns:
        Three arrays (n_windows, p + 1 + n₃) and one (n_windows, n₂ + 1), which for n₂ = −1 has no column.
    """
    length = max(past_steps, 0) + 1 + future_steps
    deviation, speed, seen = inputs[:, :length], inputs[:, length : 2 * length], inputs[:, 2 * length :]
    curvature = np.radians(deviation) / (np.maximum(speed, SLOWEST) * step)
    lateral = curvature * np.square(speed)
    return [1e3 * curvature, lateral, lateral * np.gradient(speed, step, axis=1), seen]


@dataclass(frozen=True, slots=True)
class CurvatureCoordinates:
    """Few coordinates in which a mixture sees the windows: principal components of each block, see the module.

    Of channels c with standard deviations s they are y = Vᵀ diag(1/s) (c − mean), V the directions of the largest
    variance: numbers without a unit.

    Attributes:
        past_steps: n₂.
        future_steps: n₃.
        step: s between two samples.
        mean: Mean of each channel (n_channels,), in the module's units.
        basis: From channels to coordinates, diag(1/s) V (n_channels, n_coordinates), in the inverse of these units;
            each block has coordinates of its own.
    """

    past_steps: int
    future_steps: int
    step: float
    mean: Floats
    basis: Floats

    @classmethod
    def fit(cls, inputs: Floats, past_steps: int, future_steps: int, step: float) -> Self:
        """Find the principal components of windows to learn from; arguments as for `curvature_blocks`."""
        blocks = curvature_blocks(inputs, past_steps, future_steps, step)
        channels = np.concatenate(blocks, axis=1)
        mean, scale = channels.mean(axis=0), channels.std(axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        ranks = [min(PATH_RANK, block.shape[1]) for block in blocks]
        basis = np.zeros((channels.shape[1], sum(ranks)))
        row = column = 0
        for block, rank in zip(blocks, ranks, strict=True):
            own = slice(row, row + block.shape[1])
            directions = principal_directions((block - mean[own]) / scale[own], rank)
            basis[own, column : column + rank] = directions / scale[own, None]
            row, column = own.stop, column + rank
        return cls(past_steps, future_steps, step, mean, basis)

    @property
    def path_length(self) -> int:
        """Samples of a window's path, p + 1 + n₃."""
        return max(self.past_steps, 0) + 1 + self.future_steps

    @property
    def seen(self) -> int:
        """Steering wheel angles that a window has seen, n₂ + 1."""
        return self.past_steps + 1

    @property
    def window_inputs(self) -> int:
        """Inputs of a window, as `windows.cut_windows` lays them out."""
        return 2 * self.path_length + self.seen

    def transform(self, inputs: Floats) -> Floats:
        """Return the coordinates (n_windows, n_coordinates), without a unit, of windows (n_windows, n_inputs).

        The formula is that of the class; windows are as `windows.cut_windows` lays them out.
        """
        blocks = curvature_blocks(inputs, self.past_steps, self.future_steps, self.step)
        coordinates: Floats = (np.concatenate(blocks, axis=1) - self.mean) @ self.basis
        return coordinates

    def origin(self, inputs: Floats) -> Floats:
        """Return the angle from which the change is predicted, deg (n_windows, 1), of windows (n_windows, n_inputs).

        It is the current one, 0 where none is seen.
        """
        return inputs[:, -1:] if self.past_steps >= 0 else np.zeros((len(inputs), 1))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what a file has to hold."""
        return {name: np.array(getattr(self, name)) for name in self.__slots__}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """Return the coordinates that `arrays` was taken from."""
        past_steps, future_steps = (int(arrays[name]) for name in ("past_steps", "future_steps"))
        return cls(past_steps, future_steps, float(arrays["step"]), arrays["mean"], arrays["basis"])


def principal_directions(centred: Floats, rank: int) -> Floats:
    """Return the orthonormal directions (n_columns, rank) of the largest variance of centred rows (n, n_columns).

    They are eigenvectors of XᵀX, the largest eigenvalue first, of rows X in any units; none has a unit itself.
    """
    return np.linalg.eigh(centred.T @ centred)[1][:, ::-1][:, :rank]
