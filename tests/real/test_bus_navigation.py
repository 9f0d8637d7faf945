"""A real logger's GNSS over CAN: one MF4 becomes a project whose navigation comes from its bus."""

from __future__ import annotations

import shutil
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from wheelprint.ingest.convert import plan_conversion
from wheelprint.schemas.project import Project

pytestmark = pytest.mark.skipif(find_spec("asammdf") is None, reason="asammdf is not installed (the extra mf4)")

PROJECT = """
[vehicle]
wheelbase = 2.7
[can]
database = [{ file = "OBD-v4.4.dbc", channel = "1" }, { file = "canmod-gnss.dbc", channel = "2" }]
[can.signals]
speed = { signal = "OBD_RX.S01PID0D_VehicleSpeed" }
[nav.can]
unix_time = { signal = "GnssTime.Epoch", valid = "TimeConfirmed" }
latitude = { signal = "GnssPosition.Latitude", valid = "PositionValid" }
longitude = { signal = "GnssPosition.Longitude", valid = "PositionValid" }
position_accuracy = { signal = "GnssPosition.PositionAccuracy", valid = "PositionValid" }
altitude = { signal = "GnssAltitude.Altitude", valid = "AltitudeValid" }
nav_speed = { signal = "GnssSpeed.Speed", valid = "SpeedValid" }
heading_clockwise = { signal = "GnssAttitude.Heading", valid = "AttitudeValid" }
nav_yaw_rate = { signal = "GnssImu.AngularRateZ", valid = "ImuValid" }
[sync]
max_gap = 1.5
"""


def test_gnss_over_can_is_navigation_and_its_speed_that_of_obd(shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "canedge"
    folder = tmp_path / "raw" / "anna" / "monday"
    folder.mkdir(parents=True)
    shutil.copy(source / "00000003-60FEBB3B.MF4", folder)
    for name in ("OBD-v4.4.dbc", "canmod-gnss.dbc"):
        shutil.copy(source / name, tmp_path)
    (tmp_path / "wheelprint.toml").write_text(PROJECT)
    (task,), problems = plan_conversion(Project(tmp_path))
    assert problems == []
    outcome = task.run(**task.arguments)
    assert outcome.problems == ()
    clock = outcome.entry["clock"]
    assert clock["reason"].startswith("the unit's own time in GnssTime.Epoch, told ")
    assert clock["offset_s"] == pytest.approx(5.57, abs=0.05)

    table = pq.read_table(Project(tmp_path).synced_file("anna", "monday"))
    obd, gnss = (table[name].to_numpy(zero_copy_only=False) for name in ("speed", "nav_speed"))
    both = np.isfinite(obd) & np.isfinite(gnss)
    assert both.sum() > 5000
    assert np.corrcoef(obd[both], gnss[both])[0, 1] > 0.998
    assert np.median(np.abs(obd[both] - gnss[both])) < 0.2
    # The path that the positions tell is as long as the speed says.
    x, y = (table[name].to_numpy(zero_copy_only=False) for name in "xy")
    step = np.hypot(np.diff(x), np.diff(y))
    known = np.isfinite(step) & np.isfinite(gnss[1:])
    assert step[known].sum() == pytest.approx(0.1 * gnss[1:][known].sum(), rel=0.01)
    assert table["nav_yaw_rate"].null_count < 0.01 * len(table)
    assert table["heading"].null_count < 0.15 * len(table)
