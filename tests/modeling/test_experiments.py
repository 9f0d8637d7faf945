"""The papers' experiments: their grids, their cells, that they go on where they stopped, and their tables."""

from __future__ import annotations

import csv
import json
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from typer.testing import CliRunner

from wheelprint.cli import app
from wheelprint.modeling import cells, experiment_cells, experiment_figures, experiment_models, experiments
from wheelprint.modeling.drivers import read_series
from wheelprint.modeling.experiment_models import fit_apart
from wheelprint.modeling.experiments import Experiment, gather_experiment, plan_experiment
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import Project
from wheelprint.schemas.tables import LOOKAHEAD_COLUMNS

Perform = Callable[..., Any]
SMALL: dict[str, Any] = {
    "FUTURE_STEPS": 5,
    "PAST_STEPS": (-1, 1),
    "MP_COMPONENTS": (1, 2),
    "WITHOUT_PATH": (1, 1),
    "PP_COMPONENTS": (12,),
    "REGRESSORS": (None, 3),
    "REPEATS": 2,
    "METHODS": {"proposed": (27, 1, 2), "general": (1, -1, 2)},
}
"""Grids that take seconds."""


@pytest.fixture(scope="module", autouse=True)
def small() -> Iterator[None]:
    """Shrink the grids."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in SMALL.items():
            for module in (experiment_cells, experiment_figures, experiment_models, experiments):
                if hasattr(module, name):
                    patch.setattr(module, name, value)
        yield


@pytest.fixture(scope="module")
def done(project: Project, perform: Perform) -> Project:
    """The project with both experiments done, MP's also as printed."""
    runs: tuple[tuple[Experiment, bool], ...] = (
        ("motion-primitives", False), ("motion-primitives", True), ("lookahead", False),
    )  # fmt: skip
    for experiment, faithful in runs:
        perform(project, plan_experiment(project, experiment, faithful=faithful)[0])
        gather_experiment(project, experiment, faithful=faithful)
    return project


