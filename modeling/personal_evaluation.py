"""Are the models personal? Learning curves, models of one driver on another, and whose model explains a minute best.

Learning curves show a driver's model when the population comes from the *other drivers only*: what can be known before
the driver has driven. In the cross-driver matrix and the identification every driver's model, own or adapted, has
learnt from all folds but the one that is tested; the population adapted there is that of all candidates without this
fold, so that all of them start from the same.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

from .. import __version__
from ..schemas.config import Config
from ..schemas.errors import InputError
from ..schemas.project import Project, encode_name
from ..schemas.store import Manifest, describe_output, fingerprint, publish_json, publish_text
from ..schemas.tables import CROSS_DRIVER_COLUMNS, IDENTIFICATION_COLUMNS, LEARNING_CURVE_COLUMNS
from ..schemas.tasks import Outcome, Task
from .drivers import one_thread, read_series, training_and_test
from .estimator import FloatArray
from .personal import (
    QUANTITIES,
    Likelihoods,
    Quantity,
    Samples,
    curve_minutes,
    cut_minutes,
    first_minutes_after,
    fit_own,
    measure,
    name_drivers,
    personalise,
    take_samples,
    weight,
)
from .regression import MixtureRegression
from .windows import Rows

TABLES = {
    "learning_curve": LEARNING_CURVE_COLUMNS,
    "cross_driver": CROSS_DRIVER_COLUMNS,
    "identification": IDENTIFICATION_COLUMNS,
}
"""Table of results -> its columns."""

Row = dict[str, Any]
Printed = tuple[str, tuple[str, ...], list[tuple[Any, ...]]]


def plan_personal(project: Project, drivers: Mapping[str, Mapping[str, str]]) -> list[Task]:
    """Plan one task for each driver's learning curve and one for each test fold of all drivers.

    Args:
        project: The project.
        drivers: The drivers that are modelled, each with the SHA-256 of its dataset files by path.

    Returns:
        The tasks; none where `models.personal.evaluate` says so or fewer than two drivers are modelled.
    """
    config = project.config
    if not config.models.personal.evaluate or len(drivers) < 2:
        return []
    mark = fingerprint(
        {
            "version": __version__,
            "settings": config.models.personal.model_dump(),
            "seed": config.models.seed,
            "period": config.sync.period,
            "embargo": config.dataset.embargo,
            "folds": config.dataset.folds,
            "maximum_spread": config.lookahead.maximum_spread,
            "dataset": {driver: dict(files) for driver, files in drivers.items()},
        }
    )
    common = {"project": project.directory, "drivers": tuple(drivers), "config": config}
    curves = [
        Task("cells", f"personal/learning curve/{driver}", evaluate_learning_curve, {**common, "driver": driver}, mark)
        for driver in drivers
    ]
    folds = [
        Task("cells", f"personal/fold {fold}", evaluate_across_drivers, {**common, "fold": fold}, mark)
        for fold in range(config.dataset.folds)
    ]
    return curves + folds


def evaluate_learning_curve(project: Path, drivers: Sequence[str], driver: str, config: Config) -> Outcome:
    """Measure own, adapted and population's models of one driver over the minutes they learn from.

    Args:
        project: Project folder.
        drivers: All that are modelled; the population is the others.
        driver: Whose curve.
        config: The project file.

    Returns:
        The outcome; a model that has too few samples to be fitted has no row.

    Raises:
        InputError: A dataset cannot be read.
    """
    settings, seed, rate = config.models.personal, config.models.seed, config.sync.rate
    series = {name: read_series(project, name, config) for name in drivers}
    own = series[driver]
    rows: list[Row] = []
    with one_thread():
        for quantity in QUANTITIES:
            others = [
                take_samples(series[name], np.ones(len(series[name].time), dtype=np.bool_), quantity, settings)
                for name in drivers
                if name != driver
            ]
            population = fit_own(others, quantity, settings, seed)
            for fold in range(config.dataset.folds):
                training, test = training_and_test(own, fold, config)
                asked = take_samples(own, test, quantity, settings)
                come = first_minutes_after(own, training, fold, rate)
                models: list[tuple[str, int, MixtureRegression | None]] = [("population", 0, population)]
                for minutes in curve_minutes(training.sum() / (60.0 * rate)):
                    learnt = take_samples(own, come < minutes, quantity, settings)
                    models.append(("own", minutes, fit_own([learnt], quantity, settings, seed)))
                    if population is not None:
                        models.append(("adapted", minutes, personalise(population, learnt, quantity, settings)))
                for model, minutes, regression in models:
                    if regression is not None and len(asked.centres):
                        error, likelihoods = measure(regression, asked)
                        who = {"driver": driver, "quantity": quantity, "model": model, "minutes": minutes}
                        rows.append({**who, "fold": fold, **_means(error, likelihoods)})
    return _publish(project, Path("learning_curve") / f"{encode_name(driver)}.json", {"learning_curve": rows})


def evaluate_across_drivers(project: Path, drivers: Sequence[str], fold: int, config: Config) -> Outcome:
    """Test every driver's model on every driver's test fold, and name the driver of each of its minutes.

    Args:
        project: Project folder.
        drivers: All that are modelled.
        fold: The test fold; no model has learnt from it.
        config: The project file.

    Returns:
        The outcome; a quantity that some driver has too few samples of is left out and named as a problem.

    Raises:
        InputError: A dataset cannot be read.
    """
    settings = config.models.personal
    series = {name: read_series(project, name, config) for name in drivers}
    splits = {name: training_and_test(own, fold, config) for name, own in series.items()}
    matrix: list[Row] = []
    scores: dict[str, dict[str, dict[Quantity, tuple[Samples, dict[str, Likelihoods]]]]] = {}
    problems = []
    with one_thread():
        for quantity in QUANTITIES:
            learnt = {name: take_samples(series[name], splits[name][0], quantity, settings) for name in drivers}
            models = _fit_all(learnt, quantity, config)
            if models is None:
                reason = f"test fold {fold}: the models of {quantity} are not compared, some driver has too few samples"
                problems.append(InputError(project / "wheelprint.toml", "models.personal", f"{reason}; add recordings"))
                continue
            for driver in drivers:
                asked = take_samples(series[driver], splits[driver][1], quantity, settings)
                if not len(asked.centres):
                    continue
                for model, of_driver in models.items():
                    found: dict[str, Likelihoods] = {}
                    for whose, regression in of_driver.items():
                        error, found[whose] = measure(regression, asked)
                        who = {"quantity": quantity, "model": model, "model_driver": whose, "driver": driver}
                        matrix.append({**who, "fold": fold, **_means(error, found[whose])})
                    scores.setdefault(driver, {}).setdefault(model, {})[quantity] = asked, found
    named = [
        row
        for driver, by_model in scores.items()
        for row in _identify(driver, fold, np.flatnonzero(splits[driver][1]), by_model, config.sync.rate)
    ]
    tables = {"cross_driver": matrix, "identification": named}
    return _publish(project, Path("across_drivers") / f"fold-{fold}.json", tables, problems)


def gather_personal(project: Project, tasks: Iterable[Task]) -> list[Printed]:
    """Gather the current cells into `results/learning_curve.csv`, `cross_driver.csv` and `identification.csv`.

    `identification.json` holds the rates with their 95 % intervals (Wilson) and the confusion matrices: driver → named
    driver → minutes.

    Args:
        project: The project.
        tasks: As `plan_personal` planned them; others are passed over.

    Returns:
        Tables to print: title, heads and rows.
    """
    manifest = Manifest(project.directory)
    rows: dict[str, list[Row]] = {name: [] for name in TABLES}
    planned = [task for task in tasks if task.name.startswith("personal/")]
    if not planned:
        return []
    for task in planned:
        if manifest.is_current(task.section, task.name, task.fingerprint):
            for output in manifest.entry(task.section, task.name)["outputs"]:
                content = json.loads((project.directory / output["path"]).read_text(encoding="utf-8"))
                for name in TABLES:
                    rows[name] += content.get(name, [])
    for name, columns in TABLES.items():
        text = io.StringIO()
        table = csv.DictWriter(text, columns, lineterminator="\n")
        table.writeheader()
        table.writerows(rows[name])
        publish_text(project.results_folder / f"{name}.csv", text.getvalue())
    rates = identification_rates(rows["identification"])
    publish_json(project.results_folder / "identification.json", rates)
    heads = ("model", "density", "evidence", "minutes", "right", "rate", "low", "high")
    printed: list[Printed] = [
        (
            "Whose minute is it: held-out minutes by their likeliest model",
            heads,
            [tuple(r[h] for h in heads) for r in rates],
        )
    ]
    return [_print_curve(rows["learning_curve"]), *printed]


def identification_rates(rows: Sequence[Mapping[str, Any]]) -> list[Row]:
    """Return the rate of rightly named minutes and the confusion matrix for each model, density and evidence.

    The rate r of n minutes has the 95 % interval of Wilson (1927), with z = 1.96:

        (r + z²/2n ± z √(r (1 − r) / n + z²/4n²)) / (1 + z²/n)

    Args:
        rows: Of `identification.csv`.
    """
    groups: dict[tuple[str, str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["model"], row["density"], row["evidence"]), []).append(row)
    rates = []
    for (model, density, evidence), own in sorted(groups.items()):
        right, minutes = sum(row["driver"] == row["named"] for row in own), len(own)
        low, high = _wilson(right, minutes)
        confusion: dict[str, dict[str, int]] = {}
        for (driver, named), count in sorted(Counter((row["driver"], row["named"]) for row in own).items()):
            confusion.setdefault(driver, {})[named] = count
        what = {"model": model, "density": density, "evidence": evidence}
        numbers = {"minutes": minutes, "right": right, "rate": right / minutes, "low": low, "high": high}
        rates.append({**what, **numbers, "confusion": confusion})
    return rates


def _fit_all(
    learnt: Mapping[str, Samples], quantity: Quantity, config: Config
) -> dict[str, dict[str, MixtureRegression]] | None:
    """Return every driver's own and adapted model, by name of the kind; None where one cannot be fitted."""
    settings, seed = config.models.personal, config.models.seed
    own = {name: fit_own([samples], quantity, settings, seed) for name, samples in learnt.items()}
    population = fit_own(list(learnt.values()), quantity, settings, seed)
    fitted = {name: model for name, model in own.items() if model is not None}
    if population is None or len(fitted) < len(own):
        return None
    adapted = {name: personalise(population, samples, quantity, settings) for name, samples in learnt.items()}
    return {"own": fitted, "adapted": adapted}


