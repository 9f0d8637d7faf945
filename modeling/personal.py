"""Personal models: a driver's own fit, the population's, and the population adapted to a driver; whose minute is this?

Two things are personal and modelled: how the wheel is moved, and how far ahead the driver looks.

    steering     the angles of the next steps given the path, its speed and the angles seen (MP, n₁ = 1)
    lookahead    the lookahead distance given course deviation and speed (PP's general regression)

The road says much about the drive and nothing about who drives: some commute on motorways. So drivers are told apart
by the *conditional* density of outputs given inputs; the joint density, which also tells roads and speeds apart, stands
beside it. Windows overlap, and each predicted step counts once: a window's log-likelihood is divided by its steps.
Lookahead distances of neighbouring samples say nearly the same, and count as one within `LOOKAHEAD_MEMORY`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ..schemas.config import Personal
from .adaptation import adapt
from .baselines import Ridge
from .estimator import FloatArray
from .lookahead_models import GeneralLookahead
from .motion_primitives import EVERYTHING, fit_motion_primitives, windows_needed
from .regression import MixtureRegression
from .windows import Mask, Rows, Series, cut_windows, window_centres

Quantity = Literal["steering", "lookahead"]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)

EVERY = 2
"""Every other window is learnt from: neighbours 0.1 s apart are nearly equal."""

MINUTE = 60.0
"""s; a fold is cut into pieces about as long, and each is asked whose it is."""


LOOKAHEAD_MEMORY = 0.4
"""s; lookahead distances so near to each other are told by the same steering, and count as one, as in the dataset."""


@dataclass(frozen=True, slots=True)
class Samples:
    """What one driver did, as one of the two models takes it.

    Attributes:
        centres: Row of the series that each sample belongs to (n_samples,), rising.
        inputs: Shape (n_samples, n_inputs); as in `windows`, or deg per sample and m/s.
        outputs: Shape (n_samples, n_outputs); deg, or m.
    """

    centres: Rows
    inputs: FloatArray
    outputs: FloatArray

    @property
    def joint(self) -> FloatArray:
        """Inputs and outputs side by side, in their units (n_samples, n_inputs + n_outputs)."""
        return np.concatenate([self.inputs, self.outputs], axis=1)


def take_samples(series: Series, rows: Mask, quantity: Quantity, settings: Personal) -> Samples:
    """Return all samples of a driver that lie within the given rows (n_rows,)."""
    if quantity == "steering":
        past, future = settings.past_steps, settings.future_steps
        centres = window_centres(series.stretch, rows & series.has_path_and_steering, max(past, 0), future)
        windows = cut_windows(series, centres, past, future)
        return Samples(centres, windows.inputs, windows.outputs)
    centres = np.flatnonzero(rows & series.has_lookahead)
    return Samples(centres, series.path_points[centres], series.lookahead[centres, None])


def fit_own(
    samples: Sequence[Samples], quantity: Quantity, settings: Personal, seed: int = 0
) -> MixtureRegression | None:
    """Fit a regression to the samples of one driver, or of all: then it is the population's.

    Args:
        samples: Of each driver.
        quantity: What they are samples of.
        settings: Components and steps.
        seed: Of the starts.

    Returns:
        The regression, None where there are too few samples for one.
    """
    if quantity == "lookahead":
        inputs, outputs = _together(samples, 1)
        if len(inputs) < samples_needed(quantity, settings):
            return None
        return GeneralLookahead(settings.lookahead_components, 1, seed).fit(inputs, outputs[:, 0]).regression
    inputs, outputs = _together(samples, EVERY)
    if len(inputs) < samples_needed(quantity, settings):
        return None
    gap = -(-(max(settings.past_steps, 0) + settings.future_steps) // EVERY)
    primitives = fit_motion_primitives(
        inputs,
        outputs,
        np.full(len(inputs), "1"),
        n1=1,
        components=settings.components,
        shrinkage=Ridge.fit(inputs, outputs, gap=gap).penalty,
        seed=seed,
    )
    return primitives.regressions[EVERYTHING]


def personalise(
    population: MixtureRegression, samples: Samples, quantity: Quantity, settings: Personal
) -> MixtureRegression:
    """Adapt the population's regression to a driver, see `adaptation`; any number of samples will do.

    Args:
        population: Of everybody.
        samples: Of the driver.
        quantity: What they are samples of.
        settings: With the relevance, rows for each channel.

    Raises:
        ValueError: The samples have other channels than the population's, or missing values.
    """
    joint = samples.joint[:: EVERY if quantity == "steering" else 1]
    mixture = adapt(population.mixture_, joint, settings.relevance * joint.shape[1])
    channels = range(joint.shape[1])
    inputs = population.n_features_in_
    return MixtureRegression.from_mixture(
        mixture, channels[:inputs], channels[inputs:], single_output=quantity == "lookahead"
    )


def samples_needed(quantity: Quantity, settings: Personal) -> int:
    """Return the fewest samples that a regression is fitted to."""
    if quantity == "lookahead":
        return 100
    channels = 2 * (max(settings.past_steps, 0) + 1 + settings.future_steps) + settings.past_steps + 1
    return max(windows_needed(channels + settings.future_steps, settings.components), 100)


@dataclass(frozen=True, slots=True)
class Likelihoods:
    """Log-likelihood of each sample under one driver's model, in nats, each (n_samples,).

    Attributes:
        conditional: Of the outputs given the inputs: log p(y | x), by the number of outputs.
        joint: Of both: log p(x, y), by the number of outputs.
    """

    conditional: FloatArray
    joint: FloatArray


def measure(model: MixtureRegression, samples: Samples) -> tuple[FloatArray, Likelihoods]:
    """Return each sample's mean absolute error, Σ |ŷ − y| / n_outputs (n_samples,), deg or m, and its log-likelihoods.

    Args:
        model: Anybody's.
        samples: What is to be explained.

    Raises:
        ValueError: The samples have other channels than the model, or missing values.
    """
    outputs = samples.outputs.shape[1]
    error = np.abs(model.predict(samples.inputs).reshape(samples.outputs.shape) - samples.outputs).mean(axis=1)
    conditional = model.log_likelihood(samples.inputs, samples.outputs) / outputs
    joint = model.mixture_.score_samples(samples.joint) / outputs
    return error, Likelihoods(conditional, joint)


def weight(quantity: Quantity, rate: float) -> float:
    """Return what one sample's log-likelihood counts for a minute, at a rate in Hz: a weight.

    It is 1 of steering, and w = 1 / max(`LOOKAHEAD_MEMORY` · rate, 1) of lookahead distances, which say less each.
    """
    return 1.0 if quantity == "steering" else 1.0 / max(LOOKAHEAD_MEMORY * rate, 1.0)


def cut_minutes(rows: Rows, centres: Rows, rate: float) -> NDArray[np.intp]:
    """Return which piece of about a minute, from 0, each sample of a fold belongs to (n_samples,).

    With n rows at a rate f they are max(round(n / (60 f)), 1), all equally long: a fold of less than a minute and a
    half is one.

    Args:
        rows: Rows of the fold (n_rows,), rising.
        centres: Rows of its samples (n_samples,).
        rate: Hz.
    """
    pieces = max(round(len(rows) / (MINUTE * rate)), 1)
    number: NDArray[np.intp] = np.searchsorted(rows, centres) * pieces // len(rows)
    return number


def name_drivers(likelihoods: Mapping[str, FloatArray], minutes: NDArray[np.intp]) -> dict[int, tuple[str, float]]:
    """Say whose model explains each minute best, by the sum of its samples' log-likelihoods: arg max Σ log p.

    Args:
        likelihoods: By driver, two at least, log-likelihood of each sample, nats (n_samples,).
        minutes: Which minute each sample belongs to (n_samples,).

    Returns:
        By minute: the driver, and by how many nats the model beats the next one.
    """
    names = list(likelihoods)
    scores = np.array([np.bincount(minutes, weights=values) for values in likelihoods.values()])
    second, first = np.sort(scores, axis=0)[-2:]
    best = scores.argmax(axis=0)
    return {
        minute: (names[best[minute]], float(first[minute] - second[minute])) for minute in np.unique(minutes).tolist()
    }


def first_minutes_after(series: Series, training: Mask, fold: int, rate: float) -> NDArray[np.float64]:
    """Return how many minutes of training data come before each row, counted from the test fold on.

    A learning curve takes the first so many: a stretch of driving as a new driver would have it, nested within the
    longer ones. It begins where the test fold ends, so that every fold has another stretch, and after the last row of
    the series goes on at the first. The i-th row of these, from 0, has t = i / (60 rate).

    Args:
        series: The driver's data.
        training: Rows that may be learnt from (n_rows,).
        fold: The test fold.
        rate: Hz.

    Returns:
        min, infinite in rows that may not be learnt from (n_rows,).
    """
    begin = int(np.flatnonzero(series.fold == fold)[-1]) + 1 if (series.fold == fold).any() else 0
    order = np.roll(np.arange(len(training)), -begin)
    minutes = np.full(len(training), np.inf)
    taken = order[training[order]]
    minutes[taken] = np.arange(len(taken)) / (60.0 * rate)
    return minutes


def curve_minutes(available: float) -> list[int]:
    """Return 1, 2, 5, 10, 20, 50, … min, as far as `available` min reach: f · 10ⁿ with f = 1, 2, 5."""
    steps = [factor * 10**power for power in range(6) for factor in (1, 2, 5)]
    return [minutes for minutes in steps if minutes <= available]


def _together(samples: Sequence[Samples], every: int) -> tuple[FloatArray, FloatArray]:
    return (
        np.concatenate([own.inputs[::every] for own in samples]),
        np.concatenate([own.outputs[::every] for own in samples]),
    )
