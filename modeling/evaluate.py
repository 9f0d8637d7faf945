"""Cross-validation of the drivers' models (PP eq. 12): a cell for each driver, fold and experiment, then the tables."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from typing import Any

from .. import __version__
from ..schemas.errors import InputError
from ..schemas.project import Project
from ..schemas.store import Manifest, fingerprint, publish_json, publish_text
from ..schemas.tables import CALIBRATION_COLUMNS, HORIZON_COLUMNS, LOOKAHEAD_COLUMNS, MOTION_PRIMITIVE_COLUMNS
from ..schemas.tasks import Task
from .cells import evaluate_lookahead, evaluate_motion_primitives
from .drivers import modelled_drivers
from .personal_evaluation import gather_personal, plan_personal

EXPERIMENTS = {"lookahead": LOOKAHEAD_COLUMNS, "motion_primitives": MOTION_PRIMITIVE_COLUMNS}
"""Experiment -> columns of its table of results."""

DETAILS = {"horizons": HORIZON_COLUMNS, "calibration": CALIBRATION_COLUMNS}
"""What the cells of motion primitives hold beside their rows -> columns of its table."""

MEASURES = ("mean_error", "mean_sd", "mean_variance", "coverage_68", "coverage_95", "crps")

Row = Mapping[str, Any]


def plan_evaluation(project: Project) -> tuple[list[Task], list[InputError]]:
    """Plan one task for each driver, fold and experiment, and for motion primitives each number of past steps.

    Those of `plan_personal` follow.

    Returns:
        The tasks, and the drivers with too little data.

    Raises:
        InputError: See `drivers.modelled_drivers`.
    """
    config = project.config
    drivers, problems = modelled_drivers(project)
    settings = config.models.model_dump()
    made_from: dict[str, Any] = {
        "version": __version__,
        "seed": config.models.seed,
        "period": config.sync.period,
        "embargo": config.dataset.embargo,
        "maximum_spread": config.lookahead.maximum_spread,
    }
    path_types = {"segments": config.segments.model_dump(), "clustering_seed": config.dataset.seed}
    tasks = []
    for driver, files in drivers.items():
        for fold in range(config.dataset.folds):
            cell = {"project": project.directory, "driver": driver, "fold": fold, "config": config}
            made_from |= {"dataset": files, "fold": fold}
            mark = fingerprint(made_from | {"grid": settings["lookahead"]})
            tasks.append(Task("cells", f"lookahead/{driver}/fold {fold}", evaluate_lookahead, cell, mark))
            for past_steps in dict.fromkeys(config.models.motion_primitives.past_steps):
                name = f"motion_primitives/{driver}/fold {fold}/past {past_steps}"
                grid = {"grid": settings["motion_primitives"], "past_steps": past_steps}
                mark = fingerprint(made_from | path_types | grid)
                tasks.append(Task("cells", name, evaluate_motion_primitives, {**cell, "past_steps": past_steps}, mark))
    return tasks + plan_personal(project, drivers), problems


def gather_results(project: Project) -> list[tuple[str, tuple[str, ...], list[tuple[Any, ...]]]]:
    """Gather the current cells into `results/lookahead.csv`, `results/motion_primitives.csv` and `summary.json`.

    `horizons.csv` and `calibration.csv` say more of the motion primitives, by horizon and by probability. The tables
    hold one line for each driver, model, fold and split; a cell that could not be computed is absent, a column that
    does not apply is empty. The summary holds the means over the folds.

    Returns:
        The summary of the test folds as tables to print: title, heads and rows, in the units of `schemas.tables`.

    Raises:
        InputError: See `drivers.modelled_drivers`.
    """
    manifest = Manifest(project.directory)
    rows: dict[str, list[Row]] = {name: [] for name in (*EXPERIMENTS, *DETAILS)}
    tasks = plan_evaluation(project)[0]
    for task in tasks:
        if task.name.split("/")[0] in EXPERIMENTS and manifest.is_current(task.section, task.name, task.fingerprint):
            for output in manifest.entry(task.section, task.name)["outputs"]:
                content = json.loads((project.directory / output["path"]).read_text(encoding="utf-8"))
                rows[task.name.split("/")[0]] += content["rows"]
                for name in DETAILS:
                    rows[name] += content.get(name, ())
    summary: dict[str, list[Row]] = {}
    printed = []
    for name, columns in (EXPERIMENTS | DETAILS).items():
        text = io.StringIO()
        table = csv.DictWriter(text, columns, lineterminator="\n")
        table.writeheader()
        table.writerows(rows[name])
        publish_text(project.results_folder / f"{name}.csv", text.getvalue())
    for experiment, columns in EXPERIMENTS.items():
        summary[experiment] = _means_over_folds(rows[experiment], columns)
        heads = tuple(name for name in columns if name not in ("fold", "split"))
        title = experiment.replace("_", " ").capitalize() + ": means over the test folds"
        printed.append(
            (
                title,
                heads,
                [tuple(row[name] for name in heads) for row in summary[experiment] if row.get("split") != "train"],
            )
        )
    publish_json(project.results_folder / "summary.json", summary)
    return printed + gather_personal(project, tasks)


def _means_over_folds(rows: Sequence[Row], columns: Sequence[str]) -> list[Row]:
    """Return one row for each model of each driver: means of the measures, sum of the samples, number of folds."""
    measures = [name for name in columns if name in MEASURES]
    same = [name for name in columns if name not in (*MEASURES, "fold", "samples")]
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        if row["samples"]:
            groups.setdefault(tuple(row[name] for name in same), []).append(row)
    return [
        {
            **dict(zip(same, key, strict=True)),
            **{name: sum(row[name] for row in own) / len(own) for name in measures},
            "samples": sum(row["samples"] for row in own),
            "folds": len(own),
        }
        for key, own in groups.items()
    ]
