"""A predicted stretch: the right place, the right predictions, and said that the model had seen it."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from wheelprint.modeling.predict import load_steering_model, predict_steering
from wheelprint.modeling.train import plan_training
from wheelprint.report.page import write_report
from wheelprint.report.predictions import _liveliest, predicted_stretch
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import Project
from wheelprint.schemas.store import Manifest
from wheelprint.schemas.times import iso_utc

DRIVER, RECORDING = "王小明", "环路 1"
SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def trained(project: Project, tmp_path_factory: pytest.TempPathFactory) -> Project:
    """A copy of the project with one driver's motion primitives."""
    folder = tmp_path_factory.mktemp("trained") / "project"
    shutil.copytree(project.directory, folder)
    copy = Project(folder)
    (task,) = [task for task in plan_training(copy)[0] if task.name == f"motion_primitives/{DRIVER}"]
    outcome = task.run(**task.arguments)
    Manifest(folder).record(task.section, task.name, {**outcome.entry, "fingerprint": "", "problems": []})
    return copy


def test_the_stretch_shows_what_the_model_predicts_and_what_the_driver_did(trained: Project) -> None:
    shown = predicted_stretch(trained, DRIVER, [RECORDING])
    assert shown is not None
    lines = {trace.name: trace for trace in shown.figure.data}
    assert list(lines) == ["95 % band", "68 % band", "predicted", "driven"]

    table = predict_steering(trained, load_steering_model(trained, DRIVER), DRIVER, RECORDING)
    dataset = trained.dataset(DRIVER)
    dataset = dataset.filter(pa.compute.equal(dataset["recording"], RECORDING))
    starts = [vertical.x0 for vertical in shown.figure.layout.shapes]
    assert np.allclose(np.diff(starts), 5.0)
    assert f"{len(starts)} predictions of 5 s" in shown.caption

    predicted = np.asarray(lines["predicted"].y, float).reshape(len(starts), 51)
    assert np.isnan(predicted[:, -1]).all(), "predictions do not join"
    means = np.array(table["mean"].to_pylist(), np.float32)
    rows = [int(np.flatnonzero((means == values).all(axis=1))[0]) for values in predicted[:, :-1].astype(np.float32)]
    made = table["time"].cast(pa.int64()).to_numpy()[rows]
    assert (np.diff(made) == 5 * SECOND).all()
    assert f"from {iso_utc(int(made[0])).replace('T', ' ').removesuffix('Z')}: " in shown.caption

    inner = np.asarray(lines["68 % band"].y, float).reshape(len(starts), 101)
    sd = np.array(table["sd"].to_pylist())[rows]
    assert np.allclose(inner[:, :50], means[rows] + 0.9944579 * sd, rtol=1e-4, atol=1e-3)

    time = dataset["time"].cast(pa.int64()).to_numpy()
    steering = dataset["steering_wheel_angle"].to_numpy()
    at = np.searchsorted(
        time, made[0] + np.rint(np.asarray(lines["driven"].x, float) * 10).astype(np.int64) * SECOND // 10
    )
    assert np.allclose(lines["driven"].y, steering[at], atol=1e-3)
    error = np.abs(means[rows] - np.array([steering[np.searchsorted(time, start) + 1 :][:50] for start in made]))
    assert f"Mean error here {error.mean():.1f}°" in shown.caption


def test_the_stretch_is_the_one_in_which_the_steering_moves_most() -> None:
    rng = np.random.default_rng(1)
    time = np.arange(2000, dtype=np.int64) * SECOND // 10
    driven = np.cumsum(rng.normal(size=2000))
    driven[:10] = driven[-5:] = np.nan  # Where no prediction is made, the angle may be missing.
    made = np.delete(time[10:-60], slice(700, 760))
    horizon = 5 * SECOND

    first, number = _liveliest(made, time, driven, horizon)

    every = set(made.tolist())
    possible = {
        start: np.std(driven[(time >= start) & (time < start + 6 * horizon)])
        for start in every
        if all(start + k * horizon in every for k in range(6))
    }
    assert number == 6
    assert first == max(possible, key=lambda start: possible[start])


def test_fewer_predictions_are_shown_where_no_more_follow_each_other() -> None:
    time = np.arange(300, dtype=np.int64) * SECOND // 10
    made = time[20:90]
    assert _liveliest(made, time, np.zeros(300), 5 * SECOND) == (made[0], 2)


def test_the_page_shows_the_stretch_and_says_that_the_model_had_seen_it(trained: Project) -> None:
    text = write_report(trained).read_text(encoding="utf-8")
    section = text[text.index('<section id="prediction">') : text.index('<section id="provenance">')]
    assert "The models were trained on all data of their driver, these stretches included." in section
    assert f"{DRIVER}/" in section
    assert section.count("<figure>") == 1


def test_a_damaged_model_is_a_problem_on_the_page(trained: Project, tmp_path: Path) -> None:
    shutil.copytree(trained.directory, tmp_path / "copy")
    copy = Project(tmp_path / "copy")
    (copy.model_folder("motion_primitives", DRIVER) / "arrays.npz").write_bytes(b"nothing")
    with pytest.raises(InputError):
        predicted_stretch(copy, DRIVER, [RECORDING])
    text = write_report(copy).read_text(encoding="utf-8")
    summary = text[text.index('<section id="summary">') : text.index('<section id="recordings">')]
    assert "arrays.npz" in summary
