from __future__ import annotations

import numpy as np
import pytest

from wheelprint.ingest.signs import reversed_signals

RATE = 10.0
RIGHT = {
    "steering_wheel_angle", "steering_wheel_speed", "speed", "yaw_rate", "longitudinal_acceleration",
    "lateral_acceleration",
}  # fmt: skip


def drive(seed: int, seconds: float = 120.0, turning: float = 8.0) -> dict[str, np.ndarray]:
    """A car that turns and changes speed, each of its signals with noise of its own."""
    random = np.random.default_rng(seed)
    time = np.arange(0, seconds, 1 / RATE)
    speed = 12 + 5 * np.sin(time / 9)
    yaw_rate = turning * np.sin(time / 5) + turning / 2 * np.sin(time / 1.7 + 1)
    angle = 15.7 * np.degrees(np.arctan(2.8 * np.radians(yaw_rate) / speed))
    noise = {name: random.normal(size=len(time)) for name in sorted(RIGHT)}
    return {
        "nav_speed": speed,
        "nav_yaw_rate": yaw_rate,
        "steering_wheel_angle": angle + noise["steering_wheel_angle"],
        "steering_wheel_speed": np.gradient(angle) * RATE + noise["steering_wheel_speed"],
        "speed": speed + 0.1 * noise["speed"],
        "yaw_rate": yaw_rate + 0.5 * noise["yaw_rate"],
        "longitudinal_acceleration": np.gradient(speed) * RATE + 0.1 * noise["longitudinal_acceleration"],
        "lateral_acceleration": speed * np.radians(yaw_rate) + 0.2 * noise["lateral_acceleration"],
    }


def test_right_signs_are_left_alone() -> None:
    for seed in range(20):
        assert reversed_signals(drive(seed), RATE) == {}


@pytest.mark.parametrize("name", sorted(RIGHT))
def test_each_wrong_sign_is_found_and_no_other(name: str) -> None:
    signals = drive(1)
    signals[name] = -signals[name]
    found = reversed_signals(signals, RATE)
    # The steering wheel speed is judged by the steering wheel angle: where the angle is turned, the two disagree.
    alike = {"steering_wheel_angle", "steering_wheel_speed"} if name == "steering_wheel_angle" else {name}
    assert set(found) == alike
    assert all(correlation < -0.5 for _, correlation in found.values())


def test_nothing_is_said_without_turning_without_moving_or_of_too_little() -> None:
    straight = drive(2, turning=0.05)
    straight["yaw_rate"] = -straight["yaw_rate"]
    assert reversed_signals(straight, RATE) == {}
    short = drive(2, seconds=15)
    short["speed"] = -short["speed"]
    assert reversed_signals(short, RATE) == {}
    standing = drive(2)
    standing["nav_speed"] = standing["nav_speed"] * 0.1
    standing["yaw_rate"] = -standing["yaw_rate"]
    assert reversed_signals(standing, RATE) == {}


def test_without_navigation_there_is_no_witness() -> None:
    assert reversed_signals({"speed": np.arange(1000.0)}, RATE) == {}


def test_missing_samples_are_passed_over() -> None:
    signals = drive(3)
    signals["yaw_rate"] = -signals["yaw_rate"]
    signals["nav_speed"][::7] = np.nan
    assert set(reversed_signals(signals, RATE)) == {"yaw_rate"}
