"""The papers' experiments: MP's Table II and PP's Fig. 5 as grids of cells, and the tables that come of them.

A cell is one point of the grid for one driver and test fold, and a task of its own: a run may be stopped at any time
and goes on where it was. Folds come one after another, so that what there is of a stopped run covers every driver.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any, Literal

from .. import __version__
from ..schemas.errors import InputError
from ..schemas.project import Project
from ..schemas.store import Manifest, fingerprint, publish_json, publish_text
from ..schemas.tasks import Task
from .claims import Finding, papers, weigh_claims
from .drivers import modelled_drivers
from .experiment_cells import (
    MP_SUBSET,
    PP_COMPONENTS,
    REGRESSORS,
    evaluate_lookahead,
    evaluate_path_types,
    evaluate_primitives,
)
from .experiment_figures import draw_situations, follow_track
from .experiment_models import FUTURE_STEPS, MP_COMPONENTS, PAST_STEPS

Experiment = Literal["motion-primitives", "lookahead"]

PAPERS: Mapping[Experiment, str] = {"motion-primitives": "MP", "lookahead": "PP"}
"""Experiment -> the paper it is from."""

SECTION = "experiments"
"""Of the manifest."""

WITHOUT_PATH = (1, 3)
"""n₂ and n₄ at which MP's inputs are tried without the path ahead, too."""

MP_COLUMNS = (
    "driver", "windows", "path_types", "past_steps", "future_steps", "components", "future_path", "fold", "mean_error",
    "mean_variance", "mean_sd", "mean_squared_error", "coverage_68", "coverage_95", "samples", "fell_back",
)  # fmt: skip
PP_COLUMNS = (
    "driver", "model", "components", "regressors", "fold", "split", "repeats", "mean_error", "mean_error_sd", "mean_sd",
    "mean_sd_sd", "samples",
)  # fmt: skip

Row = Mapping[str, Any]
Printed = list[tuple[str, tuple[str, ...], list[tuple[Any, ...]]]]


def plan_experiment(project: Project, experiment: Experiment, *, faithful: bool) -> tuple[list[Task], list[InputError]]:
    """Plan the cells of an experiment.

    Returns:
        The tasks, and the drivers with too little data.

    Raises:
        InputError: No dataset was built yet; or training windows would share samples with test windows.
    """
    config = project.config
    drivers, problems = modelled_drivers(project)
    made_from: dict[str, Any] = {
        "version": __version__,
        "seed": config.models.seed,
        "period": config.sync.period,
        "embargo": config.dataset.embargo,
        "maximum_spread": config.lookahead.maximum_spread,
        "segments": config.segments.model_dump(exclude={"clusters"}),
        "clustering_seed": config.dataset.seed,
        "wheelbase": config.vehicle.wheelbase,
    }
    if experiment == "motion-primitives":
        _check_embargo(project)
    tasks = []
    for fold in range(config.dataset.folds):
        for driver, dataset in drivers.items():
            shared = {"project": project.directory, "driver": driver, "fold": fold, "faithful": faithful}
            for name, run, point in _cells(experiment, fold):
                mark = fingerprint(
                    made_from
                    | {"dataset": dataset, "cell": name, "point": {"fold": fold, **point}, "faithful": faithful}
                )
                title = f"{_variant(faithful)}/{experiment}/{driver}/{name}"
                tasks.append(Task(SECTION, title, run, {**shared, **point, "config": config}, mark))
    return tasks, problems


