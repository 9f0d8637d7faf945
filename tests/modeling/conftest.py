"""A small project of simulated numbers whose dataset is there: two drivers to model, one with too little."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from wheelprint.dataset.folds import deal_folds
from wheelprint.dataset.path import course_deviation
from wheelprint.dataset.segments import divide
from wheelprint.schemas.project import Project
from wheelprint.schemas.store import Manifest, describe_output, publish_table
from wheelprint.schemas.tables import DATASET
from wheelprint.schemas.tasks import Outcome, Task

TICK = 100_000_000
START = 1_700_000_000_000_000_000
FOLDS = 3

CONFIG = f"""
[vehicle]
wheelbase = 2.8
[dataset]
folds = {FOLDS}
embargo = 1.1
[lookahead]
points = 5
[segments]
clusters = 2
[models]
minimum_minutes = 1.0
[models.lookahead]
components = [1, 2]
regressors = [2]
starts = 1
[models.motion_primitives]
inputs = ["curvature", "paper"]
path_types = [1, 3, 27]
past_steps = [-1, 1]
future_steps = 5
components = [1, 2]
[models.personal]
evaluate = false
"""

DRIVERS = {"王 小明": (700, 500), "b.~": (800,), "little": (100,)}
"""Driver -> rows of each recording."""


def drive(rows: int, seed: int) -> dict[str, np.ndarray]:
    """A winding road; the steering follows the curvature with a driver's gain and some noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(rows) / 10
    speed = 12.0 + 4.0 * np.sin(t / 9 + seed) + rng.normal(0, 0.1, rows)
    yaw_rate = 10.0 * np.sin(t + seed) * (np.sin(t / 23) > -0.5) + rng.normal(0, 0.2, rows)
    run = (np.arange(rows) >= rows // 3).astype(np.int32)
    deviation = course_deviation(np.cumsum(yaw_rate) / 10, run)
    segment, _ = divide(deviation, run, 0.2)
    lookahead = np.where(np.abs(yaw_rate) > 1.0, 5.0 + speed + rng.normal(0, 1.0, rows), np.nan)
    return {
        "time": START + seed * 10**13 + (np.arange(rows) + 50 * run) * TICK,
        "run": run,
        "course_deviation": deviation,
        "speed": speed,
        "steering_wheel_angle": 3.0 * yaw_rate + rng.normal(0, 1.0, rows),
        "lookahead": lookahead,
        "lookahead_spread": lookahead * (0.3 + 0.2 * np.sin(t)),
        "segment": segment,
    }


def write_dataset(project: Project, driver: str, recordings: Sequence[dict[str, np.ndarray]]) -> None:
    """Publish a driver's dataset and confirm it in the manifest; columns that no model reads are null."""
    fold = deal_folds(sum(len(columns["time"]) for columns in recordings), FOLDS, seed=0)
    outputs = []
    for number, columns in enumerate(recordings):
        rows = len(columns["time"])
        values = {**columns, "fold": fold[:rows]}
        fold = fold[rows:]
        arrays = [
            pa.array(values[f.name], from_pandas=True).cast(f.type) if f.name in values else pa.nulls(rows, f.type)
            for f in DATASET
        ]
        name = f"drive {number}"
        (project.directory / "raw" / driver / name).mkdir(parents=True, exist_ok=True)
        path = project.dataset_file(driver, name)
        publish_table(path, pa.Table.from_arrays(arrays, schema=DATASET))
        outputs.append(describe_output(project.directory, path, rows=rows, recording=name))
    Manifest(project.directory).record("dataset", driver, {"fingerprint": "x", "outputs": outputs})


def write_project(directory: Path) -> Project:
    """Write the project file and every driver's dataset."""
    directory.mkdir(parents=True, exist_ok=True)
    (directory / "wheelprint.toml").write_text(CONFIG, encoding="utf-8")
    project = Project(directory)
    for place, (driver, lengths) in enumerate(DRIVERS.items()):
        write_dataset(project, driver, [drive(rows, 10 * place + number) for number, rows in enumerate(lengths)])
    return project


def carry_out(project: Project, tasks: Sequence[Task]) -> list[Outcome]:
    """Run tasks and record what they did, as the commands do."""
    manifest = Manifest(project.directory)
    outcomes = []
    for task in tasks:
        outcome = task.run(**task.arguments)
        manifest.record(task.section, task.name, {**outcome.entry, "fingerprint": task.fingerprint})
        outcomes.append(outcome)
    return outcomes


@pytest.fixture(scope="session")
def project(tmp_path_factory: pytest.TempPathFactory) -> Project:
    """The project; its tasks may be carried out, its dataset stays as it is."""
    return write_project(tmp_path_factory.mktemp("modelled"))


@pytest.fixture
def own_project(tmp_path: Path) -> Project:
    """A copy of the project, to be changed."""
    return write_project(tmp_path / "own")


@pytest.fixture(scope="session")
def perform() -> Callable[[Project, Sequence[Task]], list[Outcome]]:
    """Runs tasks as the commands do."""
    return carry_out


@pytest.fixture(scope="session")
def replace_dataset() -> Callable[[Project, str, Sequence[dict[str, Any]]], None]:
    """Writes a driver's dataset anew."""
    return write_dataset


@pytest.fixture(scope="session")
def recordings() -> Callable[[str], list[dict[str, np.ndarray]]]:
    """Returns the columns of a driver's recordings."""
    places = list(DRIVERS)
    return lambda driver: [drive(rows, 10 * places.index(driver) + n) for n, rows in enumerate(DRIVERS[driver])]
