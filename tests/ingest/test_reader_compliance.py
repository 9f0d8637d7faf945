"""What every reader has to do: the same traffic in every format of CAN logs, the same drive in those of navigation."""

from __future__ import annotations

import gzip
import json
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import can
import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
import zstandard
from google.protobuf.descriptor_pb2 import FieldDescriptorProto as Field
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.writer import Writer

from wheelprint.ingest.account import Account
from wheelprint.ingest.can.frames import DATA, FrameBatch
from wheelprint.ingest.mapped_table import MappedTable
from wheelprint.ingest.oxts.ncom_writer import write_ncom
from wheelprint.ingest.readers import READERS, NavigationReader, recognise
from wheelprint.schemas.config import Nav
from wheelprint.schemas.errors import InputError

START = 1_715_562_000_000_000_000


@dataclass(frozen=True)
class Frame:
    time: int
    id: int
    extended: bool
    data: bytes


def traffic(n: int) -> list[Frame]:
    """Classic data frames of both kinds of identifiers and all lengths, at whole ms."""
    random = np.random.default_rng(11)
    times = START + np.cumsum(random.integers(1, 30, n)) * 1_000_000
    frames = []
    for time in times.tolist():
        extended = bool(random.random() < 0.3)
        identifier = int(random.integers(0x800, 1 << 29) if extended else random.integers(1, 1 << 11))
        frames.append(Frame(time, identifier, extended, random.bytes(int(random.integers(1, 9)))))
    return frames


def by_python_can(suffix: str) -> Callable[[list[Frame], Path], Path]:
    def write(frames: list[Frame], folder: Path) -> Path:
        path = folder / f"log{suffix}"
        with can.Logger(path) as logger:
            for frame in frames:
                logger(
                    can.Message(
                        timestamp=frame.time / 1e9, arbitration_id=frame.id, is_extended_id=frame.extended,
                        data=frame.data, channel=0,
                    )
                )  # fmt: skip
        return path

    return write


def by_line(line: Callable[[Frame], str], header: str = "") -> Callable[[list[Frame], Path], Path]:
    def write(frames: list[Frame], folder: Path) -> Path:
        path = folder / "log"
        path.write_text(header + "".join(line(frame) + "\n" for frame in frames), encoding="ascii")
        return path

    return write


def seconds(frame: Frame) -> str:
    return f"{frame.time // 10**9}.{frame.time % 10**9 // 1000:06d}"


def spaced(frame: Frame) -> str:
    return " ".join(f"{byte:02X}" for byte in frame.data)


def shown(frame: Frame) -> str:
    return f"{frame.id:08X}" if frame.extended else f"{frame.id:03X}"


def gvret(frame: Frame) -> str:
    data = ",".join(f"{byte:02X}" for byte in frame.data)
    return f"{frame.time // 1000},{frame.id:08X},{str(frame.extended).lower()},Rx,0,{len(frame.data)},{data},"


