"""Times of camera frames, from names, columns and messages."""

from __future__ import annotations

import struct
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import Writer

from wheelprint.ingest.account import Account
from wheelprint.ingest.cameras import CameraIndex, stamp_in
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.tables import CAMERA_FRAMES

START = 1_700_000_000_000_000_000
EXPECTED = "expected a stamp since 1970 of 10 (s), 13 (ms), 16 (µs) or 19 (ns) digits, or date and time to the second"


def read(path: Path) -> tuple[list[tuple[Any, ...]], Account]:
    account = Account()
    table = CameraIndex(path).frames(account)
    assert table.schema == CAMERA_FRAMES
    table = table.set_column(0, "time", table["time"].cast(pa.int64()))
    return [tuple(row.values()) for row in table.to_pylist()], account


@pytest.mark.parametrize(
    ("text", "nanoseconds"),
    [
        ("1700000000", 0),
        ("1700000000.5", 500_000_000),
        ("frame_1700000000_000000123", 123),
        ("1700000000-000123", 123_000),
        ("left-1700000000123", 123_000_000),
        ("1700000000123456", 123_456_000),
        ("cam0_1700000000123456789_left", 123_456_789),
        ("2023-11-14T22:13:20Z", 0),
        ("2023-11-14T22:13:20.000000001", 1),
        ("2023-11-15 00:13:20,25+02:00", 250_000_000),
        ("2023-11-14 18:43:20-0330", 0),
        ("IMG_20231114_221320", 0),
        ("20231114221320123", 123_000_000),
        ("2023_11_14-22_13_20-123456", 123_456_000),
        ("1700000000_1", 0),
    ],
)
def test_stamps(text: str, nanoseconds: int) -> None:
    assert stamp_in(text) == START + nanoseconds


@pytest.mark.parametrize(
    "text", ["", "000001", "frame 12345678901", "2023-11-14", "20231314_221320", "9300000000000000000"]
)
def test_what_is_no_stamp(text: str) -> None:
    with pytest.raises(ValueError, match=r"month|expected a stamp"):
        stamp_in(text)


@given(st.integers(1_000_000_000, 4_000_000_000), st.integers(0, 999_999))
def test_a_date_is_its_count(seconds: int, microseconds: int) -> None:
    moment = datetime.fromtimestamp(seconds, UTC).replace(microsecond=microseconds)
    expected = seconds * 10**9 + microseconds * 1000
    assert stamp_in(moment.isoformat(timespec="microseconds")) == expected
    assert stamp_in(f"{moment:%Y%m%d_%H%M%S_%f}") == expected
    assert stamp_in(f"{seconds}.{microseconds:06d}") == expected


def test_a_folder_of_images(tmp_path: Path) -> None:
    for name in ("1700000001.png", "1700000000.5.JPG", "latest.jpg", "notes.txt"):
        (tmp_path / name).write_bytes(b"")
    rows, account = read(tmp_path)
    assert rows == [
        (START + 500_000_000, "", "1700000000.5.JPG", None),
        (START + 1_000_000_000, "", "1700000001.png", None),
    ]
    assert account == Account(accepted=2, rejected=1, rejections=[("latest.jpg", f"{EXPECTED}; in the image's name")])


def test_a_csv_with_a_header(tmp_path: Path) -> None:
    path = tmp_path / "frames.csv"
    path.write_text(
        'frame;Timestamp;file\n2;1700000001;"b;2.png"\r\n\n1;1700000000;a.png\n3;0.25;c.png\n4\n5;1700000002;\n'
    )
    assert CameraIndex.sniff(path.read_bytes())
    rows, account = read(path)
    assert rows == [
        (START, "", "a.png", None),
        (START + 10**9, "", "b;2.png", None),
        (START + 2 * 10**9, "", None, None),
    ]
    assert account == Account(
        accepted=3,
        rejected=2,
        rejections=[("line 5", f"{EXPECTED}; found '3;0.25;c.png'"), ("line 6", f"{EXPECTED}; found '4'")],
    )


def test_a_csv_without_a_header(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    path.write_text("1700000000000000000,1700000000000000000.png\n1700000000000000005,b.png")
    rows, account = read(path)
    assert rows == [(START, "", "1700000000000000000.png", None), (START + 5, "", "b.png", None)]
    assert account == Account(accepted=2)


def test_a_csv_without_times(tmp_path: Path) -> None:
    path = tmp_path / "frames.csv"
    path.write_text("name,size\na.png,3\n")
    with pytest.raises(InputError) as raised:
        read(path)
    assert str(raised.value) == (
        f"{path}: line 1: expected a column of times, one of time, timestamp, stamp, timestamp_ns, time_ns, "
        "#timestamp, #timestamp [ns], utc; found name, size. Name the column in the header"
    )


def test_images_in_mcap(tmp_path: Path) -> None:
    output = BytesIO()
    writer = Writer(output, use_chunking=False)
    writer.start()
    ros = writer.register_schema("sensor_msgs/msg/CompressedImage", "ros2msg", b"")
    other = writer.register_schema("foxglove.CompressedImage", "protobuf", b"")
    front = writer.register_channel("/front", "cdr", ros)
    back = writer.register_channel("/back", "protobuf", other)
    image = (
        b"\0\1\0\0"
        + struct.pack("<iII", 1_700_000_000, 7, 2)
        + b"c\0\0\0"
        + struct.pack("<I", 5)
        + b"jpeg\0"
        + bytes(99)
    )
    writer.add_message(front, START + 10, image, START)
    writer.add_message(back, START + 3, b"protobuf", START)
    writer.add_message(front, START + 10, b"short", START)
    writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it without types
    path = tmp_path / "a.mcap"
    path.write_bytes(output.getvalue())
    rows, account = read(path)
    content = path.read_bytes()
    # A record of a message is its opcode 05, its length, 22 bytes of header and the data.
    places = [content.find(data) - 22 - 9 for data in (b"protobuf" * 1 + b"\x05", image)]
    assert rows == [(START + 3, "/back", None, places[0]), (START + 7, "/front", None, places[1])]
    assert {content[place] for place in places} == {5}
    assert (account.accepted, account.rejected, account.truncated) == (2, 1, False)


def test_it_refuses_other_content(tmp_path: Path) -> None:
    for head in (
        b"",
        b"(1.0) can0 123#00\n",
        b"Time Stamp,ID,Extended,Bus,LEN,D1\n",
        b"timestamp,arbitration_id,data\n",
    ):
        assert not CameraIndex.sniff(head)
    with pytest.raises(InputError):
        read(tmp_path / "missing.csv")
