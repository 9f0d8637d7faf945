"""Axes and units of navigation, against pyproj, rotation matrices and brute force."""

from __future__ import annotations

import json
from itertools import combinations, pairwise

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pyproj import Geod, Transformer
from scipy.spatial.transform import Rotation

from wheelprint.ingest.motion import near_cosine, near_sine, wrapped
from wheelprint.ingest.navigation import (
    GRAVITY,
    Origin,
    anticlockwise_from_east,
    horizontal_motion,
    is_on_earth,
    local_position,
    longest_increasing,
    merge_navigation,
    navigation_batch,
    origin_metadata,
    remove_gravity,
)
from wheelprint.schemas.angles import wrap_degrees
from wheelprint.schemas.signals import SIGNALS
from wheelprint.schemas.tables import NAVIGATION

START = 1_700_000_000_000_000_000


def doubles(*values: float) -> npt.NDArray[np.float64]:
    return np.array(values, np.float64)


class TestLocalPosition:
    @pytest.mark.parametrize(
        "origin",
        [Origin(53.1, -2.47, 54.0), Origin(-33.9, 179.999, 0.0), Origin(0.0, 0.0, 3000.0), Origin(78.2, 15.6, 5)],
    )
    def test_agrees_with_pyproj(self, origin: Origin) -> None:
        random = np.random.default_rng(1)
        latitude = origin.latitude + random.uniform(-0.5, 0.5, 200)
        longitude = origin.longitude + random.uniform(-0.5, 0.5, 200)
        longitude = np.where(longitude >= 180, longitude - 360, longitude)
        altitude = origin.altitude + random.uniform(-100, 100, 200)
        reference = Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 +step "
            f"+proj=topocentric +ellps=WGS84 +lon_0={origin.longitude} +lat_0={origin.latitude} +h_0={origin.altitude}"
        )
        east, north, _ = reference.transform(longitude, latitude, altitude)
        x, y = local_position(latitude, longitude, altitude, origin)
        assert np.abs(x - east).max() < 1e-7
        assert np.abs(y - north).max() < 1e-7

    def test_agrees_with_pyproj_on_the_other_side_of_the_earth(self) -> None:
        reference = Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 +step "
            "+proj=topocentric +ellps=WGS84 +lon_0=11 +lat_0=48 +h_0=5"
        )
        latitude, longitude = doubles(48.0, -33.0, 48.0, 90.0), doubles(11.0, 11.0, 151.0, -170.0)
        east, north, _ = reference.transform(longitude, latitude, np.full(4, 5.0))
        x, y = local_position(latitude, longitude, np.full(4, np.nan), Origin(48.0, 11.0, 5.0))
        assert np.abs(x - east).max() < 1e-7
        assert np.abs(y - north).max() < 1e-7

    @pytest.mark.parametrize(("distance", "shrinks"), [(100.0, 1e-9), (10_000.0, 1.3e-6), (100_000.0, 1.3e-4)])
    def test_distances_are_those_on_the_ellipsoid(self, distance: float, shrinks: float) -> None:
        azimuths = np.arange(15.0, 360.0, 30.0)
        origin = Origin(48.0, 11.0, 0.0)
        longitude, latitude, _ = Geod(ellps="WGS84").fwd(
            np.full(12, 11.0), np.full(12, 48.0), azimuths, np.full(12, distance)
        )
        x, y = local_position(np.asarray(latitude), np.asarray(longitude), np.zeros(12), origin)
        assert np.hypot(x, y) == pytest.approx(distance, rel=shrinks, abs=1e-6)
        assert np.degrees(np.arctan2(x, y)) % 360 == pytest.approx(azimuths, abs=0.01)

    def test_missing_stays_missing(self) -> None:
        x, y = local_position(
            doubles(48.0, np.nan), doubles(11.0, np.nan), doubles(0.0, np.nan), Origin(48.0, 11.0, 0.0)
        )
        assert (x[0], y[0]) == (0.0, 0.0)
        assert np.isnan(x[1])
        assert np.isnan(y[1])


