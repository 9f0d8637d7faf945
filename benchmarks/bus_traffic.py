"""Traffic of a car's buses from a seed, with its DBC: 40 messages, 347 signals, three of the messages multiplexed.

The same frames can be written as candump, BLF, or MF4 bus logging. Signals are what buses carry: sensors that move
slowly under a little noise, counters, checksums, switches and states.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from wheelprint.ingest.can.candump_writer import write_candump
from wheelprint.ingest.can.frames import DATA, FrameBatch

START = 1_700_000_000_000_000_000
"""ns since 1970."""
CYCLES_MS = (10,) * 14 + (20,) * 14 + (50,) * 6 + (100,) * 6
MULTIPLEXED = (5, 17, 30)
"""Numbers of the messages that have a multiplexer."""
CHANNELS = ("can0", "can1")
STRETCH_MS = 200_000
"""Traffic is made in stretches of so long, a multiple of every cycle."""
FRAMES_A_STRETCH = sum(STRETCH_MS // cycle for cycle in CYCLES_MS)

Words = npt.NDArray[np.uint64]


@dataclass(frozen=True, slots=True)
class Field:
    """One signal.

    Attributes:
        name: In the DBC.
        kind: `sensor`, `counter`, `checksum`, `switch` or `multiplexer`.
        first: Its first bit, counted from the least (big-endian: most) significant bit of each byte.
        length: Bits.
        signed: Two's complement.
        factor: As the DBC writes it.
        offset: See `factor`.
        page: Value of the multiplexer that selects it, None where it is always there.
    """

    name: str
    kind: str
    first: int
    length: int
    signed: bool = False
    factor: str = "1"
    offset: str = "0"
    page: int | None = None


@dataclass(frozen=True, slots=True)
class Message:
    """One message of 8 bytes.

    Attributes:
        name: In the DBC.
        id: 11 or, from 2048 on, 29 bits.
        channel: Index of its bus.
        cycle_ms: It is sent so often.
        big_endian: Byte order of all its signals.
        fields: They do not overlap, but where pages of a multiplexer take turns.
    """

    name: str
    id: int
    channel: int
    cycle_ms: int
    big_endian: bool
    fields: tuple[Field, ...]


def messages(seed: int) -> list[Message]:
    """Draw the messages."""
    rng = np.random.default_rng([seed, 0])
    ids = rng.choice(np.arange(0x80, 0x7FF), len(CYCLES_MS), replace=False)
    drawn = []
    for number, cycle in enumerate(CYCLES_MS):
        name = f"Message{number:02d}"
        identifier = 0x18FF0000 + number if number % 10 == 9 else int(ids[number])
        fields = _pages(rng, name) if number in MULTIPLEXED else tuple(_fields(rng, name, 0, 64, 8, None))
        drawn.append(Message(name, identifier, number % 2, cycle, number % 3 == 0, fields))
    return drawn


def _pages(rng: np.random.Generator, name: str) -> tuple[Field, ...]:
    """Return 17 signals: a multiplexer, four that are always there, and four pages of three."""
    fields = [Field(f"{name}_Page", "multiplexer", 0, 4), *_fields(rng, name, 4, 28, 4, None)]
    for page in range(4):
        fields += _fields(rng, f"{name}_Page{page}", 32, 32, 3, page)
    return tuple(fields)


def _fields(
    rng: np.random.Generator, name: str, first: int, bits: int, count: int, page: int | None
) -> Iterator[Field]:
    """Divide bits among so many signals."""
    narrow = [int(length) for length in rng.choice((1, 2, 4, 8), count // 2)]
    spare = bits - sum(narrow)
    wide = count - len(narrow)
    lengths = rng.permutation([*narrow, *[min(16, spare // wide)] * wide])
    for number, length in enumerate(lengths.tolist()):
        kind = {1: "switch", 2: "switch", 4: "counter", 8: "checksum"}.get(length, "sensor")
        factor, offset = ("1", "0") if kind != "sensor" else (str(rng.choice(("0.1", "0.01", "0.0625", "1"))), "0")
        if kind == "sensor" and rng.random() < 0.3:
            offset = str(rng.choice(("-40", "-1000", "0.5")))
        signed = kind == "sensor" and bool(rng.random() < 0.5)
        yield Field(f"{name}_Signal{number}", kind, first, length, signed, factor, offset, page)
        first += length


def dbc(layouts: list[Message]) -> str:
    """Return the database."""
    lines = ['VERSION ""', "", "NS_ :", "", "BS_:", "", "BU_: ECU", ""]
    for message in layouts:
        lines.append(f"BO_ {message.id | (message.id > 0x7FF) << 31} {message.name}: 8 ECU")
        for field in message.fields:
            start = field.first ^ 7 if message.big_endian else field.first
            role = " M" if field.kind == "multiplexer" else "" if field.page is None else f" m{field.page}"
            order, sign = int(not message.big_endian), "-" if field.signed else "+"
            scaling = f'({field.factor},{field.offset}) [0|0] ""'
            lines.append(f" SG_ {field.name}{role} : {start}|{field.length}@{order}{sign} {scaling} Vector__XXX")
        lines.append("")
    return "\n".join(lines)


def frames(layouts: list[Message], seed: int, count: int) -> Iterator[FrameBatch]:
    """Yield the first `count` frames of the traffic, a stretch at a time."""
    for number in range(-(-count // FRAMES_A_STRETCH)):
        stretch = _stretch(layouts, np.random.default_rng([seed, 1, number]), number)
        size = min(count - number * FRAMES_A_STRETCH, FRAMES_A_STRETCH)
        data, channel = stretch.data[:size], stretch.channel[:size]
        none, eight = np.zeros(size, bool), np.full(size, 8, np.uint8)
        yield FrameBatch(
            stretch.time[:size], channel, CHANNELS, stretch.id[:size], stretch.id[:size] > 0x7FF, none,
            np.full(size, DATA, np.uint8), eight, data,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Stretch:
    time: npt.NDArray[np.int64]
    channel: npt.NDArray[np.int16]
    id: npt.NDArray[np.uint32]
    data: npt.NDArray[np.uint8]


def _stretch(layouts: list[Message], rng: np.random.Generator, number: int) -> _Stretch:
    """Make all frames of one stretch, in the order of time."""
    parts = []
    for message in layouts:
        n = STRETCH_MS // message.cycle_ms
        sent = (number * n + np.arange(n)) * message.cycle_ms * 1000 + rng.integers(0, 400, n) + message.id % 9000
        word = np.zeros(n, np.uint64)
        page = np.arange(n) % 4
        for field in message.fields:
            raw = _raw(field, rng, sent.astype(np.float64) * 1e-6, page)
            if field.page is not None:
                raw = np.where(page == field.page, raw, np.uint64(0))
            shift = 64 - field.first - field.length if message.big_endian else field.first
            word |= raw << np.uint64(shift)
        payload = word.astype(">u8" if message.big_endian else "<u8").view(np.uint8).reshape(n, 8)
        parts.append((sent, np.full(n, message.channel, np.int16), np.full(n, message.id, np.uint32), payload))
    time, channel, identifier, data = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(time, kind="stable")
    return _Stretch(START + 1000 * time[order], channel[order], identifier[order], data[order])


def _raw(
    field: Field, rng: np.random.Generator, seconds: npt.NDArray[np.float64], page: npt.NDArray[np.int64]
) -> Words:
    """Return the raw values of a signal at the times it is sent."""
    n, most = len(seconds), (1 << field.length) - 1
    if field.kind == "multiplexer":
        return page.astype(np.uint64)
    if field.kind == "counter":
        return (np.arange(n) & most).astype(np.uint64)
    if field.kind == "checksum":
        return rng.integers(0, most + 1, n).astype(np.uint64)
    phase = 2 * np.pi * rng.random()
    if field.kind == "switch":
        return (np.sin(seconds / 7 + phase) > 0.8).astype(np.uint64)
    moving = 0.3 * np.sin(seconds / 5 + phase) + 0.1 * np.sin(seconds / 0.7) + rng.normal(0, 0.001, n)
    centre = 0.0 if field.signed else 0.5
    return np.rint((centre + moving) * most).astype(np.int64).view(np.uint64) & np.uint64(most)


def write_logs(folder: Path, seed: int, count: int, kinds: tuple[str, ...]) -> None:
    """Write `bus.dbc` and the traffic as `bus.log` (candump), `bus.blf` and `bus.mf4`, whichever of the kinds."""
    layouts = messages(seed)
    (folder / "bus.dbc").write_text(dbc(layouts), encoding="ascii")
    if "log" in kinds:
        write_candump(folder / "bus.log", frames(layouts, seed, count))
    if "blf" in kinds:
        write_blf(folder / "bus.blf", frames(layouts, seed, count))
    if "mf4" in kinds:
        write_mf4(folder / "bus.mf4", frames(layouts, seed, count))


def write_blf(path: Path, batches: Iterator[FrameBatch]) -> None:
    """Write CAN_MESSAGE objects in compressed containers of 128 KiB, as python-can's writer does."""
    record = np.dtype(
        [
            ("signature", "S4"), ("header", "<u2"), ("version", "<u2"), ("size", "<u4"), ("type", "<u4"),
            ("flags", "<u4"), ("client", "<u2"), ("object", "<u2"), ("time", "<u8"),
            ("channel", "<u2"), ("direction", "u1"), ("dlc", "u1"), ("id", "<u4"), ("data", "u1", (8,)),
        ]
    )  # fmt: skip
    with path.open("wb") as file:
        file.write(bytes(144))
        unpacked = objects = 0
        for batch in batches:
            content = np.zeros(len(batch), record)
            content["signature"], content["header"], content["version"] = b"LOBJ", 32, 1
            content["size"], content["type"], content["flags"], content["dlc"] = record.itemsize, 1, 2, 8
            content["time"], content["channel"] = batch.time - START, batch.channel + 1
            content["id"], content["data"] = batch.id | batch.extended.astype(np.uint32) << 31, batch.data
            unpacked, objects = unpacked + content.nbytes, objects + len(batch)
            octets = content.tobytes()
            for begin in range(0, len(octets), 1 << 17):
                piece = octets[begin : begin + (1 << 17)]
                packed = zlib.compress(piece, 6)
                file.write(struct.pack("<4sHHII", b"LOBJ", 16, 1, 32 + len(packed), 10))
                file.write(struct.pack("<H6xI4x", 2, len(piece)) + packed + bytes(len(packed) % 4))
        size = file.tell()
        begun = np.datetime64(START, "ns").astype("M8[ms]").item()
        date = (begun.year, begun.month, begun.isoweekday() % 7, begun.day, begun.hour, begun.minute, begun.second, 0)
        file.seek(0)
        sizes = (144, 5, 0, 0, 0, 2, 6, 8, 1, size, unpacked, objects, 0)
        file.write(struct.pack("<4sIBBBBBBBBQQII8H8H", b"LOGG", *sizes, *date, *date))


