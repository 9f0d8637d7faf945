"""The truth agrees with itself: each quantity follows from others by textbook formulas."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import numpy as np
import numpy.typing as npt
from pyproj import Transformer

from wheelprint.modeling.simulation.truth import TRUTH

DT = 0.01
FloatArray = npt.NDArray[np.float64]


def integral(rate: FloatArray) -> FloatArray:
    return np.concatenate(([0.0], np.cumsum(DT * (rate[1:] + rate[:-1]) / 2)))


def unwrapped(angle: FloatArray) -> FloatArray:
    return np.unwrap(angle, period=360)


def test_schema_and_time(eventful: SimpleNamespace) -> None:
    assert eventful.table.schema.equals(TRUTH)
    assert all(field.metadata[b"description"] for field in eventful.table.schema)
    assert len(eventful.table) == 24_000
    assert set(np.diff(eventful.time)) == {10_000_000}
    assert json.loads(eventful.table.schema.metadata[b"origin"]) == eventful.entry["origin"]


def test_missing_is_where_the_driver_does_not_pursue(eventful: SimpleNamespace) -> None:
    truth = eventful.truth
    undefined = {"pursuit_angle", "lookahead", "goal_x", "goal_y"}
    for name in eventful.table.column_names:
        assert (eventful.table[name].null_count > 0) == (name in undefined)
    missing = np.isnan(truth["lookahead"])
    assert missing[truth["speed"] == 0].all()
    # Otherwise only in a swerve, the end of which is driven by pursuit again.
    swerve = next(e for e in eventful.entry["emergencies"] if e["kind"] == "swerve")
    inside = (truth["time"] >= np.datetime64(swerve["start"][:-1])) & (
        truth["time"] < np.datetime64(swerve["stop"][:-1])
    )
    elsewhere = missing & (truth["speed"] > 0)
    assert elsewhere.any()
    assert (elsewhere <= inside).all()
    assert not missing[inside][-99:].any()
    assert missing[inside][:-100].all()


def test_positions_follow_course_and_speed(eventful: SimpleNamespace) -> None:
    truth = eventful.truth
    course = np.radians(unwrapped(truth["course"]))
    for name, direction in (("x", np.cos(course)), ("y", np.sin(course))):
        assert np.abs(truth[name] - integral(truth["speed"] * direction)).max() < 0.02


def test_course_changes_by_curvature_times_distance(eventful: SimpleNamespace) -> None:
    truth = eventful.truth
    course = unwrapped(truth["course"])
    turned = np.degrees(integral(truth["curvature"] * truth["speed"]))
    assert np.ptp(course) > 90
    assert np.abs(course - course[0] - turned).max() < 0.05
    assert np.abs(np.diff(course) - np.diff(turned)).max() < 0.01


def test_heading_changes_by_the_yaw_rate_of_the_bicycle(eventful: SimpleNamespace) -> None:
    truth, car = eventful.truth, eventful.campaign.car
    heading = unwrapped(truth["heading"])
    assert np.abs(heading - heading[0] - integral(truth["yaw_rate"])).max() < 1e-6
    expected = [
        math.degrees(v * math.tan(math.radians(delta)) / (car.wheelbase + car.understeer_gradient * v * v))
        for v, delta in zip(truth["speed"], truth["road_wheel_angle"], strict=True)
    ]
    assert np.abs(truth["yaw_rate"] - expected).max() < 1e-9


def test_rear_axle_slips_outwards(eventful: SimpleNamespace) -> None:
    truth, car = eventful.truth, eventful.campaign.car
    slip = (truth["course"] - truth["heading"] + 180) % 360 - 180
    expected = -np.degrees(car.rear_slip) * truth["speed"] * np.radians(truth["yaw_rate"])
    assert np.abs(slip - expected).max() < 1e-9
    assert 0.3 < np.abs(slip).max() < 1.5


def test_accelerations_are_the_derivatives_of_the_velocity(eventful: SimpleNamespace) -> None:
    truth = eventful.truth
    course, heading = np.radians(truth["course"]), np.radians(truth["heading"])
    moving = (truth["speed"][:-2] > 0) & (truth["speed"][2:] > 0)
    rate = [(v[2:] - v[:-2]) / (2 * DT) for v in (truth["speed"] * np.cos(course), truth["speed"] * np.sin(course))]
    middle = heading[1:-1]
    for name, expected in (
        ("longitudinal_acceleration", rate[0] * np.cos(middle) + rate[1] * np.sin(middle)),
        ("lateral_acceleration", rate[1] * np.cos(middle) - rate[0] * np.sin(middle)),
    ):
        error = np.abs(truth[name][1:-1] - expected)[moving]
        assert error.max() < 0.25
        assert np.quantile(error, 0.99) < 0.02


def test_steering_wheel_and_road_wheels(eventful: SimpleNamespace) -> None:
    truth, car = eventful.truth, eventful.campaign.car
    wheel = truth["steering_wheel_angle"]
    assert np.abs(wheel - car.steering_ratio * truth["road_wheel_angle"]).max() < 1e-9
    assert np.abs(wheel - wheel[0] - integral(truth["steering_wheel_speed"])).max() < 3
    assert np.median(np.abs(wheel)) < 5
    # What the wheels do is what eq. 1 asks for, a little later and with an unsteady hand.
    follows = ~np.isnan(truth["pursuit_angle"]) & ~truth["emergency"]
    lag = round(100 * (eventful.trip.driver.steering_smoothing + car.steering_lag))
    asked = np.roll(truth["pursuit_angle"], lag)
    assert np.nanmean(np.abs(truth["road_wheel_angle"] - asked)[follows]) < 0.08


def test_pure_pursuit_of_the_centre_line_gives_back_the_lookahead_law(eventful: SimpleNamespace) -> None:
    """PP eq. 1 and 3: of all distances to points of the centre line ahead, the one whose angle is the one asked for."""
    truth, car, driver = eventful.truth, eventful.campaign.car, eventful.trip.driver
    arc, first = np.unique(truth["arc_length"], return_index=True)
    line = np.arange(arc[0], arc[-1], 0.02)
    line_x, line_y = np.interp(line, arc, truth["centre_x"][first]), np.interp(line, arc, truth["centre_y"][first])
    errors = []
    for row in range(0, 22_000, 40):
        if not abs(truth["pursuit_angle"][row]) > 1.5:
            continue
        ahead = slice(*np.searchsorted(line, truth["arc_length"][row] + np.array([1.0, 40.0])))
        dx, dy = line_x[ahead] - truth["x"][row], line_y[ahead] - truth["y"][row]
        distance = np.hypot(dx, dy)
        bearing = np.arctan2(dy, dx) - math.radians(truth["heading"][row])
        angle = np.degrees(np.arctan(2 * car.wheelbase * np.sin(bearing) / distance))
        law = min(driver.lookahead_base + driver.lookahead_time * truth["speed"][row], driver.lookahead_maximum)
        # Several distances may explain one angle; the law's is one of them.
        crossings = np.flatnonzero(np.diff(np.sign(angle - truth["pursuit_angle"][row])) != 0)
        assert len(crossings) > 0
        errors.append(np.abs(distance[crossings] - law).min())
    assert len(errors) > 50
    assert max(errors) < 0.1


def test_lookahead_law_is_recovered_by_a_regression(eventful: SimpleNamespace) -> None:
    truth, driver = eventful.truth, eventful.trip.driver
    pursued = ~np.isnan(truth["lookahead"])
    speed, lookahead = truth["speed"][pursued], truth["lookahead"][pursued]
    bounded = lookahead >= driver.lookahead_maximum
    assert bounded.any()
    assert lookahead.max() == driver.lookahead_maximum
    slope, base = np.polyfit(speed[~bounded], lookahead[~bounded], 1)
    assert abs(slope - driver.lookahead_time) < 1e-9
    assert abs(base - driver.lookahead_base) < 1e-8
    goal = np.hypot(truth["goal_x"] - truth["x"], truth["goal_y"] - truth["y"])[pursued]
    assert np.abs(goal - lookahead).max() < 1e-9


def test_geodetic_positions(eventful: SimpleNamespace) -> None:
    truth, origin = eventful.truth, eventful.entry["origin"]
    topocentric = Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 +step "
        "+proj=topocentric +ellps=WGS84 "
        f"+lon_0={origin['longitude']!r} +lat_0={origin['latitude']!r} +h_0={origin['altitude']!r}"
    )
    x, y, _ = topocentric.transform(truth["longitude"], truth["latitude"], truth["altitude"])
    assert np.abs(x - truth["x"]).max() < 1e-4
    assert np.abs(y - truth["y"]).max() < 1e-4
    assert np.abs(truth["altitude"] - origin["altitude"]).max() < 0.02
    assert 39.8 < origin["latitude"] < 40.1
    assert 116.2 < origin["longitude"] < 116.5


def test_emergencies_are_what_they_say(eventful: SimpleNamespace) -> None:
    truth = eventful.truth
    expected = np.zeros(len(truth["time"]), bool)
    for emergency in eventful.entry["emergencies"]:
        start, stop = (np.datetime64(emergency[end][:-1]) for end in ("start", "stop"))
        inside = (truth["time"] >= start) & (truth["time"] < stop)
        expected |= inside
        strength = emergency["strength_m_s2"]
        if emergency["kind"] == "braking":
            assert 7 <= strength <= 9
            assert abs(truth["longitudinal_acceleration"][inside].min() + strength) < 0.05
            assert truth["brake_pressure"][inside].max() > 60
        else:
            assert 7 <= abs(strength) <= 8.5
            lateral = truth["lateral_acceleration"][inside]
            assert 0.85 < np.abs(lateral).max() / abs(strength) < 1.1
            assert np.sign(lateral[np.abs(lateral).argmax()]) == np.sign(strength)
            offset = np.hypot(truth["x"] - truth["centre_x"], truth["y"] - truth["centre_y"])
            assert offset[inside].max() > 0.7
            assert offset[inside][-1] < 0.5
    assert sorted(e["kind"] for e in eventful.entry["emergencies"]) == ["braking", "swerve"]
    assert np.array_equal(truth["emergency"], expected)
    assert truth["longitudinal_acceleration"][~expected].min() > -3.5
    assert np.abs(truth["lateral_acceleration"][~expected]).max() < 4
