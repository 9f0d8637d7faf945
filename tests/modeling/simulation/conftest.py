"""One small campaign, simulated once: a drive with everything in it, and one whose sensors make no noise."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from wheelprint.modeling.simulation.campaign import FIRST_START, Campaign, Trip, simulate
from wheelprint.modeling.simulation.driver import Driver
from wheelprint.modeling.simulation.logs import CanClock, Sensors

SILENT = Sensors(
    jitter=0.0,
    error_interval=1e9,
    steering_wheel_angle=0.0,
    speed=0.0,
    yaw_rate=0.0,
    yaw_rate_bias=0.0,
    acceleration=0.0,
    brake_pressure=0.0,
    position=0.0,
    velocity=0.0,
    attitude=0.0,
    nav_yaw_rate=0.0,
    nav_acceleration=0.0,
)


@dataclass(frozen=True)
class Simulated:
    """A recording on disk, its truth as arrays and its entry in `campaign.json`."""

    folder: Path
    campaign: Campaign
    trip: Trip
    truth: dict[str, Any]
    entry: dict[str, Any]

    @property
    def time(self) -> Any:
        """UTC of the truth's rows, int64 ns."""
        return self.truth["time"].astype("datetime64[ns]").astype(np.int64)


def simulated(directory: Path, campaign: Campaign) -> list[Simulated]:
    recordings = simulate(directory, campaign)
    entries = json.loads((directory / "truth" / "campaign.json").read_text(encoding="utf-8"))["recordings"]
    found = []
    for recording, trip in zip(recordings, campaign.trips, strict=True):
        table = pq.read_table(directory / "truth" / trip.driver.name / f"{trip.name}.parquet", partitioning=None)
        truth = {name: table[name].to_numpy() for name in table.column_names}
        found.append(Simulated(recording.folder, campaign, trip, truth, entries[recording.key]))
    return found


@pytest.fixture(scope="session")
def eventful(tmp_path_factory: pytest.TempPathFactory) -> Simulated:
    """Four minutes with both emergencies, gaps in both logs and a clock that is wrong."""
    driver = Driver("王伟", lookahead_base=5.0, lookahead_time=0.6, lookahead_maximum=18.0)
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
    return simulated(tmp_path_factory.mktemp("eventful"), Campaign((trip,), seed=5))[0]


@pytest.fixture(scope="session")
def silent(tmp_path_factory: pytest.TempPathFactory) -> Simulated:
    """Ninety seconds whose logs are exact but for quantisation."""
    trip = Trip(Driver("Anna"), "drive1", FIRST_START, 1.5, CanClock(-2.5, -60.0))
    return simulated(tmp_path_factory.mktemp("silent"), Campaign((trip,), seed=8, sensors=SILENT))[0]
