"""The logs say what the truth says: read by python-can, cantools and a few lines written from the NCOM manual."""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Iterable
from importlib import resources
from types import SimpleNamespace
from typing import Any

import can
import cantools
import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pytest
from pyproj import Geod

from wheelprint.modeling.simulation.logs import MAPPING, MESSAGE_RATES, UNKNOWN_RATES, CanClock, navigation_log
from wheelprint.modeling.simulation.truth import Origin, geodetic

Decoded = dict[str, tuple[npt.NDArray[np.int64], dict[str, npt.NDArray[np.float64]]]]


def database() -> Any:
    text = (resources.files("wheelprint.schemas.databases") / "byd_tang.dbc").read_text(encoding="utf-8")
    return cantools.database.load_string(text, "dbc")


@pytest.fixture(scope="module")
def frames(eventful: SimpleNamespace) -> list[can.Message]:
    return list(can.CanutilsLogReader(eventful.folder / "can.log"))


def decoded(recording: SimpleNamespace, frames: Iterable[can.Message]) -> Decoded:
    """Decode a log frame by frame: by message, UTC in ns as the truth's clock has it, and the signals."""
    known = {message.frame_id: message for message in database().messages}
    times: dict[str, list[int]] = defaultdict(list)
    values: dict[str, list[dict[str, float]]] = defaultdict(list)
    clock, start = recording.trip.clock, recording.time[0]
    for frame in frames:
        if frame.is_error_frame or frame.arbitration_id not in known:
            continue
        message = known[frame.arbitration_id]
        # CAN stamp = UTC + offset + drift·(UTC - start), solved for UTC.
        stamp = round(frame.timestamp * 1e6) * 1000
        elapsed = (stamp - round(clock.offset * 1e9) - start) / (1 + clock.drift * 1e-6)
        times[message.name].append(start + round(elapsed))
        values[message.name].append(message.decode(frame.data, decode_choices=False))
    return {
        name: (np.array(times[name]), {key: np.array([v[key] for v in values[name]], float) for key in values[name][0]})
        for name in times
    }


@pytest.fixture(scope="module")
def exact(silent: SimpleNamespace) -> Decoded:
    return decoded(silent, can.CanutilsLogReader(silent.folder / "can.log"))


@pytest.mark.parametrize(
    ("canonical", "factor", "offset"),
    [
        ("steering_wheel_angle", 1.0, 2.3),
        ("steering_wheel_speed", 1.0, 0.0),
        ("speed", 3.6, 0.0),
        ("accelerator_pedal", 1.0, 0.0),
        ("brake_pressure", 1.0, 0.0),
        ("yaw_rate", 1.0, 0.0),
        ("longitudinal_acceleration", 1.0, 0.0),
        ("lateral_acceleration", 1.0, 0.0),
    ],
)
def test_signals_are_the_truth_within_quantisation(
    silent: SimpleNamespace, exact: Decoded, canonical: str, factor: float, offset: float
) -> None:
    message, signal = MAPPING[canonical].split(".")
    time, values = exact[message]
    expected = factor * np.interp(time - silent.time[0], silent.time - silent.time[0], silent.truth[canonical]) + offset
    quantum = database().get_message_by_name(message).get_signal_by_name(signal).scale
    # A stamp in whole µs is late by less than one: no signal changes by a hundredth of its quantum meanwhile.
    assert np.abs(values[signal] - expected).max() <= 0.505 * quantum
    assert np.ptp(expected) > 20 * quantum


def test_the_vocabulary_of_the_bus_is_mapped(silent: SimpleNamespace) -> None:
    from wheelprint.schemas.config import read_config
    from wheelprint.schemas.signals import CAN_SIGNALS

    config = read_config(silent.directory / "wheelprint.toml")
    assert {name: mapped.signal for name, mapped in config.can.signals.items()} == MAPPING
    assert set(CAN_SIGNALS) - set(MAPPING) == {"brake_pedal", "abs_active", "esc_active"}
    assert (config.vehicle.wheelbase, config.vehicle.steering_ratio, config.vehicle.steering_offset) == (
        2.82,
        "estimate",
        "estimate",
    )


def test_wheel_speeds_and_states(silent: SimpleNamespace, exact: Decoded) -> None:
    time, wheels = exact["WHEEL_SPEEDS"]
    speed = 3.6 * np.interp(time - silent.time[0], silent.time - silent.time[0], silent.truth["speed"])
    assert np.abs((wheels["REAR_LEFT"] + wheels["REAR_RIGHT"]) / 2 - speed).max() < 0.11
    assert (wheels["FRONT_LEFT"] + wheels["FRONT_RIGHT"]).mean() > (wheels["REAR_LEFT"] + wheels["REAR_RIGHT"]).mean()
    time, states = exact["DRIVE_STATE"]
    gear = silent.truth["gear"][np.searchsorted(silent.time, time, side="right") - 1]
    assert np.array_equal(states["GEAR"], gear)
    assert set(gear) == {1, 4}
    pressure = np.interp(time - silent.time[0], silent.time - silent.time[0], silent.truth["brake_pressure"])
    clear = np.abs(pressure - 1) > 0.8
    assert np.array_equal(states["BRAKE_SWITCH"][clear], (pressure > 1)[clear])


