"""Tracks, the bicycle, drives along tracks: geometry, limits that hold, and that the combined driver always returns."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from wheelprint.dataset.path import course_deviation
from wheelprint.dataset.reference import SPACING as REFERENCE_SPACING
from wheelprint.dataset.reference import Reference
from wheelprint.modeling.bicycle import Bicycle
from wheelprint.modeling.driver_limits import DriverLimits, Limits
from wheelprint.modeling.driving import (
    CONTROLS,
    HANDS,
    TOLERANCE,
    Control,
    as_driven,
    drive_track,
    measure,
    share_within,
)
from wheelprint.modeling.lookahead_laws import ConstantLookahead, LinearLookahead, fit_simple_laws
from wheelprint.modeling.lookahead_models import GeneralLookahead, VelocityLookahead
from wheelprint.modeling.simulation.campaign import draw_campaign, drive_trip
from wheelprint.modeling.track import (
    FASTEST,
    PIECES,
    SLOWEST,
    SPACING,
    STEP,
    FloatArray,
    Track,
    lay_track,
    recorded_tracks,
)
from wheelprint.modeling.windows import Series

CAR = Bicycle(2.8, 15.0, 0.002)
PERIOD = 100_000_000
WIDE = DriverLimits(np.array([1.0]), Limits(*(np.array([value]) for value in (1.0, 99.0, 500.0, 400.0))))


def constant(distance: float) -> ConstantLookahead:
    return ConstantLookahead().fit(np.zeros((1, 2)), np.array([distance]))


def everywhere(track: Track, share: float) -> FloatArray:
    """Return a domain of which all the track's inputs are the same share."""
    return np.full(len(track.inputs), share)


def bend(curvature: float, speed: float, length: float = 300.0) -> Track:
    """A clothoid into an arc, at one speed."""
    n = round(length / SPACING)
    bent = curvature * np.clip(np.arange(n) * SPACING / 40.0, 0.0, 1.0)
    course = np.concatenate([[0.0], np.cumsum(bent)[:-1]]) * SPACING
    unknown = np.full(n, np.nan)
    x, y = (np.concatenate([[0.0], np.cumsum(f(course + bent * SPACING / 2))[:-1]]) * SPACING for f in (np.cos, np.sin))
    return Track(x, y, course, bent, np.full(n, speed), unknown, unknown, unknown)


def test_test_track_is_as_its_pieces_say() -> None:
    track = lay_track()
    assert len(track.x) == pytest.approx(sum(length for length, _ in PIECES) / SPACING, abs=len(PIECES))
    turned = sum(length / radius for length, radius in PIECES if radius)
    assert track.course[-1] == pytest.approx(turned, abs=0.05)
    assert np.min(track.speed) >= SLOWEST - 1e-12
    assert np.max(track.speed) <= FASTEST + 1e-12
    assert np.max(track.speed**2 * np.abs(track.curvature)) < 2.0 + 1e-9
    assert np.abs(np.diff(track.speed**2)).max() <= 2 * 1.5 * SPACING + 1e-9
    np.testing.assert_allclose(np.hypot(np.diff(track.x), np.diff(track.y)), SPACING, rtol=1e-4)
    # It ends where integrating its curvature ends.
    s = track.distance
    end = solve_ivp(
        lambda at, state: [np.cos(state[2]), np.sin(state[2]), np.interp(at, s, track.curvature)],
        (0.0, s[-1]), [0.0, 0.0, 0.0], max_step=0.2,
    ).y[:, -1]  # fmt: skip
    np.testing.assert_allclose(end, [track.x[-1], track.y[-1], track.course[-1]], atol=0.3)
    np.testing.assert_allclose(track.inputs[:, 0], np.degrees(track.curvature * track.speed * STEP))


def test_bicycle_and_its_inverse() -> None:
    curvature, speed = np.array([0.1, -0.02, 0.0, 0.004]), np.array([3.0, 10.0, 20.0, 30.0])
    angle = CAR.steering_wheel_angle(curvature, speed)
    np.testing.assert_allclose(CAR.curvature(angle, speed), curvature, atol=1e-15)
    assert angle[0] == pytest.approx(15 * math.degrees(math.atan(0.1 * (2.8 + 0.002 * 9))))


