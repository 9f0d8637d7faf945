"""How many components? Information criteria along a path of numbers of components (PP eq. 8)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from .estimator import FloatArray, as_array
from .mixture import GaussianMixture, ParameterCount

Counts = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class ComponentPath:
    """Mixtures of the same rows with one number of components after another, and what their criteria say.

    With log-likelihood L, p parameters and n rows, the lower the better:

        BIC = −2 log L + p log n        AIC = −2 log L + 2 p

    Attributes:
        n_components: What was asked for (n_ks,).
        kept: Components that did not collapse (n_ks,).
        log_likelihood: log L of all rows in nats (n_ks,).
        n_parameters: p of the components kept (n_ks,).
        bic: In nats (n_ks,).
        aic: In nats (n_ks,).
        mixtures: The fits (n_ks,).
    """

    n_components: Counts
    kept: Counts
    log_likelihood: FloatArray
    n_parameters: Counts
    bic: FloatArray
    aic: FloatArray
    mixtures: tuple[GaussianMixture, ...]

    def best(self, criterion: Literal["bic", "aic"] = "bic") -> GaussianMixture:
        """Return the mixture with the lowest criterion, of equals the first one."""
        return self.mixtures[int({"bic": self.bic, "aic": self.aic}[criterion].argmin())]

    def table(self) -> list[dict[str, float]]:
        """Return a row for each number of components, as a data frame or a CSV takes them; units as in the class."""
        names = ("n_components", "kept", "log_likelihood", "n_parameters", "bic", "aic")
        columns = {name: getattr(self, name).tolist() for name in names}
        return [dict(zip(names, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def select_components(
    X: npt.ArrayLike, ks: Iterable[int], *, parameter_count: ParameterCount = "full", **settings: Any
) -> ComponentPath:
    """Fit a mixture for each number of components and return them with their criteria; see `ComponentPath`.

    Args:
        X: Rows, shape (n_samples, n_features), in any units.
        ks: Numbers of components, each at least 1.
        parameter_count: What p counts, see `GaussianMixture.n_parameters`.
        settings: Further arguments of `GaussianMixture`.

    Raises:
        ValueError: No number is given, or see `GaussianMixture.fit`.
    """
    rows, counts = as_array(X, "X"), list(ks)
    if not counts:
        raise ValueError("ks must name at least one number of components, found none")
    mixtures = tuple(GaussianMixture(k, **settings).fit(rows) for k in counts)
    log_likelihood = np.array([mixture.score_samples(rows).sum() for mixture in mixtures])
    parameters = np.array([mixture.n_parameters(parameter_count) for mixture in mixtures], dtype=np.intp)
    return ComponentPath(
        np.array(counts, dtype=np.intp),
        np.array([len(mixture.weights_) for mixture in mixtures], dtype=np.intp),
        log_likelihood,
        parameters,
        -2.0 * log_likelihood + parameters * math.log(len(rows)),
        -2.0 * log_likelihood + 2.0 * parameters,
        mixtures,
    )