class TestDirections:
    def test_anticlockwise_from_east(self) -> None:
        compass = doubles(0, 45, 90, 180, 270, 315, -90, 271, 720)
        assert anticlockwise_from_east(compass).tolist() == [90, 45, 0, -90, -180, 135, -180, 179, 90]

    @given(st.one_of(st.floats(-1e6, 1e6), st.sampled_from((-540.0, -180.0, 180.0, 540.0, np.nan))))
    def test_compiled_code_wraps_as_all_other_does(self, angle: float) -> None:
        assert np.array_equal(wrapped(angle), wrap_degrees(angle), equal_nan=True)

    def test_speed_and_course(self) -> None:
        north = doubles(1, 0, -1, 0, -0.0, 3, 0.3, 0.29, np.nan)
        east = doubles(0, 1, 0, -1, -1, 4, 0.4, 0.4, 1)
        speed, course = horizontal_motion(north, east)
        assert speed.tolist() == pytest.approx([1, 1, 1, 1, 1, 5, 0.5, np.hypot(0.29, 0.4), np.nan], nan_ok=True)
        expected = [90, 0, -90, -180, -180, 36.8698976, 36.8698976, np.nan, np.nan]
        assert course.tolist() == pytest.approx(expected, nan_ok=True)


class TestSeries:
    """What vector units add up, against the C library."""

    @given(angle=st.one_of(st.floats(-np.pi / 4, np.pi / 4), st.sampled_from((np.pi / 4, 1e-8, 0.0, np.nan))))
    def test_sines_and_cosines(self, angle: float) -> None:
        assert near_sine(angle) == pytest.approx(np.sin(angle), rel=1e-15, abs=0, nan_ok=True)
        assert near_cosine(angle) == pytest.approx(np.cos(angle), rel=1e-15, abs=0, nan_ok=True)

    @pytest.mark.parametrize("largest", [0.01, np.pi / 4, 1.0, 100.0])
    def test_gravity_at_any_angle(self, largest: float) -> None:
        pitch, roll = np.random.default_rng(0).uniform(-largest, largest, (2, 1001))
        forward, left = remove_gravity(np.zeros((1001, 3)), pitch, roll)
        assert forward == pytest.approx(-GRAVITY * np.sin(pitch), rel=1e-15, abs=0)
        assert left == pytest.approx(-GRAVITY * np.cos(pitch) * np.sin(roll), rel=1e-15, abs=0)

    @given(north=st.floats(-1e3, 1e3), east=st.floats(-1e3, 1e3))
    def test_courses(self, north: float, east: float) -> None:
        assume(np.hypot(north, east) > 0.51)
        speed, course = horizontal_motion(doubles(north), doubles(east))
        assert speed[0] == pytest.approx(np.hypot(north, east), rel=1e-15)
        assert wrap_degrees(course[0] - np.degrees(np.arctan2(north, east))) == pytest.approx(0, abs=6e-14)
        assert -180 <= course[0] < 180


class TestGravity:
    @given(seed=st.integers(0, 2**32 - 1))
    def test_it_is_what_rotation_matrices_say(self, seed: int) -> None:
        random = np.random.default_rng(seed)
        heading, pitch, roll = random.uniform([-np.pi, -0.4, -0.4], [np.pi, 0.4, 0.4], (20, 3)).T
        body_to_ned = Rotation.from_euler("ZYX", np.stack([heading, pitch, roll], axis=1))
        acceleration = random.uniform(-10, 10, (20, 3))
        measured = acceleration - body_to_ned.inv().apply([0.0, 0.0, GRAVITY])
        longitudinal, lateral = remove_gravity(measured, pitch, roll)
        assert longitudinal == pytest.approx(acceleration[:, 0], abs=1e-12)
        assert lateral == pytest.approx(-acceleration[:, 1], abs=1e-12)

    def test_a_car_parked_nose_up_and_leaning_right_does_not_accelerate(self) -> None:
        pitch, roll = 0.1, 0.05
        measured = doubles(0.979, -0.488, -9.745)[None] * GRAVITY / 9.80665
        longitudinal, lateral = remove_gravity(measured, doubles(pitch), doubles(roll))
        assert abs(longitudinal[0]) < 1e-3
        assert abs(lateral[0]) < 1e-3

    def test_without_angles_it_stays(self) -> None:
        measured = np.tile([1.0, 2.0, -9.8], (3, 1))
        longitudinal, lateral = remove_gravity(measured, doubles(np.nan, 0.1, 0.0), doubles(0.1, np.nan, 0.0))
        assert longitudinal.tolist() == [1.0, 1.0, 1.0]
        assert lateral.tolist() == [-2.0, -2.0, -2.0]


