"""How far ahead to look: the learnt laws of a driver beside the two simplest ones that the same data tell."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from ..schemas.project import Project
from .estimator import FloatArray
from .lookahead_models import SPEED, GeneralLookahead, VelocityLookahead
from .storage import load_model

LAWS = ("general", "velocity", "constant", "linear")
"""General and velocity-based mixture (PP), the driver's median, and a line in speed."""


class LookaheadLaw(Protocol):
    """What all laws do."""

    def predict(self, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation in m, each (n,), for [Δθ, v] (n, 2), deg per sample and m/s."""
        ...


@dataclass
class ConstantLookahead:
    """The same distance everywhere, the driver's median.

    Attributes:
        distance: m.
        sd: m, of the driver's distances around it.
    """

    distance: float = field(init=False)
    sd: float = field(init=False)

    def fit(self, inputs: FloatArray, lookahead: FloatArray) -> ConstantLookahead:  # noqa: ARG002 - as the others
        """Take the median of lookahead distances h (n,) in m, sd = √mean (h − median)².

        The inputs (n, 2) tell it nothing.
        """
        self.distance = float(np.median(lookahead))
        self.sd = float(np.sqrt(np.mean(np.square(lookahead - self.distance))))
        return self

    def predict(self, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the distance and its standard deviation, m, each (n,), for inputs (n, 2)."""
        return np.full(len(inputs), self.distance), np.full(len(inputs), self.sd)


@dataclass
class LinearLookahead:
    """h = a + b v by least squares.

    Attributes:
        base: a, m.
        time: b, s.
        sd: m, of the residuals.
    """

    base: float = field(init=False)
    time: float = field(init=False)
    sd: float = field(init=False)

    def fit(self, inputs: FloatArray, lookahead: FloatArray) -> LinearLookahead:
        """Fit the line by min Σ (h − a − b v)².

        Args:
            inputs: [Δθ, v], deg per sample and m/s (n, 2).
            lookahead: h, m (n,).
        """
        design = np.column_stack([np.ones(len(inputs)), inputs[:, SPEED]])
        self.base, self.time = np.linalg.lstsq(design, lookahead, rcond=None)[0].tolist()
        self.sd = float(np.sqrt(np.mean(np.square(design @ [self.base, self.time] - lookahead))))
        return self

    def predict(self, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return h = a + b v and the residuals' standard deviation, m, each (n,), for [Δθ, v] (n, 2), v in m/s."""
        return self.base + self.time * inputs[:, SPEED], np.full(len(inputs), self.sd)


def fit_simple_laws(inputs: FloatArray, lookahead: FloatArray) -> dict[str, LookaheadLaw]:
    """Return `constant` and `linear`, fitted to [Δθ, v] (n, 2) and lookahead distances (n,) in m."""
    return {
        "constant": ConstantLookahead().fit(inputs, lookahead),
        "linear": LinearLookahead().fit(inputs, lookahead),
    }


def load_mixtures(project: Project, driver: str) -> tuple[GeneralLookahead, VelocityLookahead]:
    """Load a driver's trained general and velocity-based mixture.

    Raises:
        InputError: They were not trained, or their files are damaged.
    """
    general, _ = load_model(
        project.model_folder("lookahead_general", driver),
        {"lookahead_general": (GeneralLookahead.from_arrays, GeneralLookahead.predict)},
    )
    velocity, _ = load_model(
        project.model_folder("lookahead_velocity", driver),
        {"lookahead_velocity": (VelocityLookahead.from_arrays, VelocityLookahead.predict)},
    )
    return general, velocity
