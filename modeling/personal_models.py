"""Personal models that are kept: the population's, that of each driver adapted from it, and one that goes on learning.

    population_…   fitted to all drivers together
    adapted_…      the population's, adapted to one driver (`adaptation`)
    online_…       one driver's, learnt drive by drive, the old drives not needed any more (`online`)

each of the `personal.QUANTITIES`: `…_steering` and `…_lookahead`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..schemas.config import Personal
from .estimator import FloatArray
from .online import OnlineMixture
from .personal import QUANTITIES, Quantity
from .regression import MixtureRegression

KINDS = tuple(f"{form}_{quantity}" for form in ("population", "adapted", "online") for quantity in QUANTITIES)


@dataclass(frozen=True, slots=True)
class PersonalModel:
    """A regression of one of the two quantities, and what it takes to use it.

    Attributes:
        regression: Predicts the quantity.
        window: n₂ and n₃ of the steering's windows; None for the lookahead distance.
        state: From which it goes on learning; None: it does not.
    """

    regression: MixtureRegression
    window: tuple[int, int] | None
    state: OnlineMixture | None = None

    @classmethod
    def of_state(cls, state: OnlineMixture, quantity: Quantity, settings: Personal) -> Self:
        """Return the model that the statistics of all drives so far give; their last columns are the outputs."""
        steering = quantity == "steering"
        channels = np.arange(state.means.shape[1])
        inputs = len(channels) - (settings.future_steps if steering else 1)
        regression = MixtureRegression.from_mixture(
            state.mixture, channels[:inputs], channels[inputs:], single_output=not steering
        )
        return cls(regression, window_of(quantity, settings), state)

    def predict(self, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Predict the quantity, by the formulas of `MixtureRegression`.

        Args:
            inputs: Shape (n_samples, n_inputs): windows as `windows.cut_windows` lays them out, or [Δθ, v], deg per
                sample and m/s.

        Returns:
            Means and standard deviations: of each following step (n_samples, n₃), deg; or (n_samples,), m.

        Raises:
            ValueError: The inputs have another number of columns or missing values.
        """
        return self.regression.predict(inputs, return_sd=True)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what a file has to hold."""
        state = {} if self.state is None else self.state.arrays()
        return {
            **self.regression.arrays(),
            "window": np.array(self.window or (), dtype=np.int64),
            **{f"state/{name}": values for name, values in state.items()},
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """Return the model that `arrays` was taken from; raises as `MixtureRegression.from_arrays`."""
        state = {name.removeprefix("state/"): values for name, values in arrays.items() if name.startswith("state/")}
        window = tuple(arrays["window"].tolist())
        return cls(
            MixtureRegression.from_arrays(arrays),
            (window[0], window[1]) if window else None,
            OnlineMixture.from_arrays(state) if state else None,
        )


def window_of(quantity: Quantity, settings: Personal) -> tuple[int, int] | None:
    """Return n₂ and n₃ of a quantity's windows; None for the lookahead distance."""
    return (settings.past_steps, settings.future_steps) if quantity == "steering" else None
