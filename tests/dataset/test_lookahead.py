"""The lookahead distance against PP eq. 1 to 3 written as a double loop, and against drives whose answer is known."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from wheelprint.dataset.lookahead import lookahead_distance
from wheelprint.schemas.config import Lookahead

Floats = NDArray[np.float64]
WHEELBASE = 2.82


def drive(samples: int, seed: int) -> tuple[Floats, Floats, Floats, Floats]:
    """x, y, heading and road wheel angle of a car on a winding road, the angle with a driver's noise."""
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(samples)
    speed = 12 + 6 * np.sin(0.05 * t + rng.uniform(0, 6))
    steering = 4 * np.sin(0.3 * t + rng.uniform(0, 6)) + 3 * np.sin(0.11 * t) + rng.normal(0, 0.2, samples)
    heading = np.cumsum(np.degrees(speed * np.tan(np.radians(steering)) / WHEELBASE) * 0.1) + rng.uniform(-180, 180)
    x = np.cumsum(speed * np.cos(np.radians(heading)) * 0.1)
    y = np.cumsum(speed * np.sin(np.radians(heading)) * 0.1)
    return x, y, (heading + 180) % 360 - 180, steering


def by_loop(
    x: Floats, y: Floats, heading: Floats, delta: Floats, run: NDArray[np.int32], settings: Lookahead, noise: float
) -> tuple[list[float], list[float]]:
    """PP eq. 1 to 3 as they stand, and the spread by its definition."""
    best, spread = [], []
    for t in range(len(x)):
        candidates = []
        for n in range(1, settings.points + 1):
            if t + n >= len(x) or run[t + n] != run[t]:
                break
            h = math.sqrt((x[t + n] - x[t]) ** 2 + (y[t + n] - y[t]) ** 2)
            if not settings.minimum <= h <= settings.maximum or h == 0:
                continue
            alpha = math.atan2(y[t + n] - y[t], x[t + n] - x[t]) - math.radians(heading[t])
            delta_0 = math.degrees(math.atan(2 * math.sin(alpha) * WHEELBASE / h))
            if not math.isnan(delta[t] - delta_0):
                candidates.append((abs(delta[t] - delta_0), h))
        if candidates:
            smallest = min(error for error, _ in candidates)
            best.append(next(h for error, h in candidates if error <= smallest + 1e-12))
            near = [h for error, h in candidates if error <= smallest + noise]
            spread.append(max(near) - min(near))
        else:
            best.append(math.nan)
            spread.append(math.nan)
    return best, spread


@given(
    st.integers(0, 1000),
    st.integers(0, 150),
    st.builds(
        Lookahead,
        points=st.integers(1, 60),
        minimum=st.sampled_from([0.0, 2.0, 10.0]),
        maximum=st.sampled_from([10.5, 25.0, 100.0]),
    ),
    st.sampled_from([0.01, 0.5]),
)
def test_equals_the_double_loop(seed: int, samples: int, settings: Lookahead, noise: float) -> None:
    rng = np.random.default_rng(seed)
    x, y, heading, steering = drive(samples, seed)
    run = np.cumsum(rng.random(samples) < 0.03).astype(np.int32)
    for values in (x, y, heading, steering):
        values[rng.random(samples) < 0.02] = np.nan
    found = lookahead_distance(x, y, heading, steering, run, WHEELBASE, settings, noise)
    expected = by_loop(x, y, heading, steering, run, settings, noise)
    np.testing.assert_allclose(found[0], expected[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[1], expected[1], rtol=0, atol=1e-9)


def test_equals_the_double_loop_beyond_one_block_of_rows() -> None:
    x, y, heading, steering = drive(9000, 3)
    run = np.repeat([0, 1], [4090, 4910]).astype(np.int32)
    found = lookahead_distance(x, y, heading, steering, run, WHEELBASE, Lookahead())
    expected = by_loop(x, y, heading, steering, run, Lookahead(), 0.1)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


def test_a_driver_who_steers_towards_a_point_of_the_path_is_seen_through() -> None:
    x, y, heading, _ = drive(2000, 5)
    aim = np.random.default_rng(0).integers(5, 30, 1970)
    t = np.arange(1970)
    h = np.hypot(x[t + aim] - x[t], y[t + aim] - y[t])
    alpha = np.arctan2(y[t + aim] - y[t], x[t + aim] - x[t]) - np.radians(heading[t])
    steering = np.full(2000, np.nan)
    steering[:1970] = np.degrees(np.arctan(2 * WHEELBASE * np.sin(alpha) / h))
    settings = Lookahead(minimum=0.5)
    found, spread = lookahead_distance(x, y, heading, steering, np.zeros(2000, np.int32), WHEELBASE, settings, 1e-9)
    np.testing.assert_allclose(found[:1970], h, rtol=0, atol=1e-9)
    np.testing.assert_allclose(spread[:1970], 0, atol=1e-9)
    assert np.isnan(found[1970:]).all()
    assert np.isnan(spread[1970:]).all()


def test_on_a_straight_road_every_distance_explains_the_steering() -> None:
    x = 0.1 * 17.3 * np.arange(200, dtype=np.float64)
    angle = math.radians(31.7)
    straight = lookahead_distance(
        x * math.cos(angle), x * math.sin(angle), np.full(200, 31.7), np.zeros(200), np.zeros(200, np.int32),
        WHEELBASE, Lookahead(points=40),
    )  # fmt: skip
    np.testing.assert_allclose(straight[0][:150], 2 * 1.73, rtol=0, atol=1e-9)
    np.testing.assert_allclose(straight[1][:150], 38 * 1.73, rtol=0, atol=1e-9)


def test_on_a_circle_every_distance_explains_the_steering_of_the_kinematic_car() -> None:
    radius, angle = 40.0, np.radians(2.0 * np.arange(120))
    found, spread = lookahead_distance(
        radius * np.cos(angle), radius * np.sin(angle), np.degrees(angle) + 90,
        np.full(120, math.degrees(math.atan(WHEELBASE / radius))), np.zeros(120, np.int32),
        WHEELBASE, Lookahead(points=20),
    )  # fmt: skip
    chords = 2 * radius * np.sin(np.radians(np.arange(1, 21)))
    np.testing.assert_allclose(found[:100], chords[chords >= 2][0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(spread[:100], chords[-1] - chords[chords >= 2][0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("samples", [0, 1])
def test_next_to_nothing(samples: int) -> None:
    nothing = np.zeros(samples)
    found = lookahead_distance(
        nothing, nothing, nothing, nothing, np.zeros(samples, np.int32), WHEELBASE, Lookahead(minimum=0)
    )
    assert [np.isnan(part).tolist() for part in found] == [[True] * samples] * 2


def test_standing_still_has_no_lookahead() -> None:
    nothing = np.zeros(30)
    found, _ = lookahead_distance(nothing, nothing, nothing, nothing, np.zeros(30, np.int32), 2.8, Lookahead(minimum=0))
    assert np.isnan(found).all()


def test_an_hour_takes_less_than_two_seconds() -> None:
    x, y, heading, steering = drive(36_000, 1)
    start = time.process_time()
    lookahead_distance(x, y, heading, steering, np.zeros(36_000, np.int32), WHEELBASE, Lookahead())
    assert time.process_time() - start < 2.0
