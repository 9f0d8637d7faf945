"""Six files of a real logger: as many frames as the files count, and two ways to the car's speed that agree."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from wheelprint.ingest.account import Account
from wheelprint.ingest.can.database import load_database
from wheelprint.ingest.can.decode import decode
from wheelprint.ingest.can.mf4 import Mf4

pytestmark = pytest.mark.skipif(find_spec("asammdf") is None, reason="asammdf is not installed (the extra mf4)")

# The record counters of the CAN_DataFrame groups, read from the files' own ##CG blocks.
COUNTS = {
    "00000001-60FEB68B.MF4": 45_096,
    "00000002-60FEB8E3.MF4": 73_812,
    "00000003-60FEBB3B.MF4": 73_799,
    "00000004-60FEBD93.MF4": 73_818,
    "00000005-60FEBFEB.MF4": 73_844,
    "00000006-60FFE42F.MF4": 7_601,
}


@pytest.fixture(scope="module")
def frames(shared_data: Path) -> dict[str, pa.Table]:
    tables = {}
    for name, count in COUNTS.items():
        account = Account()
        batches = list(Mf4(shared_data / "canedge" / name).batches(account))
        assert account == Account(accepted=count)
        tables[name] = pa.Table.from_batches([batch.to_arrow() for batch in batches])
    return tables


def test_every_frame_arrives_in_the_order_of_time(frames: dict[str, pa.Table]) -> None:
    assert {name: len(table) for name, table in frames.items()} == COUNTS
    last = 0
    for table in frames.values():
        time = table["time"].cast(pa.int64()).to_numpy()
        assert (np.diff(time) >= 0).all()
        assert time[0] > last
        last = time[-1]
        assert set(table["channel"].to_pylist()) == {"1", "2"}


def test_gnss_speed_over_can_agrees_with_that_of_obd(shared_data: Path, frames: dict[str, pa.Table]) -> None:
    folder = shared_data / "canedge"
    table = pa.concat_tables(frames.values())
    obd = decode(table, load_database([str(folder / "OBD-v4.4.dbc")], folder))["OBD_RX"]
    gnss = decode(table, load_database([str(folder / "canmod-gnss.dbc")], folder))["GnssSpeed"]
    measured = gnss.filter(gnss["SpeedValid"].to_numpy() == 1)
    told = obd.filter(obd["S01PID0D_VehicleSpeed"].is_valid())
    speed = told["S01PID0D_VehicleSpeed"].to_numpy().astype(float) / 3.6
    at = told["time"].cast(pa.int64()).to_numpy()
    known = measured["time"].cast(pa.int64()).to_numpy()
    after = np.clip(np.searchsorted(known, at), 1, len(known) - 1)
    near = (np.abs(known[after] - at) < 1e9) & (np.abs(known[after - 1] - at) < 1e9)
    reference = np.interp(at - known[0], known - known[0], measured["Speed"].to_numpy().astype(float))[near]
    speed = speed[near]
    assert len(speed) > 5000
    assert (reference > 1).mean() > 0.9
    assert np.corrcoef(speed, reference)[0, 1] > 0.999
    # OBD tells whole km/h.
    assert np.median(np.abs(speed - reference)) < 0.2
    assert np.polyfit(reference, speed, 1)[0] == pytest.approx(1, abs=0.02)


def test_the_logger_s_clock_is_a_few_seconds_from_that_of_gnss(shared_data: Path, frames: dict[str, pa.Table]) -> None:
    folder = shared_data / "canedge"
    table = pa.concat_tables(frames.values())
    clock = decode(table, load_database([str(folder / "canmod-gnss.dbc")], folder))["GnssTime"]
    clock = clock.filter(clock["TimeConfirmed"].to_numpy() == 1)
    late = clock["time"].cast(pa.int64()).to_numpy() / 1e9 - clock["Epoch"].to_numpy()
    # Its own clock is 5.6 s ahead all the time: the start in the header is UTC, and was added whole.
    assert len(late) > 1500
    assert np.median(late) == pytest.approx(5.57, abs=0.05)
    assert np.ptp(np.percentile(late, [5, 95])) < 0.25
