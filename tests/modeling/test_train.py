"""Training and prediction: what is saved predicts as it did, on recordings of the dataset."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from wheelprint.modeling.lookahead_models import GeneralLookahead, VelocityLookahead
from wheelprint.modeling.predict import load_steering_model, predict_steering
from wheelprint.modeling.storage import load_card, load_model
from wheelprint.modeling.train import plan_training
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import Project
from wheelprint.schemas.store import Manifest

Perform = Callable[..., Any]
DRIVER = "王 小明"


@pytest.fixture(scope="module")
def trained(project: Project, perform: Perform) -> Project:
    """The project with its models."""
    tasks, problems = plan_training(project)
    assert [problem.where for problem in problems] == ["models.minimum_minutes"]
    perform(project, tasks)
    return project


def test_plan_and_outputs(trained: Project) -> None:
    tasks = plan_training(trained)[0]
    kinds = ("motion_primitives", "lookahead_general", "lookahead_velocity")
    assert [task.name for task in tasks] == [f"{kind}/{driver}" for driver in ("b.~", DRIVER) for kind in kinds]
    manifest = Manifest(trained.directory)
    assert all(manifest.is_current("models", task.name, task.fingerprint) for task in tasks)
    for kind in kinds:
        files = {path.name for path in trained.model_folder(kind, "b.~").iterdir()}
        assert files == {"arrays.npz", "golden.npz", "card.json"}


def test_card_says_what_the_model_is(trained: Project) -> None:
    card = load_card(trained.model_folder("motion_primitives", DRIVER))
    assert card["driver"] == DRIVER
    assert card["recordings"] == 2
    assert card["hours"] == pytest.approx(1200 / 36000)
    assert {name: value for name, value in card["parameters"].items() if name != "covariance_shrinkage_rows"} == {
        "inputs": "paper", "calibrated": True, "path_types": 27, "past_steps": 1, "future_steps": 5, "components": 2,
        "starts": 1, "seed": 0,
    }  # fmt: skip
    assert card["windows"]["all"] == 1200 - 4 * (1 + 6)
    assert len(card["dataset"]) == 2
    speed = trained.dataset(DRIVER)["speed"].to_numpy()
    assert card["ranges"]["speed"] == {"minimum": speed.min(), "maximum": speed.max(), "unit": "m/s"}
    assert len(card["clusters"]) == 2
    assert all(card["limits"])
    velocity = load_card(trained.model_folder("lookahead_velocity", DRIVER))
    assert velocity["parameters"] == {"components": 2, "regressors": 2, "starts": 1, "seed": 0}


def test_lookahead_models_load(trained: Project) -> None:
    general, _ = load_model(
        trained.model_folder("lookahead_general", DRIVER),
        {"lookahead_general": (GeneralLookahead.from_arrays, GeneralLookahead.predict)},
    )
    velocity, _ = load_model(
        trained.model_folder("lookahead_velocity", DRIVER),
        {"lookahead_velocity": (VelocityLookahead.from_arrays, VelocityLookahead.predict)},
    )
    asked = np.array([[1.0, 10.0], [-1.0, 14.0]])
    for mean, sd in (general.predict(asked), velocity.predict(asked)):
        np.testing.assert_allclose(mean, [15.0, 19.0], atol=1.0)
        assert (sd > 0.5).all()


def test_training_again_gives_the_same_bytes(trained: Project, perform: Perform) -> None:
    folder = trained.model_folder("motion_primitives", "b.~")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    perform(trained, [task for task in plan_training(trained)[0] if task.name == "motion_primitives/b.~"])
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_predictions_along_a_recording(trained: Project) -> None:
    model = load_steering_model(trained, DRIVER)
    table = predict_steering(trained, model, DRIVER, "drive 1")
    assert table.column_names == [
        "time", "steering_wheel_angle", "path_type", "regression", "mean", "sd", "domain_score",
    ]  # fmt: skip
    data = trained.dataset(DRIVER).to_pandas()
    data = data[data.recording == "drive 1"].reset_index(drop=True)
    # Two runs of 166 and 334 rows; of each the first row has no course deviation, one is past and five are future.
    assert len(table) == 500 - 2 * (1 + 1 + 5)
    time = data.time.astype("int64").tolist()
    rows = [time.index(stamp) for stamp in table["time"].cast(pa.int64()).to_pylist()]
    angle = data.steering_wheel_angle.to_numpy()
    np.testing.assert_array_equal(table["steering_wheel_angle"].to_numpy(), angle[rows])
    ahead = np.array([angle[row + 1 : row + 6] for row in rows])
    mean, sd = (np.array(table[name].to_pylist()) for name in ("mean", "sd"))
    assert mean.shape == sd.shape == ahead.shape
    error = np.abs(mean - ahead)
    assert error.mean() < 1.2
    assert np.abs(ahead - angle[rows][:, None]).mean() > 5.0
    assert (error < 1.96 * sd).mean() == pytest.approx(0.95, abs=0.04)
    names = set(table["regression"].to_pylist())
    assert names <= set(model.primitives.regressions)
    assert len(names) > 1


def test_one_drivers_model_on_anothers_recording(trained: Project) -> None:
    table = predict_steering(trained, load_steering_model(trained, "b.~"), DRIVER, "drive 0")
    assert len(table) > 600
    assert np.isfinite(np.array(table["mean"].to_pylist())).all()


def test_what_cannot_be_predicted(trained: Project, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        load_steering_model(trained, "little")
    folder = trained.directory / "models" / "motion_primitives" / "little"
    assert (
        str(caught.value) == f"{folder}: driver 'little' has no motion primitives; trained are those of b.~, {DRIVER}"
    )
    model = load_steering_model(trained, "b.~")
    with pytest.raises(InputError) as caught:
        predict_steering(trained, model, "b.~", "drive 7")
    assert str(caught.value) == (
        f"{trained.directory}/dataset: driver 'b.~' has no recording 'drive 7' in the dataset; there are drive 0"
    )
    (tmp_path / "wheelprint.toml").write_text("[vehicle]\nwheelbase = 2.8\n[sync]\nrate = 20.0\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        predict_steering(Project(tmp_path), model, "b.~", "drive 0")
    assert str(caught.value) == (
        f"{tmp_path}/wheelprint.toml: sync.rate: the model was trained on samples 0.1 s apart, the dataset's are "
        "0.05 s apart; train again"
    )
