"""Real NCOM logs, packet by packet against a plain decoder written from the description of the format."""

from __future__ import annotations

import json
import math
import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pytest

from wheelprint.ingest.account import Account
from wheelprint.ingest.oxts.ncom import Ncom
from wheelprint.ingest.oxts.ncom_packets import NcomPackets

LOGS = ("oxts/NAVsdk_example2.ncom", "rav4/nav.ncom", "gr86/raw/car55/indianapolis_06/nav.ncom")

Fields = dict[str, list[float | None]]


def plain_decoder(content: bytes, utc_offset: int) -> tuple[Fields, list[int]]:
    """Decode one packet after another, as the NCOM manual describes it.

    Returns:
        Every field of every packet, None where invalid, and every packet's stamp in ns UTC: forwards as OxTS's decoder
        counts minutes, and backwards from the first minute that is told.
    """
    integers = (
        ("acceleration", 3, 1e4), ("angular_rate", 12, 1e5), ("velocity", 43, 1e4), ("orientation", 52, 1e6),
    )  # fmt: skip
    fields: Fields = {}
    minutes: list[int | None] = []
    milliseconds: list[int] = []
    place = 0
    while place + 72 <= len(content):
        packet = content[place : place + 72]
        if packet[0] != 0xE7 or sum(packet[1:71]) % 256 != packet[71]:
            place += 1
            continue
        row: dict[str, float | None] = {"offset": place, "status": packet[21], "channel": packet[62]}
        for name, start, counts in integers:
            for axis in range(3):
                octets = packet[start + 3 * axis : start + 3 * axis + 3]
                integer = int.from_bytes(octets, "little", signed=True)
                row[f"{name}.{axis}"] = None if integer == -8_388_608 else integer / counts
        row["latitude"], row["longitude"] = struct.unpack_from("<dd", packet, 23)
        (row["altitude"],) = struct.unpack_from("<f", packet, 39)
        for index in range(8):
            row[f"batch.{index}"] = packet[63 + index]
        row["checksum1"] = packet[22] == sum(packet[1:22]) % 256
        row["checksum2"] = packet[61] == sum(packet[1:61]) % 256
        for name, value in row.items():
            fields.setdefault(name, []).append(value)

        (now,) = struct.unpack_from("<H", packet, 1)
        minute = minutes[-1] if minutes else None
        if minute is not None and now < 2000 < milliseconds[-1]:
            minute += 1
        if packet[62] == 0:
            (told,) = struct.unpack_from("<i", packet, 63)
            minute = told if told >= 1000 else minute
        milliseconds.append(now)
        minutes.append(minute)
        place += 72

    for number in range(len(minutes) - 2, -1, -1):
        following = minutes[number + 1]
        if minutes[number] is None and following is not None:
            minutes[number] = following - (milliseconds[number] > milliseconds[number + 1])
    seconds = 315_964_800 + utc_offset
    stamps = [
        (((minute or 0) * 60 + seconds) * 1000 + now) * 1_000_000
        for minute, now in zip(minutes, milliseconds, strict=True)
    ]
    return fields, stamps


def read_samples(path: Path) -> tuple[pa.Table, Account]:
    account = Account()
    return pa.Table.from_batches(list(Ncom(path).batches(account))), account


def column(table: pa.Table, name: str) -> npt.NDArray[np.float64]:
    values: npt.NDArray[np.float64] = table[name].to_numpy().astype(np.float64)
    return values


def seconds(table: pa.Table) -> npt.NDArray[np.float64]:
    time = table["time"].cast(pa.int64()).to_numpy()
    elapsed: npt.NDArray[np.float64] = (time - time[0]) / 1e9
    return elapsed


