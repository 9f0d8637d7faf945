"""Steering from the geometry of the path alone: what a car needs to follow it, without looking at the driver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from .baselines import PENALTIES, Floats, Ridge
from .curvature import curvature_blocks

TAPS = 5
"""Samples before and after the predicted one that its angle is made of. Steering leads the path by some 0.3 s."""

SAMPLES = 20_000
"""At most so many angles are fitted to: there are a dozen coefficients."""


@dataclass(frozen=True, slots=True)
class Kinematic:
    """The steering wheel angle as a short filter of the curvature κ of the path and of κv².

        δ_t = c + Σ_j (a_j κ_t+j + b_j κ_t+j v²_t+j),    j from −`TAPS` to `TAPS`

    In a steady curve the two filters' sums are the steering ratio times the wheelbase, and times the understeer
    gradient. All steps share them; beyond the ends of a window its path goes on as it was there.

    Attributes:
        past_steps: n₂.
        future_steps: n₃.
        step: s between two samples.
        filter: The fitted coefficients.
        variances: Mean square error of each step on the windows learnt from, deg² (n₃,).
    """

    past_steps: int
    future_steps: int
    step: float
    filter: Ridge
    variances: Floats

    @classmethod
    def fit(
        cls,
        inputs: Floats,
        outputs: Floats,
        past_steps: int,
        step: float,
        *,
        gap: int = 0,
        penalties: Sequence[float] = PENALTIES,
    ) -> Self:
        """Fit the filter by ridge regression.

        Args:
            inputs: Shape (n_windows, n_inputs), as `windows.cut_windows` lays them out, in the order of time.
            outputs: Shape (n_windows, n₃), deg.
            past_steps: n₂.
            step: s between two samples.
            gap: Windows left out on both sides of a block when the penalty is chosen.
            penalties: Values to choose from, numbers of rows.

        Raises:
            ValueError: There are too few windows, see `Ridge.fit`.
        """
        future_steps = outputs.shape[1]
        every = -(-outputs.size // SAMPLES)
        thinned = slice(None, None, every)
        around = np.concatenate(
            [
                np.lib.stride_tricks.sliding_window_view(block, 2 * TAPS + 1, axis=1)
                for block in _path(inputs[thinned], past_steps, future_steps, step)
            ],
            axis=2,
        )
        coefficients = Ridge.fit(
            around.reshape(-1, around.shape[2]),
            outputs[thinned].reshape(-1, 1),
            gap=-(-gap // every) * future_steps,
            penalties=penalties,
        )
        unmeasured = cls(past_steps, future_steps, step, coefficients, np.zeros(future_steps))
        errors = unmeasured.predict(inputs)[0] - outputs
        return cls(past_steps, future_steps, step, coefficients, np.square(errors).mean(axis=0))

    def predict(self, inputs: Floats) -> tuple[Floats, Floats]:
        """Return means in deg and variances in deg², each (n_windows, n₃), of windows (n_windows, n_inputs).

        See the class for the formula; windows are as `windows.cut_windows` lays them out.
        """
        blocks = _path(inputs, self.past_steps, self.future_steps, self.step)
        mean = np.full((len(inputs), self.future_steps), self.filter.intercept[0])
        taps = self.filter.coefficients[:, 0].reshape(len(blocks), -1)
        for block, weights in zip(blocks, taps, strict=True):
            filtering = np.zeros((block.shape[1], self.future_steps))
            for step in range(self.future_steps):
                filtering[step : step + len(weights), step] = weights
            mean += block @ filtering
        return mean, np.broadcast_to(self.variances, mean.shape)


def _path(inputs: Floats, past_steps: int, future_steps: int, step: float) -> list[Floats]:
    """Return κ and κv² from `TAPS` before the first predicted step to as many after the last, ends held."""
    wanted = max(past_steps, 0) + np.arange(1 - TAPS, future_steps + TAPS + 1)
    blocks = curvature_blocks(inputs, past_steps, future_steps, step)[:2]
    return [block[:, np.clip(wanted, 0, block.shape[1] - 1)] for block in blocks]
