"""The cells of the papers' experiments: one point of a grid, one driver, one test fold.

With `faithful` the formulas are the papers' own, see `docs/choices.md`:

    MP  segments cluster by their features as they are; each path type's mixture is fitted apart, without shrinkage;
        it predicts by eqs. 20 and 22 as printed
    PP  the prediction is the arg max of eq. 10
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..schemas.config import Config
from ..schemas.project import encode_name
from ..schemas.store import describe_output, publish_json
from ..schemas.tasks import Outcome
from .drivers import (
    describe_path_types,
    fit_path_types,
    one_thread,
    part,
    read_series,
    training_and_test,
)
from .experiment_models import (
    FUTURE_STEPS,
    LABELS,
    PATH_TYPES,
    fit_structure,
    known_lookahead,
    own_labels,
    split_windows,
    with_labels,
)
from .lookahead_models import GeneralLookahead, VelocityLookahead
from .motion_primitives import EVERYTHING, MotionPrimitives
from .windows import Floats, Mask

WITHIN_68, WITHIN_95 = (NormalDist().inv_cdf((1.0 + share) / 2.0) for share in (0.68, 0.95))
"""Half widths of the Gaussian bands that hold 68 % and 95 %, in standard deviations."""

PP_COMPONENTS = (3, 4, 5, 6, 8, 9, 10, 12, 15, 20)
REGRESSORS = (None, 3, 4, 5, 6)
"""PP's n₂; None is the general model."""
REPEATS = 20

MP_SUBSET = "1-1-1"
"""The path type whose windows MP's Table II is of."""


def evaluate_primitives(
    project: Path,
    driver: str,
    fold: int,
    past_steps: int,
    components: int,
    future_path: bool,
    faithful: bool,
    config: Config,
) -> Outcome:
    """Measure one point of MP's Table II for all its numbers of path types.

    `mean_error` (deg) and `mean_variance` (deg²) are its ave_err and var. Every measure is once over all test windows
    and once over those of path type 1-1-1, as MP has it. `fell_back` are the test windows predicted by a coarser
    regression than n₁ asks for, because their type had too few windows.

    Args:
        project: Project folder.
        driver: Whose data.
        fold: The test fold, from 0.
        past_steps: n₂.
        components: n₄.
        future_path: Whether the inputs hold the path ahead.
        faithful: Formulas as printed.
        config: The project file.

    Raises:
        InputError: There are too few windows to learn from, no segment lies entirely in the training folds, or the
            dataset cannot be read.
    """
    series = read_series(project, driver, config)
    rows: list[dict[str, Any]] = []
    with one_thread():
        split = split_windows(project, driver, series, fold, past_steps, config, faithful=faithful)
        columns = _columns(past_steps, future_path=future_path)
        learnt, asked = split.learnt.inputs[:, columns], split.asked.inputs[:, columns]
        finest = fit_structure(
            learnt, split.learnt.outputs, split.learnt_types, components, config.models.seed, past_steps,
            faithful=faithful,
        )  # fmt: skip
        for n1 in PATH_TYPES:
            primitives = finest.coarser(n1)
            mean, variance = primitives.predict(asked, split.asked_types)
            coarser = _fell_back(primitives, split.asked_types)
            for windows, chosen in (("all", np.ones(len(mean), np.bool_)), (MP_SUBSET, split.asked_types == MP_SUBSET)):
                point = {
                    "driver": driver,
                    "windows": windows,
                    "path_types": n1,
                    "past_steps": past_steps,
                    "future_steps": FUTURE_STEPS,
                    "components": components,
                    "future_path": future_path,
                    "fold": fold,
                }
                measures = _measures(split.asked.outputs[chosen], mean[chosen], variance[chosen])
                rows.append(
                    {**point, **measures, "samples": int(chosen.sum()), "fell_back": int(coarser[chosen].sum())}
                )
    facts = {"clusters": describe_path_types(split.types), "fallbacks": finest.fallbacks()}
    past, path = f"past{past_steps}", "" if future_path else "-no-path"
    file = f"fold{fold}-{past}-components{components}{path}.json"
    return publish_cell(project, "motion_primitives", driver, file, rows, facts, faithful=faithful)


def evaluate_path_types(project: Path, driver: str, fold: int, faithful: bool, config: Config) -> Outcome:
    """Cluster the path segments of the training folds into MP's three labels (Table I), and ask BIC how many it wants.

    BIC is asked with all parameters of k components of d features, k − 1 + kd + kd(d + 1)/2, and with the 2k + kd that
    PP eq. 8 prints.

    Args:
        project: Project folder.
        driver: Whose data.
        fold: The test fold, from 0.
        faithful: Features as they are, not their logarithms.
        config: The project file.

    Raises:
        InputError: No segment lies entirely in the training folds, or the dataset cannot be read.
    """
    series = read_series(project, driver, config)
    training, test = training_and_test(series, fold, config)
    series = part(series, training + 2 * test, config)
    with one_thread():
        types = fit_path_types(series, training, with_labels(config, LABELS), logarithms=not faithful)
        free = fit_path_types(series, training, with_labels(config, "bic"), logarithms=not faithful)
    segments = int(np.count_nonzero(np.bincount(series.segment, weights=~training) == 0))
    d = free.mixture.n_features_in_
    rows = [{"driver": driver, "fold": fold, **cluster} for cluster in describe_path_types(types)]
    full = dict(free.criterion)
    too_many = {k: (k - 1 + k * d + k * d * (d + 1) / 2) - (2 * k + k * d) for k in full}
    printed = {k: bic - too_many[k] * math.log(segments) for k, bic in full.items()}
    facts = {
        "segments": segments,
        "clusters_by_bic": min(full, key=lambda k: full[k]),
        "clusters_by_bic_as_printed": min(printed, key=lambda k: printed[k]),
    }
    return publish_cell(project, "path_types", driver, f"fold{fold}.json", rows, facts, faithful=faithful)