def test_checksums_rates_unknown_identifiers_and_error_frames(frames: list[can.Message]) -> None:
    by_id = defaultdict(list)
    for frame in frames:
        if not frame.is_error_frame:
            by_id[frame.arbitration_id].append(frame)
    lengths = {message.frame_id: message.length for message in database().messages}
    rates = {database().get_message_by_name(name).frame_id: rate for name, rate in MESSAGE_RATES.items()}
    assert set(by_id) == set(lengths) | set(UNKNOWN_RATES)
    for identifier, rate in (rates | UNKNOWN_RATES).items():
        # Four minutes but for the gap of 1.5 s.
        assert abs(len(by_id[identifier]) - rate * 238.5) <= 2
    for identifier, some in by_id.items():
        assert {len(frame.data) for frame in some} == {lengths.get(identifier, 8)}
        if len(some[0].data) == 8:
            assert all(frame.data[7] == 0xFF - sum(frame.data[:7]) % 256 for frame in some)
    assert 1 <= sum(frame.is_error_frame for frame in frames) <= 12


def test_stamps_are_utc_on_the_logger_s_clock_within_jitter(
    eventful: SimpleNamespace, frames: list[can.Message]
) -> None:
    clock, start = eventful.trip.clock, eventful.time[0]
    stamps = [round(frame.timestamp * 1e6) * 1000 for frame in frames]
    assert stamps == sorted(stamps)
    is_steering = np.array([frame.arbitration_id == 0x11F for frame in frames])
    steering = np.array(stamps, np.int64)[is_steering]
    elapsed = (steering - round(clock.offset * 1e9) - start) / (1 + clock.drift * 1e-6)
    cycle = np.rint((elapsed - elapsed[0]) / 1e7)
    error = elapsed - elapsed[0] - cycle * 1e7
    assert np.ptp(error) <= 2 * 300_000 + 1000
    assert np.ptp(error) > 500_000
    # Neither offset nor drift is hidden by the jitter: the drift alone moves the last stamp by 9.6 ms.
    assert 0 <= elapsed[0] + 300_000 < 1.07e7
    assert 0 <= 240e9 - elapsed[-1] + 300_000 < 2.1e7
    without_drift = steering - steering[0] - np.rint((steering - steering[0]) / 1e7) * 1e7
    assert np.ptp(without_drift) > 9e6


def test_clock_stamps_exactly() -> None:
    start = 1_715_562_000_000_000_000
    time = start + np.array([0, 1, 100_000_000_000], np.int64)
    assert (CanClock(-1.5, 25.0).stamp(time, start) - start).tolist() == [
        -1_500_000_000,
        -1_499_999_999,
        98_502_500_000,
    ]


def test_gaps_are_empty_and_nothing_else(eventful: SimpleNamespace, frames: list[can.Message]) -> None:
    clock = eventful.trip.clock
    can_time = np.array([frame.timestamp for frame in frames]) - clock.offset - eventful.time[0] / 1e9
    silence = np.diff(can_time)
    assert silence.max() == pytest.approx(1.5, abs=0.02)
    assert can_time[silence.argmax()] == pytest.approx(60.0, abs=0.02)
    assert np.sort(silence)[-2] < 0.02
    packets = read_ncom(eventful)
    steps = np.diff(packets["time"])
    assert sorted(set(steps.tolist())) == [10, 2010]
    assert packets["time"][steps.argmax()] - packets["time"][0] == 89_990


def read_ncom(recording: SimpleNamespace) -> dict[str, npt.NDArray[Any]]:
    """Read packets by the manual: `time` is ms since the first packet, angles are degrees."""
    content = (recording.folder / "nav.ncom").read_bytes()
    found: dict[str, list[Any]] = defaultdict(list)
    minute = 0
    for at in range(0, len(content), 72):
        packet = content[at : at + 72]
        assert packet[0] == 0xE7
        assert packet[71] == sum(packet[1:71]) % 256
        triples = {
            name: [int.from_bytes(packet[i : i + 3], "little", signed=True) for i in (first, first + 3, first + 6)]
            for name, first in (("acceleration", 3), ("rate", 12), ("velocity", 43), ("orientation", 52))
        }
        milliseconds = struct.unpack_from("<H", packet, 1)[0]
        if found["milliseconds"] and milliseconds < found["milliseconds"][-1]:
            minute += 60_000
        found["milliseconds"].append(milliseconds)
        found["time"].append(minute + milliseconds)
        found["status"].append(packet[21])
        latitude, longitude, altitude = struct.unpack_from("<ddf", packet, 23)
        found["latitude"].append(np.degrees(latitude))
        found["longitude"].append(np.degrees(longitude))
        found["altitude"].append(altitude)
        found["acceleration"].append([1e-4 * count for count in triples["acceleration"]])
        found["rate"].append([np.degrees(1e-5 * count) for count in triples["rate"]])
        found["velocity"].append([1e-4 * count for count in triples["velocity"]])
        found["orientation"].append([np.degrees(1e-6 * count) for count in triples["orientation"]])
        if packet[62] == 0:
            # GPS runs 18 s ahead of UTC, and the minute belongs to its packet.
            minutes = struct.unpack_from("<i", packet, 63)[0]
            found["utc"].append([len(found["time"]) - 1, minutes * 60_000 + milliseconds + 315_964_800_000 - 18_000])
    packets = {name: np.array(values) for name, values in found.items()}
    packets["time"] -= packets["time"][0]
    return packets