@pytest.mark.parametrize("law", [4.0, 8.0, 15.0])
def test_pursuit_of_an_arc_is_exact_for_a_kinematic_bicycle(law: float) -> None:
    """On the arc the circle through the goal point is the arc; the angle is atan(L κ), the deviation goes to zero."""
    driven = drive_track(bend(1 / 40, 8.0), constant(law), Bicycle(2.8))
    late = driven["distance"] > 200
    np.testing.assert_allclose(np.radians(driven["steering_wheel_angle"][late]), np.arctan(2.8 / 40), rtol=2e-3)
    assert np.abs(driven["deviation"][late]).max() < 0.01
    assert driven["distance"][-1] == pytest.approx(300 - law, abs=2.0)
    np.testing.assert_allclose(np.diff(driven["time"]), STEP)


def test_understeer_drives_a_curve_wide_as_far_as_the_geometry_says() -> None:
    """The car turns δ/(L + K v²); steady pursuit at e outside has 2 L sin α / h = (L + K v²) κ_car."""
    speed, h = 15.0, 12.0
    driven = drive_track(bend(1 / 100, speed, 600.0), constant(h), CAR)
    e = driven["deviation"][-1]
    radius = 100.0 - e  # of the circle that the rear axle is on
    # the goal point lies on the road's circle, h from the rear axle
    cosine = (radius**2 + h**2 - 100.0**2) / (2 * radius * h)
    sine_alpha = cosine  # α is measured from the tangent, the angle to the centre from the radius
    tangent = (2.8 + 0.002 * speed**2) / radius
    assert 2 * 2.8 * sine_alpha / h == pytest.approx(tangent, rel=2e-3)
    assert e < -0.05


@settings(deadline=None, max_examples=60)
@given(
    speed=st.floats(2.0, 25.0),
    lateral=st.floats(-3.5, 3.5),
    side=st.sampled_from([-3.0, 3.0]),
    lookahead=st.floats(2.0, 40.0),
    known=st.floats(0.0, 1.0),
)
def test_combined_always_returns(speed: float, lateral: float, side: float, lookahead: float, known: float) -> None:
    """Starting 3 m off, at any speed, curvature, lookahead distance, and however strange the inputs are."""
    curvature = max(min(lateral / speed**2, 1 / 12), -1 / 12)
    track = bend(curvature, speed, 150.0 + 15.0 * speed)
    driven = drive_track(track, constant(lookahead), CAR, "combined", WIDE, everywhere(track, known), offset=side)
    late = driven["distance"] > driven["distance"][-1] - 20
    assert abs(driven["deviation"][0] - side) < 0.01
    assert np.abs(driven["deviation"]).max() < 3.6
    assert np.abs(driven["deviation"][late]).max() < 2 * TOLERANCE
    assert np.abs(np.diff(driven["steering_wheel_angle"])).max() <= HANDS * STEP + 1e-6


@settings(deadline=None, max_examples=30)
@given(speed=st.floats(2.0, 25.0), lateral=st.floats(-3.0, 3.0), side=st.sampled_from([-3.0, 3.0]))
def test_controller_alone_returns_to_the_path(speed: float, lateral: float, side: float) -> None:
    """Where nothing is known, the deviation goes to zero and hardly beyond, whatever the driver would do."""
    curvature = max(min(lateral / speed**2, 1 / 12), -1 / 12)
    track = bend(curvature, speed, 150.0 + 15.0 * speed)
    driven = drive_track(track, constant(1.0), CAR, "combined", WIDE, everywhere(track, 0.0), offset=side)
    assert driven["driver_share"].max() < 1e-9
    assert np.abs(driven["deviation"][driven["distance"] > driven["distance"][-1] - 10]).max() < 0.05
    assert (np.sign(side) * driven["deviation"]).min() > -0.5


