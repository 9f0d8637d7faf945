"""Prediction sample by sample gives what prediction of the whole recording gives, types of path included."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from wheelprint import Predictor
from wheelprint.dataset.segments import Division, divide, features, path_types
from wheelprint.modeling import PathAhead, Sample, path_ahead
from wheelprint.modeling.drivers import read_series
from wheelprint.modeling.path_ahead import HISTORY, label_windows
from wheelprint.modeling.path_types import PathTypes
from wheelprint.modeling.predict import SteeringModel, load_steering_model, predict_steering
from wheelprint.modeling.train import plan_training
from wheelprint.modeling.windows import Series, window_centres
from wheelprint.schemas.project import Project

DRIVER, RECORDING = "王 小明", "drive 0"
TICK = 100_000_000


@pytest.fixture(scope="module")
def trained(project: Project, perform: Callable[..., Any]) -> Project:
    tasks, _ = plan_training(project)
    perform(project, [task for task in tasks if task.name == f"motion_primitives/{DRIVER}"])
    return project


@pytest.fixture(scope="module")
def model(trained: Project) -> SteeringModel:
    return load_steering_model(trained, DRIVER)


@pytest.fixture(scope="module")
def series(trained: Project) -> Series:
    return read_series(trained.directory, DRIVER, trained.config)


def samples_of(series: Series, rows: np.ndarray) -> Iterator[tuple[int, Sample]]:
    for row in rows.tolist():
        values = (series.course_deviation[row], series.speed[row], series.steering_wheel_angle[row])
        yield row, Sample(int(series.time[row]), *map(float, values))


def plans(predictor: Predictor, series: Series, row: int) -> PathAhead | None:
    """What a planner says at a row: what was driven in this stretch afterwards; None where it ends too early."""
    ahead = np.arange(row + 1, row + 1 + predictor.model.future_steps)
    if ahead[-1] >= len(series.time) or series.stretch[ahead[-1]] != series.stretch[row]:
        return None
    return PathAhead(series.course_deviation[ahead], series.speed[ahead])


@pytest.fixture(scope="module")
def lively(model: SteeringModel, series: Series) -> SteeringModel:
    """The model with short segments of three types, so that the type of path changes all the time."""
    division = Division(model.division.neutral, model.division.neutral, 2)
    segment, _ = divide(series.course_deviation, series.stretch, *division)
    types = PathTypes.fit(features(series.course_deviation, series.speed, segment, TICK), 3, 3, 0)
    return replace(model, types=types, division=division)


@pytest.mark.parametrize("which", ["model", "lively"])
def test_every_window_of_a_recording_is_predicted_as_in_one_go(
    trained: Project, series: Series, which: str, request: pytest.FixtureRequest
) -> None:
    predictor = Predictor(request.getfixturevalue(which))
    table = predict_steering(trained, predictor.model, DRIVER, RECORDING)
    streamed = [
        predictor.step(sample, plans(predictor, series, row))
        for row, sample in samples_of(series, np.flatnonzero(series.recording == RECORDING))
    ]
    predictions = [prediction for prediction in streamed if prediction is not None]
    assert [one.time for one in predictions] == table["time"].cast(pa.int64()).to_pylist()
    assert [one.path_type for one in predictions] == table["path_type"].to_pylist()
    assert [one.regression for one in predictions] == table["regression"].to_pylist()
    assert len(set(table["path_type"].to_pylist())) > (6 if which == "lively" else 1)
    for name in ("mean", "sd", "domain_score"):
        streamed_values = np.array([getattr(one, name) for one in predictions])
        np.testing.assert_allclose(streamed_values, np.array(table[name].to_pylist()), rtol=1e-9, atol=1e-9)


def test_a_plan_gives_what_steps_with_the_path_ahead_give(model: SteeringModel, series: Series) -> None:
    rows = np.flatnonzero(series.stretch == 0)
    by_step, by_plan = Predictor(model), Predictor(model)
    assert by_plan.step(Sample(0, 0.0, 10.0, 0.0)) is None
    by_plan.plan(int(series.time[0]), PathAhead(series.course_deviation[rows], series.speed[rows]))
    predicted = 0
    for row, sample in samples_of(series, rows):
        one, other = by_step.step(sample, plans(by_step, series, row)), by_plan.step(sample)
        assert (one is None) == (other is None)
        if one is not None and other is not None:
            predicted += 1
            assert one.path_type == other.path_type
            np.testing.assert_array_equal(one.mean, other.mean)
    assert predicted == len(rows) - 1 - 1 - model.future_steps
    # A plan at other times than the samples' plans nothing for them.
    by_plan.plan(TICK // 2, PathAhead(np.ones(20), np.ones(20)))
    assert by_plan.step(Sample(0, 1.0, 1.0, 1.0)) is None
    assert by_plan.step(Sample(TICK, 1.0, 1.0, 1.0)) is None


def test_types_of_path_are_those_of_a_recording_that_ends_at_the_horizon(
    lively: SteeringModel, series: Series, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against the definition, window by window: cut the recording at the horizon and label its segments."""
    rows = (series.recording == RECORDING) & series.has_path_and_steering
    centres = window_centres(series.stretch, rows, max(lively.past_steps, 0), lively.future_steps)[::7]
    args = (centres, lively.future_steps, lively.types, lively.division, lively.period)
    for history in (HISTORY, 4_000_000_000):
        monkeypatch.setattr(path_ahead, "HISTORY", history)
        found = label_windows(series, *args)
        for centre, path_type in zip(centres.tolist(), found.tolist(), strict=True):
            cut = slice(max(0, centre - history // TICK), centre + lively.future_steps + 1)
            stretch = series.stretch[cut]
            deviation, speed = series.course_deviation[cut], series.speed[cut]
            segment, _ = divide(deviation, stretch, *lively.division)
            begins = np.flatnonzero(np.diff(segment, prepend=-1))
            labels = lively.types.label(features(deviation, speed, segment, lively.period)[: segment[-1] + 1])
            assert path_type == path_types(labels, stretch[begins])[segment[centre - cut.start]]
    assert label_windows(series, centres[:0], *args[1:]).shape == (0,)


def test_nothing_reaches_across_a_gap(model: SteeringModel) -> None:
    ahead = PathAhead(np.full(5, 0.5), np.full(5, 10.0))

    def drive(predictor: Predictor, start: int, deviations: list[float]) -> list[Any]:
        return [
            predictor.step(Sample(start + step * TICK, deviation, 10.0, 2.0), ahead)
            for step, deviation in enumerate(deviations)
        ]

    fresh, used = Predictor(model), Predictor(model)
    drive(used, 0, [-2.0, -2.0, 0.0, 3.0, 3.0])
    for start in (7 * TICK, 4 * TICK):  # later than one period, and back in time
        expected, found = (drive(predictor, start, [0.5, 0.5, -0.5]) for predictor in (fresh, used))
        assert expected[0] is None
        assert found[0] is None
        for one, other in zip(expected[1:], found[1:], strict=True):
            assert one.path_type == other.path_type
            np.testing.assert_array_equal(one.mean, other.mean)
        fresh = Predictor(model)
    # A sample without a course deviation is the first one of a stretch, whatever its time.
    without = drive(used, 7 * TICK, [np.nan, 0.5, 0.5])
    assert [prediction is None for prediction in without] == [True, True, False]
    missing = used.step(Sample(10 * TICK, 0.5, 10.0, np.nan), ahead)
    assert missing is None


def test_a_trained_model_is_loaded_by_its_driver(trained: Project) -> None:
    predictor = Predictor.load(trained.directory, DRIVER)
    assert predictor.model.past_steps == 1
    assert predictor.model.division == Division(0.05, 0.05, 5)


def test_a_path_ahead_that_cannot_be_used_is_refused(model: SteeringModel) -> None:
    predictor = Predictor(model)
    sample = Sample(0, 0.0, 10.0, 0.0)
    with pytest.raises(ValueError, match=r"^the path ahead must have 5 steps and no missing values$"):
        predictor.step(sample, PathAhead(np.zeros(4), np.zeros(4)))
    with pytest.raises(ValueError, match=r"^the path ahead must have 5 steps and no missing values$"):
        predictor.step(sample, PathAhead([0.0, 0.0, np.nan, 0.0, 0.0], np.zeros(5)))
    with pytest.raises(ValueError, match=r"same shape \(n_steps,\), found \(5,\) and \(4,\)$"):
        predictor.plan(0, PathAhead(np.zeros(5), np.zeros(4)))