class TestLongestIncreasing:
    @given(stamps=st.lists(st.integers(0, 12), max_size=9), after=st.integers(-1, 4))
    def test_no_larger_choice_exists(self, stamps: list[int], after: int) -> None:
        kept = longest_increasing(np.array(stamps, np.int64), after)
        chosen = [stamp for stamp, keep in zip(stamps, kept, strict=True) if keep]
        assert all(a < b for a, b in pairwise([after, *chosen]))
        longer = combinations(stamps, len(chosen) + 1)
        assert not any(all(a < b for a, b in pairwise([after, *choice])) for choice in longer)

    @given(stamps=st.lists(st.integers(0, 5), min_size=1, max_size=9).map(sorted))
    def test_the_first_of_equal_stamps_is_kept(self, stamps: list[int]) -> None:
        kept = longest_increasing(np.array(stamps, np.int64), -1)
        assert np.flatnonzero(kept).tolist() == [stamps.index(stamp) for stamp in sorted(set(stamps))]

    def test_what_lies_before_is_not_repeated(self) -> None:
        assert longest_increasing(np.array([5, 6, 7]), 6).tolist() == [False, False, True]
        assert longest_increasing(np.array([], np.int64), 6).tolist() == []


def table(start: int, latitudes: list[float], origin: Origin | None, utc_from: str = "here") -> pa.Table:
    """A log that drives north along a meridian, one sample a second."""
    latitude = doubles(*latitudes)
    signals: dict[str, npt.NDArray[np.generic]] = {"nav_status": np.full(len(latitude), 4, np.uint8)}
    if origin is not None:
        longitude, altitude = np.full(len(latitude), 11.0), np.zeros(len(latitude))
        x, y = local_position(latitude, longitude, altitude, origin)
        signals |= {"latitude": latitude, "longitude": longitude, "altitude": altitude, "x": x, "y": y}
    time = START + (start + np.arange(len(latitude))) * 1_000_000_000
    metadata = {"origin": origin_metadata(origin), "utc_from": utc_from}
    return pa.Table.from_batches([navigation_batch(time, signals, metadata)])


class TestTables:
    def test_a_batch_has_every_column(self) -> None:
        batch = navigation_batch(
            np.array([START]),
            {"latitude": doubles(48.0), "course": doubles(np.nan), "nav_status": np.array([4], np.uint8)},
            {"origin": origin_metadata(Origin(48.0, 11.0, 500.0))},
        )
        assert batch.schema.remove_metadata().equals(NAVIGATION)
        assert batch.schema.field("latitude").metadata == NAVIGATION.field("latitude").metadata
        (row,) = batch.to_pylist()
        assert {name: value for name, value in row.items() if value is not None} == {
            "time": row["time"], "latitude": 48.0, "nav_status": 4,
        }  # fmt: skip
        assert row["time"].isoformat() == "2023-11-14T22:13:20+00:00"
        assert json.loads(batch.schema.metadata[b"origin"]) == {"latitude": 48.0, "longitude": 11.0, "altitude": 500.0}

    def test_one_log_stays_as_it_is(self) -> None:
        only = table(0, [48.0, 48.001], Origin(48.0, 11.0, 0.0))
        assert merge_navigation([only]).equals(only, check_metadata=True)
        empty = only.slice(0, 0)
        assert merge_navigation([empty]).equals(empty, check_metadata=True)
        assert merge_navigation([empty, only]).equals(only, check_metadata=True)

    def test_logs_are_joined_around_the_first_origin(self) -> None:
        first = table(0, [48.0, 48.001, 48.002], Origin(48.0, 11.0, 0.0), "there")
        second = table(2, [48.002, 48.003], Origin(48.002, 11.0, 0.0))
        whole = table(0, [48.0, 48.001, 48.002, 48.003], Origin(48.0, 11.0, 0.0), "there")
        merged = merge_navigation([second, first])
        assert merged.equals(whole, check_metadata=True)

    def test_a_log_without_a_position_lends_no_origin(self) -> None:
        blind = table(0, [0.0, 0.0], None)
        merged = merge_navigation([blind, table(5, [48.0], Origin(48.0, 11.0, 0.0))])
        assert json.loads(merged.schema.metadata[b"origin"]) == {"latitude": 48.0, "longitude": 11.0, "altitude": 0.0}
        assert merged["x"].to_pylist() == [None, None, 0.0]
        assert len(merge_navigation([blind, table(9, [0.0], None)])) == 3


def test_a_position_is_on_earth_up_to_its_limits() -> None:
    lowest, highest = SIGNALS["altitude"].minimum, SIGNALS["altitude"].maximum
    limits = ((-90.0, 90.0), (-180.0, 180.0), (lowest, highest))
    inside, (past, unknown) = [0.0, 0.0, 100.0], (np.inf, np.nan)
    places, expected = [inside], [True]
    for column, (low, high) in enumerate(limits):
        for value in (low, high, np.nextafter(low, -past), np.nextafter(high, past), -past, past, unknown):
            places.append([value if number == column else usual for number, usual in enumerate(inside)])
            expected.append(low <= value <= high)
    latitude, longitude, altitude = np.array(places).T
    assert is_on_earth(latitude, longitude, altitude).tolist() == expected
