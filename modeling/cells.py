"""The cells of the evaluation: what one driver's models do on one test fold when they learn from the others."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..schemas.config import Config
from ..schemas.errors import InputError
from ..schemas.project import encode_name
from ..schemas.store import describe_output, publish_json
from ..schemas.tasks import Outcome
from .baselines import Persistence, Ridge
from .calibration import Forecast
from .curvature import curvature_blocks
from .curvature_primitives import fit_curvature_primitives
from .drivers import (
    describe_path_types,
    fit_path_types,
    label_rows,
    one_thread,
    part,
    read_series,
    training_and_test,
)
from .held_out import blocks_of, calibrate
from .kinematic import Kinematic
from .learned_baselines import LearnedBaseline
from .lookahead_models import GeneralLookahead, VelocityLookahead
from .measures import measure
from .mixture import GaussianMixture
from .motion_primitives import N1, MotionPrimitives, fit_motion_primitives, windows_needed
from .windows import Floats, Mask, Rows, Windows, cut_windows, spread_out, window_centres

MIXTURES = {"paper": "mixture", "curvature": "curvature_mixture"}
"""Mixture as `[models.motion_primitives] inputs` names it -> its name in the results."""

FEWEST_SAMPLES = 100
"""Windows, or lookahead distances, without which nothing is fitted: 10 s."""


def evaluate_motion_primitives(project: Path, driver: str, fold: int, past_steps: int, config: Config) -> Outcome:
    """Fit motion primitives and baselines to all folds but one and test them on that one (PP eq. 12).

    Segments and types of path are those of the training folds too, and the type of a row is told by rows of its own
    side alone, training or test. All numbers of past steps are tested on the same windows, those that are whole for the
    largest one.

    Args:
        project: Project folder.
        driver: Whose data.
        fold: The test fold, from 0.
        past_steps: n₂.
        config: The project file.

    Returns:
        The cell, with the measures of `measures.measure`; a problem where the test fold has no whole window.

    Raises:
        InputError: There are too few windows to learn from, no segment lies entirely in the training folds, or the
            dataset cannot be read.
    """
    settings = config.models.motion_primitives
    series = read_series(project, driver, config)
    training, test = training_and_test(series, fold, config)
    past, future = max(*settings.past_steps, 0), settings.future_steps
    complete = series.has_path_and_steering
    of_training, of_test = (window_centres(series.stretch, rows & complete, past, future) for rows in (training, test))
    learnt = cut_windows(series, spread_out(of_training, settings.max_windows), past_steps, future)
    asked = cut_windows(series, of_test, past_steps, future)
    needed = max(windows_needed(learnt.inputs.shape[1] + future, max(settings.components)), FEWEST_SAMPLES)
    if (found := len(learnt.centres)) < needed:
        raise _too_few(project, driver, fold, f"{found} windows to learn from", needed)
    measured = _Measured(driver, fold, past_steps, asked.outputs, config.sync.period / 1e9)
    with one_thread():
        sides = part(series, training + 2 * test, config)
        types = fit_path_types(sides, training, config)
        path_type = label_rows(sides, types, config)
        ridge = Ridge.fit(learnt.inputs, learnt.outputs, gap=past + future)
        persistence = Persistence.fit(learnt.current, learnt.outputs)
        measured.add("persistence", Forecast.gaussian(*persistence.predict(asked.current)))
        measured.add("ridge", Forecast.gaussian(*ridge.predict(asked.inputs)))
        for name, forecast in _baselines(learnt, asked, past_steps, config):
            measured.add(name, forecast)
        fallbacks: dict[str, dict[str, str]] = {}
        fitted: dict[str, Any] = {}
        for components in settings.components:
            for inputs in dict.fromkeys(settings.inputs):
                model = MIXTURES[inputs]
                finest, facts = fit_mixture(
                    inputs,
                    learnt,
                    path_type[learnt.centres],
                    settings.path_types,
                    past_steps,
                    components,
                    ridge.penalty,
                    config,
                )
                fitted[f"{model}, {components} components"] = facts
                forecasts = finest.forecasts(asked.inputs, path_type[asked.centres], settings.path_types)
                for n1, forecast in zip(settings.path_types, forecasts, strict=True):
                    fallbacks[f"{model}, {n1} path types, {components} components"] = finest.coarser(n1).fallbacks()
                    measured.add(model, forecast, n1, components)
    said = {"penalty": ridge.penalty, "fits": fitted, "clusters": describe_path_types(types), "fallbacks": fallbacks}
    details = {"horizons": measured.horizons, "calibration": measured.probabilities}
    file = f"fold-{fold}.past-{past_steps}.json"
    return _publish(project, Path("motion_primitives") / encode_name(driver) / file, measured.rows, said | details)


@dataclass
class _Measured:
    """What a cell has measured so far: over all steps, by horizon, and by probability.

    Attributes:
        driver: Whose data.
        fold: The test fold.
        past_steps: n₂.
        truth: What the driver did in the windows of the fold, deg (n_windows, n₃).
        step: s between two steps.
    """

    driver: str
    fold: int
    past_steps: int
    truth: Floats
    step: float
    rows: list[dict[str, Any]] = field(default_factory=list)
    horizons: list[dict[str, Any]] = field(default_factory=list)
    probabilities: list[dict[str, Any]] = field(default_factory=list)

    def add(self, model: str, forecast: Forecast, path_types: int = 1, components: int | None = None) -> None:
        """Measure a model's forecast of these windows."""
        point = {
            "driver": self.driver,
            "model": model,
            "path_types": path_types,
            "past_steps": self.past_steps,
            "future_steps": self.truth.shape[1],
            "components": components,
            "fold": self.fold,
        }
        overall, by_horizon, by_probability = measure(forecast, self.truth, self.step)
        self.rows.append(point | overall)
        self.horizons.extend(point | row for row in by_horizon)
        self.probabilities.extend(point | row for row in by_probability)


