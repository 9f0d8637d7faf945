"""Two real KITTI drives."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from wheelprint.ingest.account import Account
from wheelprint.ingest.content import head
from wheelprint.ingest.oxts.kitti import Kitti

DRIVES = [("2011_09_26_drive_0001", 108), ("2011_09_30_drive_0018", 2762)]


@pytest.mark.parametrize(("drive", "frames"), DRIVES)
def test_a_real_drive_is_read_whole_and_its_quantities_agree(shared_data: Path, drive: str, frames: int) -> None:
    folder = shared_data / "kitti" / drive / "oxts"
    path = folder / "timestamps.txt"
    assert Kitti.sniff(head(path))
    assert not Kitti.sniff(head(folder / "dataformat.txt"))
    account = Account()
    table = pa.Table.from_batches(list(Kitti(path).batches(account)))
    assert account == Account(accepted=frames)
    assert len(table) == frames
    assert len(Kitti(path).parts()) == frames + 1

    raw = np.array([np.loadtxt(folder / "data" / f"{number:010d}.txt") for number in range(frames)])
    # Microseconds are what `datetime` keeps of the nine digits.
    stamps = [
        np.datetime64(datetime.fromisoformat(line[:26]), "us") for line in path.read_text(encoding="ascii").splitlines()
    ]
    time = table["time"].cast(pa.int64()).to_numpy()
    assert (time // 1000).tolist() == np.array(stamps).astype(np.int64).tolist()

    column = {name: table[name].to_numpy() for name in table.column_names[1:]}
    assert np.array_equal(column["latitude"], raw[:, 0])
    assert np.array_equal(column["longitude"], raw[:, 1])
    assert np.array_equal(column["position_accuracy"], raw[:, 23])
    # KITTI gives accelerations in the horizontal plane (af, al) too; on these roads they differ little.
    assert np.abs(column["nav_longitudinal_acceleration"] - raw[:, 14]).max() < 0.12
    assert np.abs(column["nav_lateral_acceleration"] - raw[:, 15]).max() < 0.13
    assert np.abs(raw[:, 12] - raw[:, 15]).max() > 0.4
    # What is measured apart tells the same story: the signs.
    seconds = (time - time[0]) / 1e9
    turning = np.gradient(np.unwrap(np.radians(column["heading"])), seconds)
    assert np.corrcoef(turning, column["nav_yaw_rate"])[0, 1] > 0.99
    speeding = np.gradient(column["nav_speed"], seconds)
    assert np.corrcoef(speeding, column["nav_longitudinal_acceleration"])[0, 1] > 0.98
    centripetal = np.radians(column["nav_yaw_rate"]) * column["nav_speed"]
    assert np.corrcoef(centripetal, column["nav_lateral_acceleration"])[0, 1] > 0.85
    moving = np.hypot(np.gradient(column["x"], seconds), np.gradient(column["y"], seconds))
    assert np.median(np.abs(moving - column["nav_speed"])) < 0.1
    way = np.degrees(np.arctan2(np.gradient(column["y"]), np.gradient(column["x"])))
    assert np.nanmedian(np.abs((way - column["course"] + 180) % 360 - 180)) < 0.5
    assert np.nanmedian(np.abs((column["course"] - column["heading"] + 180) % 360 - 180)) < 1
