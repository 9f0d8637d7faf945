"""The path from the bus: against an independent integration, and against the truth of simulated drives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp

from wheelprint.ingest.dead_reckoning import DeadReckoning, at_standstill, dead_reckon, integrate_path
from wheelprint.ingest.stored_signals import SampledSignal
from wheelprint.modeling.simulation.campaign import Campaign, draw_campaign
from wheelprint.modeling.simulation.logs import CanClock
from wheelprint.modeling.simulation.recorded import Recorded, record_trip

SECOND = 10**9
EPOCH = 1_700_000_000 * SECOND
PERIOD, MAX_GAP = SECOND // 10, SECOND // 2


def bus(speed: npt.NDArray[np.float64], yaw_rate: npt.NDArray[np.float64], rate: int = 50) -> dict[str, SampledSignal]:
    time = EPOCH + np.arange(len(speed), dtype=np.int64) * (SECOND // rate)
    return {"speed": SampledSignal(time, speed), "yaw_rate": SampledSignal(time, yaw_rate)}


def reckon(can: dict[str, SampledSignal]) -> DeadReckoning:
    found = dead_reckon(can, PERIOD, MAX_GAP)
    assert found is not None
    return found


def test_the_path_is_that_of_an_independent_integration() -> None:
    """Smooth driving, integrated by an adaptive Runge-Kutta of the continuous functions."""

    def speed(t: npt.ArrayLike) -> npt.NDArray[np.float64]:
        return np.asarray(12 + 5 * np.sin(np.asarray(t) / 9))

    def yaw_rate(t: npt.ArrayLike) -> npt.NDArray[np.float64]:
        return np.asarray(8 * np.sin(np.asarray(t) / 5) + 3)

    time = np.arange(0, 120.01, 0.02)
    found = reckon(bus(speed(time), yaw_rate(time)))
    at = (found.signals["x"].time - EPOCH) / SECOND

    def motion(t: float, state: npt.NDArray[np.float64]) -> list[float]:
        return [float(np.radians(yaw_rate(t))), *(float(speed(t)) * part(state[0]) for part in (np.cos, np.sin))]

    known = np.isfinite(found.signals["x"].values)
    begin = float(at[known][0])
    truth = solve_ivp(motion, (begin, 120), [0, 0, 0], t_eval=at[known], rtol=1e-10, atol=1e-10).y
    np.testing.assert_allclose(found.signals["x"].values[known], truth[1], atol=0.05)
    np.testing.assert_allclose(found.signals["y"].values[known], truth[2], atol=0.05)
    turned = (found.signals["course"].values[known] - np.degrees(truth[0]) + 180) % 360 - 180
    np.testing.assert_allclose(turned, 0, atol=0.02)
    assert np.count_nonzero(known) > 1190


def test_the_trapezoidal_rule_is_a_plain_loop_and_begins_anew_in_every_run() -> None:
    random = np.random.default_rng(0)
    run = np.repeat([-1, 0, -1, 1, 2, -1], [3, 20, 4, 1, 30, 2])
    speed, yaw_rate = random.uniform(0, 20, len(run)), random.normal(0, 20, len(run))
    speed[run < 0] = np.nan
    heading, x, y = integrate_path(speed, yaw_rate, run, 0.1)
    expected = np.full((3, len(run)), np.nan)
    for k, number in enumerate(run.tolist()):
        if number < 0:
            continue
        if k == 0 or run[k - 1] != number:
            expected[:, k] = 0.0
            continue
        before = expected[:, k - 1]
        turned = before[0] + 0.1 * (yaw_rate[k - 1] + yaw_rate[k]) / 2
        expected[0, k] = turned
        for row, part in ((1, np.cos), (2, np.sin)):
            ends = [v * part(np.radians(h)) for v, h in ((speed[k - 1], before[0]), (speed[k], turned))]
            expected[row, k] = before[row] + 0.1 * sum(ends) / 2
    np.testing.assert_allclose([heading, x, y], expected, rtol=0, atol=1e-9)


def test_left_turns_are_positive_and_a_circle_closes() -> None:
    seconds = 360 / 9.0
    time = np.arange(0, seconds + 1.001, 0.02)
    found = reckon(bus(np.full(len(time), 10.0), np.full(len(time), 9.0)))
    x, y, course = (found.signals[name].values for name in ("x", "y", "course"))
    first = int(np.flatnonzero(np.isfinite(x))[0])
    radius = 10 / np.radians(9)
    assert course[first + 100] == pytest.approx(90)
    assert y[first + 100] == pytest.approx(radius, abs=0.01)
    assert (x[first + 400], y[first + 400]) == pytest.approx((0, 0), abs=0.01)
    assert found.facts["distance_m"] == pytest.approx(10 * (len(x[np.isfinite(x)]) / 10))


def test_a_gap_ends_a_run_and_nothing_reaches_across() -> None:
    can = bus(np.full(3000, 10.0), np.zeros(3000))
    kept = (np.arange(3000) < 1000) | (np.arange(3000) >= 1200)
    can["speed"] = replace(can["speed"], time=can["speed"].time[kept], values=can["speed"].values[kept])
    found = reckon(can)
    x = found.signals["x"].values
    assert found.facts["runs"] == 2
    assert np.isnan(x[205:235]).all()
    assert x[np.isfinite(x)].max() < 370


def test_the_bias_comes_from_standstill_without_its_ends() -> None:
    speed = np.concatenate((np.zeros(80), np.full(200, 10.0), np.zeros(60), np.full(100, 5.0)))
    yaw_rate = np.full(len(speed), 0.3)
    yaw_rate[280:285] = yaw_rate[335:345] = 40
    assert at_standstill(speed, yaw_rate, PERIOD) == pytest.approx((0.3, 0.02, 0.0, (75 + 50) / 10))
    never = at_standstill(speed + 5, yaw_rate, PERIOD)
    assert (never.bias, never.bias_error, never.seconds) == (0.0, 0.3, 0.0)


def test_a_bias_that_wanders_between_standstills_is_told_from_noise() -> None:
    random = np.random.default_rng(0)
    speed = np.tile(np.repeat([0.0, 10.0], 100), 40)
    noise = random.normal(0, 0.05, len(speed))
    wander = np.repeat(random.normal(0.1, 0.1, 40), 200)
    still = at_standstill(speed, 0.1 + noise, PERIOD)
    moved = at_standstill(speed, wander + noise, PERIOD)
    assert still.bias == pytest.approx(0.1, abs=0.005)
    assert still.bias_error < 0.005
    assert moved.bias_error == pytest.approx(0.1, rel=0.3)
    for found in (still, moved):
        assert found.noise == pytest.approx(0.05 * np.sqrt(0.1), rel=0.05)


def test_without_both_signals_at_once_there_is_no_path() -> None:
    can = bus(np.full(100, 10.0), np.zeros(100))
    assert dead_reckon({"speed": can["speed"]}, PERIOD, MAX_GAP) is None
    assert dead_reckon({"yaw_rate": can["yaw_rate"]}, PERIOD, MAX_GAP) is None
    later = replace(can["yaw_rate"], time=can["yaw_rate"].time + 3600 * SECOND)
    assert dead_reckon(can | {"yaw_rate": later}, PERIOD, MAX_GAP) is None
    nothing = SampledSignal(np.array([], np.int64), np.array([]))
    assert dead_reckon(can | {"yaw_rate": nothing}, PERIOD, MAX_GAP) is None


def recorded(seed: int, minutes: float) -> Recorded:
    (trip,) = draw_campaign(seed, 1, 1, 1.0).trips
    return record_trip(Campaign((replace(trip, minutes=minutes, clock=CanClock(), can_gaps=(), nav_gaps=()),), seed), 0)


def drift(drive: Recorded, kilometres: float = 1.0) -> tuple[npt.NDArray[np.float64], float]:
    """Errors in m at the end of each kilometre, begun in the truth's place and direction; and what was promised."""
    found = reckon(drive.can)
    true = {name: drive.truth[name].to_numpy() for name in ("x", "y", "heading", "speed")}
    at = found.signals["x"].time
    moment = drive.truth["time"].to_numpy().astype(np.int64)
    x, y, angle = (
        np.interp(at, moment, values) for values in (true["x"], true["y"], np.unwrap(np.radians(true["heading"])))
    )
    distance = np.interp(at, moment, np.cumsum(true["speed"]) / 100)
    known = np.isfinite(found.signals["x"].values)
    path = found.signals["x"].values + 1j * found.signals["y"].values
    heading = np.radians(found.signals["heading"].values)
    errors = []
    begin = int(np.flatnonzero(known & (distance > 20))[0])
    while distance[-1] > distance[begin] + 1000 * kilometres:
        end = int(np.searchsorted(distance, distance[begin] + 1000 * kilometres))
        moved = (path[end] - path[begin]) * np.exp(1j * (angle[begin] - heading[begin]))
        errors.append(abs(moved - (x[end] - x[begin]) - 1j * (y[end] - y[begin])))
        begin = end
    return np.array(errors), float(found.facts["drift_m_per_km"])


def test_the_drift_on_simulated_drives_is_within_what_is_said() -> None:
    errors, promised = zip(*(drift(recorded(seed, 8.0)) for seed in range(3)), strict=True)
    joined = np.concatenate(errors)
    assert len(joined) > 12
    rms = float(np.sqrt(np.mean(joined**2)))
    assert 0.1 * np.mean(promised) < rms < np.mean(promised), (rms, promised)
    assert max(promised) < 10


def test_the_bias_of_the_simulated_sensor_is_found() -> None:
    facts = reckon(recorded(5, 3.0).can).facts
    assert facts["yaw_rate_bias_deg_s"] == pytest.approx(0.15, abs=3 * facts["yaw_rate_bias_standard_error_deg_s"])
    assert facts["yaw_rate_bias_standard_error_deg_s"] < 0.03
    assert facts["source"] == "bus: speed and yaw rate integrated"
    assert facts["standstill_s"] > 2
    # 0.1 deg/s at 100 Hz is 0.01 deg/s/√Hz; the mean over a grid period keeps the density.
    assert facts["yaw_rate_noise_deg_s_sqrt_hz"] == pytest.approx(0.01, rel=0.5)
