"""A small part of `benchmarks/clock_recovery.py`, and the signs of simulated signals turned one by one."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from wheelprint.ingest.clock import ClockEstimate
from wheelprint.ingest.signs import reversed_signals
from wheelprint.modeling.simulation.campaign import Campaign, draw_campaign
from wheelprint.modeling.simulation.logs import CanClock
from wheelprint.modeling.simulation.recorded import Recorded, record_trip, synced_table

SIGNED = (
    "steering_wheel_angle", "steering_wheel_speed", "speed", "yaw_rate", "longitudinal_acceleration",
    "lateral_acceleration",
)  # fmt: skip


@pytest.fixture(scope="module")
def benchmark() -> ModuleType:
    place = Path(__file__).parents[2] / "benchmarks" / "clock_recovery.py"
    spec = importlib.util.spec_from_file_location("clock_recovery", place)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["clock_recovery"] = module
    spec.loader.exec_module(module)
    return module


def test_clocks_and_steering_of_simulated_campaigns_come_back(benchmark: ModuleType) -> None:
    outcomes = [
        benchmark.recover(seed, lambda seed: benchmark.draw(seed, (2.0, 6.0), (6.0, 9.0))) for seed in range(100, 102)
    ]
    table, holds = benchmark.summary(outcomes)
    assert holds, table
    ratios = [
        clock.error_ms / clock.found.standard_error_ms
        for outcome in outcomes
        for clock in outcome.clocks["speed and yaw rate"]
    ]
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 2.0
    for outcome in outcomes:
        steering = outcome.steering
        assert abs(steering.ratio) < 4 * steering.ratio_error < 1
        assert abs(steering.offset) < 4 * steering.offset_error < 0.2


def test_the_table_says_where_the_promise_is_broken(benchmark: ModuleType) -> None:
    found = replace(ClockEstimate.fixed(1.0, "estimated"), standard_error_ms=1.0, drift_standard_error_ppm=1.0)
    refused = ClockEstimate.trusted("too little excitation")
    steering = benchmark.Steering(0.5, 0.1, 0.1, 0.1)

    def campaigns(*clocks: object) -> list[object]:
        return [
            benchmark.Outcome(
                seed, {"speed and yaw rate": [clock], "speed": [], "yaw rate": [], "steering": []}, steering
            )
            for seed, clock in enumerate(clocks)
        ]

    good = [benchmark.Clock(40.0, found, 9.0, 1.0, 4.0)] * 19
    assert benchmark.summary(campaigns(*good, benchmark.Clock(2.0, refused, 1e3, 1e3, 90.0)))[1]
    assert not benchmark.summary(campaigns(*good, *[benchmark.Clock(2.0, refused, 1e3, 1e3, 90.0)] * 2))[1]
    assert not benchmark.summary(campaigns(*good, benchmark.Clock(2.0, found, 1.0, -10.2, 1.0)))[1]
    assert not benchmark.summary(campaigns(*good, benchmark.Clock(40.0, found, 1.0, 1.0, 5.5)))[1]
    assert benchmark.summary(campaigns(*good, benchmark.Clock(20.0, found, 1.0, 1.0, 5.5)))[1]


@pytest.fixture(scope="module")
def drive() -> Recorded:
    (trip,) = draw_campaign(11, 1, 1, 4.0, clock_offset=0.0, clock_drift=0.0).trips
    return record_trip(Campaign((replace(trip, clock=CanClock()),), 11), 0)


def judged(drive: Recorded, turned: str) -> dict[str, tuple[str, float]]:
    can = dict(drive.can)
    if turned:
        can[turned] = replace(can[turned], values=-can[turned].values)
    table = synced_table(drive._replace(can=can), ClockEstimate.trusted(""), 10**8, 5 * 10**8)
    names = (*SIGNED, "nav_speed", "nav_yaw_rate")
    return reversed_signals({name: table[name].cast("double").to_numpy() for name in names}, 10.0)


def test_the_signs_of_the_simulator_are_right(drive: Recorded) -> None:
    assert judged(drive, "") == {}


@pytest.mark.parametrize("name", SIGNED)
def test_each_turned_signal_of_a_simulated_drive_is_found_and_no_other(drive: Recorded, name: str) -> None:
    found = judged(drive, name)
    # The steering wheel speed is judged by the steering wheel angle: where the angle is turned, the two disagree.
    alike = {"steering_wheel_angle", "steering_wheel_speed"} if name == "steering_wheel_angle" else {name}
    assert set(found) == alike
    assert all(correlation < -0.7 for _, correlation in found.values())
