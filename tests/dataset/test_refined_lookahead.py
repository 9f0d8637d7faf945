"""The refined lookahead distance: the compiled parts against plain loops, and simulated drivers whose law is known."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from wheelprint.dataset.lookahead import lookahead_distance
from wheelprint.dataset.pursuit import most_likely_path, steering_towards
from wheelprint.dataset.reference import SPACING, Reference
from wheelprint.dataset.refined_lookahead import STEP, refined_lookahead
from wheelprint.dataset.steering_lag import Sight, estimate_manner, without_lag
from wheelprint.modeling.simulation.car import Car
from wheelprint.modeling.simulation.driver import Driver, Motion, drive, intend
from wheelprint.modeling.simulation.road import generate_road
from wheelprint.schemas.config import Lookahead

Floats = NDArray[np.float64]
PERIOD = 100_000_000
CAR = Car()


def test_the_goal_point_lies_where_the_path_first_gets_that_far() -> None:
    rng = np.random.default_rng(1)
    turning = np.cumsum(rng.normal(0, 0.15, 60))
    path_x, path_y = np.cumsum(np.cos(turning)), np.cumsum(np.sin(turning))
    x, y, heading = path_x[:5] + rng.normal(0, 0.3, 5), path_y[:5] + rng.normal(0, 0.3, 5), turning[:5]
    h = np.array([0.05, 1.0, 2.5, 9.0, 30.0, 400.0])
    first, stop = np.arange(5), np.array([60, 60, 60, 20, 5])
    found = steering_towards(x, y, heading, np.tile(h, (5, 1)), path_x, path_y, first, stop, 2.8)
    for t, (k, distance) in itertools.product(range(5), enumerate(h)):
        fine = np.linspace(first[t], stop[t] - 1, 200_001)
        east = np.interp(fine, np.arange(60), path_x) - x[t]
        north = np.interp(fine, np.arange(60), path_y) - y[t]
        far = np.hypot(east, north)
        if far[0] > distance or far.max() < distance:
            assert math.isnan(found[t, k])
            continue
        goal = int(np.argmax(far >= distance))
        alpha = math.atan2(north[goal], east[goal]) - heading[t]
        assert found[t, k] == pytest.approx(math.degrees(math.atan(2 * 2.8 * math.sin(alpha) / distance)), abs=0.01)


@given(st.integers(0, 10_000), st.integers(1, 6), st.integers(1, 3), st.integers(0, 2))
def test_the_cheapest_trajectory_is_the_cheapest_of_all(seed: int, samples: int, states: int, reach: int) -> None:
    rng = np.random.default_rng(seed)
    cost = rng.random((samples, states))
    run = np.cumsum(rng.random(samples) < 0.3).astype(np.int32)
    change = np.sort(rng.random(reach + 1))

    def total(trajectory: tuple[int, ...] | NDArray[np.int64]) -> float:
        paid = sum(cost[t, k] for t, k in enumerate(trajectory))
        for t in range(1, samples):
            step = abs(trajectory[t] - trajectory[t - 1])
            if run[t] == run[t - 1]:
                paid += change[step] if step <= reach else math.inf
        return float(paid)

    found = most_likely_path(cost, run, change)
    assert total(found) == pytest.approx(min(map(total, itertools.product(range(states), repeat=samples))))


def test_two_lags_in_a_row_are_undone() -> None:
    # A frequency of 0.4 Hz through two lags of 0.1 s each.
    t = 0.1 * np.arange(200)
    omega = 2 * np.pi * 0.4
    wanted = 3 * np.exp(1j * omega * t)
    lagging = (wanted / (1 + 1j * omega * 0.1) ** 2).real
    found = without_lag(lagging, np.repeat([0, 1], 100), 0.2, PERIOD)
    assert np.flatnonzero(np.isnan(found)).tolist() == [0, 99, 100, 199]
    inside = np.isfinite(found)
    np.testing.assert_allclose(found[inside], wanted.real[inside], rtol=0, atol=0.05)
    assert np.abs(lagging - wanted.real).max() > 1.0
    assert without_lag(lagging, np.zeros(200, int), 0.0, PERIOD) is lagging


def bend(samples: int, radius: float, offset: float) -> Sight:
    """A car beside the centre line of a bend that pursues a point 12 m ahead."""
    s = SPACING * np.arange(600)
    heading = np.cumsum(np.where((s > 60) & (s < 150), SPACING / radius, 0.0))
    path_x, path_y = np.cumsum(np.cos(heading)) * SPACING, np.cumsum(np.sin(heading)) * SPACING
    place = 1.0 + 0.8 * np.arange(samples)
    at = place / SPACING
    own = np.interp(at, np.arange(600), heading)
    x = np.interp(at, np.arange(600), path_x) - offset * np.sin(own)
    y = np.interp(at, np.arange(600), path_y) + offset * np.cos(own)
    first = at.astype(np.int64)
    stop = np.full(samples, 600)
    goal = np.full((samples, 1), 12.0)
    steering = steering_towards(x, y, own, goal, path_x, path_y, first, stop, 2.8)[:, 0]
    speed, run = np.full(samples, 8.0), np.zeros(samples, np.int32)
    return Sight(x, y, np.degrees(own), speed, steering, run, path_x, path_y, first, stop)


def test_the_crossing_between_candidates_is_exact_and_carried_over_the_straight() -> None:
    sight = bend(220, 40.0, 0.0)
    found, spread = refined_lookahead(sight, 2.8, Lookahead(position_noise=0.0), PERIOD, 0.0, 0.01)
    told = spread < 3.0
    assert told.sum() > 20
    # The bend is a polyline, and so is the law that was driven.
    np.testing.assert_allclose(found[told], 12.0, rtol=0.01)
    # On the straight nothing is told, and the distance stays near what the bend said of it.
    assert np.median(spread[10:50]) > 10.0
    np.testing.assert_allclose(found, 12.0, rtol=0.2)


def test_what_positions_do_to_near_goal_points_is_not_told() -> None:
    sight = bend(220, 40.0, 0.0)
    of_exact, of_rough = (
        refined_lookahead(sight, 2.8, Lookahead(position_noise=noise), PERIOD, 0.0, 0.01)[1] for noise in (0.0, 0.05)
    )
    # At 12 m, 5 cm across the path turn the steering by 2 L e / h² = 0.11 deg, eleven times its noise here.
    known = np.isfinite(of_exact)
    assert (of_rough[known] >= of_exact[known]).all()
    assert np.median(of_rough[known]) > np.median(of_exact[known])


def test_where_the_path_ends_there_is_no_distance() -> None:
    sight = bend(60, 40.0, 0.3)
    sight.stop[:] = sight.first + 1
    found, spread = refined_lookahead(sight, 2.8, Lookahead(), PERIOD, 0.0, 0.01)
    assert np.isnan(found).all()
    assert np.isnan(spread).all()


@dataclass(frozen=True)
class Simulated:
    """A drive at 10 Hz, measured with noise, and its truth."""

    sight: Sight
    motion: Motion
    lookahead: Floats


def simulated(driver: Driver, seed: int, minutes: float = 5.0) -> Simulated:
    """Let a driver drive on a road that is known, and measure at 10 Hz with the noise of a navigation unit."""
    rng = np.random.default_rng(seed)
    road = generate_road(rng, 30 * 60 * minutes)
    intentions = intend(rng, road, driver, (), 60 * minutes)
    assert intentions is not None
    motion = drive(rng, road, CAR, driver, intentions, 60 * minutes)
    rows = np.flatnonzero(motion.speed[::10] > 1.0) * 10
    reference = Reference(road.x[::2].copy(), road.y[::2].copy(), closed=False, file=Path("road.csv"))
    x, y = (values[rows] + rng.normal(0, 0.01, len(rows)) for values in (motion.x, motion.y))
    heading = np.degrees(motion.heading[rows]) + rng.normal(0, 0.03, len(rows))
    wheel = np.degrees(motion.road_wheel_angle[rows]) + rng.normal(0, 0.002, len(rows))
    run = np.cumsum(np.diff(rows, prepend=rows[0]) > 10).astype(np.int32)
    place = reference.locate(x, y, np.degrees(motion.course[rows]), run)
    path_x, path_y, first, stop = reference.ahead(place, 150.0)
    speed = motion.speed[rows]
    sight = Sight(x, y, heading, speed, wheel, run, path_x, path_y, first, stop, reference, place)
    return Simulated(sight, motion, motion.lookahead[rows])


@pytest.fixture(scope="module")
def drives() -> tuple[Driver, list[Simulated]]:
    """Two drives of one unsteady driver."""
    driver = Driver("anna", lookahead_base=5.5, lookahead_time=0.75, steering_noise=0.6, steering_smoothing=0.13)
    return driver, [simulated(driver, seed) for seed in (5, 6)]


def test_a_car_is_where_the_simulation_says(drives: tuple[Driver, list[Simulated]]) -> None:
    for one in drives[1]:
        assert one.sight.place is not None
        rows = np.flatnonzero(one.motion.speed[::10] > 1.0) * 10
        np.testing.assert_allclose(one.sight.place, one.motion.arc_length[rows], rtol=0, atol=0.1)


def test_lag_noise_and_law_come_back(drives: tuple[Driver, list[Simulated]]) -> None:
    driver, simulations = drives
    manner = estimate_manner([one.sight for one in simulations], CAR.wheelbase, Lookahead(), PERIOD, 0.1)
    assert manner.reason == ""
    assert manner.lag == pytest.approx(driver.steering_smoothing + CAR.steering_lag, abs=0.05)
    assert manner.lag_standard_error is not None
    assert 0.001 < manner.lag_standard_error < 0.05
    assert manner.noise == pytest.approx(driver.steering_noise / CAR.steering_ratio, rel=0.4)
    assert manner.base is not None
    assert manner.time is not None
    speed = np.linspace(2, 25, 24)
    fitted = np.clip(manner.base + manner.time * speed, driver.lookahead_minimum, driver.lookahead_maximum)
    assert np.abs(fitted / driver.lookahead(speed) - 1).max() < 0.1


def test_the_true_distance_comes_back_where_the_steering_tells_it(drives: tuple[Driver, list[Simulated]]) -> None:
    _, simulations = drives
    sights = [one.sight for one in simulations]
    manner = estimate_manner(sights, CAR.wheelbase, Lookahead(), PERIOD, 0.1)
    parts = [refined_lookahead(s, CAR.wheelbase, Lookahead(), PERIOD, manner.lag, manner.noise) for s in sights]
    found, spread = (np.concatenate(values) for values in zip(*parts, strict=True))
    true = np.concatenate([one.lookahead for one in simulations])
    told = spread <= 0.3 * found
    assert told.mean() > 0.1
    error = np.abs(found / true - 1)
    assert np.nanmedian(error[told]) < 0.1
    assert np.corrcoef(found[told], true[told])[0, 1] > 0.9
    # It is a trajectory: it never jumps.
    steps = np.abs(np.diff(np.log(found)))[
        np.diff(np.concatenate([s.run + 100 * k for k, s in enumerate(sights)])) == 0
    ]
    assert np.nanmax(steps) < 10 * STEP


def test_the_papers_definition_on_a_simulated_drive_is_that_of_a_plain_loop(
    drives: tuple[Driver, list[Simulated]],
) -> None:
    sight = drives[1][0].sight
    x, y, heading, delta = (v[:1500] for v in (sight.x, sight.y, sight.heading, sight.road_wheel_angle))
    run = sight.run[:1500]
    found, _ = lookahead_distance(x, y, heading, delta, run, CAR.wheelbase, Lookahead())
    for t in range(len(x)):
        candidates = []
        for n in range(t + 1, min(t + 51, len(x))):
            h = math.dist((x[n], y[n]), (x[t], y[t]))
            if run[n] == run[t] and 2 <= h <= 100:
                alpha = math.atan2(y[n] - y[t], x[n] - x[t]) - math.radians(heading[t])
                steering = math.degrees(math.atan(2 * math.sin(alpha) * CAR.wheelbase / h))
                candidates.append((abs(delta[t] - steering), h))
        expected = min(candidates)[1] if candidates else math.nan
        assert found[t] == pytest.approx(expected, abs=1e-9, nan_ok=True)


def test_a_given_lag_is_taken_and_too_little_driving_says_nothing(drives: tuple[Driver, list[Simulated]]) -> None:
    sight = drives[1][0].sight
    given = estimate_manner([sight], CAR.wheelbase, Lookahead(steering_lag=0.19), PERIOD, 0.1)
    assert (given.lag, given.lag_standard_error, given.reason) == (0.19, None, "")
    assert given.noise < 0.1
    few = bend(100, 40.0, 0.0)
    reference = Reference(few.path_x, few.path_y, closed=False, file=Path("a"))
    few = Sight(
        few.x, few.y, few.heading, few.speed, few.road_wheel_angle, few.run, few.path_x, few.path_y, few.first,
        few.stop, reference, few.first * np.float64(SPACING),
    )  # fmt: skip
    nothing = estimate_manner([few], 2.8, Lookahead(), PERIOD, 0.1)
    assert (nothing.lag, nothing.noise, nothing.base) == (0.0, 0.1, None)
    assert nothing.reason == "10 s along the reference, 60 s are needed"
    assert estimate_manner([], 2.8, Lookahead(), PERIOD, 0.1).reason == "no recording has a reference"