def write_pcap(frames: list[Frame], folder: Path) -> Path:
    path = folder / "log.pcap"
    content = struct.pack("<IHHiIII", 0xA1B23C4D, 2, 4, 0, 0, 65535, 227)
    for frame in frames:
        packet = struct.pack(">IB3x", frame.id | frame.extended << 31, len(frame.data)) + frame.data.ljust(8, b"\0")
        content += struct.pack("<IIII", frame.time // 10**9, frame.time % 10**9, len(packet), len(packet)) + packet
    path.write_bytes(content)
    return path


def write_mcap(frames: list[Frame], folder: Path) -> Path:
    path = folder / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("can.Frame", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("can0", "json", schema)
        for frame in frames:
            content = {"id": frame.id, "is_extended": frame.extended, "data": list(frame.data)}
            writer.add_message(channel, frame.time, json.dumps(content).encode(), frame.time)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def write_protobuf(frames: list[Frame], folder: Path) -> Path:
    file = FileDescriptorProto(name="frame.proto", package="can", syntax="proto3")
    message = file.message_type.add(name="Frame")
    kinds = {"id": Field.TYPE_UINT32, "is_extended": Field.TYPE_BOOL, "data": Field.TYPE_BYTES}
    for number, (name, kind) in enumerate(kinds.items(), 1):
        message.field.add(name=name, number=number, type=kind, label=Field.LABEL_OPTIONAL)
    definition = FileDescriptorSet(file=[file]).SerializeToString()
    pool = DescriptorPool()
    pool.Add(file)
    kind = GetMessageClass(pool.FindMessageTypeByName("can.Frame"))
    path = folder / "log.mcap"
    with path.open("wb") as output:
        writer = Writer(output)
        writer.start()
        channel = writer.register_channel(
            "can0", "protobuf", writer.register_schema("can.Frame", "protobuf", definition)
        )
        for frame in frames:
            content = kind(id=frame.id, is_extended=frame.extended, data=frame.data).SerializeToString()
            writer.add_message(channel, frame.time, content, frame.time)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


GVRET_HEADER = "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n"
WRITERS: dict[str, Callable[[list[Frame], Path], Path]] = {
    "asc": by_python_can(".asc"),
    "blf": by_python_can(".blf"),
    "candump": by_line(lambda f: f"({seconds(f)}) can0 {shown(f)}#{f.data.hex().upper()}"),
    "candump-console": by_line(lambda f: f" ({seconds(f)})  can0  {shown(f):>8}   [{len(f.data)}]  {spaced(f)}"),
    "crtd": by_line(lambda f: f"{seconds(f)} 1R{29 if f.extended else 11} {shown(f)} {spaced(f)}"),
    "gvret csv": by_line(gvret, GVRET_HEADER),
    "mcap": write_mcap,
    "mcap (protobuf)": write_protobuf,
    "pcap": write_pcap,
    "python-can csv": by_python_can(".csv"),
    "trc": by_python_can(".trc"),
}
RELATIVE = {"asc", "trc"}
"""python-can's writers put the time of writing into these, so that only differences can be compared."""
STREAMED = {form for form in WRITERS if not form.startswith("mcap")}
"""Formats that are read from front to end, and so through compression too."""


def format_of(form: str) -> str:
    return form.partition(" (")[0]


def frame_reader(path: Path) -> tuple[str, Account, list[FrameBatch]]:
    reader = next(reader for reader in recognise(path) if reader.kind == "can")
    account = Account()
    batches = list(reader.batches(account))  # type: ignore[attr-defined]
    return reader.format, account, batches


def check(frames: list[Frame], batches: list[FrameBatch], relative: bool) -> None:
    time = np.concatenate([batch.time for batch in batches])
    expected = np.array([frame.time for frame in frames])
    if relative:
        time, expected = time - time[0], expected - expected[0]
    assert np.abs(time - expected).max() < 1000
    got = [
        (int(batch.id[n]), bool(batch.extended[n]), batch.data[n, : batch.length[n]].tobytes(), int(batch.kind[n]))
        for batch in batches
        for n in range(len(batch))
    ]
    assert got == [(frame.id, frame.extended, frame.data, DATA) for frame in frames]


def test_every_format_of_can_logs_is_here_or_has_real_files() -> None:
    formats = {reader.format for reader in READERS if reader.kind == "can"}
    assert formats - {"mf4"} == {format_of(form) for form in WRITERS}


@pytest.mark.parametrize("form", WRITERS)
def test_the_same_traffic_gives_the_same_frames(form: str, tmp_path: Path) -> None:
    frames = traffic(500)
    name, account, batches = frame_reader(WRITERS[form](frames, tmp_path))
    assert name == format_of(form)
    assert (account.accepted, account.rejected, account.truncated) == (500, 0, False)
    check(frames, batches, form in RELATIVE)


@pytest.mark.parametrize("form", sorted(STREAMED))
@pytest.mark.parametrize("compress", [gzip.compress, zstandard.compress], ids=["gzip", "zstd"])
def test_compressed_logs_are_read_alike(form: str, compress: Callable[[bytes], bytes], tmp_path: Path) -> None:
    frames = traffic(200)
    path = WRITERS[form](frames, tmp_path)
    path.write_bytes(compress(path.read_bytes()))
    name, account, batches = frame_reader(path)
    assert name == format_of(form)
    assert (account.accepted, account.rejected, account.truncated) == (200, 0, False)
    check(frames, batches, form in RELATIVE)


@pytest.mark.parametrize("form", WRITERS)
def test_each_file_is_claimed_by_one_format(form: str, tmp_path: Path) -> None:
    start = WRITERS[form](traffic(50), tmp_path).read_bytes()[:65536]
    assert {reader.format for reader in READERS if reader.sniff(start)} == {format_of(form)}


@pytest.mark.parametrize("form", WRITERS)
def test_cut_anywhere_whole_records_before_the_cut_arrive(form: str, tmp_path: Path) -> None:
    frames = traffic(60)
    path = WRITERS[form](frames, tmp_path)
    content = path.read_bytes()
    for cut in np.linspace(len(content) // 4, len(content) - 1, 25).astype(int).tolist():
        path.write_bytes(content[:cut])
        try:
            _, account, batches = frame_reader(path)
        except InputError:
            continue
        got = sum(map(len, batches))
        assert account.accepted == got
        if got > 1:
            # A text format cannot know that its last line lacks bytes; all lines before it are whole.
            check(frames[: got - 1], [batch_head(batches, got - 1)], form in RELATIVE)


def batch_head(batches: list[FrameBatch], n: int) -> FrameBatch:
    """Return the first n frames as one batch."""
    columns = {
        name: np.concatenate([getattr(batch, name) for batch in batches])[:n]
        for name in ("time", "channel", "id", "extended", "fd", "kind", "length")
    }
    data = np.concatenate([batch.data[:, :8] for batch in batches])[:n]
    return FrameBatch(**columns, channels=batches[-1].channels, data=data)


@pytest.mark.parametrize("form", WRITERS)
def test_random_damage_ends_as_a_result_or_an_input_error(form: str, tmp_path: Path) -> None:
    path = WRITERS[form](traffic(60), tmp_path)
    content = path.read_bytes()
    random = np.random.default_rng(5)
    for _ in range(60):
        damaged = bytearray(content)
        for place in random.integers(0, len(content), random.integers(1, 8)).tolist():
            damaged[place] = int(random.integers(0, 256))
        path.write_bytes(damaged)
        try:
            _, account, batches = frame_reader(path)
        except InputError:
            continue
        assert account.accepted == sum(map(len, batches))
        assert len(account.rejections) == min(account.rejected, 100)


MAPPING = Nav.model_validate(
    {
        "files": "*",
        "time": {"column": "when", "format": "unix-ns"},
        "columns": {"latitude": "lat", "longitude": "lon", "altitude": "alt"},
    }
)


def drive(n: int) -> pa.Table:
    """Positions at 10 Hz, at whole ms."""
    random = np.random.default_rng(12)
    time = START + np.arange(n) * 100_000_000
    latitude, longitude = (start + np.cumsum(random.normal(0, 1e-5, n)) for start in (48.0, 11.0))
    return pa.table(
        {"when": time, "lat": latitude, "lon": longitude, "alt": np.float64(np.float32(500.5)) + np.arange(n)}
    )


def write_locations(table: pa.Table, folder: Path) -> Path:
    path = folder / "nav.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel(
            "/gps", "json", writer.register_schema("foxglove.LocationFix", "jsonschema", b"{}")
        )
        for row in table.to_pylist():
            stamp = {"sec": row["when"] // 10**9, "nsec": row["when"] % 10**9}
            said = {"timestamp": stamp, "latitude": row["lat"], "longitude": row["lon"], "altitude": row["alt"]}
            writer.add_message(channel, row["when"], json.dumps(said).encode(), row["when"])
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def write_packets(table: pa.Table, folder: Path) -> Path:
    path, still = folder / "nav.ncom", np.zeros((len(table), 3))
    when, latitude, longitude, altitude = (table[name].to_numpy() for name in ("when", "lat", "lon", "alt"))
    write_ncom(
        path, time=when, latitude=latitude, longitude=longitude, altitude=altitude, velocity=still,
        orientation=still, acceleration=still, angular_rate=still,
    )  # fmt: skip
    return path


def write_csv(table: pa.Table, folder: Path) -> Path:
    pyarrow.csv.write_csv(table, folder / "nav.txt")
    return folder / "nav.txt"


def write_parquet(table: pa.Table, folder: Path) -> Path:
    pyarrow.parquet.write_table(table, folder / "nav.bin")
    return folder / "nav.bin"


NAV_WRITERS: dict[str, Callable[[pa.Table, Path], Path]] = {
    "columns (csv)": write_csv,
    "columns (parquet)": write_parquet,
    "mcap": write_locations,
    "ncom": write_packets,
}


def nav_reader(form: str, path: Path) -> NavigationReader:
    if format_of(form) == "columns":
        return MappedTable(path, MAPPING)
    return next(reader for reader in recognise(path) if reader.kind == "nav")  # type: ignore[return-value]


@pytest.mark.parametrize("form", NAV_WRITERS)
def test_the_same_drive_gives_the_same_navigation(form: str, tmp_path: Path) -> None:
    wanted, account = drive(300), Account()
    reader = nav_reader(form, NAV_WRITERS[form](wanted, tmp_path))
    assert reader.format == format_of(form)
    table = pa.Table.from_batches(list(reader.batches(account)))
    assert (account.accepted, account.rejected, account.truncated) == (300, 0, False)
    assert table["time"].cast(pa.int64()).to_pylist() == wanted["when"].to_pylist()
    for name, column in (("latitude", "lat"), ("longitude", "lon"), ("altitude", "alt")):
        assert table[name].to_numpy() == pytest.approx(wanted[column].to_numpy(), abs=1e-10)
    assert table["x"][0].as_py() == table["y"][0].as_py() == 0


@pytest.mark.parametrize("form", NAV_WRITERS)
def test_no_other_reader_claims_a_drive(form: str, tmp_path: Path) -> None:
    start = NAV_WRITERS[form](drive(300), tmp_path).read_bytes()[:65536]
    claims = {reader.format for reader in READERS if reader.sniff(start)}
    assert claims == {format_of(form)} - {"columns"}


@pytest.mark.parametrize("form", NAV_WRITERS)
def test_cuts_and_damage_of_a_drive_end_as_a_result_or_an_input_error(form: str, tmp_path: Path) -> None:
    path = NAV_WRITERS[form](drive(60), tmp_path)
    content = path.read_bytes()
    random = np.random.default_rng(6)
    cuts = [content[:cut] for cut in np.linspace(1, len(content) - 1, 25).astype(int).tolist()]
    for _ in range(60):
        damaged = bytearray(content)
        for place in random.integers(0, len(content), random.integers(1, 8)).tolist():
            damaged[place] = int(random.integers(0, 256))
        cuts.append(bytes(damaged))
    for damaged_content in cuts:
        path.write_bytes(damaged_content)
        account = Account()
        try:
            got = sum(len(batch) for batch in nav_reader(form, path).batches(account))
        except InputError:
            continue
        except StopIteration:  # Not recognised as navigation any more.
            continue
        assert got <= account.accepted
        assert len(account.rejections) == min(account.rejected, 100)
