"""A seeded part of `benchmarks/event_recovery.py`: simulated emergencies are found, and nothing else."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest


@pytest.fixture(scope="module")
def benchmark() -> ModuleType:
    path = Path(__file__).resolve().parents[2] / "benchmarks" / "event_recovery.py"
    spec = importlib.util.spec_from_file_location("event_recovery", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["event_recovery"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def drivers(benchmark: ModuleType) -> Any:
    return benchmark.drive_campaign(benchmark.campaign_of(5, drivers=2, recordings=1, minutes=15.0))


def test_emergencies_of_simulated_drivers_are_found_and_nothing_else(benchmark: ModuleType, drivers: Any) -> None:
    found = benchmark.score(drivers)
    assert found.emergencies == {"braking": 4, "swerve": 5}
    assert found.recall == 1.0
    assert found.normal_s > 1600
    assert found.false_alarms.total() == 0
    assert found.weakest > 1.1


def test_the_proposed_situations_are_those_of_the_road(benchmark: ModuleType, drivers: Any) -> None:
    for there, seen, proposed, right in benchmark.situations_fit(drivers).values():
        assert there > 5
        assert seen >= 0.9 * there
        assert right >= 0.7 * proposed