def gather_experiment(project: Project, experiment: Experiment, *, faithful: bool) -> Printed:
    """Gather the cells that are done into tables below `results/experiments/`, or `…/faithful/`.

    motion-primitives: `motion_primitives.csv`, `table_1.csv`, `table_2.csv`, `figure_2.json`;
    lookahead: `lookahead.csv`, `figure_5.csv`, `figure_6_7.json`; and both `claims.csv` and `claims.json`.

    Returns:
        What to print: title, heads and rows.

    Raises:
        InputError: No dataset was built yet.
    """
    found = _read_cells(project, experiment, faithful=faithful)
    folder = project.results_folder / "experiments" / ("faithful" if faithful else "")
    folds = project.config.dataset.folds
    findings = _other_findings(folder / "claims.json", PAPERS[experiment])
    if experiment == "motion-primitives":
        rows = [row for cell in found.get("grid", ()) for row in cell["rows"]]
        own = weigh_claims(rows, "MP", folds)
        types = found.get("types", [])
        table_2 = table_ii(rows)
        _publish_rows(folder / "motion_primitives.csv", rows, MP_COLUMNS)
        _publish_rows(folder / "table_1.csv", table_i(types))
        _publish_rows(folder / "table_2.csv", table_2)
        publish_json(folder / "figure_2.json", found.get("situations", []))
        heads = ("type", "path_types", "past_steps", "components", "paper_error", "error_1_1_1", "error_all")
        printed: Printed = [
            ("Table II of MP: mean error, deg", heads, [tuple(row[name] for name in heads) for row in table_2])
        ]
    else:
        rows = [row for cell in found.get("grid", ()) for row in cell["rows"]]
        own = weigh_claims(rows, "PP", folds)
        figure_5 = over_folds(rows)
        _publish_rows(folder / "lookahead.csv", rows, PP_COLUMNS)
        _publish_rows(folder / "figure_5.csv", figure_5)
        publish_json(folder / "figure_6_7.json", found.get("track", []))
        heads = ("driver", "model", "regressors", "components", "mean_error", "mean_sd", "folds")
        shown = [tuple(row[name] for name in heads) for row in figure_5 if row["split"] == "test"]
        printed = [("Fig. 5 of PP: means over the test folds, m", heads, shown)]
    findings = sorted([*findings, *map(asdict, own)], key=lambda finding: finding["paper"])
    _publish_rows(folder / "claims.csv", findings, list(Finding.__dataclass_fields__))
    publish_json(folder / "claims.json", findings)
    verdicts = [
        (finding.name, finding.windows, finding.printed, finding.in_words) for finding in own if finding.driver == "all"
    ]
    printed.append(("Claims, all drivers", ("claim", "windows", "paper", "here"), verdicts))
    return printed


def table_i(cells: Sequence[Row]) -> list[Row]:
    """Return MP's Table I: the paper's clusters, then each driver's, means over the training sets of the folds.

    Duration in s, average and maximum course deviation in deg per sample, average speed in km/h as the paper has it.
    """
    features = ("duration_s", "average_course_deviation_deg", "maximum_course_deviation_deg", "average_speed_km_h")
    rows: list[Row] = [
        {"source": "paper", **{name: row[name] for name in ("label", *features)}, "folds": None}
        for row in papers()["table_1"]
    ]
    groups: dict[tuple[str, int], list[Row]] = {}
    for cell in cells:
        for row in cell["rows"]:
            groups.setdefault((row["driver"], row["label"]), []).append(row)
    for (driver, label), own in sorted(groups.items()):
        mean = {name: _mean([row[name] for row in own if name in row]) for name in (*features[:3], "average_speed_m_s")}
        speed = mean.pop("average_speed_m_s")
        rows.append(
            {
                "source": driver,
                "label": label,
                **mean,
                "average_speed_km_h": None if speed is None else 3.6 * speed,
                "folds": len(own),
            }
        )
    return rows


def table_ii(rows: Sequence[Row]) -> list[Row]:
    """Return MP's Table II beside the same points here: mean error and variance over drivers and folds.

    Errors are in deg, variances in deg², coverages shares. `…_1_1_1` is over the windows of path type 1-1-1, as the
    paper has it, `…_all` over all; `fell_back_…` is the share of windows that a coarser regression predicted, because
    their path type had too few windows to learn from.
    """
    content = papers()["table_2"]
    table: list[Row] = []
    for figures in content["rows"]:
        point = dict(zip(content["columns"], figures, strict=True))
        row: dict[str, Any] = {name: point[name] for name in ("type", "path_types", "past_steps", "components")}
        row |= {"paper_error": point["ave_err"], "paper_variance": point["var"]}
        for windows, name in ((MP_SUBSET, "1_1_1"), ("all", "all")):
            own = [
                found
                for found in rows
                if found["windows"] == windows
                and found["future_path"]
                and found["samples"]
                and all(found[key] == point[key] for key in ("path_types", "past_steps", "components"))
            ]
            samples = sum(found["samples"] for found in own)
            row |= {
                f"error_{name}": _mean([found["mean_error"] for found in own]),
                f"variance_{name}": _mean([found["mean_variance"] for found in own]),
                f"coverage_68_{name}": _mean([found["coverage_68"] for found in own]),
                f"samples_{name}": samples,
                f"fell_back_{name}": sum(found["fell_back"] for found in own) / samples if samples else None,
                f"folds_{name}": len(own),
            }
        table.append(row)
    return table


