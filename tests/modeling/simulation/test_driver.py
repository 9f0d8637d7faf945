from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from wheelprint.modeling.pure_pursuit import Line, goal_point
from wheelprint.modeling.simulation.car import Car
from wheelprint.modeling.simulation.closed_loop import swerve_shape
from wheelprint.modeling.simulation.driver import Driver, Emergency, coloured_noise, drive, intend, plan_speed
from wheelprint.modeling.simulation.road import STEP, Road, generate_road


@pytest.fixture(scope="module")
def road() -> Road:
    return generate_road(np.random.default_rng(11), 2500.0)


def test_lookahead_law_is_bounded() -> None:
    driver = Driver("a", lookahead_base=3.0, lookahead_time=0.5, lookahead_minimum=4.0, lookahead_maximum=12.0)
    assert driver.lookahead(np.array([0.0, 2.0, 10.0, 18.0, 30.0])).tolist() == [4.0, 4.0, 8.0, 12.0, 12.0]


def test_planned_speed_is_the_greatest_that_comfort_allows(road: Road) -> None:
    driver = Driver("a", acceleration=1.2, deceleration=2.0, lateral_comfort=2.0, speed_factor=0.9)
    stops = road.stop_lines[:1]
    speed, _ = plan_speed(road, driver, stops)

    allowed = [
        min((0.9 * limit) ** 2, 2.0 / abs(curvature) if curvature else math.inf)
        for limit, curvature in zip(road.limit, road.curvature, strict=True)
    ]
    allowed[math.ceil(stops[0] / STEP)] = 0.0
    for i in reversed(range(len(allowed) - 1)):
        allowed[i] = min(allowed[i], allowed[i + 1] + 2 * 2.0 * STEP)
    for i in range(1, len(allowed)):
        allowed[i] = min(allowed[i], allowed[i - 1] + 2 * 1.2 * STEP)
    assert np.allclose(speed**2, allowed, atol=1e-9)


def test_goal_point_is_on_the_line_at_the_distance() -> None:
    angle = np.linspace(0, 3, 200)
    line = Line(20 * np.sin(angle), 20 - 20 * np.cos(angle), 20 * 3 / 199)
    for distance in (1.5, 4.0, 11.0, 25.0):
        x, y = goal_point(0.3, -0.4, distance, line, 2)
        assert math.hypot(x - 0.3, y + 0.4) == pytest.approx(distance, abs=1e-12)
        assert math.hypot(x, y - 20) == pytest.approx(20, abs=2e-3)
    assert goal_point(0.0, 0.0, 100.0, line, 2) == pytest.approx((line.x[-1], line.y[-1]))


def test_swerve_changes_neither_heading_nor_position_in_the_end() -> None:
    u = Polynomial([0, 1])
    bump = u**4 * (1 - u) ** 4
    acceleration = bump.deriv(2) / bump.deriv(2)(0.5)
    shares = np.linspace(0, 1, 21)
    assert np.allclose([swerve_shape(share) for share in shares], acceleration(shares), atol=1e-12)
    once = acceleration.integ()
    assert once(1) - once(0) == pytest.approx(0, abs=1e-12)
    assert (once - once(0)).integ()(1) == pytest.approx(0, abs=1e-12)


def test_coloured_noise_has_the_deviation_and_the_memory_asked_for() -> None:
    noise = coloured_noise(np.random.default_rng(0), 400_000, 0.7, 0.5)
    assert noise.std() == pytest.approx(0.7, rel=0.03)
    assert np.corrcoef(noise[:-50], noise[50:])[0, 1] == pytest.approx(math.exp(-1), abs=0.03)
    smooth = coloured_noise(np.random.default_rng(0), 400_000, 0.7, 0.5, smoothing=0.5)
    assert np.diff(smooth).std() < 0.1 * np.diff(noise).std()