def made_up_series(seed: int) -> Series:
    """A driver who turns less and slower, and looks farther, the faster the car is."""
    rng = np.random.default_rng(seed)
    n = 3000
    speed = 3.0 + 17.0 * (0.5 + 0.5 * np.sin(np.arange(n) / 150 + seed))
    phase = np.cumsum(0.02 + 0.1 * rng.random(n))
    wheel = 600.0 / speed * np.sin(phase)
    stretch = np.arange(n) // 1000
    deviation = np.degrees(CAR.curvature(wheel, speed) * speed * STEP)
    return Series(
        recording=np.full(n, "a"), time=np.arange(n) * PERIOD, stretch=stretch, course_deviation=deviation,
        speed=speed, steering_wheel_angle=wheel, lookahead=3.0 + 0.8 * speed + rng.normal(0, 0.5, n),
        segment=stretch, fold=np.zeros(n, np.int64),
    )  # fmt: skip


@cache
def limits_of(seed: int) -> DriverLimits:
    return DriverLimits.fit(made_up_series(seed), STEP)


def test_limits_hold_what_they_say_of_the_data() -> None:
    series = made_up_series(3)
    shown = limits_of(3).at(series.speed)
    rate = np.abs(np.diff(series.steering_wheel_angle)) / STEP
    inside = np.diff(series.stretch) == 0
    assert np.mean(np.abs(series.steering_wheel_angle) <= shown.angle) > 0.99
    assert np.mean(rate[inside] <= shown.rate[1:][inside]) > 0.99
    assert np.mean((series.lookahead >= shown.nearest) & (series.lookahead <= shown.farthest)) > 0.95
    slow, fast = (limits_of(3).at(np.array([v])) for v in (4.0, 19.0))
    assert slow.angle[0] > 3 * fast.angle[0]
    assert slow.farthest[0] < fast.nearest[0]


def test_limits_need_something_that_was_shown() -> None:
    series = made_up_series(3)
    unknown = Series(
        **{name: getattr(series, name) for name in Series.__slots__} | {"lookahead": np.full(3000, np.nan)}
    )
    with pytest.raises(ValueError, match="limits need rows with speed, steering and lookahead distance, found none"):
        DriverLimits.fit(unknown, STEP)
    with pytest.raises(ValueError, match="control 'bounded' needs limits"):
        drive_track(lay_track(), constant(5.0), CAR, "bounded")
    with pytest.raises(ValueError, match="'combined' a domain too"):
        drive_track(lay_track(), constant(5.0), CAR, "combined", WIDE)


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 3),
    lookahead=st.floats(0.5, 60.0),
    side=st.floats(-3.0, 3.0),
    control=st.sampled_from(CONTROLS[1:]),
    radii=st.lists(
        st.tuples(st.floats(5.0, 60.0), st.floats(-60.0, 60.0).filter(lambda r: abs(r) > 7)), min_size=1, max_size=4
    ),
)
def test_bounded_never_exceeds_the_limits(
    seed: int, lookahead: float, side: float, control: Control, radii: list[tuple[float, float]]
) -> None:
    """Lookahead, angle and rate of the driver, wherever the car begins and however tight the track is."""
    track = lay_track([(30, 0), *radii, (80, 0)])
    limits = limits_of(seed)
    driven = drive_track(track, constant(lookahead), CAR, control, limits, everywhere(track, 0.5), offset=side)
    angle, distance = driven["driver_angle"], driven["distance"]
    assert (np.abs(angle) <= limits.at(driven["speed"]).angle + 1e-9).all()
    shown = limits.at(track.speed)
    assert (driven["lookahead"] >= np.interp(distance, track.distance, shown.nearest) - 1e-9).all()
    assert (driven["lookahead"] <= np.interp(distance, track.distance, shown.farthest) + 1e-9).all()
    # Between two rows ten steps are made, each at the limit of its place.
    places = zip((distance[:-1] / SPACING).astype(int), (distance[1:] / SPACING).astype(int) + 2, strict=True)
    most = np.array([shown.rate[first:stop].max() for first, stop in places])
    assert (np.abs(np.diff(angle)) <= most * STEP + 1e-9).all()
    if control == "bounded":
        np.testing.assert_allclose(driven["steering_wheel_angle"], angle, atol=1e-9)


