"""The whole way on real recordings: rav4 converts, gr86 goes from raw logs to evaluated models."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from typer.testing import CliRunner

from wheelprint import Project
from wheelprint.cli import app
from wheelprint.modeling.cells import MIXTURES


def wheelprint(*arguments: str | Path) -> tuple[int, dict[str, Any]]:
    """Run a command with `--json`; return its exit status and what it said."""
    result = CliRunner().invoke(app, [*map(str, arguments), "--json"], catch_exceptions=False)
    return result.exit_code, json.loads(result.stdout)


def test_rav4_speeds_of_car_and_navigation_agree(shared_data: Path, tmp_path: Path) -> None:
    folder = tmp_path / "raw" / "comma" / "one"
    folder.mkdir(parents=True)
    for name in ("can.log", "nav.ncom"):
        (folder / name).symlink_to(shared_data / "rav4" / name)
    (tmp_path / "wheelprint.toml").write_text(
        f"""[vehicle]
wheelbase = 2.66
[can]
database = ["{shared_data}/rav4/rav4.dbc"]
[can.signals]
steering_wheel_angle = "STEER_ANGLE_SENSOR.STEER_ANGLE"
speed = "SPEED.SPEED"
""",
        encoding="utf-8",
    )
    status, said = wheelprint("convert", "--project", tmp_path)
    assert (status, said["problems"]) == (0, [])
    synced = Project(tmp_path).synced("comma").to_pandas()
    assert 590 <= len(synced) <= 605
    both = synced.dropna(subset=["speed", "nav_speed"])
    assert len(both) >= 590
    assert np.corrcoef(both["speed"], both["nav_speed"])[0, 1] > 0.99
    can, nav = Project(tmp_path).manifest["recordings"]["comma/one"]["inputs"]
    assert (can["accepted"], can["rejected"]) == (135_468, 0)
    assert can["decoded"] + can["unknown"] + can["remote"] + can["errors"] == 135_468
    assert (nav["accepted"], nav["rejected"]) == (1200, 0)


def test_gr86_goes_from_raw_logs_to_results(shared_data: Path, tmp_path: Path) -> None:
    (tmp_path / "raw").symlink_to(shared_data / "gr86" / "raw")
    (tmp_path / "wheelprint.toml").write_text(
        f"""vehicle = {{ wheelbase = 2.575, steering_ratio = 13.5 }}
can.database = ["{shared_data}/gr86/car.dbc"]
[can.signals]
steering_wheel_angle = "WHEEL.WheelAngle"
speed = "MOTION.Speed"
[dataset]
folds = 4
[models]
lookahead = {{ components = [3], starts = 1 }}
motion_primitives = {{ path_types = [1], inputs = ["paper", "curvature"] }}
""",
        encoding="utf-8",
    )
    status, said = wheelprint("run", "--project", tmp_path)
    assert (status, said["problems"]) == (0, [])

    drivers = {"car13", "car55", "car72", "car98"}
    assert {driver for driver, _ in pd.read_csv(tmp_path / "results" / "lookahead.csv").groupby("driver")} == drivers
    results = pd.read_csv(tmp_path / "results" / "motion_primitives.csv")
    assert set(results["driver"]) == drivers
    assert set(results["fold"]) == set(range(4))
    minutes = {driver: entry["driven_s"] / 60 for driver, entry in Project(tmp_path).manifest["dataset"].items()}
    assert sum(value >= 10 for value in minutes.values()) == 2
    error = results.groupby(["driver", "model"])["mean_error"].mean()
    for driver, driven in minutes.items():
        if driven >= 10:
            for mixture in MIXTURES.values():
                assert error[driver, mixture] < 0.5 * error[driver, "persistence"]
                assert error[driver, mixture] <= 1.02 * error[driver, "ridge"]
