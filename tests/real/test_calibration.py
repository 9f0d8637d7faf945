"""Clock and steering of real cars: what is known of them from elsewhere comes out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pytest

from wheelprint import decode, read_frames, read_nav
from wheelprint.dataset.calibration import SteeringCalibration, estimate_steering
from wheelprint.ingest.clock import ClockEstimate, Series, estimate_clock
from wheelprint.ingest.resample import grid, resample

PERIOD = 100_000_000
MAX_GAP = 500_000_000
KMH = 1 / 3.6


def series(table: pa.Table, *names: str) -> Series:
    """Stamps and the mean of some columns."""
    time = table["time"].cast(pa.int64()).to_numpy()
    return time, np.mean([table[name].cast(pa.float64()).to_numpy() for name in names], axis=0)


def on_grid(signals: dict[str, Series]) -> dict[str, npt.NDArray[np.float64]]:
    start = max(int(time[0]) for time, _ in signals.values())
    stop = min(int(time[-1]) for time, _ in signals.values())
    at = grid(start, stop + 1, PERIOD)
    return {
        name: resample(time, values, at, "linear" if name == "wheel" else "mean", MAX_GAP, PERIOD)
        for name, (time, values) in signals.items()
    }


@pytest.fixture(scope="module")
def rav4(shared_data: Path) -> dict[str, Series]:
    messages = decode(read_frames(shared_data / "rav4" / "can.log"), shared_data / "rav4" / "rav4.dbc")
    wheels = messages["WHEEL_SPEEDS"]
    wheels = wheels.filter(pa.compute.equal(wheels["channel"], wheels["channel"][0]))
    time, front = series(wheels, "WHEEL_SPEED_FL", "WHEEL_SPEED_FR")
    _, rear = series(wheels, "WHEEL_SPEED_RL", "WHEEL_SPEED_RR")
    return {
        "front": (time, front * KMH),
        "rear": (time, rear * KMH),
        "nav": series(read_nav(shared_data / "rav4" / "nav.ncom"), "nav_speed"),
    }


def rav4_clock(rav4: dict[str, Series], wheels: str, shift: int = 0) -> ClockEstimate:
    time, speed = rav4[wheels]
    return estimate_clock(time + shift, speed, *rav4["nav"])


def test_the_clock_of_one_minute_is_found_from_free_rolling_wheels(rav4: dict[str, Series]) -> None:
    """The rear wheels of this car are not driven; its log and its navigation run on nearly the same clock."""
    found = rav4_clock(rav4, "rear")
    assert found.applied, found.reason
    assert abs(found.offset_s) < 0.05
    assert found.correlation is not None
    assert found.correlation > 0.999


def test_driven_wheels_lead_by_their_slip(rav4: dict[str, Series]) -> None:
    """Why the standard error is no bound for the truth: slip grows with acceleration, as a shift in time does."""
    assert -0.09 < rav4_clock(rav4, "front").offset_s - rav4_clock(rav4, "rear").offset_s < -0.02


@pytest.mark.parametrize("seconds", [-1.7, 0.777, 3.3, 7200.0])
def test_a_known_shift_of_the_stamps_comes_out(rav4: dict[str, Series], seconds: float) -> None:
    shifted = rav4_clock(rav4, "rear", round(seconds * 1e9))
    assert shifted.offset_s - rav4_clock(rav4, "rear").offset_s == pytest.approx(seconds, abs=0.005)


def steering_of_giulia(shared_data: Path, sign: int) -> SteeringCalibration:
    messages = decode(read_frames(shared_data / "giulia" / "exp2.log.gz"), shared_data / "giulia" / "giulia.dbc")
    signals = on_grid(
        {
            "wheel": series(messages["EPS_1"], "STEERING_ANGLE"),
            "yaw": series(messages["ABS_2"], "YAW_RATE"),
            "speed": series(messages["ABS_1"], "WHEEL_SPEED_RL", "WHEEL_SPEED_RR"),
        }
    )
    return estimate_steering(sign * signals["wheel"], -np.degrees(signals["yaw"]), signals["speed"], 2.82)


def test_steering_of_a_car_in_town(shared_data: Path) -> None:
    found = steering_of_giulia(shared_data, 1)
    assert found.reason == ""
    assert found.ratio == pytest.approx(13, abs=1)
    assert found.offset == pytest.approx(1, abs=1)
    assert found.understeer == pytest.approx(0.15, abs=0.1)
    assert "sign = -1" in steering_of_giulia(shared_data, -1).reason


def test_racing_tells_the_offset_but_not_the_ratio(shared_data: Path) -> None:
    """At racing speed less than 4 m/s² to the side means straight ahead, and the offset is not that of the car."""
    offsets = {}
    for name in ("car13/barber_01", "car55/indianapolis_03", "car55/indianapolis_06"):
        messages = decode(
            read_frames(shared_data / "gr86" / "raw" / name / "can.log"), shared_data / "gr86" / "car.dbc"
        )
        signals = on_grid(
            {
                "wheel": series(messages["WHEEL"], "WheelAngle"),
                "yaw": series(messages["MOTION"], "Yaw"),
                "speed": series(messages["MOTION"], "Speed"),
            }
        )
        wheel, yaw, speed = signals["wheel"], signals["yaw"], signals["speed"] * KMH
        there = np.isfinite(wheel + yaw + speed)
        assert np.corrcoef(wheel[there], (yaw / speed)[there])[0, 1] > 0.8
        unknown = estimate_steering(wheel, yaw, speed, 2.575)
        assert unknown.ratio is None
        assert unknown.reason.startswith("the ratio cannot be told: ")
        hard = estimate_steering(wheel, yaw, speed, 2.575, maximum_lateral_acceleration=20)
        assert hard.ratio == pytest.approx(13.5, abs=1.5)
        offsets[name] = estimate_steering(wheel, yaw, speed, 2.575, ratio=13.5).offset
    assert offsets == {
        "car13/barber_01": pytest.approx(4.1, abs=0.5),
        "car55/indianapolis_03": pytest.approx(1.0, abs=1),
        "car55/indianapolis_06": pytest.approx(11.9, abs=1),
    }
