"""Human driving in town: what the car's own sensors say of one another."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import wheelprint
from wheelprint.ingest.resample import grid, resample

PERIOD = 100_000_000


def test_steering_goes_against_yaw_rate_over_speed_before_signs_are_turned(shared_data: Path) -> None:
    frames = wheelprint.read_frames(shared_data / "giulia" / "exp2.log.gz")
    assert (len(frames), frames.schema.metadata[b"rejected"]) == (364_863, b"0")
    decoded = wheelprint.decode(frames, str(shared_data / "giulia" / "giulia.dbc"))
    start, stop = (value.value for value in (frames["time"][0], frames["time"][-1]))
    at = grid(start, stop, PERIOD)

    def on_grid(message: str, signal: str) -> np.ndarray:
        table = decoded[message]
        return resample(
            table["time"].cast("int64").to_numpy(), table[signal].to_numpy(), at, "mean", PERIOD * 5, PERIOD
        )

    steering = on_grid("EPS_1", "STEERING_ANGLE")
    yaw_rate = on_grid("ABS_2", "YAW_RATE")
    speed = np.mean([on_grid("ABS_1", f"WHEEL_SPEED_{wheel}") for wheel in ("FL", "FR", "RL", "RR")], axis=0)
    driving = np.isfinite(steering) & np.isfinite(yaw_rate) & (speed > 3)
    assert np.count_nonzero(driving) > 500
    assert np.corrcoef(steering[driving], (yaw_rate / speed)[driving])[0, 1] < -0.99
