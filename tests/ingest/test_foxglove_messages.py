"""Foxglove's messages in MCAP: frames, positions and images as protobuf, by the definition in the file, and as JSON."""

from __future__ import annotations

import base64
import json
import struct
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from google.protobuf import descriptor_pb2, timestamp_pb2
from mcap.writer import Writer

from wheelprint.ingest.account import Account
from wheelprint.ingest.cameras import CameraIndex
from wheelprint.ingest.mcap_frames import McapFrames
from wheelprint.ingest.mcap_navigation import McapNavigation

START = 1_700_000_000_000_000_000
Field = descriptor_pb2.FieldDescriptorProto
SCALARS = {
    "uint32": Field.TYPE_UINT32, "bytes": Field.TYPE_BYTES, "bool": Field.TYPE_BOOL, "double": Field.TYPE_DOUBLE,
    "string": Field.TYPE_STRING,
}  # fmt: skip
WIRE_VARINT, WIRE_64, WIRE_BYTES = 0, 1, 2

FRAME = {"timestamp": "Timestamp", "id": "uint32", "data": "bytes", "is_extended": "bool", "dlc": "uint32",
         "bus": "string"}  # fmt: skip
FIX = {"timestamp": "Timestamp", "frame_id": "string", "latitude": "double", "longitude": "double",
       "altitude": "double", "position_covariance": "double*", "position_covariance_type": "uint32"}  # fmt: skip
IMAGE = {"timestamp": "Timestamp", "frame_id": "string", "data": "bytes", "format": "string"}


def definition(schema: str, fields: dict[str, str]) -> bytes:
    """Return the FileDescriptorSet of a message, with what it needs behind it, as some writers have it."""
    package, _, name = schema.rpartition(".")
    file = descriptor_pb2.FileDescriptorProto(
        name=f"{name}.proto", package=package, syntax="proto3", dependency=["google/protobuf/timestamp.proto"]
    )
    message = file.message_type.add(name=name)
    for number, (field, kind) in enumerate(fields.items(), 1):
        label = Field.LABEL_REPEATED if kind.endswith("*") else Field.LABEL_OPTIONAL
        if kind == "Timestamp":
            message.field.add(
                name=field, number=number, label=label, type=Field.TYPE_MESSAGE, type_name=".google.protobuf.Timestamp"
            )
        else:
            message.field.add(name=field, number=number, label=label, type=SCALARS[kind.removesuffix("*")])
    stamp = descriptor_pb2.FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(stamp)
    return bytes(descriptor_pb2.FileDescriptorSet(file=[file, stamp]).SerializeToString())


def varint(number: int) -> bytes:
    octets = b""
    while number > 0x7F:
        octets += bytes([number & 0x7F | 0x80])
        number >>= 7
    return octets + bytes([number])