def fit_mixture(
    inputs: Literal["paper", "curvature"],
    learnt: Windows,
    path_types: NDArray[Any],
    told_apart: Sequence[N1],
    past_steps: int,
    components: int,
    penalty: float,
    config: Config,
) -> tuple[MotionPrimitives, dict[str, Any]]:
    """Fit and, where the project file asks for it, calibrate motion primitives of the finest n₁ asked for.

    Args:
        inputs: Which mixture, as `[models.motion_primitives] inputs` names it.
        learnt: Windows to learn from.
        path_types: Path type of each window (n_windows,).
        told_apart: Each n₁ that will be asked for.
        past_steps: n₂.
        components: n₄.
        penalty: What ridge regression of the same windows chose, a number of rows.
        config: The project file.

    Returns:
        The motion primitives, and what was chosen: `covariance_shrinkage_rows` or `tied`, and whether `calibrated`.

    Raises:
        ValueError: There are fewer windows than `windows_needed`.
    """
    settings, seed = config.models.motion_primitives, config.models.seed
    finest, levels = max(told_apart), told_apart if settings.calibrate else ()
    if inputs == "curvature":
        primitives, tied = fit_curvature_primitives(
            learnt.inputs,
            learnt.outputs,
            path_types,
            learnt.centres,
            n1=finest,
            components=components,
            past_steps=past_steps,
            step=config.sync.period / 1e9,
            levels=levels,
            starts=settings.starts,
            seed=seed,
        )
        return primitives, {"tied": tied, "calibrated": bool(primitives.calibrations)}

    def fit(rows: Rows) -> MotionPrimitives:
        return fit_motion_primitives(
            learnt.inputs[rows],
            learnt.outputs[rows],
            path_types[rows],
            n1=finest,
            components=components,
            shrinkage=penalty * len(rows) / len(learnt.centres),
            starts=settings.starts,
            seed=seed,
        )

    primitives, calibrations = fit(np.arange(len(learnt.centres))), {}
    if levels:
        needed = windows_needed(learnt.inputs.shape[1] + settings.future_steps, components)
        length = max(past_steps, 0) + 1 + settings.future_steps
        blocks = blocks_of(learnt.centres, length, needed)
        calibrations = calibrate(fit, learnt.inputs, learnt.outputs, path_types, blocks, levels)
    facts = {"covariance_shrinkage_rows": penalty, "calibrated": bool(calibrations)}
    return replace(primitives, calibrations=calibrations), facts


def _baselines(learnt: Windows, asked: Windows, past_steps: int, config: Config) -> Iterator[tuple[str, Forecast]]:
    """Yield the forecasts of the baselines that the project file names, from the papers' inputs all of them."""
    settings, step = config.models.motion_primitives, config.sync.period / 1e9
    gap = max(past_steps, 0) + settings.future_steps
    for name in dict.fromkeys(settings.baselines):
        if name == "kinematic":
            kinematic = Kinematic.fit(learnt.inputs, learnt.outputs, past_steps, step, gap=gap)
            yield name, Forecast.gaussian(*kinematic.predict(asked.inputs))
        elif name == "ridge_curvature":
            blocks = (
                curvature_blocks(windows.inputs, past_steps, settings.future_steps, step) for windows in (learnt, asked)
            )
            given, tested = (np.concatenate([k, kv2, seen], axis=1) for k, kv2, _, seen in blocks)
            yield name, Forecast.gaussian(*Ridge.fit(given, learnt.outputs, gap=gap).predict(tested))
        else:
            learned = LearnedBaseline.fit(
                name, learnt.inputs, learnt.outputs, past_steps=past_steps, gap=gap, seed=config.models.seed
            )
            yield name, Forecast.gaussian(*learned.predict(asked.inputs))


