"""Motion primitives: the steering that follows, by mixture regression within types of path (MP sections III-B, III-C).

MP's upper level says which type of path a window is on, its lower level is one mixture regression for each type:

    n₁ = 1    one regression for all windows
    n₁ = 3    one for each own path label, the cluster of the segment at t
    n₁ = 27   one for each path type, the labels of the previous, the own and the next segment (MP eq. 8)

MP clusters into three labels, hence its 3 and 27; another number of clusters gives as many regressions as there are
labels, or triples of labels.

MP fits each type's mixture apart. Here the mixture of everything is adapted to a label's windows, and the label's to a
path type's, so that types with few windows borrow from their like; with many windows each comes to stand by itself.

A mixture of 156 channels that nearly depend on each other, with few independent windows, needs *covariance shrinkage*.
Here it is a number of rows of noise, as wide as each channel, that stand beside each component's own rows (an
inverse-Wishart prior, in other words). With one component that is ridge regression exactly, the number being its
penalty; so the penalty that ridge regression of the same windows chooses by cross-validation is the number to take.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from .adaptation import adapt
from .calibration import Calibration, Forecast
from .curvature import CurvatureCoordinates
from .mixture import GaussianMixture
from .regression import MixtureRegression

Floats = NDArray[np.float64]
N1 = Literal[1, 3, 27]
"""How many types of path MP tells apart."""

EVERYTHING = "all"
"""Name of the regression that knows no path types."""

PRIOR_WINDOWS = 20
"""Windows per channel that stand for the prior of each component of a path type, see `adaptation.adapt`.

Fitted apart, as in MP, a path type with less than two thousand windows or so predicts worse than everything together:
on 10 minutes of one simulated driver the error rose from 1.6 to 2.7 deg with n₁ = 3. With this prior n₁ = 27 lowers it
by 0 to 9 % for eight drivers, real and simulated; 10 or 40 does about as well.
"""

OWN_WINDOWS = 1
"""Windows per channel from which on a path type has a regression of its own."""

FEWEST_WINDOWS = 1
"""Windows per channel and component without which even the regression for everything is not fitted."""

OUTPUT_NOISE = 1e-6
"""Share of an output's variance that remains of the noise of `_fit`, to keep covariances positive definite."""

TOLERANCE = 1.0
"""EM ends when the mean log-likelihood of a window, several hundred nats, rises by less.

What follows sharpens the components on the windows learnt from. For eight drivers, real and simulated, 0.01 instead of
1 changed the error on held-out folds by −5 to +4 %, on average by nothing, and took up to four times as long.
"""