def test_navigation_is_the_truth_in_the_unit_s_own_axes(silent: SimpleNamespace) -> None:
    packets, truth = read_ncom(silent), silent.truth
    assert len(packets["time"]) == 12_000
    assert set(packets["status"]) == {4}
    rows, utc = packets["utc"].T
    assert np.array_equal(utc, silent.time[rows] // 1_000_000)
    assert np.abs(packets["latitude"] - truth["latitude"]).max() < 1e-9
    assert np.abs(packets["longitude"] - truth["longitude"]).max() < 1e-9
    assert np.abs(packets["altitude"] - truth["altitude"]).max() < 1e-4
    north, east, down = packets["velocity"].T
    assert np.abs(np.hypot(north, east) - truth["speed"]).max() < 2e-4
    assert np.abs(down).max() < 0.01
    moving = truth["speed"] > 3
    course = np.degrees(np.arctan2(north, east))
    for angle, expected, rows_used in (
        (course, truth["course"], moving),
        (90 - packets["orientation"][:, 0], truth["heading"], np.ones(len(moving), bool)),
    ):
        # Up to the convergence of the meridians: a few hundredths of a degree within kilometres.
        assert np.abs((angle - expected + 180) % 360 - 180)[rows_used].max() < 0.05
    assert np.abs(packets["rate"][:, 2] + truth["yaw_rate"]).max() < 1e-3
    assert np.abs(packets["acceleration"][:, 0] - truth["longitudinal_acceleration"]).max() < 1e-4
    assert np.abs(packets["acceleration"][:, 1] + truth["lateral_acceleration"]).max() < 1e-4
    assert np.abs(packets["acceleration"][:, 2] + 9.80665).max() < 1e-4


def test_velocity_points_along_the_geodesic_between_positions(silent: SimpleNamespace) -> None:
    """Eight kilometres east of the origin north is 0.06 degrees from where it was there."""
    origin = Origin(**silent.entry["origin"])
    x = silent.truth["x"] + 8000.0
    moved = silent.table
    for name, values in zip(
        ("x", "latitude", "longitude", "altitude"), (x, *geodetic(x, silent.truth["y"], origin)), strict=True
    ):
        moved = moved.set_column(moved.column_names.index(name), moved.schema.field(name), pa.array(values))
    log = navigation_log(np.random.default_rng(0), moved, silent.campaign.sensors, origin, ())

    north, east, _ = log.velocity.T
    first, middle, last = slice(0, -20, 50), slice(10, -10, 50), slice(20, None, 50)
    azimuth, _, distance = Geod(ellps="WGS84").inv(
        log.longitude[first], log.latitude[first], log.longitude[last], log.latitude[last]
    )
    steady = (distance > 1.0) & (np.abs(silent.truth["yaw_rate"][middle]) < 0.5)
    assert steady.sum() > 50
    error = (np.degrees(np.arctan2(east[middle], north[middle])) - azimuth + 180) % 360 - 180
    assert np.abs(error[steady]).max() < 0.01
    assert np.hypot(north, east)[middle] == pytest.approx(distance / 0.2, abs=0.05)
    turned = np.degrees(log.orientation[:, 0]) - (90 - silent.truth["heading"])
    assert turned == pytest.approx(np.full(len(turned), 0.06), abs=0.01)


def test_noise_of_sensors_is_small_and_there(eventful: SimpleNamespace, frames: list[can.Message]) -> None:
    sensors = eventful.campaign.sensors
    time, steer = decoded(eventful, (frame for frame in frames if frame.arbitration_id == 0x11F))["STEER"]
    true = np.interp(time - eventful.time[0], eventful.time - eventful.time[0], eventful.truth["steering_wheel_angle"])
    quiet = ~eventful.truth["emergency"][np.searchsorted(eventful.time, time, side="right") - 1]
    error = (steer["ANGLE"] - true - 2.3)[quiet]
    assert abs(error.mean()) < 0.01
    assert sensors.steering_wheel_angle < error.std() < 2 * sensors.steering_wheel_angle + 0.03
    packets = read_ncom(eventful)
    rows = np.searchsorted(eventful.time, eventful.time[0] + packets["time"] * 1_000_000)
    north = (packets["latitude"] - eventful.truth["latitude"][rows]) * 111_000
    assert 0.3 * sensors.position < north.std() < 2 * sensors.position
    assert np.diff(north).std() < 0.01
    rate_error = packets["rate"][:, 2] + eventful.truth["yaw_rate"][rows]
    assert rate_error.std() == pytest.approx(sensors.nav_yaw_rate, rel=0.05)
