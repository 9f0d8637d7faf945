"""The stage that drives the laws: what it plans, what it writes, that it does nothing twice, and what it refuses."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from wheelprint.dataset.path import course_deviation
from wheelprint.modeling.driving import CONTROLS
from wheelprint.modeling.lookahead_laws import LAWS
from wheelprint.modeling.tracking import TEST_TRACK, current_cells, gather_tracks, plan_tracking
from wheelprint.modeling.train import plan_training
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import Project
from wheelprint.schemas.store import Manifest, publish_table, read_table
from wheelprint.schemas.tables import TRACK_COLUMNS

Perform = Callable[..., Any]
DRIVER = "b.~"
RECORDING = "b.~/drive 0"
OTHER = "王 小明"


def with_positions(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The same drive in the plane, its steering that of a bicycle of 2.8 m, ratio 15 and K = 0.001."""
    speed, run = columns["speed"], columns["run"]
    course = np.cumsum(np.nan_to_num(columns["course_deviation"]))
    x, y = (np.cumsum(speed * f(np.radians(course))) / 10 for f in (np.cos, np.sin))
    curvature = np.radians(np.gradient(course) * 10) / speed
    wheel = 15 * np.degrees(np.arctan(curvature * (2.8 + 0.001 * speed**2)))
    wrapped = (course + 180) % 360 - 180
    return columns | {
        "x": x, "y": y, "course": wrapped, "course_deviation": course_deviation(wrapped, run),
        "steering_wheel_angle": wheel,
    }  # fmt: skip


@pytest.fixture
def trained(
    own_project: Project, perform: Perform, replace_dataset: Callable[..., None], recordings: Callable[[str], list[Any]]
) -> Project:
    """A project of its own whose recordings have positions, with trained models and a calibrated car."""
    for driver in (DRIVER, OTHER):
        replace_dataset(own_project, driver, [with_positions(columns) for columns in recordings(driver)])
    tasks = [task for task in plan_training(own_project)[0] if task.name.startswith("lookahead")]
    perform(own_project, tasks)
    calibration = {"fingerprint": "c", "steering_ratio": 15.0, "understeer_deg_per_m_s2": math.degrees(0.001)}
    Manifest(own_project.directory).put("calibration", calibration)
    return own_project


def test_plan_names_every_driver_and_path(trained: Project) -> None:
    names = [task.name for task in plan_tracking(trained)]
    own = [f"{OTHER}/{OTHER}/drive {number}" for number in (0, 1)]
    assert names == [f"{DRIVER}/{TEST_TRACK}", f"{DRIVER}/{RECORDING}", f"{OTHER}/{TEST_TRACK}", *own]
    assert [task.name for task in plan_tracking(trained, [OTHER], recordings=1)] == [f"{OTHER}/{TEST_TRACK}", own[0]]
    assert [task.name for task in plan_tracking(trained, [OTHER], recordings=0)] == [f"{OTHER}/{TEST_TRACK}", *own]
    assert [task.name for task in plan_tracking(trained, [OTHER], RECORDING, -1.5)] == [f"{OTHER}/{RECORDING}/-1.5 m"]
    marks = {task.fingerprint for path in (TEST_TRACK, RECORDING) for o in (0.0, 1.0)
             for task in plan_tracking(trained, (), path, o)}  # fmt: skip
    assert len(marks) == 8


def test_what_is_refused(trained: Project, perform: Perform) -> None:
    with pytest.raises(InputError) as refused:
        plan_tracking(trained, ["b.~", "nobody", "little"])
    assert str(refused.value) == (
        f"{trained.directory}: nobody, little: no model of the lookahead distance was trained; there are those of "
        f"{DRIVER}, {OTHER}"
    )
    with pytest.raises(InputError) as refused:
        plan_tracking(trained, (), "b.~/x")
    assert str(refused.value) == (
        f"{trained.directory}: b.~/x: no such recording, and no track; there are {TEST_TRACK}, {RECORDING}, "
        f"little/drive 0, {OTHER}/drive 0, {OTHER}/drive 1"
    )
    (trained.directory / "raw" / DRIVER / "new").mkdir()
    with pytest.raises(InputError, match="the dataset holds nothing of this recording; run `wheelprint build`"):
        plan_tracking(trained, (), "b.~/new")
    manifest = Manifest(trained.directory)
    manifest.put("calibration", {})
    with pytest.raises(InputError, match="the steering of the vehicle was not calibrated yet; run `wheelprint build`"):
        perform(trained, plan_tracking(trained, [DRIVER], TEST_TRACK))
    manifest.put("models", {})
    with pytest.raises(InputError, match="no model of the lookahead distance is there; run `wheelprint train`"):
        plan_tracking(trained)


