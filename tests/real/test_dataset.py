"""The dataset stage on real drives: town driving is left alone, racing is not cut to pieces."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray

from wheelprint.dataset.detectors import propose_events
from wheelprint.dataset.drive import derive
from wheelprint.dataset.events import covered
from wheelprint.dataset.steering import Steering
from wheelprint.ingest.convert import plan_conversion
from wheelprint.schemas.project import Project
from wheelprint.schemas.store import read_table

GIULIA = """
[vehicle]
wheelbase = 2.82
[can]
database = ["giulia.dbc"]
[can.signals]
steering_wheel_angle = "EPS_1.STEERING_ANGLE"
steering_wheel_speed = "EPS_1.STEERING_RATE"
speed = "ABS_1.WHEEL_SPEED_RL"
"""
GR86 = """
[vehicle]
wheelbase = 2.575
steering_ratio = 13.5
steering_offset = 0.0
[can]
database = ["car.dbc"]
[can.signals]
steering_wheel_angle = "WHEEL.WheelAngle"
steering_wheel_speed = "WHEEL.WheelRate"
speed = "MOTION.Speed"
longitudinal_acceleration = "MOTION.Ax"
brake_pressure = "PEDALS.BrakeP"
"""


def converted(folder: Path, config: str) -> tuple[Project, dict[str, pa.Table]]:
    """Convert the project in the folder and return its synced tables by `driver/recording`."""
    (folder / "wheelprint.toml").write_text(config, encoding="utf-8")
    project = Project(folder)
    for task in plan_conversion(project)[0]:
        task.run(**task.arguments)
    return project, {r.key: read_table(project.synced_file(r.driver, r.name)) for r in project.recordings()}


def times(table: pa.Table) -> NDArray[np.int64]:
    time: NDArray[np.int64] = table["time"].cast(pa.int64()).to_numpy()
    return time


def test_a_drive_in_town_is_left_alone_but_for_its_stops_and_one_emergency(shared_data: Path, tmp_path: Path) -> None:
    recording = tmp_path / "raw" / "alfa" / "town"
    recording.mkdir(parents=True)
    (recording / "can.log").write_bytes(gzip.decompress((shared_data / "giulia" / "exp2.log.gz").read_bytes()))
    (tmp_path / "giulia.dbc").symlink_to(shared_data / "giulia" / "giulia.dbc")
    project, tables = converted(tmp_path, GIULIA)
    events = propose_events(tables, project.config.events, project.config.sync.period)
    kinds = [event.kind for event in events]
    assert kinds == ["standstill", "standstill", "hard_acceleration", "hard_braking"]
    table = tables["alfa/town"]
    # All four wheels slow down from 14.4 to 6.5 m/s within a second, at a brake pressure of 100 bar.
    braking = events[-1]
    assert (braking.start - times(table)[0]) / 1e9 == pytest.approx(123.2, abs=0.5)
    assert braking.severity == pytest.approx(1.9, abs=0.2)
    assert events[-2].severity < 1.1
    inside = covered(times(table), events[:2])
    speed = table["speed"].to_numpy()
    assert (speed[inside] < 1).all()
    assert 10 < np.count_nonzero(inside) / 10 < 20


@pytest.fixture(scope="module")
def racing(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Project, dict[str, pa.Table]]:
    folder = tmp_path_factory.mktemp("racing")
    for name in ("indianapolis_01", "indianapolis_03", "indianapolis_06"):
        (folder / "raw" / "car55").mkdir(parents=True, exist_ok=True)
        (folder / "raw" / "car55" / name).symlink_to(shared_data / "gr86" / "raw" / "car55" / name)
    (folder / "car.dbc").symlink_to(shared_data / "gr86" / "car.dbc")
    return converted(folder, GR86)


def test_racing_is_not_cut_to_pieces(racing: tuple[Project, dict[str, pa.Table]]) -> None:
    project, tables = racing
    events = propose_events(tables, project.config.events, project.config.sync.period)
    absent = sum(
        np.count_nonzero(covered(times(t), [e for e in events if e.recording == k])) for k, t in tables.items()
    )
    samples = sum(map(len, tables.values()))
    lateral = np.concatenate([t["nav_lateral_acceleration"].to_numpy() for t in tables.values()])
    assert np.mean(np.abs(lateral) > project.config.events.hard_cornering.at_least) > 0.1
    assert 0 < absent / samples < 0.1


def test_the_path_of_a_race_is_consistent(racing: tuple[Project, dict[str, pa.Table]]) -> None:
    project, tables = racing
    drive = derive(tables["car55/indianapolis_06"], [], Steering(13.5, 0.0), project.config)
    x, y, course, speed = (drive.columns[name] for name in ("x", "y", "course", "speed"))
    moving = (np.diff(drive.run) == 0) & (speed[1:] > 10)
    direction = np.degrees(np.arctan2(np.diff(y), np.diff(x)))
    halfway = course[:-1] + drive.columns["course_deviation"][1:] / 2
    assert np.quantile(np.abs((direction - halfway + 180) % 360 - 180)[moving], 0.99) < 1.0
    step = 0.05 * (speed[1:] + speed[:-1])
    # the recording's own position and speed agree to a few per cent
    assert np.quantile(np.abs(np.hypot(np.diff(x), np.diff(y)) / step - 1)[moving], 0.99) < 0.15
    turning = drive.columns["course_deviation"][1:][moving] / speed[1:][moving]
    assert np.corrcoef(turning, drive.columns["road_wheel_angle"][1:][moving])[0, 1] > 0.9
    known = np.isfinite(drive.columns["lookahead"])
    assert known.mean() > 0.98
    assert np.all(drive.columns["lookahead"][known] >= 2)
    assert np.all(drive.columns["lookahead"][known] <= 100)
    assert sum(drive.excluded.values()) + len(drive.time) == len(tables["car55/indianapolis_06"])