def evaluate_lookahead(project: Path, driver: str, fold: int, config: Config) -> Outcome:
    """Fit lookahead models and baselines to all folds but one and test them on both splits (PP eqs. 12, 22 and 23).

    Persistence is the lookahead distance of the previous sample. That follows from the driver's own steering 0.1 s ago,
    which no model is given: it shows how slowly the distance changes, and is not what a model has to beat. Samples
    without a previous one are left out of its row.

    Args:
        project: Project folder.
        driver: Whose data.
        fold: The test fold, from 0.
        config: The project file.

    Returns:
        The cell: mean error and mean standard deviation, m; a problem where the test fold has no lookahead distance.

    Raises:
        InputError: There are too few samples to learn from, or the dataset cannot be read.
    """
    settings, seed = config.models.lookahead, config.models.seed
    series = read_series(project, driver, config)
    before = np.append(np.nan, np.where(np.diff(series.stretch) == 0, series.lookahead[:-1], np.nan))
    known = series.has_lookahead
    training, test = (rows[known] for rows in training_and_test(series, fold, config))
    inputs, lookahead, previous = series.path_points[known], series.lookahead[known], before[known]
    if (found := int(training.sum())) < FEWEST_SAMPLES:
        raise _too_few(project, driver, fold, f"{found} lookahead distances to learn from", FEWEST_SAMPLES)
    rows: list[dict[str, Any]] = []

    def measure(model: str, components: int | None, regressors: int | None, prediction: tuple[Floats, Floats]) -> None:
        mean, sd = prediction
        for split, of_split in (("train", training), ("test", test)):
            asked = of_split & np.isfinite(mean)
            rows.append(
                {
                    "driver": driver,
                    "model": model,
                    "components": components,
                    "regressors": regressors,
                    "fold": fold,
                    "split": split,
                    "mean_error": _mean(np.abs(mean - lookahead)[asked]),
                    "mean_sd": _mean(sd[asked]),
                    "samples": int(asked.sum()),
                }
            )

    with one_thread():
        learnt = spread_out(np.flatnonzero(training), settings.max_samples)
        change = (lookahead - previous)[training & np.isfinite(previous)]
        spread = math.sqrt(_mean(np.square(change)) or 0.0)
        measure("persistence", None, None, (previous, np.full(len(previous), spread)))
        gap = round(config.dataset.embargo * 1e9 / config.sync.period)
        mean, variance = Ridge.fit(inputs[training], lookahead[training, None], gap=gap).predict(inputs)
        measure("ridge", None, None, (mean[:, 0], np.sqrt(variance[:, 0])))
        fallbacks: dict[str, list[str]] = {}
        classes: dict[int, GaussianMixture] = {}
        for components in settings.components:
            general = GeneralLookahead(components, settings.starts, seed)
            measure("general", components, None, general.fit(inputs[learnt], lookahead[learnt]).predict(inputs))
            fallbacks[f"general, {components} components"] = list(general.fallbacks)
            for regressors in settings.regressors:
                velocity = VelocityLookahead(components, regressors, settings.starts, seed)
                if (wanted := min(components, regressors)) not in classes:
                    classes[wanted] = velocity.fit_classes(inputs[learnt])
                prediction = velocity.fit(inputs[learnt], lookahead[learnt], classes[wanted]).predict(inputs)
                measure("velocity", components, regressors, prediction)
                fallbacks[f"velocity, {components} components, {regressors} regressors"] = list(velocity.fallbacks)
    name = Path("lookahead") / encode_name(driver) / f"fold-{fold}.json"
    return _publish(project, name, rows, {"fallbacks": fallbacks})


def _mean(values: Floats | Mask) -> float | None:
    return float(values.mean()) if values.size else None


def _too_few(project: Path, driver: str, fold: int, found: str, needed: int) -> InputError:
    reason = (
        f"driver {driver!r}, test fold {fold}: {found}, and {needed} are needed; add recordings, decide about proposed "
        "events (`wheelprint review`), or ask for fewer components"
    )
    return InputError(project / "wheelprint.toml", "models", reason)


def _publish(project: Path, name: Path, rows: Sequence[Mapping[str, Any]], facts: Mapping[str, Any]) -> Outcome:
    path = project / "results" / "cells" / name
    publish_json(path, {"rows": rows, **facts})
    problems = []
    if any(not row["samples"] for row in rows):
        reason = (
            "nothing in this test fold to measure with, its cells in the results are empty; its stretches without a "
            "break are too short: use fewer folds (dataset.folds), or decide about proposed events"
        )
        problems.append(InputError(path, "", reason))
    return Outcome({"outputs": [describe_output(project, path, rows=len(rows))]}, tuple(problems))
