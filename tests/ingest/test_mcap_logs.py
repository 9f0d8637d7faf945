"""MCAP written by its own package, with messages whose CDR is written here field by field."""

from __future__ import annotations

import base64
import gzip
import json
import struct
from collections.abc import Iterable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from mcap.writer import CompressionType, Writer

from wheelprint.ingest.account import Account
from wheelprint.ingest.mcap_frames import McapFrames
from wheelprint.ingest.mcap_navigation import McapNavigation
from wheelprint.ingest.navigation import GRAVITY
from wheelprint.ingest.oxts.ncom import Ncom
from wheelprint.ingest.oxts.ncom_writer import write_ncom
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.tables import NAVIGATION

START = 1_700_000_000_000_000_000
Said = tuple[str, str, str, int, bytes]  # topic, schema, encoding, log time, data


def cdr(time: int, *fields: tuple[str, Any], frame: str = "can", order: str = "<") -> bytes:
    """Encode a header and fields (a code of struct, or `s` for text, or `y` for a sequence of bytes)."""
    content = b""
    name = frame.encode() + b"\0"
    every = (("i", time // 10**9), ("I", time % 10**9), ("s", name), *fields)
    for code, value in every:
        if code in "sy":
            content += bytes(-len(content) % 4) + struct.pack(f"{order}I", len(value)) + value
        else:
            content += bytes(-len(content) % struct.calcsize(f"={code}")) + struct.pack(f"{order}{code}", value)
    return (b"\0\1\0\0" if order == "<" else b"\0\0\0\0") + content


def can_frame(
    time: int, identifier: int, data: bytes, flags: tuple[bool, bool, bool] = (False, False, False), **how: Any
) -> bytes:
    octets = [("B", octet) for octet in data.ljust(8, b"\0")]
    return cdr(time, ("I", identifier), *(("?", flag) for flag in flags), ("B", len(data)), *octets, **how)


def write(path: Path, said: Iterable[Said], *, finish: bool = True, **how: Any) -> Path:
    output = BytesIO()
    writer = Writer(output, **how)
    writer.start()
    channels: dict[tuple[str, str, str], int] = {}
    for topic, schema, encoding, time, data in said:
        key = (topic, schema, encoding)
        if key not in channels:
            # A bag from a machine without the message's package has an empty schema.
            number = writer.register_schema(schema, "ros2msg", b"")
            channels[key] = writer.register_channel(topic, encoding, number)
        writer.add_message(channels[key], time, data, time)
    if finish:
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it without types
    path.write_bytes(output.getvalue())
    return path


def read(path: Path) -> tuple[list[dict[str, Any]], Account]:
    account = Account()
    tables = [pa.Table.from_batches([batch.to_arrow()]) for batch in McapFrames(path).batches(account)]
    rows: list[dict[str, Any]] = []
    for table in tables:
        rows += table.set_column(0, "time", table["time"].cast(pa.int64())).to_pylist()
    return rows, account


def navigation(path: Path) -> tuple[pa.Table, Account]:
    account = Account()
    batches = list(McapNavigation(path).batches(account))
    return pa.Table.from_batches(batches, batches[0].schema if batches else NAVIGATION), account


CLASSIC = "can_msgs/msg/Frame"


def row(time: int, identifier: int, data: bytes, **other: Any) -> dict[str, Any]:
    usual = {"channel": "can0", "extended": False, "fd": False, "kind": "data"}
    return {"time": time, **usual, "id": identifier, "data": data} | other


def traffic(count: int) -> tuple[list[Said], list[dict[str, Any]]]:
    rng = np.random.default_rng(4)
    said, rows = [], []
    for k in range(count):
        time, data = START + k * 1_234_567, rng.bytes(int(rng.integers(0, 9)))
        said.append(("/can0", CLASSIC, "cdr", time + 5, can_frame(time, k % 0x7FF, data, frame="x" * (k % 5))))
        rows.append(row(time, k % 0x7FF, data))
    return said, rows


def test_every_kind_of_frame(tmp_path: Path) -> None:
    wide = bytes(range(12))
    fd = cdr(START + 5, ("I", 0x55), ("?", False), ("?", False), ("B", 12), ("y", wide))
    path = write(
        tmp_path / "a.mcap",
        [
            ("/can0", CLASSIC, "cdr", 1, can_frame(START, 0x123, b"\1\2\3")),
            ("/can0", CLASSIC, "cdr", 1, can_frame(START + 1, 0x1FFFFFFF, b"", (False, True, False), order=">")),
            ("/can1", CLASSIC, "cdr", 1, can_frame(START + 2, 0x7, bytes(5), (True, False, False))),
            ("/can1", "can_msgs/Frame", "cdr", 1, can_frame(START + 3, 0x20000004, bytes(8), (False, False, True))),
            ("/can0", CLASSIC, "cdr", START + 4, can_frame(0, 1, b"a")),
            ("/image", "sensor_msgs/msg/Image", "cdr", 1, b"anything"),
            ("/can0", "ros2_socketcan_msgs/msg/FdFrame", "cdr", 1, fd),
        ],
    )
    assert McapFrames.sniff(path.read_bytes())
    rows, account = read(path)
    assert rows == [
        row(START, 0x123, b"\1\2\3"),
        row(START + 1, 0x1FFFFFFF, b"", extended=True),
        row(START + 2, 0x7, b"", channel="can1", kind="remote"),
        row(START + 3, 4, bytes(8), channel="can1", kind="error"),
        row(START + 4, 1, b"a"),
        row(START + 5, 0x55, wide, fd=True),
    ]
    assert account == Account(accepted=6)
    assert navigation(path) == (pa.Table.from_batches([], NAVIGATION), Account())


def test_frames_as_json(tmp_path: Path) -> None:
    stamp = {"sec": START // 10**9, "nsec": 7}
    said = [
        {"timestamp": stamp, "id": 0x123, "data": base64.b64encode(b"\1\2").decode(), "channel": "vcan0"},
        {"timestamp": stamp, "id": "0x1ABCDE", "data": [1, 255]},
        {"header": {"stamp": {"sec": 1, "nanosec": 2}}, "id": 5, "is_extended": True, "is_rtr": True, "dlc": 4},
        {"id": 6, "data": list(range(12)), "is_fd": True},
        {"data": []},
        {"id": 6, "data": "not base64"},
        ["id"],
    ]
    path = write(
        tmp_path / "a.mcap",
        [("/bus", "foxglove.CanFrame", "json", 9, json.dumps(one).encode()) for one in said]
        + [("/bus", "foxglove.CanFrame", "json", 9, b"{")],
        use_chunking=False,
    )
    rows, account = read(path)
    assert rows == [
        row(START + 7, 0x123, b"\1\2", channel="vcan0"),
        row(START + 7, 0x1ABCDE, b"\1\xff", channel="bus", extended=True),
        row(1_000_000_002, 5, b"", channel="bus", extended=True, kind="remote"),
        row(9, 6, bytes(range(12)), channel="bus", fd=True),
    ]
    assert (account.accepted, account.rejected, account.truncated) == (4, 4, False)
    assert [reason.partition(";")[0][:105] for _, reason in account.rejections] == [
        "expected a message with id and data",
        "expected a message with id and data (Only base64 data is allowed)",
        "expected a JSON object",
        "expected a JSON object (Expecting property name enclosed in double quotes: line 1 column 2 (char 1))",
    ]


@pytest.mark.parametrize("compression", list(CompressionType))
def test_compressed_chunks_and_files(tmp_path: Path, compression: CompressionType) -> None:
    said, rows = traffic(3000)
    path = write(tmp_path / "a.mcap", said, compression=compression, chunk_size=20_000)
    assert read(path) == (rows, Account(accepted=3000))
    path.write_bytes(gzip.compress(path.read_bytes()))
    assert read(path) == (rows, Account(accepted=3000))


def test_messages_that_are_no_frames_are_rejected(tmp_path: Path) -> None:
    good = can_frame(START, 1, b"\1")
    bad = [
        can_frame(START, 0x800, b"\1"),
        good[:-1],
        can_frame(START, 1, bytes(8))[:-9] + b"\x09" + bytes(8),
        b"\0\2\0\0" + good[4:],
    ]
    said = [("/can0", CLASSIC, "cdr", 1, data) for data in (*bad, good)] + [("/can0", CLASSIC, "ros1", 1, good)]
    rows, account = read(write(tmp_path / "a.mcap", said))
    assert rows == [row(START, 1, b"\1")]
    assert account.accepted == 1
    assert [reason for _, reason in account.rejections] == [
        f"{reason}; the message is damaged or of another definition"
        for reason in (
            "identifier 800 is beyond 7FF",
            f"{len(good) - 1} bytes are too few for can_msgs/msg/Frame",
            "9 bytes of payload are told, 8 are there",
            "expected CDR: four bytes that tell the encoding (00 00 or 00 01 first), then a header",
            "encoded as 'ros1'; only cdr (ROS 2), json and protobuf are read",
        )
    ]
    assert account.rejections[0][0].endswith("record 3 of the chunk, topic /can0")


@pytest.mark.parametrize("chunked", [True, False])
def test_cut_anywhere_whole_records_before_the_cut_arrive(tmp_path: Path, chunked: bool) -> None:
    said, rows = traffic(30)
    path = write(tmp_path / "a.mcap", said, use_chunking=chunked, chunk_size=300, compression=CompressionType.NONE)
    content = path.read_bytes()
    before = 0
    for cut in range(8, len(content)):
        path.write_bytes(content[:cut])
        found, account = read(path)
        assert found == rows[: len(found)]
        assert len(found) >= before
        before = len(found)
        # The very last bytes are the magic once more.
        assert account.truncated
        assert account.rejected == 1
        if not chunked:
            assert len(found) == sum(content.find(one[-1]) + len(one[-1]) <= cut for one in said)
    assert before == 30


def test_damage_ends_as_a_result(tmp_path: Path) -> None:
    said, rows = traffic(300)
    path = write(tmp_path / "a.mcap", said, chunk_size=1000)
    content, rng, lost = path.read_bytes(), np.random.default_rng(8), 0
    for _ in range(200):
        damaged = bytearray(content)
        for place in rng.integers(8, len(content), 3):
            damaged[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        found, account = read(path)
        assert account.accepted == len(found)
        lost += len(found) < len(rows)
        assert len(found) == len(rows) or account.rejected
        navigation(path)
    assert lost > 50


def test_navigation_that_may_be_behind_the_end_is_said(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", traffic(80)[0])
    whole, cut = Account(), Account()
    assert list(McapNavigation(path).batches(whole)) == []
    path.write_bytes(path.read_bytes()[:-100])
    assert list(McapNavigation(path).batches(cut)) == []
    assert (whole, cut) == (Account(), Account(truncated=True))


def test_raw_packets_are_read_as_ncom(tmp_path: Path) -> None:
    n = 500
    write_ncom(
        tmp_path / "a.ncom",
        time=START + np.arange(n) * 10_000_000,
        latitude=48 + np.arange(n) * 1e-6,
        longitude=11,
        altitude=500,
        velocity=(5.0, 1.0, 0.0),
        orientation=(0.2, 0.0, 0.0),
        acceleration=(0.1, 0.2, -9.8),
        angular_rate=(0.0, 0.0, 0.1),
    )
    packets = (tmp_path / "a.ncom").read_bytes()
    said = []
    for k in range(n):
        packet = packets[72 * k : 72 * k + 72]
        if k == 7:
            packet = packet[:40] + b"!" + packet[41:]
        octets = [("B", octet) for octet in packet]
        said.append(("/ncom", "oxts_msgs/msg/Ncom", "cdr", START + k, cdr(START, *octets, frame="oxts_link")))
    said.insert(20, ("/ncom", "oxts_msgs/msg/Ncom", "cdr", START, b"\0\1\0\0short"))
    path = write(tmp_path / "a.mcap", said)
    table, account = navigation(path)
    (tmp_path / "b.ncom").write_bytes(packets[: 72 * 7] + packets[72 * 8 :])
    expected = pa.Table.from_batches(list(Ncom(tmp_path / "b.ncom").batches(Account())))
    assert table.equals(expected)
    assert (account.accepted, account.rejected) == (n - 1, 2)
    assert account.rejections[1][0] == "topic /ncom, packet 8"
    assert table.schema.metadata[b"topics"] == b'["/ncom"]'
    assert json.loads(table.schema.metadata[b"origin"])["latitude"] == pytest.approx(48)
    assert read(path) == ([], Account())


def test_packets_without_time_name_the_file(tmp_path: Path) -> None:
    packet = [("B", 0) for _ in range(72)]
    path = write(tmp_path / "a.mcap", [("/ncom", "oxts_msgs/msg/Ncom", "cdr", 1, cdr(START, *packet))])
    with pytest.raises(InputError) as raised:
        navigation(path)
    assert str(raised.value) == (
        f"{path}: topic /ncom: holds no NCOM packet in 72 bytes; one is 72 bytes from 0xE7 to a matching checksum. "
        "It may be of another format: export the unit's recording as NCOM"
    )


def doubles(*values: float) -> list[tuple[str, float]]:
    return [("d", value) for value in values]


def fix(time: int, latitude: float, longitude: float, status: int = 0) -> bytes:
    covariance = doubles(0.09, 0, 0, 0, 0.16, 0, 0, 0, 1)
    return cdr(time, ("b", status), ("H", 1), *doubles(latitude, longitude, 100), *covariance, ("B", 2), frame="gps")


def imu(time: int, acceleration: tuple[float, float, float], yaw_rate: float, pitch: float) -> bytes:
    orientation = doubles(0, np.sin(pitch / 2), 0, np.cos(pitch / 2))
    zeros = doubles(*[0.0] * 9)
    return cdr(time, *orientation, *zeros, *doubles(0, 0, yaw_rate), *zeros, *doubles(*acceleration), *zeros)


def odometry(time: int, yaw: float, forward: float, left: float) -> bytes:
    orientation = doubles(0, 0, np.sin(yaw / 2), np.cos(yaw / 2))
    zeros = doubles(*[0.0] * 36)
    child = ("s", b"base_link\0")
    return cdr(time, child, *doubles(1, 2, 3), *orientation, *zeros, *doubles(forward, left, 0, 0, 0, 0), *zeros)


def test_navigation_messages_of_one_stamp_are_one_sample(tmp_path: Path) -> None:
    uphill = np.radians(-3)  # REP 103: nose up is a negative pitch.
    resting = (GRAVITY * np.sin(-uphill), 0.0, GRAVITY * np.cos(uphill))
    fixes, motion, feeling = "sensor_msgs/msg/NavSatFix", "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"
    twist = cdr(START, *doubles(9, 9, 9, 9, 9, 9))
    said: list[Said] = [
        ("/fix", fixes, "cdr", 1, fix(START, 48, 11)),
        ("/odom", motion, "cdr", 1, odometry(START, np.radians(170), 10, np.tan(np.radians(20)) * 10)),
        ("/vel", "geometry_msgs/msg/TwistStamped", "cdr", 1, twist),
        ("/imu", feeling, "cdr", 1, imu(START + 20, resting, 0.1, uphill)),
        ("/imu", feeling, "cdr", 1, imu(START + 10, (0.5, 1.0, -GRAVITY), 0.1, 0)),
        ("/fix", fixes, "cdr", 1, fix(START + 10, 48.001, 11)),
        ("/fix", fixes, "cdr", 1, fix(START + 30, 0, 0, status=-1)),
        ("/fix", fixes, "cdr", 1, fix(START + 40, 91, 0)),
    ]
    table, account = navigation(write(tmp_path / "a.mcap", said))
    assert (table["time"].cast(pa.int64()).to_numpy() - START).tolist() == [0, 10, 20, 30]
    rows = [{name: value for name, value in one.items() if value is not None} for one in table.to_pylist()]
    assert rows[0]["nav_speed"] == pytest.approx(10 / np.cos(np.radians(20)))
    assert rows[0]["course"] == pytest.approx(-170)
    assert rows[0]["heading"] == pytest.approx(170)
    assert rows[0]["position_accuracy"] == pytest.approx(0.5)
    assert (rows[0]["x"], rows[0]["y"]) == (0, 0)
    # Forward-right-down: right becomes left.
    assert rows[1]["nav_yaw_rate"] == pytest.approx(-np.degrees(0.1))
    assert rows[1]["nav_longitudinal_acceleration"] == pytest.approx(0.5)
    assert rows[1]["nav_lateral_acceleration"] == pytest.approx(-1)
    assert rows[1]["y"] == pytest.approx(111.2, abs=0.1)
    # On a slope at rest only gravity is felt.
    assert rows[2]["nav_yaw_rate"] == pytest.approx(np.degrees(0.1))
    assert rows[2]["nav_longitudinal_acceleration"] == pytest.approx(0, abs=1e-9)
    assert rows[2]["nav_lateral_acceleration"] == pytest.approx(0, abs=1e-9)
    assert set(rows[3]) == {"time"}
    assert account.accepted == 6
    assert [reason for _, reason in account.rejections] == ["latitude 91 deg, longitude 0 deg is nowhere on earth"]
    assert table.schema.metadata[b"topics"] == b'["/fix", "/imu", "/odom"]'


def test_without_odometry_a_twist_tells_the_speed(tmp_path: Path) -> None:
    twist = cdr(START, *doubles(3, 4, 9, 0, 0, 0))
    said: list[Said] = [
        ("/vel", "geometry_msgs/msg/TwistStamped", "cdr", 1, twist),
        ("/fix", "sensor_msgs/msg/NavSatFix", "cdr", 1, fix(START, 48, 11)),
    ]
    table, account = navigation(write(tmp_path / "a.mcap", said))
    assert account == Account(accepted=2)
    assert (table["nav_speed"].to_pylist(), table["latitude"].to_pylist()) == ([5.0], [48.0])
    assert table["course"].null_count == 1


def test_it_refuses_other_content() -> None:
    for head in (b"", b"MDF     4.11    ", b"(1.0) can0 123#00\n", b"\x89PNG\r\n\x1a\n"):
        assert not McapFrames.sniff(head)
        assert not McapNavigation.sniff(head)
