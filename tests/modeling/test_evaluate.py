"""The evaluation: its cells, that nothing of a test fold is learnt, and its tables."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from wheelprint.modeling import cells
from wheelprint.modeling.cells import MIXTURES
from wheelprint.modeling.drivers import read_series
from wheelprint.modeling.evaluate import gather_results, plan_evaluation
from wheelprint.schemas.config import Lookahead
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import Project
from wheelprint.schemas.store import Manifest
from wheelprint.schemas.tables import (
    CALIBRATION_COLUMNS,
    HORIZON_COLUMNS,
    LOOKAHEAD_COLUMNS,
    MOTION_PRIMITIVE_COLUMNS,
)

TICK = 100_000_000
Perform = Callable[..., Any]


@pytest.fixture(scope="module")
def results(project: Project, perform: Perform) -> Project:
    """The project with its evaluation done."""
    perform(project, plan_evaluation(project)[0])
    gather_results(project)
    return project


def table(project: Project, name: str) -> pd.DataFrame:
    return pd.read_csv(project.results_folder / f"{name}.csv")


def test_plan(project: Project) -> None:
    tasks, problems = plan_evaluation(project)
    assert [problem.where for problem in problems] == ["models.minimum_minutes"]
    assert {task.section for task in tasks} == {"cells"}
    assert [task.name for task in tasks if "b.~" in task.name] == [
        name
        for fold in range(3)
        for name in (
            f"lookahead/b.~/fold {fold}",
            f"motion_primitives/b.~/fold {fold}/past -1",
            f"motion_primitives/b.~/fold {fold}/past 1",
        )
    ]
    assert len({task.fingerprint for task in tasks}) == len(tasks) == 18
    again = plan_evaluation(Project(project.directory))[0]
    assert [task.fingerprint for task in again] == [task.fingerprint for task in tasks]


def test_tables_hold_a_line_for_each_model_and_fold(results: Project) -> None:
    primitives = table(results, "motion_primitives")
    assert tuple(primitives.columns) == MOTION_PRIMITIVE_COLUMNS
    found = primitives.groupby(["driver", "model", "past_steps"]).size()
    for driver in ("b.~", "王 小明"):
        for past_steps in (-1, 1):
            counts = dict.fromkeys(("persistence", "ridge", "kinematic", "ridge_curvature"), 3)
            counts |= dict.fromkeys(MIXTURES.values(), 3 * 3 * 2)
            assert {model: found[driver, model, past_steps] for model in counts} == counts
    baselines = primitives[~primitives.model.isin(MIXTURES.values())]
    assert set(baselines.path_types) == {1}
    assert baselines.components.isna().all()
    assert set(primitives[primitives.model.isin(MIXTURES.values())].components) == {1, 2}
    assert set(primitives.future_steps) == {5}
    assert primitives.drop(columns="components").notna().all().all()

    lookahead = table(results, "lookahead")
    assert tuple(lookahead.columns) == LOOKAHEAD_COLUMNS
    counts = {"persistence": 6, "ridge": 6, "general": 12, "velocity": 12}
    assert lookahead[lookahead.driver == "b.~"].groupby("model").size().to_dict() == counts
    assert set(lookahead.split) == {"train", "test"}
    assert set(lookahead[lookahead.model == "velocity"].regressors) == {2}
    assert lookahead[lookahead.model != "velocity"].regressors.isna().all()


def test_summary_is_the_mean_over_the_folds(results: Project) -> None:
    summary = json.loads((results.results_folder / "summary.json").read_text(encoding="utf-8"))
    primitives = table(results, "motion_primitives")
    own = primitives[(primitives.driver == "王 小明") & (primitives.model == "mixture")]
    own = own[(own.path_types == 3) & (own.past_steps == 1) & (own.components == 2)]
    (row,) = [
        row
        for row in summary["motion_primitives"]
        if (row["driver"], row["model"], row["path_types"], row["past_steps"], row["components"])
        == ("王 小明", "mixture", 3, 1, 2)
    ]
    assert row["folds"] == len(own) == 3
    assert row["samples"] == own.samples.sum()
    for name in ("mean_error", "mean_variance", "coverage_68", "coverage_95", "crps"):
        assert row[name] == pytest.approx(own[name].mean(), rel=1e-12)


def test_horizons_and_probabilities_agree_with_the_whole(results: Project) -> None:
    """Five steps of 0.1 s, of which 0.1, 0.2, 0.3 and 0.5 s are listed; the share of all steps by probability."""
    horizons, calibration = table(results, "horizons"), table(results, "calibration")
    assert tuple(horizons.columns) == HORIZON_COLUMNS
    assert tuple(calibration.columns) == CALIBRATION_COLUMNS
    assert sorted(set(horizons.horizon)) == [0.1, 0.2, 0.3, 0.5]
    whole = table(results, "motion_primitives")
    same = ["driver", "model", "path_types", "past_steps", "components", "fold"]
    first = horizons[horizons.horizon == 0.1].set_index(same)
    assert len(first) == len(whole)
    assert (first.samples == whole.set_index(same).samples.reindex(first.index)).all()
    persistence = horizons[horizons.model == "persistence"].groupby("horizon").mean_error.mean()
    assert persistence.is_monotonic_increasing
    shares = calibration.groupby(same, dropna=False).share.agg(["sum", "size"])
    assert shares["sum"].to_numpy() == pytest.approx(1.0)
    assert set(shares["size"]) == {20}


def test_persistence_by_a_plain_loop(results: Project) -> None:
    data = results.dataset("王 小明").to_pandas()
    time = data.time.astype("int64").tolist()
    angle = data.steering_wheel_angle.tolist()
    complete = (data.course_deviation.notna() & data.speed.notna()).tolist()
    run = [f"{recording} {run}" for recording, run in zip(data.recording, data.run, strict=True)]
    in_test = (data.fold == 1).tolist()
    of_test = {name: np.array(own.time.astype("int64")) for name, own in data[data.fold == 1].groupby("recording")}
    in_training = [
        recording not in of_test or np.abs(of_test[recording] - stamp).min() > 11 * TICK
        for recording, stamp in zip(data.recording, time, strict=True)
    ]

    def changes(allowed: list[bool]) -> np.ndarray:
        def whole(t: int) -> bool:
            return all(allowed[row] and run[row] == run[t] and complete[row] for row in range(t - 1, t + 6))

        centres = [t for t in range(1, len(data) - 5) if whole(t)]
        return np.array([[angle[t + step] - angle[t] for step in range(1, 6)] for t in centres])

    asked, learnt = changes(in_test), changes(in_training)
    sd = np.sqrt((learnt**2).mean(axis=0))
    primitives = table(results, "motion_primitives")
    rows = primitives[(primitives.driver == "王 小明") & (primitives.model == "persistence") & (primitives.fold == 1)]
    assert len(rows) == 2
    for row in rows.itertuples():
        assert row.samples == len(asked)
        assert row.mean_error == pytest.approx(np.abs(asked).mean(), rel=1e-12)
        assert row.mean_variance == pytest.approx((sd**2).mean(), rel=1e-12)
        assert row.coverage_68 == pytest.approx((np.abs(asked) <= 0.99446 * sd).mean(), rel=1e-12)
        assert row.coverage_95 == pytest.approx((np.abs(asked) <= 1.95996 * sd).mean(), rel=1e-12)


def test_models_learn_the_made_up_drivers(results: Project) -> None:
    error = table(results, "motion_primitives").groupby(["driver", "past_steps", "model"]).mean_error.mean()
    for driver in ("b.~", "王 小明"):
        for past_steps in (-1, 1):
            assert error[driver, past_steps, "mixture"] < 0.5 * error[driver, past_steps, "persistence"]
            assert error[driver, past_steps, "mixture"] < 1.1 * error[driver, past_steps, "ridge"]
    lookahead = table(results, "lookahead")
    test = lookahead[lookahead.split == "test"].groupby("model").mean_error.mean()
    # The distances are 5 m + v with noise of 1 m: its mean amount is 0.8 m, and 1.13 m between two of them.
    assert test["ridge"] == pytest.approx(0.8, abs=0.08)
    assert test["general"] == pytest.approx(0.8, abs=0.1)
    assert test["velocity"] == pytest.approx(0.8, abs=0.1)
    assert test["persistence"] == pytest.approx(1.13, abs=0.1)


def test_samples_without_a_lookahead_distance_are_dropped(results: Project) -> None:
    data = results.dataset("b.~").to_pandas()
    known = data.lookahead.notna() & data.course_deviation.notna()
    lookahead = table(results, "lookahead")
    own = lookahead[(lookahead.driver == "b.~") & (lookahead.split == "test") & (lookahead.model == "ridge")]
    assert own.samples.tolist() == [int((known & (data.fold == fold)).sum()) for fold in range(3)]
    before = data.lookahead.shift().where((data.run == data.run.shift()) & (data.index > 0))
    of_persistence = known & before.notna()
    own = lookahead[(lookahead.driver == "b.~") & (lookahead.split == "test") & (lookahead.model == "persistence")]
    assert own.samples.tolist() == [int((of_persistence & (data.fold == fold)).sum()) for fold in range(3)]


def test_samples_of_a_large_spread_are_dropped_where_that_is_asked(results: Project) -> None:
    data = results.dataset("b.~").to_pandas()
    share = float((data.lookahead_spread / data.lookahead).median())
    asked = Lookahead(maximum_spread=share)
    series = read_series(results.directory, "b.~", results.config.model_copy(update={"lookahead": asked}))
    told = data.lookahead_spread <= share * data.lookahead
    assert 0 < told.sum() < data.lookahead.notna().sum()
    np.testing.assert_array_equal(series.lookahead, data.lookahead.where(told))
    everything = read_series(results.directory, "b.~", results.config)
    np.testing.assert_array_equal(everything.lookahead, data.lookahead)


def test_nothing_of_the_test_fold_is_learnt(
    own_project: Project, perform: Perform, replace_dataset: Perform, recordings: Callable[..., Any]
) -> None:
    """With another path and steering in the test fold, whatever was fitted stays the same to the last bit."""
    chosen = ("lookahead/b.~/fold 1", "motion_primitives/b.~/fold 1/past 1")

    def learnt() -> tuple[Any, ...]:
        tasks = [task for task in plan_evaluation(own_project)[0] if task.name in chosen]
        perform(own_project, tasks)
        folder = own_project.results_folder / "cells"
        primitives, lookahead = (json.loads(file.read_text()) for file in sorted(folder.rglob("*.json"), reverse=True))
        train = [row for row in lookahead["rows"] if row["split"] == "train"]
        return primitives["penalty"], primitives["clusters"], primitives["fallbacks"], train

    before = learnt()
    (columns,) = recordings("b.~")
    inside = own_project.dataset("b.~")["fold"].to_numpy() == 1
    for name in ("steering_wheel_angle", "speed", "lookahead"):
        columns[name] = np.where(inside, 3.0 * columns[name] + 1.0, columns[name])
    replace_dataset(own_project, "b.~", [columns])
    assert learnt() == before


def test_same_inputs_give_the_same_bytes(results: Project, perform: Perform) -> None:
    tasks = [task for task in plan_evaluation(results)[0] if "b.~/fold 2" in task.name]
    files = [
        results.directory / output["path"] for task in tasks for output in perform(results, [task])[0].entry["outputs"]
    ]
    first = [file.read_bytes() for file in files]
    perform(results, tasks)
    assert [file.read_bytes() for file in files] == first


def test_only_current_cells_are_gathered(own_project: Project, perform: Perform) -> None:
    tasks = [task for task in plan_evaluation(own_project)[0] if task.name.startswith("lookahead/b.~")]
    perform(own_project, tasks)
    titles = [title for title, _, _ in gather_results(own_project)]
    assert titles == ["Lookahead: means over the test folds", "Motion primitives: means over the test folds"]
    assert len(table(own_project, "lookahead")) == 36
    assert len(table(own_project, "motion_primitives")) == 0
    path = own_project.directory / "wheelprint.toml"
    path.write_text(path.read_text(encoding="utf-8").replace("starts = 1", "starts = 2"), encoding="utf-8")
    gather_results(Project(own_project.directory))
    assert len(table(own_project, "lookahead")) == 0


def test_too_few_windows_to_learn_from(
    own_project: Project, replace_dataset: Perform, recordings: Callable[..., Any]
) -> None:
    (columns,) = recordings("b.~")
    columns["run"] = np.arange(800) // 7
    columns["lookahead"] = np.where(np.arange(800) < 20, 5.0, np.nan)
    replace_dataset(own_project, "b.~", [columns])
    path = own_project.directory / "wheelprint.toml"
    path.write_text(path.read_text(encoding="utf-8").replace("components = [1, 2]", "components = [1, 9]"))
    project = Project(own_project.directory)
    where = (project.directory, "b.~", 0)
    cell_of_primitives = partial(cells.evaluate_motion_primitives, *where, 1, project.config)
    cell_of_lookahead = partial(cells.evaluate_lookahead, *where, project.config)
    for cell, found, needed in (
        (cell_of_primitives, "73 windows to learn from", 189),
        (cell_of_lookahead, "19 lookahead distances to learn from", 100),
    ):
        with pytest.raises(InputError) as caught:
            cell()
        assert str(caught.value) == (
            f"{path}: models: driver 'b.~', test fold 0: {found}, and {needed} are needed; add recordings, decide "
            "about proposed events (`wheelprint review`), or ask for fewer components"
        )


def test_a_fold_without_windows_is_a_problem(
    own_project: Project, perform: Perform, replace_dataset: Perform, recordings: Callable[..., Any]
) -> None:
    (columns,) = recordings("b.~")
    inside = own_project.dataset("b.~")["fold"].to_numpy() == 0
    columns["run"] = np.where(inside, np.arange(800), columns["run"])
    columns["course_deviation"] = np.nan_to_num(columns["course_deviation"])
    replace_dataset(own_project, "b.~", [columns])
    (task,) = [t for t in plan_evaluation(own_project)[0] if t.name == "motion_primitives/b.~/fold 0/past 1"]
    (outcome,) = perform(own_project, [task])
    path = own_project.results_folder / "cells" / "motion_primitives" / "b.%7E" / "fold-0.past-1.json"
    (problem,) = outcome.problems
    assert str(problem) == (
        f"{path}: nothing in this test fold to measure with, its cells in the results are empty; its stretches without "
        "a break are too short: use fewer folds (dataset.folds), or decide about proposed events"
    )
    gather_results(own_project)
    rows = table(own_project, "motion_primitives")
    assert set(rows.samples) == {0}
    assert rows[["mean_error", "mean_variance", "coverage_68", "coverage_95"]].isna().all().all()
    summary = json.loads((own_project.results_folder / "summary.json").read_text(encoding="utf-8"))
    assert summary["motion_primitives"] == []


def test_manifest_names_the_cells(results: Project) -> None:
    entry = Manifest(results.directory).entry("cells", "motion_primitives/王 小明/fold 2/past 1")
    (output,) = entry["outputs"]
    assert Path(output["path"]).parts[:3] == ("results", "cells", "motion_primitives")
    assert output["rows"] == 4 + 2 * 6