def wrapped(angle: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    turned: npt.NDArray[np.float64] = (angle + 180) % 360 - 180
    return turned


@pytest.mark.parametrize("name", LOGS)
def test_every_field_of_every_packet_is_what_the_plain_decoder_says(shared_data: Path, name: str) -> None:
    path = shared_data / name
    account = Account()
    (packets,) = Ncom(path).packets(account)
    expected, stamps = plain_decoder(path.read_bytes(), utc_offset=-15 if "NAVsdk" in name else -18)
    assert account == Account(accepted=len(stamps))
    assert len(stamps) * 72 == path.stat().st_size
    assert packets.time_known.all()
    assert packets.time.tolist() == stamps
    for field, values in expected.items():
        attribute, _, axis = field.partition(".")
        found = getattr(packets, attribute)
        found = found[:, int(axis)] if axis else found
        assert [None if isinstance(x, float) and math.isnan(x) else x for x in found.tolist()] == values, field
    assert packets.raw.tobytes() == path.read_bytes()
    compared = {field.partition(".")[0] for field in expected} - {"checksum1", "checksum2"}
    decoded = {name for name, member in vars(NcomPackets).items() if isinstance(member, property)}
    others = {"time", "time_known", "milliseconds", "raw", "checksum1", "checksum2"}
    assert compared | others == set(packets.__slots__) | decoded


def test_the_oxts_example_is_timed_from_its_first_packet_and_by_the_leap_seconds_of_2009(shared_data: Path) -> None:
    table, account = read_samples(shared_data / LOGS[0])
    assert account == Account(accepted=9201)
    assert len(table) == 9201
    time = table["time"].cast(pa.int64()).to_numpy()
    # GPS minute 15,669,160 and 5.4 s, less 15 s; the minute is told for the first time by the fourth packet.
    assert time[0] == (15_669_160 * 60 + 315_964_800 - 15) * 1_000_000_000 + 5_400_000_000
    assert table["time"][0].as_py().isoformat() == "2009-10-21T08:39:50.400000+00:00"
    assert set(np.diff(time).tolist()) == {4_000_000}
    assert table.schema.metadata[b"utc_from"] == b"leap second table"
    assert table["nav_status"].unique().to_pylist() == [4]
    origin = json.loads(table.schema.metadata[b"origin"])
    assert origin == {
        "latitude": table["latitude"][0].as_py(), "longitude": table["longitude"][0].as_py(),
        "altitude": table["altitude"][0].as_py(),
    }  # fmt: skip
    accuracy = column(table, "position_accuracy")
    first = int(np.flatnonzero(~np.isnan(accuracy))[0])
    assert first < 100
    assert np.nanmin(accuracy) > 0.3
    assert np.nanmax(accuracy) < 0.4


def test_without_gravity_accelerations_are_the_derivative_of_velocity(shared_data: Path) -> None:
    """Real ones of a car that brakes and turns on a slope of 2 degrees: the signs of pitch and roll matter."""
    path = shared_data / LOGS[0]
    table, _ = read_samples(path)
    (packets,) = Ncom(path).packets(Account())
    heading = packets.orientation[:, 0]
    step, period = 50, 0.004
    rate = (packets.velocity[2 * step :] - packets.velocity[: -2 * step]) / (2 * step * period)
    inner = slice(step, -step)
    forward = rate[:, 0] * np.cos(heading[inner]) + rate[:, 1] * np.sin(heading[inner])
    left = rate[:, 0] * np.sin(heading[inner]) - rate[:, 1] * np.cos(heading[inner])

    def error(values: npt.NDArray[np.float64], reference: npt.NDArray[np.float64]) -> float:
        smooth = np.convolve(values, np.full(2 * step, 0.5 / step), "same")[inner]
        return float(np.sqrt(np.mean((smooth - reference) ** 2)))

    assert error(column(table, "nav_longitudinal_acceleration"), forward) < 0.03
    assert error(column(table, "nav_lateral_acceleration"), left) < 0.04
    assert error(packets.acceleration[:, 0], forward) > 0.3
    assert error(-packets.acceleration[:, 1], left) > 0.3


@pytest.mark.parametrize("name", LOGS)
def test_axes_agree_with_each_other(shared_data: Path, name: str) -> None:
    """Displacement, course, heading, speed and yaw rate are told apart by the unit and must tell the same story."""
    table, _ = read_samples(shared_data / name)
    elapsed = seconds(table)
    x, y, speed = column(table, "x"), column(table, "y"), column(table, "nav_speed")
    course, heading = column(table, "course"), column(table, "heading")
    rate, yaw_rate = 1 / np.median(np.diff(elapsed)), column(table, "nav_yaw_rate")
    step = round(0.5 * rate)
    dx, dy = x[2 * step :] - x[: -2 * step], y[2 * step :] - y[: -2 * step]
    inner = slice(step, -step)
    # Over one second, in deg; the cars turn and slide a little.
    assert np.median(np.abs(wrapped(np.degrees(np.arctan2(dy, dx)) - course[inner]))) < 0.5
    assert np.median(np.abs(wrapped(course - heading))) < 2.5
    travelled = float(np.sum(np.hypot(np.diff(x), np.diff(y))))
    # The racing cars' speed is their wheels': 1.5 % more than the way they cover.
    assert travelled == pytest.approx(float(np.sum(speed[:-1] * np.diff(elapsed))), rel=0.02)
    turned = wrapped(heading[2 * step :] - heading[: -2 * step]) / (elapsed[2 * step :] - elapsed[: -2 * step])
    smooth = np.convolve(yaw_rate, np.full(2 * step, 0.5 / step), "same")[inner]
    assert np.corrcoef(turned, smooth)[0, 1] > 0.97


def test_all_real_logs_are_read_without_loss(shared_data: Path) -> None:
    logs = sorted(shared_data.rglob("*.ncom"))
    assert len(logs) >= 25
    for path in logs:
        assert Ncom.sniff(path.read_bytes()[:65_536])
        table, account = read_samples(path)
        assert account == Account(accepted=path.stat().st_size // 72)
        assert len(table) == account.accepted
        assert all(a < b for a, b in pairwise(table["time"].cast(pa.int64()).to_pylist()))
        assert table["x"].null_count == 0
        assert table["course"].null_count == 0


def test_no_other_real_log_is_taken_for_ncom(shared_data: Path) -> None:
    others = [path for path in shared_data.rglob("*") if path.is_file() and path.suffix != ".ncom"]
    assert len(others) > 30
    for path in others:
        with path.open("rb") as content:
            assert not Ncom.sniff(content.read(65_536)), path