def evaluate_lookahead(
    project: Path, driver: str, fold: int, components: int, regressors: int | None, faithful: bool, config: Config
) -> Outcome:
    """Fit one of PP's models twenty times, each from another k-means start, and measure it on both splits.

    Errors (PP eq. 22) and standard deviations (eq. 23), both in m, are means over the repeats with their standard
    deviation over the repeats (`…_sd`).

    Args:
        project: Project folder.
        driver: Whose data.
        fold: The test fold.
        components: N, components of all regressions together.
        regressors: n₂ of PP, classes of speed; None is the general model.
        faithful: Predictions are the arg max (eq. 10) instead of the mean.
        config: The project file.

    Raises:
        InputError: There are too few samples to learn from, or the dataset cannot be read.
    """
    series = read_series(project, driver, config)
    inputs, lookahead, training, test = known_lookahead(project, driver, series, fold, config)
    estimate: Any = "mode" if faithful else "mean"
    figures: dict[str, list[tuple[float, float]]] = {"train": [], "test": []}
    reasons: Counter[str] = Counter()
    with one_thread():
        for repeat in range(REPEATS):
            seed = config.models.seed + repeat
            model: GeneralLookahead | VelocityLookahead
            if regressors is None:
                model = GeneralLookahead(components, seed=seed, estimate=estimate)
            else:
                model = VelocityLookahead(components, regressors, seed=seed, estimate=estimate)
            model.fit(inputs[training], lookahead[training])
            reasons.update(model.fallbacks)
            mean, sd = model.predict(inputs)
            for split, chosen in (("train", training), ("test", test)):
                if chosen.any():
                    error = np.abs(mean[chosen] - lookahead[chosen])
                    figures[split].append((float(error.mean()), float(sd[chosen].mean())))
    rows = [
        {
            "driver": driver,
            "model": "general" if regressors is None else "velocity",
            "components": components,
            "regressors": regressors,
            "fold": fold,
            "split": split,
            "repeats": REPEATS,
            **_over_repeats(figures[split]),
            "samples": int(chosen.sum()),
        }
        for split, chosen in (("train", training), ("test", test))
    ]
    file = f"fold{fold}-components{components}-regressors{regressors or 0}.json"
    facts = {"fallbacks": dict(sorted(reasons.items()))}
    return publish_cell(project, "lookahead", driver, file, rows, facts, faithful=faithful)


def publish_cell(
    project: Path,
    experiment: str,
    driver: str,
    file: str,
    rows: Sequence[Mapping[str, Any]],
    facts: Mapping[str, Any],
    *,
    faithful: bool,
) -> Outcome:
    """Publish a cell below `results/experiments/cells/`.

    Args:
        project: Project folder.
        experiment: Kind of the cell, a folder.
        driver: Whose cell, a folder within it.
        file: Name of the file.
        rows: The measures.
        facts: What stands beside them in the file.
        faithful: Formulas as printed.
    """
    variant = "faithful" if faithful else "corrected"
    path = project / "results" / "experiments" / "cells" / variant / experiment / encode_name(driver) / file
    publish_json(path, {"rows": rows, **facts})
    return Outcome({"outputs": [describe_output(project, path, rows=len(rows))]})


def _columns(past_steps: int, *, future_path: bool) -> NDArray[np.intp]:
    """Return the columns of a window's inputs, all of them or those up to t alone (MP eq. 2)."""
    past = max(past_steps, 0)
    length = past + 1 + FUTURE_STEPS
    steering = 2 * length + np.arange(past_steps + 1)
    kept = np.arange(length if future_path else past + 1)
    return np.concatenate([kept, length + kept, steering])


def _fell_back(primitives: MotionPrimitives, path_types: NDArray[np.str_]) -> Mask:
    """Tell which windows (n,) are predicted by a coarser regression than n₁ asks for."""
    used = {name: primitives.model_of(name) for name in np.unique(path_types).tolist()}
    wanted = {1: np.full(len(path_types), EVERYTHING), 3: own_labels(path_types), 27: path_types}[primitives.n1]
    fell_back: Mask = np.array([used[name] for name in path_types.tolist()], dtype=np.str_) != wanted
    return fell_back


def _measures(driven: Floats, mean: Floats, variance: Floats) -> dict[str, float | None]:
    """Return MP's two measures and others, over windows and steps; None where there is no window."""
    if not len(driven):
        names = ("mean_error", "mean_variance", "mean_sd", "mean_squared_error", "coverage_68", "coverage_95")
        return dict.fromkeys(names)
    error, sd = np.abs(driven - mean), np.sqrt(variance)
    return {
        "mean_error": float(error.mean()),
        "mean_variance": float(variance.mean()),
        "mean_sd": float(sd.mean()),
        "mean_squared_error": float(np.square(error).mean()),
        "coverage_68": float(np.mean(error <= WITHIN_68 * sd)),
        "coverage_95": float(np.mean(error <= WITHIN_95 * sd)),
    }


def _over_repeats(figures: Sequence[tuple[float, float]]) -> dict[str, float | None]:
    """Return mean and standard deviation over the repeats of error and standard deviation; None without samples."""
    if not figures:
        return dict.fromkeys(("mean_error", "mean_error_sd", "mean_sd", "mean_sd_sd"))
    mean, sd = np.mean(figures, axis=0).tolist(), np.std(figures, axis=0, ddof=1).tolist()
    return {"mean_error": mean[0], "mean_error_sd": sd[0], "mean_sd": mean[1], "mean_sd_sd": sd[1]}