def rows_of(project: Project, name: str) -> list[dict[str, str]]:
    with (project.results_folder / "experiments" / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize(("experiment", "grid", "once"), [("motion-primitives", 17, 1), ("lookahead", 50, 1)])
def test_plan_holds_the_papers_grids(project: Project, experiment: Experiment, grid: int, once: int) -> None:
    """MP: 5 × 3 points, the path types, and the inputs without the path; PP: 10 numbers of components × 5 models."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiments, "PAST_STEPS", (-1, 0, 1, 2, 3))
        patch.setattr(experiments, "_check_embargo", lambda _: None)  # This project's is for short windows.
        patch.setattr(experiments, "MP_COMPONENTS", (3, 6, 9))
        patch.setattr(experiments, "PP_COMPONENTS", (3, 4, 5, 6, 8, 9, 10, 12, 15, 20))
        patch.setattr(experiments, "REGRESSORS", (None, 3, 4, 5, 6))
        tasks, problems = plan_experiment(project, experiment, faithful=False)
        faithful, _ = plan_experiment(project, experiment, faithful=True)
    assert [problem.where for problem in problems] == ["models.minimum_minutes"]
    assert len(tasks) == 2 * (3 * grid + once)
    assert len({task.fingerprint for task in [*tasks, *faithful]}) == 2 * len(tasks)
    assert len({task.name for task in [*tasks, *faithful]}) == 2 * len(tasks)
    folds = [task.arguments["fold"] for task in tasks]
    assert folds == sorted(folds)


def test_tables(done: Project) -> None:
    grid = rows_of(done, "motion_primitives.csv")
    # two drivers, three folds, (2 × 2 points + 1 without path), three numbers of path types, all and 1-1-1
    assert len(grid) == 2 * 3 * 5 * 3 * 2
    table_2 = rows_of(done, "table_2.csv")
    assert len(table_2) == 14
    assert [row["paper_error"] for row in table_2][:3] == ["2.12", "1.91", "1.87"]
    assert all(row["error_all"] == "" for row in table_2)  # No point of the small grid is one of the paper's.
    table_1 = rows_of(done, "table_1.csv")
    assert [row["source"] for row in table_1][:3] == ["paper"] * 3
    assert {row["source"] for row in table_1} == {"paper", "b.~", "王 小明"}
    lookahead = rows_of(done, "lookahead.csv")
    assert len(lookahead) == 2 * 3 * 2 * 2
    assert set(LOOKAHEAD_COLUMNS) <= set(lookahead[0])
    figure_5 = rows_of(done, "figure_5.csv")
    one = next(
        r
        for r in figure_5
        if (r["driver"], r["model"], r["components"], r["split"]) == ("b.~", "general", "12", "test")
    )
    own = [r for r in lookahead if all(r[name] == one[name] for name in ("driver", "model", "components", "split"))]
    assert float(one["mean_error"]) == pytest.approx(np.mean([float(r["mean_error"]) for r in own]))
    assert float(one["mean_error_fold_sd"]) == pytest.approx(np.std([float(r["mean_error"]) for r in own], ddof=1))
    assert int(one["folds"]) == 3


def test_claims_of_both_papers_stand_in_one_table(done: Project) -> None:
    findings = json.loads((done.results_folder / "experiments" / "claims.json").read_text(encoding="utf-8"))
    assert len(rows_of(done, "claims.csv")) == len(findings)
    assert {finding["paper"] for finding in findings} == {"MP", "PP"}
    found = {(f["name"], f["driver"]): f for f in findings if f["paper"] == "PP"}
    finding = found["velocity-based, n₂ = 3", "all"]
    assert finding["pairs"] == 6
    assert finding["low"] < finding["change"] < finding["high"]
    assert found["velocity-based, n₂ = 3", "b.~"]["pairs"] == 3
    assert found["velocity-based, n₂ = 6", "all"]["verdict"] == "cannot be told"


def test_one_path_type_is_what_the_evaluation_measures(done: Project) -> None:
    """The same windows, training rows and regression, through the other stage's cells."""
    where = (done.directory, "b.~", 1)
    primitives = done.config.models.motion_primitives.model_copy(update={"calibrate": False})
    models = done.config.models.model_copy(update={"motion_primitives": primitives})
    outcome = cells.evaluate_motion_primitives(*where, 1, done.config.model_copy(update={"models": models}))
    path = done.directory / outcome.entry["outputs"][0]["path"]
    expected = {
        row["components"]: row
        for row in json.loads(path.read_text(encoding="utf-8"))["rows"]
        if row["model"] == "mixture" and row["path_types"] == 1
    }
    point = {
        "driver": "b.~",
        "fold": "1",
        "past_steps": "1",
        "path_types": "1",
        "windows": "all",
        "future_path": "True",
    }
    found = [row for row in rows_of(done, "motion_primitives.csv") if all(row[name] == point[name] for name in point)]
    assert len(found) == len(expected) == 2
    for row in found:
        for name in ("mean_error", "mean_variance", "coverage_68", "samples"):
            assert float(row[name]) == pytest.approx(expected[int(row["components"])][name], rel=1e-9)


def test_without_the_path_ahead_nothing_of_it_is_seen() -> None:
    """Columns of Δθ and v up to t, and all of the steering, of inputs that hold their own column and step."""
    for past_steps in (-1, 0, 2):
        past = max(past_steps, 0)
        steps = np.concatenate([*[np.arange(-past, 6)] * 2, np.arange(-past_steps, 1)])
        kept = experiment_cells._columns(past_steps, future_path=False)
        assert steps[kept].max() == 0
        assert len(kept) == 2 * (past + 1) + past_steps + 1
        assert experiment_cells._columns(past_steps, future_path=True).tolist() == list(range(len(steps)))


def windows(rng: np.random.Generator, counts: dict[str, int]) -> tuple[Any, Any, Any]:
    types = np.repeat(np.array(list(counts)), list(counts.values()))
    inputs = rng.normal(size=(len(types), 4)) + rng.normal(size=4) * (np.arange(len(types)) % 3)[:, None]
    outputs = inputs @ rng.normal(size=(4, 2)) + 0.1 * rng.normal(size=(len(types), 2))
    return inputs, outputs, types


def test_types_fitted_apart_predict_by_equations_20_to_22_as_printed() -> None:
    rng = np.random.default_rng(0)
    inputs, outputs, types = windows(rng, {"1-1-1": 300, "1-2-1": 300})
    primitives = fit_apart(inputs, outputs, types, components=2, seed=0)
    own = types == "1-2-1"
    mean, variance = primitives.predict(inputs[own][:5], types[own][:5])
    mixture = primitives.regressions["1-2-1"].mixture_
    for place, x in enumerate(inputs[own][:5]):
        density, means, covariances = [], [], []
        for mu, sigma in zip(mixture.means_, mixture.covariances_, strict=True):
            slope = sigma[4:, :4] @ np.linalg.inv(sigma[:4, :4])
            density.append(multivariate_normal(mu[:4], sigma[:4, :4]).pdf(x))
            means.append(mu[4:] + slope @ (x - mu[:4]))
            covariances.append(sigma[4:, 4:] - slope @ sigma[:4, 4:])
        beta = np.array(density) / sum(density)
        np.testing.assert_allclose(mean[place], beta @ np.array(means), rtol=1e-8)
        expected = np.einsum("k,kii->i", beta**2, np.array(covariances))
        np.testing.assert_allclose(variance[place], expected, rtol=1e-8)
    changed = outputs.copy()
    changed[~own] += 100.0
    other = fit_apart(inputs, changed, types, components=2, seed=0).regressions["1-2-1"].mixture_
    np.testing.assert_array_equal(other.means_, mixture.means_)


@pytest.mark.parametrize("faithful", [False, True])
def test_types_with_few_windows_fall_back_along_the_levels(faithful: bool) -> None:
    """Also where a type is one window over and over, as at a constant angle: no crash, no singular covariance."""
    rng = np.random.default_rng(1)
    counts = {"1-1-1": 200, "2-1-2": 1, "3-1-3": 100, "1-2-1": 2, "2-2-2": 1, "3-3-3": 40, "1-3-2": 3}
    inputs, outputs, types = windows(rng, counts)
    constant = types == "3-1-3"
    inputs[constant], outputs[constant] = inputs[constant][0], outputs[constant][0]
    finest = experiment_models.fit_structure(inputs, outputs, types, 2, 0, 1, faithful=faithful)
    assert {name: finest.model_of(name) for name in counts} == {
        "1-1-1": "1-1-1", "2-1-2": "1", "3-1-3": "3-1-3", "1-2-1": "all", "2-2-2": "all", "3-3-3": "3-3-3",
        "1-3-2": "3",
    }  # fmt: skip
    assert finest.model_of("2-3-1") == "3"
    for n1, names in ((27, ("2-1-2", "1-2-1", "2-2-2", "1-3-2")), (3, ("1-2-1", "2-2-2")), (1, ())):
        primitives = finest.coarser(n1)  # type: ignore[arg-type]  # a tuple's elements are plain numbers
        mean, variance = primitives.predict(inputs, types)
        assert np.isfinite(mean).all()
        assert (variance > 0).all()
        assert experiment_cells._fell_back(primitives, types).sum() == sum(counts[name] for name in names)
    for regression in finest.regressions.values():
        for covariance in regression.mixture_.covariances_:
            np.linalg.cholesky(covariance)


def test_what_fell_back_is_counted(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    """One path type in eight is too rare to have a regression of its own."""
    monkeypatch.setattr(experiment_models, "windows_needed", lambda *_: 150)
    rare = np.where(np.arange(800) % 40 < 35, "1-1-1", "2-1-2")
    monkeypatch.setattr(experiment_models, "label_rows", lambda *_: rare)
    where, config = (project.directory, "b.~"), project.config
    outcome = experiment_cells.evaluate_primitives(*where, 1, 1, 1, True, True, config)
    path = project.directory / outcome.entry["outputs"][0]["path"]
    rows = json.loads(path.read_text(encoding="utf-8"))["rows"]
    series = read_series(*where, config)
    split = experiment_models.split_windows(*where, series, 1, 1, config, faithful=True)
    learnt, asked = Counter(split.learnt_types.tolist()), Counter(split.asked_types.tolist())
    few = {name: windows for name, windows in asked.items() if learnt[name] < 150}
    found = {(row["path_types"], row["windows"]): row["fell_back"] for row in rows}
    assert 0 < sum(few.values()) < sum(asked.values())
    assert found[27, "all"] == sum(few.values())
    assert found[27, "1-1-1"] == 0
    assert found[1, "all"] == 0


def quick_cell(**point: Any) -> Any:
    """Publish what a cell of PP's grid does, without any fit."""
    names = ("driver", "components", "regressors", "fold")
    told = {"model": "velocity" if point["regressors"] else "general", **{name: point[name] for name in names}}
    figures = {"repeats": 2, "mean_error": 1.0, "mean_error_sd": 0.1, "mean_sd": 2.0, "mean_sd_sd": 0.1, "samples": 9}
    rows = [{**told, "split": split, **figures} for split in ("train", "test")]
    file = f"fold{point['fold']}-regressors{point['regressors']}.json"
    publish = experiment_cells.publish_cell
    return publish(point["project"], "lookahead", point["driver"], file, rows, {}, faithful=point["faithful"])


def test_an_interrupted_run_goes_on_and_does_no_cell_twice(
    own_project: Project, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran: list[tuple[Any, ...]] = []
    stop_at = 5

    def counted(**arguments: Any) -> Any:
        ran.append(tuple(arguments[name] for name in ("driver", "fold", "components", "regressors")))
        if len(ran) == stop_at:
            signal.raise_signal(signal.SIGINT)
        return quick_cell(**arguments)

    monkeypatch.setattr(experiments, "evaluate_lookahead", counted)
    command = [
        "evaluate",
        "--project",
        str(own_project.directory),
        "--experiment",
        "lookahead",
        "--workers",
        "1",
        "--json",
    ]
    first = CliRunner().invoke(app, command, catch_exceptions=False)
    assert first.exit_code == 3
    said = json.loads(first.stdout)
    assert len(ran) == stop_at
    reasons = [problem["reason"] for problem in said["problems"] if problem["where"] == "lookahead"]
    # With the two cells of the test track.
    assert reasons == ["stopped after 7 of 14 cells; the same command goes on from there"]
    assert len(rows_of(own_project, "lookahead.csv")) == 2 * stop_at
    stop_at = 1000
    second = CliRunner().invoke(app, command, catch_exceptions=False)
    assert second.exit_code == 3  # The driver with too little data is a problem of its own.
    assert len(ran) == len(set(ran)) == 12
    CliRunner().invoke(app, command, catch_exceptions=False)
    assert len(ran) == 12
    assert len(rows_of(own_project, "lookahead.csv")) == 24


def test_same_inputs_give_the_same_bytes(done: Project, perform: Perform) -> None:
    for experiment in experiments.PAPERS:
        tasks = [t for t in plan_experiment(done, experiment, faithful=False)[0] if "b.~/grid/fold 1" in t.name]
        for task in tasks[-2:]:
            path = done.directory / perform(done, [task])[0].entry["outputs"][0]["path"]
            before = path.read_bytes()
            perform(done, [task])
            assert path.read_bytes() == before


def test_an_embargo_shorter_than_the_windows_is_refused(own_project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(experiments, "FUTURE_STEPS", 50)
    with pytest.raises(InputError) as caught:
        plan_experiment(own_project, "motion-primitives", faithful=False)
    found, longest = own_project.config.dataset.embargo, (50 + 1 + 1 + 4) / 10
    assert str(caught.value) == (
        f"{own_project.directory / 'wheelprint.toml'}: dataset.embargo: {found:g} s is shorter than the experiment's "
        f"longest window, {longest:g} s, and training windows would share samples with test windows; write {longest:g} "
        "or more"
    )


def test_faithful_alone_is_wrong_usage(own_project: Project) -> None:
    result = CliRunner().invoke(app, ["evaluate", "--project", str(own_project.directory), "--faithful"])
    assert result.exit_code == 2
    assert "only an experiment can be faithful: add --experiment" in result.stderr


def test_the_project_file_may_ask_for_faithful(own_project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(experiments, "evaluate_lookahead", quick_cell)
    path = own_project.directory / "wheelprint.toml"
    text = path.read_text(encoding="utf-8").replace("[models]\n", "[models]\nfaithful = true\n")
    path.write_text(text, encoding="utf-8")
    command = [
        "evaluate",
        "--project",
        str(own_project.directory),
        "--experiment",
        "lookahead",
        "--workers",
        "1",
        "--json",
    ]
    assert CliRunner().invoke(app, command, catch_exceptions=False).exit_code == 3
    assert (own_project.results_folder / "experiments" / "faithful" / "lookahead.csv").is_file()
    assert not (own_project.results_folder / "experiments" / "lookahead.csv").exists()


def test_situations_do_not_overlap_and_differ_in_steering(done: Project) -> None:
    for folder in ("", "faithful"):
        path = Path(done.results_folder) / "experiments" / folder / "figure_2.json"
        by_driver = json.loads(path.read_text(encoding="utf-8"))
        assert {cell["rows"][0]["driver"] for cell in by_driver} == {"b.~", "王 小明"}
        for cell in by_driver:
            spans = [np.ptp(situation["driven"][1:]) for situation in cell["rows"]]
            assert [s["situation"] for s in cell["rows"]] == list("abcd")
            assert spans == sorted(spans, reverse=True)
