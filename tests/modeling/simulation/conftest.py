"""Small campaigns, simulated once: a drive with everything in it, and one whose sensors make no noise."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest

from wheelprint.modeling.simulation.campaign import FIRST_START, Campaign, Trip, simulate
from wheelprint.modeling.simulation.driver import Driver
from wheelprint.modeling.simulation.logs import CanClock, Sensors


def simulated(directory: Path, campaign: Campaign) -> SimpleNamespace:
    """Simulate a campaign of one trip: its folder, `truth` as arrays, `time` in ns and entry in `campaign.json`."""
    (recording,) = simulate(directory, campaign)
    (trip,) = campaign.trips
    table = pq.read_table(directory / "truth" / trip.driver.name / f"{trip.name}.parquet", partitioning=None)
    content = json.loads((directory / "truth" / "campaign.json").read_text(encoding="utf-8"))
    return SimpleNamespace(
        directory=directory,
        folder=recording.folder,
        campaign=campaign,
        trip=trip,
        table=table,
        truth={name: table[name].to_numpy() for name in table.column_names},
        time=table["time"].to_numpy().astype("datetime64[ns]").astype(np.int64),
        content=content,
        entry=content["recordings"][recording.key],
    )


@pytest.fixture(scope="session")
def eventful(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """Four minutes with both emergencies, gaps in both logs and a clock that is wrong."""
    driver = Driver("王伟", lookahead_base=5.0, lookahead_time=0.6, lookahead_maximum=16.0)
    trip = Trip(
        driver,
        "drive one",
        FIRST_START,
        4.0,
        CanClock(1.25, 40.0),
        ("swerve", "braking"),
        can_gaps=((60.0, 1.5),),
        nav_gaps=((90.0, 2.0),),
    )
    return simulated(tmp_path_factory.mktemp("eventful"), Campaign((trip,), seed=5))


@pytest.fixture(scope="session")
def silent(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """Two minutes whose logs are exact but for quantisation."""
    sensors = Sensors(**{f.name: 0.0 for f in fields(Sensors)} | {"error_interval": 1e9})
    trip = Trip(Driver("Anna"), "drive1", FIRST_START, 2.0, CanClock(-2.5, -60.0))
    return simulated(tmp_path_factory.mktemp("silent"), Campaign((trip,), seed=4, sensors=sensors))
