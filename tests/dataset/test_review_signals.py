"""What the review page is told of the car's motion: the samples of a window, extremes of long ones, whole paths."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from wheelprint.dataset.review.signals import LONGEST_OUTLINE, LONGEST_WINDOW, Drive, Drives
from wheelprint.schemas.store import publish_table
from wheelprint.schemas.tables import SYNCED

START = 1_700_000_000_000_000_000
TICK = 100_000_000


def publish(path: Path, rows: int, **columns: Any) -> Path:
    """A synced table at 10 Hz with some columns; the others are null."""
    arrays = {f.name: pa.nulls(rows, f.type) for f in SYNCED}
    arrays["time"] = pa.array(START + TICK * np.arange(rows)).cast(SYNCED.field("time").type)
    for name, values in columns.items():
        arrays[name] = pa.array(np.asarray(values, float), from_pandas=True)
    publish_table(path, pa.table(arrays, schema=SYNCED))
    return path


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "part-0.parquet"


def test_a_window_holds_its_samples_and_what_has_values(path: Path) -> None:
    speed = np.arange(600) / 3
    speed[102:104] = np.nan
    late = np.full(600, np.nan)
    late[300:] = 5.0
    drive = Drive.read(publish(path, 600, nav_speed=speed, brake_pressure=late))
    window = drive.window(START + 100 * TICK, START + 105 * TICK)
    assert window == {"time": [0, 100, 200, 300, 400], "columns": {"nav_speed": [33.333, 33.667, None, None, 34.667]}}
    assert drive.window(START - 3 * TICK, START + 1)["time"] == [300], "before the recording there is nothing"
    assert drive.window(START + 10**15, START + 2 * 10**15) == {"time": [], "columns": {}}


def test_a_long_window_keeps_every_extreme(path: Path) -> None:
    rows = 20_000
    values = np.zeros(rows)
    values[12_345], values[12_400] = 9.0, -7.0
    values[500:520] = np.nan
    drive = Drive.read(publish(path, rows, lateral_acceleration=values, x=np.arange(rows), y=np.arange(rows)))
    window = drive.window(START, START + rows * TICK)
    drawn = window["columns"]["lateral_acceleration"]
    assert len(window["time"]) == len(drawn) <= LONGEST_WINDOW
    places = {value: drawn.index(value) for value in (9.0, -7.0)}
    for value, row in ((9.0, 12_345), (-7.0, 12_400)):
        assert window["time"][places[value]] == pytest.approx(row * 100, abs=100 * rows / LONGEST_WINDOW * 2)
    assert None in drawn, "a gap stays one"
    assert window["columns"]["x"][:3] == [0.0, 7.0, 14.0], "places are those of their times"
    assert window["time"][:3] == [0, 700, 1400]


def test_an_outline_is_short_and_whole(path: Path) -> None:
    rows = 40_000
    drive = Drive.read(publish(path, rows, x=np.arange(rows), y=-np.arange(rows), speed=np.ones(rows)))
    outline = drive.outline()
    assert len(outline["time"]) == len(outline["x"]) <= LONGEST_OUTLINE + LONGEST_OUTLINE // 10
    assert (outline["start"], outline["stop"]) == (START // 10**6, START // 10**6 + (rows - 1) * 100 + 1)
    assert outline["speed"][0] == 1.0
    without = Drive.read(publish(path, 5)).outline()
    assert (without["x"], without["speed"]) == (None, None)


def test_a_table_that_was_written_again_is_read_again(path: Path, tmp_path: Path) -> None:
    drives = Drives(most=2)
    assert drives.get(path) is None
    publish(path, 10)
    first = drives.get(path)
    assert drives.get(path) is first
    publish(path, 20)
    os.utime(path, ns=(1, 1))
    again = drives.get(path)
    assert again is not None
    assert len(again.time) == 20
    for name in "abc":
        drives.get(publish(tmp_path / name, 5))
    assert len(drives.kept) == 2
