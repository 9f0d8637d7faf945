"""A small made-up project with everything a report shows: tables, events, manifest, results; names are hostile."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from wheelprint.dataset.card import data_card
from wheelprint.dataset.events import Event, write_events
from wheelprint.schemas.project import Project
from wheelprint.schemas.store import Manifest, describe_output, publish_json, publish_table, read_table
from wheelprint.schemas.tables import (
    CROSS_DRIVER_COLUMNS,
    DATASET,
    LEARNING_CURVE_COLUMNS,
    LOOKAHEAD_COLUMNS,
    MOTION_PRIMITIVE_COLUMNS,
    SYNCED,
)

HOSTILE = '<script>alert("x")<!--'
CHINESE = "王小明"
RECORDINGS = ((HOSTILE, "ring & road"), (CHINESE, "环路 1"), (CHINESE, '2 <b>"quoted"'))
START = 1_700_000_000_000_000_000
TICK = 100_000_000

CONFIG = """
[vehicle]
name = "Test <Tang>"
wheelbase = 2.82
[dataset]
folds = 4
"""


def write_config(directory: Path) -> Project:
    """Write the project file alone."""
    directory.mkdir(parents=True, exist_ok=True)
    (directory / "wheelprint.toml").write_text(CONFIG, encoding="utf-8")
    return Project(directory)


def make_project(directory: Path, minutes: float = 2.0) -> Project:
    """Write a whole project; each recording lasts `minutes`."""
    project = write_config(directory)
    manifest = Manifest(directory)
    events = []
    for number, (driver, recording) in enumerate(RECORDINGS):
        (directory / "raw" / driver / recording).mkdir(parents=True, exist_ok=True)
        start = START + number * 86_400_000_000_000
        rng = np.random.default_rng(number)
        table = drive(start, round(minutes * 600), rng)
        path = project.synced_file(driver, recording)
        publish_table(path, table)
        key = f"{driver}/{recording.replace('/', '_')}"
        manifest.record("recordings", key, _recording_entry(project, path, table, number))
        middle = start + len(table) // 2 * TICK
        decision: Any = ("proposed", "emergency", "normal")[number]
        by = "" if decision == "proposed" else "A. <Reviewer>"
        events.append(Event(key, middle, middle + 30 * TICK, "hard_braking", 1.31, decision, by, "peak -6.5 m/s²"))
        events.append(Event(key, start + 50 * TICK, start + 70 * TICK, "swerve", 1.05, "proposed", "", ""))
        dataset = cut(table, middle, middle + 30 * TICK, rng)
        publish_table(project.dataset_file(driver, recording), dataset)
    for driver in dict.fromkeys(driver for driver, _ in RECORDINGS):
        manifest.record("dataset", driver, _dataset_entry(project, driver))
    write_events(project.events_file, events)
    manifest.content["calibration"] = {
        "steering_ratio": 15.93, "steering_ratio_standard_error": 0.021,
        "steering_offset_deg": -1.42, "steering_offset_deg_standard_error": 0.03,
        "samples": 2300, "estimated": ["steering_ratio"], "reason": "",
    }  # fmt: skip
    publish_json(manifest.path, manifest.content)
    write_results(project)
    return project


def drive(start: int, rows: int, rng: np.random.Generator) -> pa.Table:
    """A drive along a winding road, with a gap of navigation of 2 s; CAN speed is navigation's with noise."""
    t = np.arange(rows) / 10
    speed = 12 + 5 * np.sin(t / 13) + 2 * np.sin(t / 3.1)
    yaw_rate = 12 * np.sin(t / 7) * (np.sin(t / 31) > -0.2)
    course = np.cumsum(yaw_rate) / 10
    columns: dict[str, Any] = {
        "steering_wheel_angle": yaw_rate / speed * 2.82 * 16 + rng.normal(0, 0.5, rows),
        "speed": speed + rng.normal(0, 0.05, rows),
        "longitudinal_acceleration": np.gradient(speed) * 10 + rng.normal(0, 0.1, rows),
        "lateral_acceleration": speed * np.radians(yaw_rate),
        "yaw_rate": yaw_rate,
        "nav_speed": speed,
        "course": (course + 180) % 360 - 180,
        "heading": (course + 180) % 360 - 180,
        "x": np.cumsum(speed * np.cos(np.radians(course))) / 10,
        "y": np.cumsum(speed * np.sin(np.radians(course))) / 10,
        "position_accuracy": np.full(rows, 0.02),
    }
    columns["latitude"] = 39.96 + columns["y"] / 111_000
    columns["longitude"] = 116.31 + columns["x"] / 85_000
    columns["altitude"] = np.full(rows, 50.0)
    gap = slice(rows // 4, rows // 4 + 20)
    for name in ("x", "y", "course", "heading", "nav_speed", "latitude", "longitude", "altitude", "position_accuracy"):
        columns[name][gap] = np.nan
    run = np.where(np.arange(rows) < gap.start, 0, 1)
    in_gap = np.zeros(rows, bool)
    in_gap[gap] = True
    time = start + np.arange(rows) * TICK
    arrays = {
        f.name: pa.array(columns[f.name], f.type, from_pandas=True) if f.name in columns else pa.nulls(rows, f.type)
        for f in SYNCED
    }
    arrays["time"] = pa.array(time).cast(SYNCED.field("time").type)
    arrays["run"] = pa.array(run, pa.int32(), mask=in_gap)
    return pa.table(arrays, schema=SYNCED)


def cut(table: pa.Table, start: int, stop: int, rng: np.random.Generator) -> pa.Table:
    """The dataset of a drive: without its gap and its event, with lookahead distances, segments and folds."""
    time = table["time"].cast(pa.int64()).to_numpy()
    kept = table["run"].is_valid().to_numpy() & ~((time >= start) & (time < stop))
    run = table["run"].to_numpy(zero_copy_only=False)[kept] + (time[kept] >= stop)
    rows = int(kept.sum())
    taken = {name: table[name].to_numpy(zero_copy_only=False)[kept] for name in DATASET.names if name in SYNCED.names}
    speed = table["nav_speed"].to_numpy()[kept]
    turn = table["yaw_rate"].to_numpy()[kept] / 10
    label = np.where(np.abs(turn) > 0.6, 1, np.where(np.abs(turn) > 0.2, 2, 3))
    lookahead = 4 + 1.1 * speed + rng.normal(0, 1.5, rows)
    lookahead[np.abs(turn) < 0.05] = np.nan
    segment = np.cumsum(np.diff(label, prepend=label[0]) != 0)
    columns = taken | {
        "run": run,
        "course_deviation": turn,
        "speed": speed,
        "road_wheel_angle": taken["steering_wheel_angle"] / 16,
        "lookahead": lookahead,
        "lookahead_spread": np.full(rows, 2.0),
        "segment": segment,
        "path_side": np.where(turn > 0.05, "left", np.where(turn < -0.05, "right", "neutral")),
        "path_label": label,
        "path_type": np.full(rows, "1-1-1"),
        "situation": np.full(rows, "lane change"),
        "fold": np.arange(rows) // 100 % 4,
    }
    arrays = [
        pa.array(columns[f.name], from_pandas=True).cast(f.type, safe=False)
        if f.name != "time"
        else pa.array(time[kept]).cast(f.type)
        for f in DATASET
    ]
    return pa.Table.from_arrays(arrays, schema=DATASET)


def _recording_entry(project: Project, path: Path, table: pa.Table, number: int) -> dict[str, Any]:
    rejections = [{"where": "line 17", "reason": "expected 8 bytes <found> 7"}] if number == 1 else []
    quiet = {
        "backwards": {"count": 0, "worst_s": 0.0, "at": None},
        "repeated": {"count": 12, "most_on_one_stamp": 2, "at": "2023-11-14T22:13:20.000Z"},
        "gaps": {"count": 0, "longest_s": 0.0, "at": None},
    }
    jump = {"backwards": {"count": 1, "worst_s": 0.7, "at": "2023-11-14T22:13:50.000Z"}}
    camera = {
        "path": "<front>", "sha256": f"{number}c" * 32, "bytes": 9_000_000, "format": "camera", "kind": "camera",
        "accepted": 1200, "rejected": 0, "truncated": False, "rejections": [], "start": "2023-11-14T22:13:20.000Z",
        "stop": "2023-11-14T22:15:20.000Z", "stamps": quiet,
        "cameras": {"<front>": {"count": 1200, "rate_hz": 10.0, "gaps": 1, "longest_interval_s": 1.1}},
        "clock": {"relation": "trusted", "compared_with": "nav", "common_s": 119.9 if number else 0.0},
    }  # fmt: skip
    inputs = [
        {"path": "can.log", "sha256": f"{number}a" * 32, "bytes": 4_000_000, "format": "candump", "kind": "can",
         "accepted": 120_000 + number, "rejected": len(rejections), "truncated": number == 2, "rejections": rejections,
         "start": "2023-11-14T22:13:20.000Z", "stop": "2023-11-14T22:15:20.000Z", "stamps": quiet | jump,
         "decoded": 100_000, "unknown": 20_000 + number, "unknown_ids": {"0x123": 20_000 + number}, "remote": 0,
         "errors": 0},
        {"path": "nav.ncom", "sha256": f"{number}b" * 32, "bytes": 900_000, "format": "ncom", "kind": "nav",
         "accepted": 12_000, "rejected": 0, "truncated": False, "rejections": [],
         "start": "2023-11-14T22:13:20.000Z", "stop": "2023-11-14T22:15:20.000Z", "stamps": quiet},
        camera,
    ]  # fmt: skip
    clock = {
        "offset_s": 0.8215 - 0.4 * number, "drift_ppm": 12.5, "residual_ms": 1.8, "standard_error_ms": 0.6,
        "correlation": 0.998, "applied": number != 2,
        "reason": "" if number != 2 else "correlation 0.31 is below 0.9",
    }  # fmt: skip
    signals = {
        "speed": {"canonical": "speed", "message": "MOTION", "signal": "Speed", "unit": "km/h", "factor": 1 / 3.6,
                  "channel": "can0", "samples": 6000, "out_of_range": 3},
    }  # fmt: skip
    runs = table["run"].drop_null()
    facts = {"rows": len(table), "runs": len(runs.unique()), "rows_in_runs": len(runs)}
    problem = {"path": "raw/…/can.log", "where": "line 17", "reason": "1 of 120002 records rejected: <8 bytes>"}
    return {
        "fingerprint": "x", "inputs": inputs, "clock": clock, "signals": signals, "ignored": [],
        "database_repairs": ["car <1>.dbc: line 17: signals A and B overlap; both are kept"],
        "origin": {"latitude": 39.96, "longitude": 116.31, "altitude": 50.0},
        "outputs": [describe_output(project.directory, path, **facts)],
        "problems": [problem] if number == 1 else [],
    }  # fmt: skip


def _dataset_entry(project: Project, driver: str) -> dict[str, Any]:
    outputs = [
        describe_output(project.directory, project.dataset_file(driver, name), rows=1100, recording=name)
        for whose, name in RECORDINGS
        if whose == driver
    ]
    clusters = [
        {"label": 1, "share": 0.31, "duration_s": 8.29, "average_course_deviation_deg": 0.15,
         "maximum_course_deviation_deg": 0.45, "average_speed_m_s": 9.29},
        {"label": 2, "share": 0.42, "duration_s": 0.24, "average_course_deviation_deg": 0.008,
         "maximum_course_deviation_deg": 0.01, "average_speed_m_s": 13.975},
    ]  # fmt: skip
    tables = {output["recording"]: read_table(project.directory / output["path"]) for output in outputs}
    distances = dict.fromkeys(tables, 1360.0 / len(tables))
    excluded, undecided = {"hard_braking": 30, "swerve": 20, "gap": 20}, {"swerve": 20}
    card = project.data_card_file(driver)
    publish_json(card, data_card(driver, tables, distances, excluded, undecided, clusters, {}, project.config))
    return {
        "fingerprint": "x", "outputs": outputs, "documents": [describe_output(project.directory, card)],
        "clusters": clusters, "segments": 74,
        "bic": [{"clusters": k, "bic": 900.0 - 150 * k + 30 * k * k} for k in range(1, 7)],
        "driven_s": 113.0, "distance_m": 1360.0,
        "excluded": {"hard_braking": 3.0, "swerve": 2.0, "gap": 2.0}, "undecided": {"swerve": 2.0},
        "situations": {"lane change": 8.0}, "problems": [],
    }  # fmt: skip


def write_results(project: Project) -> None:
    """Write both tables of the evaluation: four folds, models and baselines."""
    rng = np.random.default_rng(7)
    lookahead: list[list[Any]] = []
    primitives: list[list[Any]] = []
    for driver in (HOSTILE, CHINESE):
        for fold in range(4):
            for split, extra in (("train", 0.0), ("test", 0.15)):
                for name, level in (("persistence", 0.9), ("ridge", 2.2)):
                    lookahead.append([driver, name, "", "", fold, split, level + extra + rng.normal(0, 0.05), 4.1, 500])
                for components in (3, 6, 12):
                    error = 2.0 - 0.04 * components + extra
                    row = [fold, split, error + rng.normal(0, 0.05), 3.9 - 0.05 * components, 500]
                    lookahead.append([driver, "general", components, "", *row])
                    row = [fold, split, 0.9 * error + rng.normal(0, 0.05), 3.7 - 0.05 * components, 500]
                    lookahead.append([driver, "velocity", components, 3, *row])
            for name, level in (("persistence", 10.6), ("ridge", 1.96)):
                primitives.append(
                    [driver, name, 1, 1, 50, "", fold, level + rng.normal(0, 0.1), 9.0, 0.66, 0.94, 1.4, 400]
                )
            for path_types, level in ((1, 2.12), (3, 1.91), (27, 1.87)):
                row = [fold, level + rng.normal(0, 0.06), 7.4, 0.67, 0.95, 1.4, 400]
                primitives.append([driver, "mixture", path_types, 1, 50, 3, *row])
    curve: list[list[Any]] = []
    crossed: list[list[Any]] = []
    for fold in range(4):
        for driver, other in ((HOSTILE, CHINESE), (CHINESE, HOSTILE)):
            curve.append([driver, "steering", "population", 0, fold, 1.0 + 0.1 * fold, -1.0, 400])
            curve += [[driver, "steering", "own", m, fold, 3.0 / m + 0.1 * fold, -2.0, 400] for m in (1, 2, 5)]
            curve += [[driver, "steering", "adapted", m, fold, 0.9 / m + 0.1 * fold, 0.0, 400] for m in (1, 2, 5)]
            crossed.append(["steering", "adapted", driver, driver, fold, 0.5 + 0.1 * fold, 1.25, 400])
            crossed.append(["steering", "adapted", other, driver, fold, 1.5 + 0.1 * fold, -3.5, 400])
    project.results_folder.mkdir(exist_ok=True)
    rate = {"model": "adapted", "density": "conditional", "evidence": "both", "minutes": 20, "right": 18, "rate": 0.9}
    confusion = {HOSTILE: {HOSTILE: 10}, CHINESE: {CHINESE: 8, HOSTILE: 2}}
    publish_json(
        project.results_folder / "identification.json",
        [{**rate, "low": 0.699, "high": 0.972, "confusion": confusion}],
    )
    for name, columns, rows in (
        ("learning_curve.csv", LEARNING_CURVE_COLUMNS, curve),
        ("cross_driver.csv", CROSS_DRIVER_COLUMNS, crossed),
        ("lookahead.csv", LOOKAHEAD_COLUMNS, lookahead),
        ("motion_primitives.csv", MOTION_PRIMITIVE_COLUMNS, primitives),
    ):
        with (project.results_folder / name).open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            writer.writerows(rows)


@pytest.fixture(scope="session")
def project(tmp_path_factory: pytest.TempPathFactory) -> Project:
    """The whole project; tests only read it and write beside it."""
    return make_project(tmp_path_factory.mktemp("synthetic"))


@pytest.fixture
def bare_project(tmp_path: Path) -> Project:
    """A project file and nothing else."""
    return write_config(tmp_path)
