"""The papers' two regressions of the lookahead distance on [Δθ, v] (PP section IV-B)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, Self

import numpy as np
import numpy.typing as npt

from .conditional_mode import conditional_mode
from .estimator import FloatArray
from .mixture import GaussianMixture
from .regression import MixtureRegression

Estimate = Literal["mean", "mode"]
"""What a model predicts: the conditional mean, or where the conditional density is highest (PP eq. 10)."""

SPEED = 1
"""Column of the inputs [Δθ, v] that the velocity-based model classifies by."""

ROWS_PER_COMPONENT = 40
"""Fewest training rows for each component: a full covariance of three channels and its mean are 9 figures."""


class LookaheadModel(Protocol):
    """What both models do: λ of PP eq. 4, from [Δθ, v] to the lookahead distance."""

    fallbacks: tuple[str, ...]

    def fit(self, inputs: FloatArray, lookahead: FloatArray) -> LookaheadModel:
        """Fit to [Δθ, v] (n_samples, 2), deg per sample and m/s, and lookahead distances (n_samples,), m."""
        ...

    def predict(self, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the mean and standard deviation of the lookahead distance, m, each (n_samples,)."""
        ...


@dataclass
class GeneralLookahead:
    """One mixture regression for all speeds (PP eqs. 13 to 17).

    PP's eq. 16 takes the arg max of the model, and its eq. 17 calls a responsibility a deviation; here it is the
    conditional mean and standard deviation. `estimate="mode"` is the arg max, around which the deviation is larger.

    Args:
        components: n₁, components of the mixture.
        starts: k-means starts; the most likely fit is kept.
        seed: Of the starts.
        faithful: Regression without priors and with covariance Σ β² C_k, as MP prints it (see `MixtureRegression`).
        estimate: What is predicted.

    Attributes:
        regression: The fitted regression.
        fallbacks: What had to be fitted with less than was asked for, and why, one sentence each.
    """

    components: int
    starts: int = 1
    seed: int = 0
    faithful: bool = False
    estimate: Estimate = "mean"
    regression: MixtureRegression = field(init=False)
    fallbacks: tuple[str, ...] = field(init=False, default=())

    def fit(self, inputs: FloatArray, lookahead: FloatArray) -> GeneralLookahead:
        """Fit the regression (PP eqs. 7 and 13).

        Args:
            inputs: [Δθ, v], deg per sample and m/s, shape (n_samples, 2).
            lookahead: m, shape (n_samples,), no missing values.

        Raises:
            ValueError: There are no samples, or missing values.
        """
        components = min(self.components, max(len(inputs) // ROWS_PER_COMPONENT, 1))
        self.regression = MixtureRegression(
            components, n_starts=self.starts, random_state=self.seed, faithful=self.faithful
        ).fit(inputs, lookahead)
        kept = len(self.regression.mixture_.weights_)
        self.fallbacks = ()
        if kept < self.components:
            self.fallbacks = (f"{kept} instead of {self.components} components for {len(inputs)} samples",)
        return self

    def predict(self, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Predict the lookahead distance by MP eqs. 18 to 22 or, as the mode, PP eq. 16.

        Args:
            inputs: [Δθ, v], deg per sample and m/s, shape (n_samples, 2).

        Returns:
            Mean and standard deviation, m, each (n_samples,); for the mode √(sd² + (mode − mean)²).

        Raises:
            ValueError: The inputs have another number of columns or missing values.
        """
        return _predict(self.regression, inputs, self.estimate)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return what a file has to hold."""
        return self.regression.arrays()

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> Self:
        """Return the fitted model that `arrays` was taken from; raises as `MixtureRegression.from_arrays`."""
        regression = MixtureRegression.from_arrays(arrays)
        model = cls(regression.n_components, faithful=regression.faithful)
        model.regression = regression
        return model


@dataclass
class VelocityLookahead:
    """Classes of speed by a Gaussian mixture, and a mixture regression for each (PP eqs. 18 to 21).

    The components are shared out in proportion to the classes' samples, at least one each (`share_out`): the paper
    only gives their total. Where fewer components than classes are asked for there are as many classes as
    components, and the classes of a class mixture that lost one are fewer too. A class without `ROWS_PER_COMPONENT`
    samples for each of its components gets fewer; one without enough for a single one is predicted by a general model
    of all samples.

    Args:
        components: Total number of components in the second layer.
        regressors: n₂, classes of speed and regressions.
        starts: k-means starts of every fit; the most likely one is kept.
        seed: Of the starts.
        faithful: As in `GeneralLookahead`.
        estimate: As in `GeneralLookahead`.

    Attributes:
        classes: The first layer, a mixture of the speed, in the order of rising mean speed.
        shares: Components of each class.
        regressions: Regression of each class; a class without its own has the general one.
        fallbacks: What had to be fitted with less than was asked for, and why, one sentence each.
    """

    components: int
    regressors: int
    starts: int = 1
    seed: int = 0
    faithful: bool = False
    estimate: Estimate = "mean"
    classes: GaussianMixture = field(init=False)
    shares: tuple[int, ...] = field(init=False)
    regressions: tuple[MixtureRegression, ...] = field(init=False)
    fallbacks: tuple[str, ...] = field(init=False, default=())

    def fit(
        self, inputs: FloatArray, lookahead: FloatArray, classes: GaussianMixture | None = None
    ) -> VelocityLookahead:
        """Fit both layers (PP eqs. 18 to 21).

        Args:
            inputs: [Δθ, v], deg per sample and m/s, shape (n_samples, 2).
            lookahead: m, shape (n_samples,), no missing values.
            classes: What `fit_classes` returns for these inputs, where that is known already.

        Raises:
            ValueError: There are no samples, or missing values.
        """
        self.classes = self.fit_classes(inputs) if classes is None else classes
        found = len(self.classes.weights_)
        fallbacks = []
        if found < self.regressors:
            fallbacks.append(f"{found} instead of {self.regressors} classes of speed")
        own_class = self.classes.predict(inputs[:, [SPEED]])
        samples = np.bincount(own_class, minlength=found)
        self.shares = share_out(self.components, samples)
        regressions: list[MixtureRegression] = []
        general: MixtureRegression | None = None
        for number, (count, share) in enumerate(zip(samples.tolist(), self.shares, strict=True)):
            where = f"class {number + 1} of speed, about {self.classes.means_[number, 0]:.1f} m/s"
            if count < ROWS_PER_COMPONENT:
                fallbacks.append(f"the general model in {where}, for {count} samples")
                general = general or self._fit(self.components, inputs, lookahead).regression
                regressions.append(general)
            else:
                own = own_class == number
                model = self._fit(share, inputs[own], lookahead[own])
                regressions.append(model.regression)
                fallbacks.extend(f"{reason} in {where}" for reason in model.fallbacks)
        self.regressions, self.fallbacks = tuple(regressions), tuple(fallbacks)
        return self

    def fit_classes(self, inputs: FloatArray) -> GaussianMixture:
        """Fit the first layer alone (PP eq. 18): the same for as many classes, however many components follow.

        Args:
            inputs: As for `fit`, shape (n_samples, 2).

        Raises:
            ValueError: There are no samples, or missing values.
        """
        speed = inputs[:, [SPEED]]
        wanted = max(min(self.regressors, self.components, len(np.unique(speed))), 1)
        classes = GaussianMixture(wanted, n_starts=self.starts, random_state=self.seed).fit(speed)
        order = np.argsort(classes.means_[:, 0])
        return GaussianMixture.from_parameters(
            classes.weights_[order], classes.means_[order], classes.covariances_[order]
        )

    def predict(self, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Predict the lookahead distance by the regression of the most probable class of speed (PP eq. 19).

        Args:
            inputs: [Δθ, v], deg per sample and m/s, shape (n_samples, 2).

        Returns:
            Mean and standard deviation, m, each (n_samples,), as of `GeneralLookahead.predict`.

        Raises:
            ValueError: The inputs have another number of columns or missing values.
        """
        mean, sd = np.empty(len(inputs)), np.empty(len(inputs))
        own_class = self.classes.predict(inputs[:, [SPEED]])
        for number in np.unique(own_class).tolist():
            own = own_class == number
            mean[own], sd[own] = _predict(self.regressions[number], inputs[own], self.estimate)
        return mean, sd

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return what a file has to hold: `classes/…` and, by class from 0, `0/…`, `1/…`."""
        arrays = {
            "classes/weights": self.classes.weights_,
            "classes/means": self.classes.means_,
            "classes/covariances": self.classes.covariances_,
            "shares": np.array(self.shares),
        }
        for number, regression in enumerate(self.regressions):
            arrays |= {f"{number}/{name}": values for name, values in regression.arrays().items()}
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> Self:
        """Return the fitted model that `arrays` was taken from; raises as `MixtureRegression.from_arrays`."""
        groups: dict[str, dict[str, npt.NDArray[Any]]] = {}
        for name, values in arrays.items():
            group, _, rest = name.rpartition("/")
            groups.setdefault(group, {})[rest] = values
        classes = GaussianMixture.from_parameters(**groups["classes"])
        regressions = tuple(MixtureRegression.from_arrays(groups[str(n)]) for n in range(len(classes.weights_)))
        shares = tuple(arrays["shares"].tolist())
        model = cls(sum(shares), len(regressions), faithful=regressions[0].faithful)
        model.classes, model.shares, model.regressions = classes, shares, regressions
        return model

    def _fit(self, components: int, inputs: FloatArray, lookahead: FloatArray) -> GeneralLookahead:
        return GeneralLookahead(components, self.starts, self.seed, self.faithful).fit(inputs, lookahead)


def _predict(regression: MixtureRegression, inputs: FloatArray, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation, or mode and root mean square deviation from it, each (n_samples,)."""
    mean, sd = regression.predict(inputs, return_sd=True)
    if estimate == "mean":
        return mean, sd
    mode = conditional_mode(regression, inputs)
    return mode, np.hypot(sd, mode - mean)


def share_out(total: int, samples: npt.NDArray[np.intp]) -> tuple[int, ...]:
    """Share `total` out in proportion to `samples` (n,), at least one each; n ≤ `total`.

    By Webster's method: each next one goes where samples / (2 share + 1) is largest, to the first of equals.
    """
    shares = np.ones(len(samples), dtype=np.intp)
    while shares.sum() < total:
        shares[np.argmax(samples / (2 * shares + 1))] += 1
    return tuple(shares.tolist())