def test_wheel_speeds_are_those_of_a_rigid_body() -> None:
    car = Car(rear_slip=0.0, understeer_gradient=0.0)
    angle, speed = 0.2, 8.0
    yaw_rate = speed * math.tan(angle) / car.wheelbase
    wheels = car.wheel_speeds(np.array([speed]), np.array([yaw_rate]), np.array([angle]))[:, 0]
    radius = speed / yaw_rate
    along = math.cos(angle), math.sin(angle)
    expected = []
    for forward, left in ((car.wheelbase, 0.825), (car.wheelbase, -0.825), (0, 0.825), (0, -0.825)):
        velocity = yaw_rate * (radius - left), yaw_rate * forward
        direction = along if forward else (1.0, 0.0)
        expected.append(velocity[0] * direction[0] + velocity[1] * direction[1])
    assert wheels == pytest.approx(expected, rel=1e-12)
    assert wheels[0] < wheels[1]


def test_pedals_are_pressed_one_at_a_time() -> None:
    pedal, pressure = Car().pedals(np.array([10.0, 10.0, 10.0, 0.0]), np.array([1.0, 0.0, -8.0, 0.0]))
    assert (pedal > 0).tolist() == [True, True, False, False]
    assert (pressure > 0).tolist() == [False, False, True, True]
    assert pressure[2] > 80


@pytest.mark.parametrize("seed", range(6))
def test_driving_looks_like_driving(seed: int) -> None:
    generator = np.random.default_rng(seed)
    asked: tuple[Emergency, ...] = ("braking", "swerve")
    while True:
        road = generate_road(generator, 30 * 300)
        driver = Driver("a", lookahead_base=generator.uniform(3, 8), lookahead_time=generator.uniform(0.45, 0.95))
        intentions = intend(generator, road, driver, asked, 300)
        if intentions is not None:
            break
    motion = drive(generator, road, Car(), driver, intentions, 300)
    quiet = motion.emergency < 0
    standing = motion.speed == 0
    offset = np.hypot(motion.x - motion.centre_x, motion.y - motion.centre_y)
    wheel = np.degrees(motion.road_wheel_angle) * 15.7

    assert len(motion.x) == 30_000
    assert 10 < np.median(motion.speed[~standing]) < 25
    assert motion.speed.max() < 28
    assert motion.speed.min() == 0
    assert 0.005 < standing.mean() < 0.25
    assert np.quantile(np.abs(motion.lateral_acceleration[quiet]), 0.99) < 3
    assert np.abs(motion.lateral_acceleration[quiet]).max() < 4
    assert motion.longitudinal_acceleration[quiet].min() > -3.5
    assert motion.longitudinal_acceleration.max() < 3.5
    assert 150 < np.abs(wheel).max() < 450
    assert np.abs(np.degrees(motion.road_wheel_speed[quiet]) * 15.7).max() < 300
    straight = quiet & ~standing & (np.abs(motion.curvature) < 1e-4)
    assert np.abs(wheel[straight]).max() < 10
    assert np.quantile(offset, 0.9) < 0.7
    assert offset[quiet].max() < 2


def test_a_stop_lasts_two_to_six_seconds_before_its_line(road: Road) -> None:
    driver = Driver("a")
    generator = np.random.default_rng(2)
    intentions = intend(generator, road, driver, (), 120.0)
    assert intentions is not None
    motion = drive(generator, road, Car(), driver, intentions, 120.0)
    edges = np.flatnonzero(np.diff((motion.speed == 0).astype(int)))
    stops = [(first + 1, last + 1) for first, last in pairwise(edges) if motion.speed[last] == 0]
    assert len(stops) >= 1
    for number, (first, last) in enumerate(stops):
        assert 1.95 < (last - first) / 100 < 6.05
        assert (last - first) / 100 == pytest.approx(intentions.standstills[number], abs=0.05)
        assert -1.0 < intentions.stops[number] - motion.arc_length[first] < 5.0


def test_a_short_road_has_no_room_for_many_emergencies(road: Road) -> None:
    assert intend(np.random.default_rng(0), road, Driver("a"), ("swerve",) * 30, 60.0) is None