def _identify(
    driver: str,
    fold: int,
    rows_of_fold: Rows,
    by_model: Mapping[str, Mapping[Quantity, tuple[Samples, Mapping[str, Likelihoods]]]],
    rate: float,
) -> Iterable[Row]:
    """Yield the rows of `identification.csv` of one driver's test fold."""
    for model, quantities in by_model.items():
        evidences: dict[str, list[Quantity]] = {quantity: [quantity] for quantity in quantities}
        if len(quantities) > 1:
            evidences["both"] = list(quantities)
        for density in ("conditional", "joint"):
            for evidence, of_quantities in evidences.items():
                minutes = np.concatenate(
                    [cut_minutes(rows_of_fold, quantities[q][0].centres, rate) for q in of_quantities]
                )
                drivers = quantities[of_quantities[0]][1]
                likelihoods: dict[str, FloatArray] = {
                    whose: np.concatenate(
                        [weight(q, rate) * getattr(quantities[q][1][whose], density) for q in of_quantities]
                    )
                    for whose in drivers
                }
                for minute, (named, margin) in name_drivers(likelihoods, minutes).items():
                    yield {
                        "driver": driver, "fold": fold, "minute": minute, "model": model, "density": density,
                        "evidence": evidence, "named": named, "margin": margin,
                        "samples": int((minutes == minute).sum()),
                    }  # fmt: skip