def test_controller_takes_over_by_and_by_where_the_inputs_are_strange() -> None:
    np.testing.assert_allclose(share_within(np.array([0.0, 1e-4, 1e-3, 10**-2.5, 1e-2, 0.5])), [0, 0, 0, 0.5, 1, 1])
    track = bend(0.0, 10.0)
    domain = np.where(np.arange(len(track.inputs)) < 600, 1.0, 0.0)
    driven = drive_track(track, constant(8.0), CAR, "combined", WIDE, domain)
    share = driven["driver_share"]
    assert share[driven["distance"] < 149].min() == 1.0
    assert share[-1] < 0.01
    assert np.abs(np.diff(share)).max() < 0.25


def test_measures_are_those_of_plain_loops() -> None:
    track = bend(0.01, 10.0)
    known = Track(
        track.x, track.y, track.course, track.curvature, track.speed, np.full(len(track.x), 12.0),
        np.full(len(track.x), 7.0), np.zeros(len(track.x)),
    )  # fmt: skip
    driven = drive_track(known, constant(9.0), CAR, offset=0.5)
    found = measure([(known, driven), (known, driven)])
    deviation, angle = driven["deviation"].tolist(), driven["steering_wheel_angle"].tolist()
    rates = [(b - a) / 0.1 for a, b in pairwise(angle)]
    changes = [(b - a) / 0.1 for a, b in pairwise(rates)]
    assert found["tracking_rms"] == pytest.approx(math.sqrt(sum(e * e for e in deviation) / len(deviation)))
    assert found["tracking_max"] == pytest.approx(max(abs(e) for e in deviation))
    assert found["steering_rate_rms"] == pytest.approx(math.sqrt(sum(r * r for r in rates) / len(rates)))
    assert found["steering_change_rms"] == pytest.approx(math.sqrt(sum(c * c for c in changes) / len(changes)))
    assert found["steering_error"] == pytest.approx(sum(abs(a - 12.0) for a in angle) / len(angle))
    assert found["lookahead_error"] == pytest.approx(2.0)
    assert found["taken_over"] == 0.0
    assert found["seconds"] == pytest.approx(2 * 0.1 * len(angle))
    nobody = measure([(track, as_driven(track))])
    assert nobody["tracking_rms"] is nobody["steering_error"] is nobody["tracking_max"] is None


def test_simple_laws() -> None:
    speed = np.linspace(2, 20, 50)
    inputs = np.column_stack([np.zeros(50), speed])
    laws = fit_simple_laws(inputs, 4.0 + 0.7 * speed)
    assert isinstance(laws["linear"], LinearLookahead)
    assert (laws["linear"].base, laws["linear"].time) == pytest.approx((4.0, 0.7))
    np.testing.assert_allclose(laws["linear"].predict(inputs)[0], 4.0 + 0.7 * speed)
    np.testing.assert_allclose(laws["constant"].predict(inputs)[0], 4.0 + 0.7 * 11.0)


@pytest.fixture(scope="module")
def simulated() -> tuple[pa.Table, Reference, Bicycle]:
    """Six minutes of a simulated driver at 10 Hz in the dataset's columns, the centre line, and the car.

    The lookahead distances are the true ones.
    """
    campaign = draw_campaign(5, 1, 1, 6.0)
    truth, road, _, _, motion, _ = drive_trip(Path(), campaign, 0)
    truth = truth.take(np.arange(0, len(truth), 10))
    usable = (
        np.isfinite(truth["lookahead"].to_numpy()) & ~truth["emergency"].to_numpy() & (truth["speed"].to_numpy() > 0.5)
    )
    run = np.cumsum(np.diff(usable, prepend=False) != 0).astype(np.int32)
    columns = {name: truth[name] for name in ("time", "x", "y", "course", "speed", "steering_wheel_angle", "lookahead")}
    deviation = course_deviation(truth["course"].to_numpy(), run)
    table = pa.table({**columns, "run": run, "course_deviation": pa.array(deviation)}).filter(pa.array(usable))
    stop = np.searchsorted(road.s, motion.arc_length[-1] + 100)
    s = np.arange(0.0, road.s[stop], REFERENCE_SPACING)
    line = Reference(np.interp(s, road.s, road.x), np.interp(s, road.s, road.y), False, Path("line"))
    car = campaign.car
    return table, line, Bicycle(car.wheelbase, car.steering_ratio, car.understeer_gradient)