def write_mf4(path: Path, batches: Iterator[FrameBatch]) -> None:
    """Write the frames as one group `CAN_DataFrame` of MF4 bus logging, with asammdf."""
    from datetime import UTC, datetime

    from asammdf import MDF, Signal, Source
    from asammdf.blocks import v4_constants as v4c

    log = MDF(version="4.10")
    log.start_time = datetime.fromtimestamp(START // 10**9, UTC)
    record = np.dtype(
        [
            ("CAN_DataFrame.BusChannel", "u1"), ("CAN_DataFrame.ID", "<u4"), ("CAN_DataFrame.IDE", "u1"),
            ("CAN_DataFrame.DLC", "u1"), ("CAN_DataFrame.DataLength", "u1"), ("CAN_DataFrame.DataBytes", "u1", (8,)),
        ]
    )  # fmt: skip
    every = list(batches)
    content = np.zeros(sum(map(len, every)), record)
    content["CAN_DataFrame.BusChannel"] = np.concatenate([batch.channel for batch in every]) + 1
    content["CAN_DataFrame.ID"] = np.concatenate([batch.id for batch in every])
    content["CAN_DataFrame.IDE"] = np.concatenate([batch.extended for batch in every])
    content["CAN_DataFrame.DLC"] = content["CAN_DataFrame.DataLength"] = 8
    content["CAN_DataFrame.DataBytes"] = np.concatenate([batch.data for batch in every])
    time = np.concatenate([batch.time for batch in every]) - START
    source = Source(name="CAN", path="CAN", comment="", source_type=v4c.SOURCE_BUS, bus_type=v4c.BUS_TYPE_CAN)
    signal = Signal(content, time / 1e9, name="CAN_DataFrame", source=source)
    log.append(signal, comment="CAN_DataFrame", common_timebase=True)
    log.save(path, overwrite=True, compression=0)
    log.close()