def test_tables_and_cells(trained: Project, perform: Perform) -> None:
    tasks = plan_tracking(trained)
    perform(trained, tasks)
    ((title, _, printed),) = gather_tracks(trained, tasks)
    assert title.startswith("Closed loop")
    with (trained.results_folder / "track.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == TRACK_COLUMNS
    per_path = len(LAWS) * len(CONTROLS)
    assert len(rows) == 2 * per_path + 3 * (per_path + 1)
    # The recordings of a driver are printed together.
    assert len(printed) == 2 * (len(LAWS) + 2) + 2 * (len(LAWS) + 3)
    found = {(row["driver"], row["path"], row["law"], row["control"]): row for row in rows}
    # Along what was driven the driver is on the path, and linear pursuit of h = 5 + v keeps near it.
    driver = found[DRIVER, RECORDING, "driver", ""]
    assert float(driver["tracking_rms"]) == 0.0
    assert driver["steering_error"] == ""
    linear = found[DRIVER, RECORDING, "linear", "pursuit"]
    assert float(linear["tracking_max"]) < 3.0
    assert (
        float(linear["lookahead_error"])
        < 1.0
        < float(found[DRIVER, RECORDING, "constant", "pursuit"]["lookahead_error"])
    )
    assert found[DRIVER, TEST_TRACK, "linear", "pursuit"]["steering_error"] == ""
    for law in LAWS:
        assert float(found[DRIVER, TEST_TRACK, law, "combined"]["tracking_max"]) < 2.0
    cell = json.loads((trained.results_folder / "cells" / "track" / "b.%7E" / "b.%7E%2Fdrive%200.json").read_text())
    assert (cell["drives"][0]["law"], cell["drives"][0]["control"]) == ("driver", "")
    for drive in cell["drives"]:
        assert max(drive["distance"]) - min(drive["distance"]) <= 500.0
        assert {len(values) for values in drive.values() if isinstance(values, list)} == {len(drive["distance"])}


def test_only_what_is_current_is_gathered(trained: Project, perform: Perform) -> None:
    first, second = plan_tracking(trained, [DRIVER]), plan_tracking(trained, [OTHER], TEST_TRACK, 3.0)
    perform(trained, [*first, *second])
    assert set(current_cells(trained)) == {task.name for task in [*first, *second]}
    begun = current_cells(trained)[f"{OTHER}/{TEST_TRACK}/+3 m"]
    assert begun["drives"][0]["deviation"][0] == pytest.approx(3.0, abs=0.01)
    manifest = Manifest(trained.directory)
    assert all(manifest.is_current(task.section, task.name, task.fingerprint) for task in first)
    Manifest(trained.directory).put("calibration", {"fingerprint": "d", "steering_ratio": 14.0})
    assert current_cells(trained) == {}
    gather_tracks(trained, first)
    assert (trained.results_folder / "track.csv").read_text(encoding="utf-8") == ",".join(TRACK_COLUMNS) + "\n"


def test_a_recording_without_a_long_stretch_is_said(trained: Project) -> None:
    (task,) = plan_tracking(trained, [DRIVER], RECORDING)
    path = trained.dataset_file(DRIVER, "drive 0")
    publish_table(path, read_table(path).slice(0, 30))
    with pytest.raises(InputError) as refused:
        task.run(**task.arguments)
    assert str(refused.value) == (
        f"{trained.directory}: {RECORDING}: no stretch of 60 m without a break, so nothing to drive; choose another "
        "recording"
    )


def test_a_reference_is_what_is_tracked(trained: Project, perform: Perform) -> None:
    """Of a reference 1 m north of a winding drive, the driver's own deviation is the part of it across the path."""
    recording = next(found for found in trained.recordings() if found.key == RECORDING)
    columns = {name: trained.dataset(DRIVER)[name].to_numpy() for name in ("x", "y", "run")}
    folder = trained.directory / "lines"
    folder.mkdir()
    lines = ["x,y", *(f"{x},{y + 1.0}" for x, y in zip(columns["x"], columns["y"], strict=True))]
    (folder / "b.~ drive 0.csv").write_text("\n".join(lines), encoding="utf-8")
    settings = trained.directory / "wheelprint.toml"
    text = settings.read_text(encoding="utf-8")
    settings.write_text(text.replace("[lookahead]", '[lookahead]\nreference = "lines/{driver} {recording}.csv"'))
    again = Project(trained.directory)
    (task,) = plan_tracking(again, [DRIVER], recording.key)
    perform(again, [task])
    row = current_cells(again)[task.name]["rows"][0]
    assert 0.4 < row["tracking_rms"] < 1.0
    (folder / "b.~ drive 0.csv").unlink()
    with pytest.raises(InputError, match="no such file"):
        task.run(**task.arguments)