def test_recorded_tracks_hold_what_was_driven(simulated: tuple[pa.Table, Reference, Bicycle]) -> None:
    table, line, car = simulated
    driven, along = recorded_tracks(table, PERIOD), recorded_tracks(table, PERIOD, line)
    assert 1 < len(driven) == len(along)
    for track in driven:
        needed = car.steering_wheel_angle(track.curvature, track.speed)
        assert np.sqrt(np.mean(np.square(needed - track.steering_wheel_angle))) < 8.0
        assert (track.speed > 1.0).all()
        assert not track.deviation.any()
    for track in along:
        np.testing.assert_allclose(np.hypot(np.diff(track.x), np.diff(track.y)), SPACING, rtol=0.02)
        assert np.abs(track.deviation).max() < 2.5
        assert track.start == pytest.approx((track.deviation[0], 0.0), abs=0.2)
    told = as_driven(along[0])
    speed = np.interp(told["distance"], along[0].distance, along[0].speed)
    moved = np.diff(told["distance"]) / STEP
    np.testing.assert_allclose(moved[20:], ((speed[1:] + speed[:-1]) / 2)[20:], rtol=0.05)


class TrueLaw:
    """How far ahead the simulated driver looks."""

    def predict(self, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        return draw_campaign(5, 1, 1, 6.0).trips[0].driver.lookahead(inputs[:, 1]), np.zeros(len(inputs))


def test_the_drivers_own_law_drives_as_the_driver_did(simulated: tuple[pa.Table, Reference, Bicycle]) -> None:
    """But for the hands' lag, their unsteadiness and the slip of the rear axle, which this car has not."""
    table, line, car = simulated
    tracks = recorded_tracks(table, PERIOD, line)
    found = measure([(track, drive_track(track, TrueLaw(), car)) for track in tracks])
    driver = measure([(track, as_driven(track)) for track in tracks])
    assert found["steering_error"] < 2.0
    assert found["lookahead_error"] < 0.05
    assert found["tracking_rms"] == pytest.approx(driver["tracking_rms"], rel=0.35)


def test_velocity_based_law_agrees_with_the_driver_better_than_a_constant(
    simulated: tuple[pa.Table, Reference, Bicycle],
) -> None:
    """Learnt from a driver whose law is known, on that driver's road, in the same car."""
    table, line, car = simulated
    inputs = np.column_stack([table["course_deviation"].to_numpy(), table["speed"].to_numpy()])
    lookahead = table["lookahead"].to_numpy()
    known = np.isfinite(inputs).all(axis=1)
    inputs, lookahead = inputs[known], lookahead[known]
    laws = {
        **fit_simple_laws(inputs, lookahead),
        "velocity": VelocityLookahead(6, 3, starts=2).fit(inputs, lookahead),
        "general": GeneralLookahead(6, starts=2).fit(inputs, lookahead),
    }
    tracks = recorded_tracks(table, PERIOD, line)
    found = {name: measure([(track, drive_track(track, law, car)) for track in tracks]) for name, law in laws.items()}
    for name in ("velocity", "general", "linear"):
        assert found[name]["lookahead_error"] < 0.5 * found["constant"]["lookahead_error"], name
        assert found[name]["steering_error"] < 0.6 * found["constant"]["steering_error"], name
    driver = measure([(track, as_driven(track)) for track in tracks])
    assert abs(found["velocity"]["tracking_rms"] - driver["tracking_rms"]) < abs(
        found["constant"]["tracking_rms"] - driver["tracking_rms"]
    )
