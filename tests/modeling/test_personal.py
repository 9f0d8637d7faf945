"""Personal models: what they learn from, whose minute it is, and the cells and tables of the evaluation."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pytest

from wheelprint.modeling import personal_evaluation
from wheelprint.modeling.drivers import read_series
from wheelprint.modeling.evaluate import gather_results, plan_evaluation
from wheelprint.modeling.mixture import GaussianMixture
from wheelprint.modeling.personal import (
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
from wheelprint.modeling.personal_evaluation import (
    evaluate_across_drivers,
    evaluate_learning_curve,
    identification_rates,
)
from wheelprint.modeling.regression import MixtureRegression
from wheelprint.schemas.config import Config, Personal
from wheelprint.schemas.project import Project
from wheelprint.schemas.tables import CROSS_DRIVER_COLUMNS, IDENTIFICATION_COLUMNS, LEARNING_CURVE_COLUMNS

DRIVERS = ("b.~", "王 小明")
SETTINGS = Personal(future_steps=5, components=1, lookahead_components=1)


def with_personal(project: Project) -> Config:
    models = project.config.models.model_copy(update={"personal": SETTINGS})
    return project.config.model_copy(update={"models": models})


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory, project: Project, perform: Callable[..., Any]) -> Project:
    """The project with the personal part of its evaluation done, and nothing else."""
    import shutil

    folder = tmp_path_factory.mktemp("personal") / "project"
    shutil.copytree(project.directory, folder)
    file = folder / "wheelprint.toml"
    asked = "evaluate = true\nfuture_steps = 5\ncomponents = 1\nlookahead_components = 1"
    file.write_text(file.read_text(encoding="utf-8").replace("evaluate = false", asked), encoding="utf-8")
    own = Project(folder)
    perform(own, [task for task in plan_evaluation(own)[0] if task.name.startswith("personal/")])
    gather_results(own)
    return own


def test_plan(results: Project, project: Project) -> None:
    names = [task.name for task in plan_evaluation(results)[0] if task.name.startswith("personal/")]
    assert names == [
        "personal/learning curve/b.~", "personal/learning curve/王 小明",
        "personal/fold 0", "personal/fold 1", "personal/fold 2",
    ]  # fmt: skip
    assert not [task for task in plan_evaluation(project)[0] if task.name.startswith("personal/")]


def test_learning_curves(results: Project) -> None:
    curve = pd.read_csv(results.results_folder / "learning_curve.csv")
    assert tuple(curve.columns) == LEARNING_CURVE_COLUMNS
    assert curve.notna().all().all()
    # 80 s and 120 s less a third and the embargo: a minute of one driver is left, less than that of the other.
    assert set(curve.minutes) == {0, 1}
    found = curve.groupby(["quantity", "model", "minutes"]).size().to_dict()
    assert found == {
        (quantity, model, 0 if model == "population" else 1): 3 if model != "population" else 6
        for quantity in ("steering", "lookahead")
        for model in ("own", "adapted", "population")
    }
    assert set(curve[curve.model == "population"].minutes) == {0}


def test_the_population_does_not_contain_the_driver(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    series = {name: read_series(project.directory, name, project.config) for name in DRIVERS}
    seen: list[list[int]] = []

    def spy(samples: Sequence[Samples], *arguments: Any) -> Any:
        seen.append([len(own.centres) for own in samples])
        return fit_own(samples, *arguments)

    monkeypatch.setattr(personal_evaluation, "fit_own", spy)
    evaluate_learning_curve(project.directory, DRIVERS, "王 小明", with_personal(project))
    other = series["b.~"]
    everything = np.ones(len(other.time), dtype=np.bool_)
    sizes = [len(take_samples(other, everything, name, SETTINGS).centres) for name in ("steering", "lookahead")]
    # The population of each quantity, then the driver's own minute beside each of three folds.
    assert seen[::4] == [[sizes[0]], [sizes[1]]]
    assert all(len(own) == 1 and own[0] <= 600 for place, own in enumerate(seen) if place % 4)
    assert len(seen) == 8


def test_no_model_has_learnt_from_the_tested_fold(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    folds: list[set[int]] = []

    def spy(series: Any, rows: Any, *arguments: Any) -> Samples:
        folds.append(set(series.fold[rows].tolist()))
        return take_samples(series, rows, *arguments)

    monkeypatch.setattr(personal_evaluation, "take_samples", spy)
    evaluate_across_drivers(project.directory, DRIVERS, 1, with_personal(project))
    assert folds == 2 * [{0, 2}, {0, 2}, {1}, {1}]


def test_cross_driver_and_identification(results: Project) -> None:
    crossed = pd.read_csv(results.results_folder / "cross_driver.csv")
    assert tuple(crossed.columns) == CROSS_DRIVER_COLUMNS
    assert len(crossed) == 2 * 2 * 2 * 2 * 3
    named = pd.read_csv(results.results_folder / "identification.csv")
    assert tuple(named.columns) == IDENTIFICATION_COLUMNS
    assert set(named.named) <= set(DRIVERS)
    assert (named.margin >= 0).all()
    rates = json.loads((results.results_folder / "identification.json").read_text(encoding="utf-8"))
    assert len(rates) == 2 * 2 * 3
    for rate in rates:
        own = named[
            (named.model == rate["model"]) & (named.density == rate["density"]) & (named.evidence == rate["evidence"])
        ]
        assert rate["minutes"] == len(own) == sum(sum(row.values()) for row in rate["confusion"].values())
        assert rate["right"] == (own.driver == own.named).sum()


def test_rates_and_their_intervals() -> None:
    what = {"model": "own", "density": "joint", "evidence": "both"}
    rows = [{**what, "driver": "a", "named": name} for name in ["a"] * 8 + ["b"] * 2]
    (rate,) = identification_rates(rows)
    assert rate["confusion"] == {"a": {"a": 8, "b": 2}}
    # Wilson's interval of 8 in 10, as in Newcombe 1998.
    assert (rate["rate"], rate["low"], rate["high"]) == pytest.approx((0.8, 0.4902, 0.9433), abs=1e-4)


def test_a_minute_is_named_by_the_sum() -> None:
    likelihoods = {"a": np.array([1.0, -3.0, 0.0, 2.0]), "b": np.array([0.0, 0.0, 0.5, 1.0])}
    assert name_drivers(likelihoods, np.array([0, 0, 2, 2])) == {0: ("b", 2.0), 2: ("a", 0.5)}


def test_lookahead_distances_told_by_the_same_steering_count_as_one() -> None:
    assert [weight("steering", 10.0), weight("lookahead", 10.0), weight("lookahead", 1.0)] == [1.0, 0.25, 1.0]


@pytest.mark.parametrize(("rows", "pieces"), [(540, 1), (899, 1), (901, 2), (1800, 3)])
def test_a_fold_is_cut_into_minutes(rows: int, pieces: int) -> None:
    fold = np.arange(100, 100 + rows)
    minutes = cut_minutes(fold, fold, 10.0)
    assert set(minutes.tolist()) == set(range(pieces))
    assert np.ptp(np.bincount(minutes)) <= 1


def test_minutes_of_a_curve() -> None:
    assert curve_minutes(0.5) == []
    assert curve_minutes(25.0) == [1, 2, 5, 10, 20]


def test_minutes_are_taken_from_the_test_fold_on(project: Project) -> None:
    series = read_series(project.directory, "b.~", project.config)
    fold = int(series.fold[400])
    training = series.fold != fold
    minutes = first_minutes_after(series, training, fold, 10.0)
    assert np.isinf(minutes[~training]).all()
    last = int(np.flatnonzero(series.fold == fold)[-1])
    order = [*range(last + 1, len(training)), *range(last + 1)]
    np.testing.assert_allclose(minutes[[row for row in order if training[row]]], np.arange(training.sum()) / 600)


def test_densities_by_hand() -> None:
    mixture = GaussianMixture.from_parameters([1.0], [[1.0, 2.0]], [[[4.0, 2.0], [2.0, 3.0]]])
    model = MixtureRegression.from_mixture(mixture, [0], [1])
    samples = Samples(np.array([0]), np.array([[3.0]]), np.array([[5.0]]))
    error, likelihoods = measure(model, samples)
    # Given x = 3 the output has mean 2 + 2/4 · 2 = 3 and variance 3 − 2 · 2/4 = 2.
    assert error[0] == pytest.approx(2.0)
    conditional = -0.5 * (np.log(2 * np.pi * 2.0) + 4.0 / 2.0)
    assert likelihoods.conditional[0] == pytest.approx(conditional)
    assert likelihoods.joint[0] == pytest.approx(conditional - 0.5 * (np.log(2 * np.pi * 4.0) + 1.0))


def test_the_population_comes_to_a_driver() -> None:
    rng = np.random.default_rng(0)

    def driver(gain: float, rows: int) -> Samples:
        inputs = rng.normal(size=(rows, 2))
        return Samples(np.arange(rows), inputs, inputs[:, :1] * gain + rng.normal(0, 0.3, (rows, 1)))

    one, other = driver(1.0, 900), driver(2.0, 900)
    inputs, outputs = np.concatenate([one.inputs, other.inputs]), np.concatenate([one.outputs, other.outputs])
    population = MixtureRegression(1).fit(inputs, outputs)
    asked = driver(3.0, 500)
    errors = [
        measure(personalise(population, driver(3.0, rows), "lookahead", SETTINGS), asked)[0].mean()
        for rows in (3, 30, 3000)
    ]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] == pytest.approx(0.3 * np.sqrt(2 / np.pi), rel=0.05)
    assert measure(population, asked)[0].mean() > errors[0]