def over_folds(rows: Sequence[Row]) -> list[Row]:
    """Return PP's Fig. 5: for each driver, model, N and split the means over the folds.

    Errors and standard deviations are in m. `repeat_sd` is the standard deviation over the repeated fits, `fold_sd`
    that over the folds.
    """
    groups: dict[tuple[Any, ...], list[Row]] = {}
    same = ("driver", "model", "regressors", "components", "split")
    for row in rows:
        if row["samples"]:
            groups.setdefault(tuple(row[name] for name in same), []).append(row)
    return [
        {
            **dict(zip(same, key, strict=True)),
            "mean_error": _mean([row["mean_error"] for row in own]),
            "mean_error_repeat_sd": _mean([row["mean_error_sd"] for row in own]),
            "mean_error_fold_sd": _deviation([row["mean_error"] for row in own]),
            "mean_sd": _mean([row["mean_sd"] for row in own]),
            "mean_sd_repeat_sd": _mean([row["mean_sd_sd"] for row in own]),
            "mean_sd_fold_sd": _deviation([row["mean_sd"] for row in own]),
            "samples": sum(row["samples"] for row in own),
            "folds": len(own),
        }
        for key, own in sorted(groups.items(), key=lambda item: tuple(-1 if v is None else v for v in item[0]))
    ]


def _cells(experiment: Experiment, fold: int) -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """Yield name, function and arguments, beside driver and fold, of the cells of one driver and fold."""
    at = f"fold {fold}"
    if experiment == "motion-primitives":
        yield f"types/{at}", evaluate_path_types, {}
        for past in PAST_STEPS:
            for components in MP_COMPONENTS:
                point: dict[str, Any] = {"past_steps": past, "components": components, "future_path": True}
                yield f"grid/{at}/past {past}/components {components}", evaluate_primitives, point
        past, components = WITHOUT_PATH
        point = {"past_steps": past, "components": components, "future_path": False}
        yield f"grid/{at}/past {past}/components {components}/without path", evaluate_primitives, point
        if fold == 0:
            yield f"situations/{at}", draw_situations, {}
        return
    for regressors in REGRESSORS:
        for components in PP_COMPONENTS:
            model = "general" if regressors is None else f"velocity {regressors}"
            point = {"components": components, "regressors": regressors}
            yield f"grid/{at}/{model}/components {components}", evaluate_lookahead, point
    if fold == 0:
        yield f"track/{at}", follow_track, {}


def _check_embargo(project: Project) -> None:
    """Raise `InputError` where the grid's windows are longer than the embargo."""
    config = project.config
    grid = {"past_steps": list(PAST_STEPS), "future_steps": FUTURE_STEPS}
    primitives = config.models.motion_primitives.model_copy(update=grid)
    models = config.models.model_copy(update={"motion_primitives": primitives})
    longest = config.model_copy(update={"models": models}).longest_window * config.sync.period / 1e9
    if config.dataset.embargo < longest:
        reason = (
            f"{config.dataset.embargo:g} s is shorter than the experiment's longest window, {longest:g} s, and "
            f"training windows would share samples with test windows; write {longest:g} or more"
        )
        raise InputError(project.directory / "wheelprint.toml", "dataset.embargo", reason)


def _variant(faithful: bool) -> str:
    return "faithful" if faithful else "corrected"


def _read_cells(project: Project, experiment: Experiment, *, faithful: bool) -> dict[str, list[Row]]:
    """Return the content of the cells that are current, by kind."""
    manifest = Manifest(project.directory)
    found: dict[str, list[Row]] = {}
    for task in plan_experiment(project, experiment, faithful=faithful)[0]:
        if manifest.is_current(task.section, task.name, task.fingerprint):
            kind = task.name.removeprefix(f"{_variant(faithful)}/{experiment}/{task.arguments['driver']}/")
            for output in manifest.entry(task.section, task.name)["outputs"]:
                content = json.loads((project.directory / output["path"]).read_text(encoding="utf-8"))
                found.setdefault(kind.partition("/")[0], []).append(content)
    return found


def _other_findings(path: Any, paper: str) -> list[dict[str, Any]]:
    """Return the findings on the other paper's claims that are there from before."""
    if not path.is_file():
        return []
    return [finding for finding in json.loads(path.read_text(encoding="utf-8")) if finding["paper"] != paper]


def _publish_rows(path: Any, rows: Iterable[Row], columns: Sequence[str] = ()) -> None:
    rows = list(rows)
    names = columns or list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    table = csv.DictWriter(text, names, lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    publish_text(path, text.getvalue())


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None


def _deviation(values: Sequence[float]) -> float | None:
    import statistics

    return statistics.stdev(values) if len(values) > 1 else None