def wire(fields: dict[str, str], **values: Any) -> bytes:
    """Encode a message by hand: https://protobuf.dev/programming-guides/encoding."""
    content = b""
    for number, (field, kind) in enumerate(fields.items(), 1):
        if field not in values:
            continue
        value = values[field]
        if kind == "Timestamp":
            value = varint(1 << 3) + varint(value // 10**9) + varint(2 << 3) + varint(value % 10**9)
        if kind in {"uint32", "bool"}:
            content += varint(number << 3 | WIRE_VARINT) + varint(int(value))
        elif kind == "double":
            content += varint(number << 3 | WIRE_64) + struct.pack("<d", value)
        else:
            octets = struct.pack(f"<{len(value)}d", *value) if kind == "double*" else value
            octets = octets.encode() if isinstance(octets, str) else octets
            content += varint(number << 3 | WIRE_BYTES) + varint(len(octets)) + octets
    return content


def write(path: Path, *topics: tuple[str, str, str, bytes, list[bytes]]) -> Path:
    output = BytesIO()
    writer = Writer(output, use_chunking=False)
    writer.start()
    for topic, schema, encoding, described, said in topics:
        number = writer.register_schema(schema, encoding, described)
        channel = writer.register_channel(topic, encoding, number)
        for data in said:
            writer.add_message(channel, START + 5, data, START + 5)
    writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it without types
    path.write_bytes(output.getvalue())
    return path


def test_frames_in_protobuf(tmp_path: Path) -> None:
    said = [
        wire(FRAME, timestamp=START, id=0x123, data=b"\1\2\3", bus="can1"),
        wire(FRAME, timestamp=START + 1, id=0x1ABCDE, data=bytes(8), is_extended=True, dlc=8),
        wire(FRAME, id=0x7FF, data=b"\xff\xee\xdd", dlc=2),
        wire(FRAME, timestamp=START + 3, id=0x800, data=b"\1"),
        b"\x0a\xff",
    ]
    path = write(tmp_path / "a.mcap", ("/bus", "acme.CanFrame", "protobuf", definition("acme.CanFrame", FRAME), said))
    account = Account()
    rows = [row for batch in McapFrames(path).batches(account) for row in batch.to_arrow().to_pylist()]
    assert [(row["time"].value, row["channel"], row["id"], row["extended"], row["data"]) for row in rows] == [
        (START, "can1", 0x123, False, b"\1\2\3"),
        (START + 1, "bus", 0x1ABCDE, True, bytes(8)),
        (START + 5, "bus", 0x7FF, False, b"\xff\xee"),
    ]
    assert (account.accepted, account.rejected) == (3, 2)
    assert [reason for _, reason in account.rejections] == [
        "identifier 800 is beyond 7FF; the message is damaged or of another definition",
        "expected acme.CanFrame in protobuf; the message is damaged or of another definition",
    ]


def test_a_file_without_the_definition_says_so(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", ("/bus", "acme.CanFrame", "protobuf", b"", [b"\x10\x01"]))
    account = Account()
    assert list(McapFrames(path).batches(account)) == []
    assert account.rejections[0][1] == (
        "the file's schema does not define acme.CanFrame (KeyError); the message is damaged or of another definition"
    )


@pytest.mark.parametrize("encoding", ["protobuf", "json"])
def test_positions(encoding: str, tmp_path: Path) -> None:
    covariance = [4.0, 0, 0, 0, 5.0, 0, 0, 0, 16.0]
    places = [(48.0 + 1e-5 * k, 11.0, 500.0 + k) for k in range(4)]
    if encoding == "protobuf":
        described = definition("foxglove.LocationFix", FIX)
        said = [
            wire(FIX, timestamp=START + k * 10**8, latitude=latitude, longitude=longitude, altitude=altitude,
                 position_covariance=covariance, position_covariance_type=2)
            for k, (latitude, longitude, altitude) in enumerate(places)
        ]  # fmt: skip
    else:
        described = b"{}"
        said = [
            json.dumps(
                {
                    "timestamp": {"sec": (START + k * 10**8) // 10**9, "nsec": (START + k * 10**8) % 10**9},
                    "latitude": latitude, "longitude": longitude, "altitude": altitude,
                    "position_covariance": covariance, "position_covariance_type": 2,
                }
            ).encode()
            for k, (latitude, longitude, altitude) in enumerate(places)
        ]  # fmt: skip
    path = write(tmp_path / "a.mcap", ("/gps", "foxglove.LocationFix", encoding, described, [*said, b"{"]))
    account = Account()
    table = pa.Table.from_batches(list(McapNavigation(path).batches(account)))
    assert (account.accepted, account.rejected) == (4, 1)
    assert table["time"].cast(pa.int64()).to_pylist() == [START + k * 10**8 for k in range(4)]
    assert table["latitude"].to_pylist() == [latitude for latitude, _, _ in places]
    assert table["altitude"].to_pylist() == [altitude for _, _, altitude in places]
    assert table["position_accuracy"].to_pylist() == pytest.approx([3.0] * 4)
    # A degree of latitude is 111.2 km here.
    assert np.diff(table["y"].to_numpy()) == pytest.approx(1.112, abs=0.002)
    assert json.loads(table.schema.metadata[b"origin"]) == {"latitude": 48.0, "longitude": 11.0, "altitude": 500.0}


@pytest.mark.parametrize("encoding", ["protobuf", "json"])
def test_images(encoding: str, tmp_path: Path) -> None:
    if encoding == "protobuf":
        described = definition("foxglove.CompressedImage", IMAGE)
        said = wire(IMAGE, timestamp=START + 7, frame_id="front", data=b"jpeg", format="jpeg")
    else:
        described = b"{}"
        stamp = {"sec": START // 10**9, "nsec": 7}
        said = json.dumps({"timestamp": stamp, "data": base64.b64encode(b"jpeg").decode(), "format": "jpeg"}).encode()
    path = write(tmp_path / "a.mcap", ("/front", "foxglove.CompressedImage", encoding, described, [said, b"\xff"]))
    account = Account()
    (row,) = CameraIndex(path).frames(account).to_pylist()
    assert (row["time"].value, row["camera"]) == (START + 7, "/front")
    assert (account.accepted, account.rejected) == (1, 1)