def _print_curve(rows: Sequence[Row]) -> Printed:
    """Return the learning curve's means over drivers and folds, one line for each quantity and number of minutes."""
    groups: dict[tuple[str, int, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["quantity"], row["minutes"], row["model"]), []).append(row)
    lines = []
    for quantity, minutes in dict.fromkeys((q, m) for q, m, _ in sorted(groups) if m):
        lines.append(
            (
                quantity,
                minutes,
                *(
                    fmean(row[what] for row in own)
                    if (own := groups.get((quantity, 0 if model == "population" else minutes, model)))
                    else None
                    for what in ("mean_error", "log_likelihood")
                    for model in ("own", "adapted", "population")
                ),
            )
        )
    heads = (
        "quantity",
        "minutes",
        *(f"{what}, {m}" for what in ("error", "nats") for m in ("own", "adapted", "population")),
    )
    return "Learning curve: means over drivers and test folds", heads, lines


def _means(error: FloatArray, likelihoods: Likelihoods) -> Row:
    return {
        "mean_error": float(error.mean()),
        "log_likelihood": float(likelihoods.conditional.mean()),
        "samples": len(error),
    }


def _wilson(right: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of a rate."""
    z = 1.959964
    rate, square = right / count, z * z / count
    half = z * math.sqrt(rate * (1 - rate) / count + square / (4 * count))
    return (rate + square / 2 - half) / (1 + square), (rate + square / 2 + half) / (1 + square)


def _publish(
    project: Path, name: Path, tables: Mapping[str, Sequence[Row]], problems: Sequence[InputError] = ()
) -> Outcome:
    path = project / "results" / "cells" / "personal" / name
    publish_json(path, tables)
    rows = sum(len(table) for table in tables.values())
    return Outcome({"outputs": [describe_output(project, path, rows=rows)]}, tuple(problems))
