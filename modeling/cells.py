"""The cells of the evaluation: what one driver's models do on one test fold when they learn from the others."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np

from ..dataset.folds import training_mask
from ..schemas.config import Config
from ..schemas.errors import InputError
from ..schemas.project import encode_name
from ..schemas.store import describe_output, publish_json
from ..schemas.tasks import Outcome
from .baselines import Persistence, Ridge
from .drivers import describe_path_types, fit_path_types, label_rows, one_thread, part, read_series
from .lookahead_models import GeneralLookahead, VelocityLookahead
from .motion_primitives import fit_motion_primitives, windows_needed
from .windows import Floats, Mask, Series, cut_windows, window_centres

WITHIN_68, WITHIN_95 = (NormalDist().inv_cdf((1.0 + share) / 2.0) for share in (0.68, 0.95))
"""Half widths of the Gaussian bands that hold 68 % and 95 %, in standard deviations."""

FEWEST_SAMPLES = 100
"""Windows, or lookahead distances, without which nothing is fitted: 10 s."""


def evaluate_motion_primitives(project: Path, driver: str, fold: int, past_steps: int, config: Config) -> Outcome:
    """Fit motion primitives and baselines to all folds but one and test them on that one.

    Segments and types of path are those of the training folds too, and the type of a row is told by rows of its own
    side alone, training or test. All numbers of past steps are tested on the same windows, those that are whole for the
    largest one.

    Args:
        project: Project folder.
        driver: Whose data.
        fold: The test fold.
        past_steps: n₂.
        config: The project file.

    Raises:
        InputError: There are too few windows to learn from.
    """
    settings = config.models.motion_primitives
    series = read_series(project, driver, config)
    training, test = _split(series, fold, config)
    past, future = max(*settings.past_steps, 0), settings.future_steps
    complete = series.has_path_and_steering
    learnt, asked = (
        cut_windows(series, window_centres(series.stretch, rows & complete, past, future), past_steps, future)
        for rows in (training, test)
    )
    needed = max(windows_needed(learnt.inputs.shape[1] + future, max(settings.components)), FEWEST_SAMPLES)
    if (found := len(learnt.centres)) < needed:
        raise _too_few(project, driver, fold, f"{found} windows to learn from", needed)
    rows: list[dict[str, Any]] = []

    def measure(model: str, path_types: int, components: int | None, prediction: tuple[Floats, Floats]) -> None:
        mean, variance = prediction
        error, sd = np.abs(mean - asked.outputs), np.sqrt(variance)
        rows.append(
            {
                "driver": driver,
                "model": model,
                "path_types": path_types,
                "past_steps": past_steps,
                "future_steps": future,
                "components": components,
                "fold": fold,
                "mean_error": _mean(error),
                "mean_variance": _mean(variance),
                "coverage_68": _mean(error <= WITHIN_68 * sd),
                "coverage_95": _mean(error <= WITHIN_95 * sd),
                "samples": len(error),
            }
        )

    with one_thread():
        sides = part(series, training + 2 * test, config)
        types = fit_path_types(sides, training, config)
        path_type = label_rows(sides, types, config)
        ridge = Ridge.fit(learnt.inputs, learnt.outputs, gap=past + future)
        measure("persistence", 1, None, Persistence.fit(learnt.current, learnt.outputs).predict(asked.current))
        measure("ridge", 1, None, ridge.predict(asked.inputs))
        fallbacks: dict[str, dict[str, str]] = {}
        for components in settings.components:
            finest = fit_motion_primitives(
                learnt.inputs,
                learnt.outputs,
                path_type[learnt.centres],
                n1=max(settings.path_types),
                components=components,
                shrinkage=ridge.penalty,
                starts=settings.starts,
                seed=config.models.seed,
            )
            for n1 in settings.path_types:
                primitives = finest.coarser(n1)
                fallbacks[f"{n1} path types, {components} components"] = primitives.fallbacks()
                measure("mixture", n1, components, primitives.predict(asked.inputs, path_type[asked.centres]))
    facts = {"penalty": ridge.penalty, "clusters": describe_path_types(types), "fallbacks": fallbacks}
    file = f"fold-{fold}.past-{past_steps}.json"
    return _publish(project, Path("motion_primitives") / encode_name(driver) / file, rows, facts)


def evaluate_lookahead(project: Path, driver: str, fold: int, config: Config) -> Outcome:
    """Fit lookahead models and baselines to all folds but one and test them on both splits.

    Persistence is the lookahead distance of the previous sample. That follows from the driver's own steering 0.1 s ago,
    which no model is given: it shows how slowly the distance changes, and is not what a model has to beat. Samples
    without a previous one are left out of its row.

    Args:
        project: Project folder.
        driver: Whose data.
        fold: The test fold.
        config: The project file.

    Raises:
        InputError: There are too few samples to learn from.
    """
    settings, seed = config.models.lookahead, config.models.seed
    series = read_series(project, driver, config)
    path = np.column_stack([series.course_deviation, series.speed])
    before = np.append(np.nan, np.where(np.diff(series.stretch) == 0, series.lookahead[:-1], np.nan))
    known = np.isfinite(path).all(axis=1) & np.isfinite(series.lookahead)
    training, test = (rows[known] for rows in _split(series, fold, config))
    inputs, lookahead, previous = path[known], series.lookahead[known], before[known]
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
        change = (lookahead - previous)[training & np.isfinite(previous)]
        spread = math.sqrt(_mean(np.square(change)) or 0.0)
        measure("persistence", None, None, (previous, np.full(len(previous), spread)))
        gap = round(config.dataset.embargo * 1e9 / config.sync.period)
        mean, variance = Ridge.fit(inputs[training], lookahead[training, None], gap=gap).predict(inputs)
        measure("ridge", None, None, (mean[:, 0], np.sqrt(variance[:, 0])))
        fallbacks: dict[str, list[str]] = {}
        for components in settings.components:
            general = GeneralLookahead(components, settings.starts, seed)
            measure("general", components, None, general.fit(inputs[training], lookahead[training]).predict(inputs))
            fallbacks[f"general, {components} components"] = list(general.fallbacks)
            for regressors in settings.regressors:
                velocity = VelocityLookahead(components, regressors, settings.starts, seed)
                prediction = velocity.fit(inputs[training], lookahead[training]).predict(inputs)
                measure("velocity", components, regressors, prediction)
                fallbacks[f"velocity, {components} components, {regressors} regressors"] = list(velocity.fallbacks)
    name = Path("lookahead") / encode_name(driver) / f"fold-{fold}.json"
    return _publish(project, name, rows, {"fallbacks": fallbacks})


def _split(series: Series, fold: int, config: Config) -> tuple[Mask, Mask]:
    """Return the rows to learn from and the rows to test."""
    embargo = round(config.dataset.embargo * 1e9)
    return training_mask(series.fold, series.recording, series.time, fold, embargo), series.fold == fold


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