@dataclass(frozen=True, slots=True)
class MotionPrimitives:
    """The fitted regressions, by path type.

    A path type with too few windows has no regression of its own; it falls back to that of its own label, and that to
    the one for everything. `model_of` says which is used.

    Attributes:
        n1: Path types that are told apart.
        regressions: By path type (`1-3-2`), own label (`3`) or `all`; `all` is always there.
        samples: Training windows by path type, own label and `all`, also of those without a regression.
        coordinates: What they predict the change of the angle from; None: the angle itself, from the papers' inputs.
        calibrations: By n₁, how the errors are distributed; without one, as Gaussians of the stated variances.
    """

    n1: N1
    regressions: Mapping[str, MixtureRegression]
    samples: Mapping[str, int]
    coordinates: CurvatureCoordinates | None = None
    calibrations: Mapping[int, Calibration] = field(default_factory=dict)

    def predict(self, inputs: Floats, path_types: NDArray[Any]) -> tuple[Floats, Floats]:
        """Predict the steering wheel angle of every future step (MP eqs. 18 to 22, corrected).

        Args:
            inputs: Shape (n_windows, n_inputs), as `windows.cut_windows` lays them out.
            path_types: Path type of each window, such as `1-3-2` (n_windows,).

        Returns:
            Means in deg and variances in deg², calibrated where that was fitted, each (n_windows, n₃).

        Raises:
            ValueError: The windows have another number of inputs than were learnt from, or missing values.
        """
        forecast = self.forecast(inputs, path_types)
        return forecast.mean, forecast.calibration.variance(forecast.sd)

    def forecast(self, inputs: Floats, path_types: NDArray[Any]) -> Forecast:
        """Return the predictive distributions of every future step; arguments, formulas and errors as for `predict`."""
        return next(self.forecasts(inputs, path_types, [self.n1]))

    def forecasts(self, inputs: Floats, path_types: NDArray[Any], levels: Iterable[N1]) -> Iterator[Forecast]:
        """Yield what `forecast` returns of the structure with each n₁ (`coarser`), the windows' coordinates found once.

        Args:
            inputs: As for `predict`.
            path_types: As for `predict`.
            levels: Each n₁.
        """
        outputs = self.regressions[EVERYTHING].n_outputs_
        given = inputs if self.coordinates is None else self.coordinates.transform(inputs)
        origin = 0.0 if self.coordinates is None else self.coordinates.origin(inputs)
        for primitives in map(self.coarser, levels):
            mean, sd = np.empty((2, len(inputs), outputs))
            for regression, own in primitives._shared_out(path_types):  # noqa: SLF001 - it is one of this class
                mean[own], sd[own] = regression.predict(given[own], return_sd=True)
            mean += origin
            yield Forecast(mean, sd, self.calibrations.get(primitives.n1, Calibration.gaussian(outputs)))

    def predict_one(self, inputs: Floats, path_type: str) -> tuple[Floats, Floats, float]:
        """Predict one window, unchecked and at once; see `predict` for the formulas.

        Args:
            inputs: A window as for `predict`, finite, float64 (n_inputs,).
            path_type: Such as `1-3-2`.

        Returns:
            Means in deg and variances in deg² as of `predict`, each (n₃,), and the domain score in nats.
        """
        rows = inputs[None]
        given = inputs if self.coordinates is None else self.coordinates.transform(rows)[0]
        mean, sd, score = self.regressions[self.model_of(path_type)].predict_one(given)
        if self.coordinates is not None:
            mean += self.coordinates.origin(rows)[0]
        calibration = self.calibrations.get(self.n1)
        return mean, np.square(sd) if calibration is None else calibration.variance(sd), score

    def domain_score(self, inputs: Floats, path_types: NDArray[Any]) -> Floats:
        """Return how ordinary windows are: the log density of the inputs in the regression that predicts, nats.

        Args:
            inputs: As for `predict`.
            path_types: As for `predict`.

        Returns:
            Shape (n_windows,), nats.

        Raises:
            ValueError: As for `predict`.
        """
        score = np.empty(len(inputs))
        given = inputs if self.coordinates is None else self.coordinates.transform(inputs)
        for regression, own in self._shared_out(path_types):
            score[own] = regression.domain_score(given[own])
        return score

    def model_of(self, path_type: str) -> str:
        """Return the name of the regression that predicts windows of a path type, also of one never seen."""
        return next(name for name in _names(path_type, self.n1) if name in self.regressions)

    def _shared_out(self, path_types: NDArray[Any]) -> Iterator[tuple[MixtureRegression, NDArray[np.intp]]]:
        """Yield each regression that predicts some of the windows, and which ones."""
        distinct, which = np.unique(path_types.astype(str), return_inverse=True)
        models = np.array([self.model_of(path_type) for path_type in distinct.tolist()], dtype=object)[which]
        for model in dict.fromkeys(models):
            yield self.regressions[model], np.flatnonzero(models == model)

    def fallbacks(self) -> dict[str, str]:
        """Return the path types of the training windows that have no regression of their own, and whose they use."""
        wanted = [name for name in self.samples if _level(name) == self.n1 and name not in self.regressions]
        return {name: self.model_of(name) for name in wanted}

    def coarser(self, n1: N1) -> MotionPrimitives:
        """Return the same structure with a smaller n₁, which is part of it."""
        kept = {name: regression for name, regression in self.regressions.items() if _level(name) <= n1}
        return replace(self, n1=n1, regressions=kept)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what a file has to hold."""
        arrays: dict[str, NDArray[Any]] = {
            "n1": np.array(self.n1),
            "sample_names": np.array(list(self.samples)),
            "sample_counts": np.array(list(self.samples.values())),
        }
        parts = {f"regressions/{name}": regression.arrays() for name, regression in self.regressions.items()}
        parts |= {f"calibrations/{n1}": calibration.arrays() for n1, calibration in self.calibrations.items()}
        if self.coordinates is not None:
            parts["coordinates"] = self.coordinates.arrays()
        return arrays | {f"{name}/{part}": values for name, own in parts.items() for part, values in own.items()}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """Return the motion primitives that `arrays` was taken from; raises as `MixtureRegression.from_arrays`."""
        parts: dict[str, dict[str, dict[str, NDArray[Any]]]] = {}
        for path, values in arrays.items():
            if "/" in path:
                *kind, part = path.split("/")
                parts.setdefault(kind[0], {}).setdefault(kind[-1], {})[part] = values
        coordinates = parts.get("coordinates", {}).get("coordinates")
        return cls(
            arrays["n1"].item(),
            {name: MixtureRegression.from_arrays(own) for name, own in parts["regressions"].items()},
            dict(zip(arrays["sample_names"].tolist(), arrays["sample_counts"].tolist(), strict=True)),
            None if coordinates is None else CurvatureCoordinates.from_arrays(coordinates),
            {int(name): Calibration.from_arrays(own) for name, own in parts.get("calibrations", {}).items()},
        )


def fit_motion_primitives(
    inputs: Floats,
    outputs: Floats,
    path_types: NDArray[Any],
    *,
    n1: N1,
    components: int,
    shrinkage: float,
    starts: int = 1,
    seed: int = 0,
) -> MotionPrimitives:
    """Fit a driver's motion primitives (MP eqs. 11 to 17).

    EM adds to the variance of channel j of each of K components the ridge of `shrinkage` · K / n of that channel's
    variance over all n windows, of outputs taken out again but for `OUTPUT_NOISE`.

    Args:
        inputs: Shape (n_windows, n_inputs), as `windows.cut_windows` lays them out.
        outputs: Shape (n_windows, n₃), deg.
        path_types: Path type of each window, such as `1-3-2` (n_windows,).
        n1: Path types that are told apart.
        components: n₄, components of each regression's mixture.
        shrinkage: Number of rows of noise beside each component's own, above 0: `baselines.Ridge.fit` of the same
            windows chooses it, `penalty`.
        starts: k-means starts of each mixture; the most likely one is kept.
        seed: Of the starts.

    Raises:
        ValueError: There are fewer windows than `windows_needed`.
    """
    joint = np.concatenate([inputs, outputs], axis=1)
    needed = windows_needed(joint.shape[1], components)
    if len(joint) < needed:
        raise ValueError(
            f"{components} components of {joint.shape[1]} channels need {needed} windows, not {len(joint)}"
        )
    noise = shrinkage * joint.var(axis=0)
    noise[inputs.shape[1] :] = 0.0
    everything = _fit(joint, inputs.shape[1], components, shrinkage, starts, seed)
    mixtures, samples = adapt_to_path_types(everything, joint, path_types, n1=n1, noise=noise)
    columns = np.arange(joint.shape[1])
    split = (columns[: inputs.shape[1]], columns[inputs.shape[1] :])
    regressions = {name: MixtureRegression.from_mixture(mixture, *split) for name, mixture in mixtures.items()}
    return MotionPrimitives(n1, regressions, samples)


def adapt_to_path_types(
    everything: GaussianMixture, joint: Floats, path_types: NDArray[Any], *, n1: N1, noise: Floats
) -> tuple[dict[str, GaussianMixture], dict[str, int]]:
    """Adapt the mixture of all windows to own labels, and theirs to path types (MP eqs. 9, 10), as windows allow.

    By one step of `adaptation.adapt`, with `PRIOR_WINDOWS` for each channel as relevance.

    Args:
        everything: The mixture of all windows.
        joint: All windows (n_windows, n_channels), in the units of `everything`.
        path_types: Path type of each window (n_windows,).
        n1: Path types that are told apart.
        noise: Sum of squares of the rows of noise beside each component's own, in squares of these units
            (n_channels,).

    Returns:
        The mixtures by name, `everything` as `all`, and the windows by name, also of those without a mixture.
    """
    distinct, which = np.unique(path_types.astype(str), return_inverse=True)
    names = np.array([[*reversed(_names(path_type, n1))] for path_type in distinct.tolist()])[which]
    samples = Counter(names.ravel().tolist())
    mixtures = {EVERYTHING: everything}
    for name in sorted(samples, key=lambda name: (_level(name), name)):
        if name != EVERYTHING and samples[name] >= OWN_WINDOWS * joint.shape[1]:
            parent = next(mixtures[other] for other in _names(name, n1)[1:] if other in mixtures)
            own = joint[(names == name).any(axis=1)]
            mixtures[name] = adapt(parent, own, PRIOR_WINDOWS * joint.shape[1], noise=noise, steps=1)
    return mixtures, dict(sorted(samples.items()))


def windows_needed(channels: int, components: int) -> int:
    """Return the fewest windows, each of `channels` inputs and outputs, that motion primitives are fitted to."""
    return FEWEST_WINDOWS * channels * components


def _fit(joint: Floats, n_inputs: int, components: int, shrinkage: float, starts: int, seed: int) -> GaussianMixture:
    """Fit the mixture of all windows (n_windows, n_channels), inputs first."""
    regularisation = shrinkage * components / len(joint)
    mixture = GaussianMixture(
        components,
        covariance_regularisation=regularisation,
        n_starts=starts,
        max_iterations=100,
        tolerance=TOLERANCE,
        random_state=seed,
    ).fit(joint)
    # In the inputs the noise makes each component's regression a ridge regression. In the outputs it would only widen
    # every prediction by what no driver did, so that all but a trace of it is taken out again.
    noise = (regularisation - OUTPUT_NOISE) * joint.var(axis=0)
    noise[:n_inputs] = 0.0
    return GaussianMixture.from_parameters(mixture.weights_, mixture.means_, mixture.covariances_ - np.diag(noise))


def _names(path_type: str, n1: N1) -> list[str]:
    """Return the regressions that may predict a path type, or own label, the most particular one first."""
    own = path_type.split("-")[1] if "-" in path_type else path_type
    return [name for name in dict.fromkeys((path_type, own, EVERYTHING)) if _level(name) <= n1]


def _level(name: str) -> int:
    """Return the n₁ from which on a regression is part of the structure."""
    return 1 if name == EVERYTHING else 27 if "-" in name else 3
