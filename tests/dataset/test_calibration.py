"""Steering calibration, on simulated cars whose ratio, offset and understeer are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from wheelprint.dataset.calibration import SteeringCalibration, estimate_steering

WHEELBASE = 2.82
RATIO, OFFSET, UNDERSTEER = 15.5, -3.2, 0.12
RATE = 10

Drive = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]


def drive(seed: int, minutes: float = 10, *, curviness: float = 0.012, noise: float = 1.0) -> Drive:
    """Steering wheel angle, yaw rate and speed at 10 Hz: the yaw rate follows with 0.2 s, sensors are noisy."""
    rng = np.random.default_rng(seed)
    n = int(minutes * 60 * RATE)

    def wander(seconds: float) -> npt.NDArray[np.float64]:
        kernel = np.hanning(int(4 * seconds * RATE))
        return np.asarray(
            np.convolve(rng.standard_normal(n + len(kernel) - 1), kernel, "valid") / np.sqrt((kernel**2).sum())
        )

    speed = np.clip(12 + 6 * wander(10), 0, 30)
    curvature = curviness * wander(2) / (1 + (speed / 12) ** 2)
    wheel = OFFSET + RATIO * np.degrees(np.arctan(curvature * (WHEELBASE + np.radians(UNDERSTEER) * speed**2)))
    yaw_rate = np.degrees(curvature * speed)
    late = np.concatenate((yaw_rate[:2], yaw_rate[:-2]))
    return (
        wheel + noise * 0.3 * rng.standard_normal(n),
        late + noise * 0.1 * rng.standard_normal(n),
        speed + noise * 0.05 * rng.standard_normal(n),
    )


def within(found: float | None, truth: float, error: float | None, standard_errors: float = 3) -> bool:
    assert found is not None
    assert error is not None
    return abs(found - truth) < standard_errors * error


@pytest.mark.parametrize("seed", range(6))
def test_ratio_offset_and_understeer_are_found(seed: int) -> None:
    found = estimate_steering(*drive(seed), WHEELBASE)
    assert found.reason == ""
    assert found.ratio == pytest.approx(RATIO, rel=0.03)
    assert found.offset == pytest.approx(OFFSET, abs=0.5)
    assert found.understeer == pytest.approx(UNDERSTEER, abs=0.05)
    assert within(found.ratio, RATIO, found.ratio_standard_error, 4)
    assert within(found.offset, OFFSET, found.offset_standard_error, 4)


def test_without_noise_or_lag_the_fit_is_the_equation() -> None:
    _, yaw_rate, speed = drive(0, noise=0)
    speed[:] = np.repeat([6.0, 18.0], len(speed) // 2)
    yaw_rate[:] = np.repeat(np.random.default_rng(0).uniform(-12, 12, len(speed) // 50), 50)
    curvature = np.radians(yaw_rate) / speed
    road_wheel = np.degrees(np.arctan(curvature * (WHEELBASE + np.radians(UNDERSTEER) * speed**2)))
    found = estimate_steering(OFFSET + RATIO * road_wheel, yaw_rate, speed, WHEELBASE, rate=1)
    assert found.ratio == pytest.approx(RATIO, abs=1e-6)
    assert found.offset == pytest.approx(OFFSET, abs=1e-6)
    assert found.understeer == pytest.approx(UNDERSTEER, abs=1e-6)


def test_standard_errors_fit_the_errors() -> None:
    found = [estimate_steering(*drive(seed, 5), WHEELBASE, ratio=RATIO) for seed in range(20, 50)]
    errors = [(c.offset or 0) - OFFSET for c in found]
    promised = [c.offset_standard_error or 0 for c in found]
    assert 0.6 < np.sqrt(np.mean(np.square(np.divide(errors, promised)))) < 1.6


def test_what_is_given_is_kept() -> None:
    wheel, yaw_rate, speed = drive(1)
    offset_only = estimate_steering(wheel, yaw_rate, speed, WHEELBASE, ratio=RATIO)
    assert (offset_only.ratio, offset_only.ratio_standard_error) == (RATIO, 0.0)
    assert within(offset_only.offset, OFFSET, offset_only.offset_standard_error, 4)
    ratio_only = estimate_steering(wheel, yaw_rate, speed, WHEELBASE, offset=OFFSET)
    assert (ratio_only.offset, ratio_only.offset_standard_error) == (OFFSET, 0.0)
    assert within(ratio_only.ratio, RATIO, ratio_only.ratio_standard_error, 4)
    neither = estimate_steering(wheel, yaw_rate, speed, WHEELBASE, ratio=RATIO, offset=OFFSET)
    assert (neither.ratio, neither.offset, neither.reason) == (RATIO, OFFSET, "")
    assert neither.understeer == pytest.approx(UNDERSTEER, abs=0.02)


def test_left_is_positive() -> None:
    """Mirrored driving mirrors the offset and nothing else."""
    wheel, yaw_rate, speed = drive(2)
    found, mirrored = (estimate_steering(s * wheel, s * yaw_rate, speed, WHEELBASE) for s in (1, -1))
    assert mirrored.ratio == pytest.approx(found.ratio, rel=1e-9)
    assert mirrored.offset == pytest.approx(-(found.offset or 0), rel=1e-9)
    assert mirrored.understeer == pytest.approx(found.understeer, rel=1e-9)


@pytest.mark.parametrize("ratio", [None, RATIO])
def test_a_reversed_angle_is_told_with_the_line_that_mends_it(ratio: float | None) -> None:
    wheel, yaw_rate, speed = drive(3)
    found = estimate_steering(-wheel, yaw_rate, speed, WHEELBASE, ratio=ratio)
    assert (found.ratio, found.offset, found.understeer) == (ratio, None, None)
    correlation = found.reason.split("correlation ")[1][:5]
    assert float(correlation) < -0.9
    assert found.reason == (
        f"the steering wheel angle turns against the yaw rate (correlation {correlation}); if the angle is positive to "
        "the right, turn it in wheelprint.toml, [can.signals]: "
        'steering_wheel_angle = { signal = "Message.Signal", sign = -1 }'
    )


def test_straight_driving_tells_the_offset_only() -> None:
    found = estimate_steering(*drive(4, curviness=0.0004), WHEELBASE)
    assert found.ratio is None
    assert found.ratio_standard_error is None
    assert found.understeer is None
    assert found.offset == pytest.approx(OFFSET, abs=0.3)
    middle = found.reason.removeprefix("the ratio cannot be told: ").split(" deg rms")[0]
    assert found.reason == (
        f"the ratio cannot be told: {middle} deg rms at the road wheels; record slow, tight bends, or give "
        "vehicle.steering_ratio"
    )
    assert float(middle.split()[-1]) < 0.5


def test_an_uncertain_offset_is_not_told() -> None:
    wheel, yaw_rate, speed = drive(5, 2)
    noise = np.repeat(np.random.default_rng(0).normal(0, 20, len(wheel) // 100), 100)
    found = estimate_steering(wheel + noise, yaw_rate, speed, WHEELBASE, ratio=RATIO)
    assert (found.offset, found.offset_standard_error) == (None, None)
    assert found.reason.startswith("the offset cannot be told: ")
    assert found.reason.endswith(" deg; record more driving, or give vehicle.steering_offset")


def test_a_car_that_never_moved_has_zero_everywhere() -> None:
    zeros, speed = np.zeros(1000), np.full(1000, 10.0)
    found = estimate_steering(zeros, zeros, speed, WHEELBASE)
    assert found.ratio is None
    assert found.offset == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("length", [0, 1, 5, 200])
def test_too_little_driving(length: int) -> None:
    wheel, yaw_rate, speed = (series[:length] for series in drive(6))
    found = estimate_steering(wheel, yaw_rate, np.maximum(speed, 5), WHEELBASE, ratio=RATIO)
    reason = f"only {found.samples / 10:.0f} s faster than 3 m/s and below 4 m/s² to the side, 30 s are needed"
    assert found == SteeringCalibration(RATIO, 0.0, None, None, None, found.samples, reason)
    assert found.samples <= length


def test_missing_slow_and_hard_cornering_samples_do_not_count() -> None:
    wheel, yaw_rate, speed = drive(7)
    base = estimate_steering(wheel, yaw_rate, speed, WHEELBASE)
    rubbish = np.full(200, 500.0)
    apart = np.array([np.nan])
    wheel_more, yaw_more, speed_more = (
        np.concatenate((series, apart, rubbish, apart, rubbish, apart, other))
        for series, other in ((wheel, rubbish), (yaw_rate, np.full(200, 30.0)), (speed, np.full(200, 20.0)))
    )
    slow = slice(len(wheel) + 1, len(wheel) + 201)
    speed_more[slow] = 1.0
    yaw_more[len(wheel) + 202 : len(wheel) + 402] = np.nan
    more = estimate_steering(wheel_more, yaw_more, speed_more, WHEELBASE)
    assert replace(more, samples=0) == replace(base, samples=0)
    assert more.samples == base.samples


def test_wild_samples_hardly_matter() -> None:
    wheel, yaw_rate, speed = drive(8)
    rng = np.random.default_rng(0)
    wheel[rng.random(len(wheel)) < 0.003] = 700
    found = estimate_steering(wheel, yaw_rate, speed, WHEELBASE)
    assert found.ratio == pytest.approx(RATIO, rel=0.05)
    assert found.offset == pytest.approx(OFFSET, abs=1)
