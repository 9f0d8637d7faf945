from __future__ import annotations

import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from cantools.database import DecodeError, Message, Signal
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.ingest.can.database import Database, MessageLayout, SignalLayout, _message_layout, load_database
from wheelprint.ingest.can.decode import (
    decode,
    decode_message,
    decode_payloads,
    decoder_of,
    message_schema,
    split_by_message,
    value_type,
)
from wheelprint.ingest.can.frames import DATA, ERROR, REMOTE, FrameBatch
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.tables import FRAMES

Value = int | float | None


def batch_of(payloads: list[bytes], width: int = 8, **columns: Any) -> FrameBatch:
    n = len(payloads)
    data = np.zeros((n, width), np.uint8)
    for row, payload in zip(data, payloads, strict=True):
        row[: len(payload)] = np.frombuffer(payload, np.uint8)
    return FrameBatch(
        time=np.asarray(columns.get("time", np.arange(n)), np.int64),
        channel=np.asarray(columns.get("channel", np.zeros(n)), np.int16),
        channels=columns.get("channels", ("can0",)),
        id=np.asarray(columns.get("id", np.full(n, 0x123)), np.uint32),
        extended=np.asarray(columns.get("extended", np.zeros(n)), bool),
        fd=np.asarray(columns.get("fd", np.zeros(n)), bool),
        kind=np.asarray(columns.get("kind", np.zeros(n)), np.uint8),
        length=np.array([len(payload) for payload in payloads], np.uint8),
        data=data,
    )


def decode_all(layout: MessageLayout, payloads: list[bytes], width: int = 8) -> dict[str, list[Value]]:
    batch = batch_of(payloads, width)
    return {name: array.to_pylist() for name, array in decode_payloads(layout, batch.data, batch.length).items()}


def alone(message: Message, signal: Signal) -> Message:
    """Return a message of one signal, always there: what cantools decodes whatever else the payload holds."""
    single = Signal(
        signal.name, signal.start, signal.length, signal.byte_order, signal.is_signed, conversion=signal.conversion
    )
    return Message(0, message.name, message.length, [single], strict=False)


def reference(message: Message, payloads: list[bytes]) -> dict[str, list[Value]]:
    """Decode with cantools, signal by signal; select multiplexed ones by their multiplexer's raw value."""
    raw: dict[str, list[Any]] = {}
    scaled: dict[str, list[Any]] = {}
    for signal in message.signals:
        single = alone(message, signal)
        for scaling, columns in ((False, raw), (True, scaled)):
            columns[signal.name] = [
                single.decode_simple(p, decode_choices=False, scaling=scaling, allow_truncated=True).get(signal.name)
                for p in payloads
            ]

    def selected(signal: Signal, row: int) -> bool:
        parent = signal.multiplexer_signal
        return parent is None or (
            raw[parent][row] in signal.multiplexer_ids and selected(message.get_signal_by_name(parent), row)
        )

    return {
        signal.name: [value if selected(signal, row) else None for row, value in enumerate(scaled[signal.name])]
        for signal in message.signals
    }


def same(got: Value, wanted: Value) -> bool:
    if wanted is None or (isinstance(wanted, float) and math.isnan(wanted)):
        return got is None
    if isinstance(wanted, int) and isinstance(got, float):
        return got == float(wanted)  # of a column that neither int64 nor uint64 holds, see test_types
    return got == wanted and math.copysign(1, got) == math.copysign(1, wanted)


@given(data=st.data(), seed=st.integers(0, 2**32))
def test_equals_cantools(messages: st.SearchStrategy[Message], data: st.DataObject, seed: int) -> None:
    message = data.draw(messages)
    layout = _message_layout(message, "")
    rng = np.random.default_rng(seed)
    longest = 8 if message.length <= 8 else 64
    lengths = rng.choice([message.length, message.length, longest, *range(longest + 1)], 12)
    payloads = [rng.bytes(length) for length in lengths]
    got, wanted = decode_all(layout, payloads, longest), reference(message, payloads)
    assert list(got) == list(wanted) == [signal.name for signal in layout.signals]
    for name, column in wanted.items():
        assert all(map(same, got[name], column)), (name, got[name], column)
    for row, payload in enumerate(payloads):
        try:
            whole = message.decode_simple(payload, decode_choices=False, allow_truncated=True)
        except DecodeError:
            continue  # a multiplexer value that no signal has: cantools gives up the common signals too
        assert all(same(got[name][row], whole.get(name)) for name in got)


@pytest.mark.parametrize(
    ("signal", "expected"),
    [
        (SignalLayout("s", 0, 8), pa.int64()),
        (SignalLayout("s", 0, 64), pa.uint64()),
        (SignalLayout("s", 0, 64, signed=True), pa.int64()),
        (SignalLayout("s", 0, 64, scale=-1), pa.float64()),
        (SignalLayout("s", 0, 62, scale=2, offset=1), pa.int64()),
        (SignalLayout("s", 0, 62, scale=2, offset=2), pa.uint64()),
        (SignalLayout("s", 0, 63, scale=2, offset=1), pa.uint64()),
        (SignalLayout("s", 0, 8, scale=0.5), pa.float64()),
        (SignalLayout("s", 0, 8, offset=0.5), pa.float64()),
        (SignalLayout("s", 0, 32, is_float=True), pa.float64()),
        (SignalLayout("s", 0, 65), pa.binary(9)),
    ],
)
def test_types(signal: SignalLayout, expected: pa.DataType) -> None:
    assert value_type(signal) == expected


@pytest.mark.parametrize(
    ("signal", "expected"),
    [
        (SignalLayout("s", 0, 64), 0xFEDCBA9876543210),
        (SignalLayout("s", 7, 64, big_endian=True), 0x1032547698BADCFE),
        (SignalLayout("s", 0, 64, signed=True), 0xFEDCBA9876543210 - 2**64),
        (SignalLayout("s", 4, 12), 0x321),
        (SignalLayout("s", 3, 12, big_endian=True), 0x032),
        (SignalLayout("s", 60, 4, signed=True), -1),
        (SignalLayout("s", 0, 63, scale=2, offset=1), 2 * 0x7EDCBA9876543210 + 1),
        (SignalLayout("s", 0, 64, scale=3, offset=0.25), 3 * 0xFEDCBA9876543210 + 0.25),
    ],
)
def test_bits_by_hand(signal: SignalLayout, expected: float) -> None:
    payload = bytes.fromhex("1032547698BADCFE")
    layout = MessageLayout("M", 1, False, 8, "", (signal,))
    assert decode_all(layout, [payload]) == {"s": [expected]}


def test_more_than_64_bits_stay_bits() -> None:
    payload = bytes(range(1, 13))
    signals = (
        SignalLayout("little", 0, 68),
        SignalLayout("big", 3, 68, big_endian=True),
        SignalLayout("beyond", 90, 80),
    )
    layout = MessageLayout("M", 1, False, 12, "", signals)
    assert decode_all(layout, [payload, payload[:8]], 64) == {
        "little": [bytes.fromhex("090807060504030201"), None],
        "big": [bytes.fromhex("010203040506070809"), None],
        "beyond": [None, None],
    }


def test_floats_that_are_not_numbers_are_null_and_infinities_are_not() -> None:
    layout = MessageLayout("M", 1, False, 4, "", (SignalLayout("f", 0, 32, is_float=True, scale=2),))
    floats = [np.nan, np.inf, -np.inf, 3e38, 0.1]
    payloads = [np.float32(value).tobytes() for value in floats] + [b"\x01\x00\x80\x7f"]  # the last: signalling
    assert decode_all(layout, payloads) == {
        "f": [None, math.inf, -math.inf, 2 * float(np.float32(3e38)), 2 * float(np.float32(0.1)), None]
    }


def test_short_frames_are_null_where_a_signal_is_cut() -> None:
    signals = (SignalLayout("a", 0, 8), SignalLayout("b", 4, 12), SignalLayout("c", 19, 12, big_endian=True))
    layout = MessageLayout("M", 1, False, 4, "", signals)
    payloads = [b"", b"\x21", b"\x21\x43", b"\x21\x43\x65\x87", b"\x21\x43\x65\x87\xff\xff"]
    assert decode_all(layout, payloads) == {
        "a": [None, 0x21, 0x21, 0x21, 0x21],
        "b": [None, None, 0x432, 0x432, 0x432],
        "c": [None, None, None, 0x587, 0x587],
    }


def test_signal_outside_its_message_is_there_where_the_frame_is_longer() -> None:
    layout = MessageLayout("M", 1, False, 1, "", (SignalLayout("a", 0, 8), SignalLayout("b", 8, 8)))
    assert decode_all(layout, [b"\x01", b"\x01\x02"]) == {"a": [1, 1], "b": [None, 2]}


def test_multiplexer_that_selects_nothing_leaves_the_common_signals() -> None:
    signals = (
        SignalLayout("mode", 0, 8),
        SignalLayout("inner", 8, 8, multiplexer="mode", multiplexer_values=(1, 3)),
        SignalLayout("deep", 16, 8, multiplexer="inner", multiplexer_values=(9,)),
        SignalLayout("common", 24, 8),
    )
    layout = MessageLayout("M", 1, False, 4, "", signals)
    payloads = [bytes(row) for row in ((1, 9, 5, 6), (1, 8, 5, 6), (2, 9, 5, 6), (3, 9, 5, 6), (77, 9, 5, 6))]
    assert decode_all(layout, payloads) == {
        "mode": [1, 1, 2, 3, 77],
        "inner": [9, 8, None, 9, None],
        "deep": [5, None, None, 5, None],
        "common": [6, 6, 6, 6, 6],
    }


SPEED = SignalLayout(
    "time", 8, 8, scale=0.5, offset=-1, unit="km/h", description="speed", choices=((0, "stop"), (4, "ö"))
)
LAYOUTS = (
    MessageLayout("B", 0x64, False, 2, "a message", (SPEED, SignalLayout("s", 0, 8, signed=True))),
    MessageLayout("A", 0x64, True, 1, "", (SignalLayout("s", 0, 8),)),
    MessageLayout("never", 0x65, False, 1, "", ()),
)
DATABASE = Database(LAYOUTS)


def example() -> FrameBatch:
    return batch_of(
        [b"\xff\x02", b"\x07", b"", b"\x01\x02", b"\x00\x00", b"\x05\x00", b"\x03\x00"],
        time=[10, 11, 12, 13, 14, 15, 9],
        id=[0x64, 0x64, 0x64, 0x64, 0x66, 0x64, 0x64],
        extended=[0, 1, 0, 0, 1, 0, 0],
        kind=[DATA, DATA, REMOTE, ERROR, DATA, DATA, DATA],
        channel=[1, 0, 0, 0, 0, 0, 1],
        channels=("can0", "can1"),
    )


@pytest.mark.parametrize("as_table", [False, True])
def test_decodes_frames_into_tables(as_table: bool) -> None:
    frames: Any = pa.Table.from_batches([example().to_arrow()]) if as_table else example()
    tables = decode(frames, DATABASE)
    assert list(tables) == ["B", "A"]
    for layout in LAYOUTS[:2]:
        assert tables[layout.name].schema.equals(message_schema(layout), check_metadata=True)
    b = tables["B"]
    assert b["time"].cast(pa.int64()).to_pylist() == [10, 15, 9]
    assert {name: b[name].to_pylist() for name in ("channel", "time_", "s")} == {
        "channel": ["can1", "can0", "can1"],
        "time_": [0.0, -1.0, -1.0],
        "s": [-1, 5, 3],
    }
    assert tables["A"].drop_columns(["time"]).to_pylist() == [{"channel": "can0", "s": 7}]


def test_decodes_pieces_of_a_table() -> None:
    table = pa.concat_tables([pa.Table.from_batches([example().to_arrow()])] * 3)
    whole = decode(table, DATABASE)["B"]["s"].to_pylist()
    assert whole == [-1, 5, 3] * 3
    assert decode(table.slice(5, 3), DATABASE)["B"]["s"].to_pylist() == [5, 3, -1]
    assert decode(table.slice(0, 0), DATABASE) == {}
    assert decode(FRAMES.empty_table(), DATABASE) == {}
    assert decode(example(), Database()) == {}


def test_schema_says_what_a_column_is() -> None:
    schema = message_schema(LAYOUTS[0])
    assert schema.names == ["time", "channel", "time_", "s"]
    assert schema.metadata == {b"message": b"B", b"id": b"0x64", b"extended": b"false", b"description": b"a message"}
    metadata = {key.decode(): value.decode() for key, value in schema.field("time_").metadata.items()}
    assert json.loads(metadata.pop("choices")) == {"-1.0": "stop", "1.0": "ö"}
    assert metadata == {"unit": "km/h", "description": "speed", "message": "B", "signal": "time"}
    assert schema.field("time").equals(FRAMES.field("time"), check_metadata=True)


def test_groups_frames_and_counts_the_unknown() -> None:
    groups, unknown = split_by_message(example(), DATABASE)
    assert [(layout.name, frames.time.tolist()) for layout, frames in groups] == [("B", [10, 15, 9]), ("A", [11])]
    assert unknown == Counter({(0x66, True): 1})
    assert decode_message(decoder_of(LAYOUTS[0]), groups[0][1]).num_rows == 3


@pytest.mark.parametrize("width", [8, 64])
def test_groups_keep_all_that_is_decoded_of_a_frame(width: int) -> None:
    payloads = [bytes(range(k, k + width - k)) for k in range(6)]
    batch = batch_of(
        payloads,
        width,
        time=[5, 4, 3, 2, 1, 0],
        id=[0x64, 0x65, 0x64, 0x64, 0x65, 0x64],
        extended=[0, 0, 1, 0, 0, 0],
        fd=[0, 1, 1, 1, 0, 0],
        channel=[1, 0, 1, 0, 1, 0],
        channels=("a", "b"),
    )
    groups, _ = split_by_message(batch, DATABASE)
    got = {layout.name: frames for layout, frames in groups}
    assert list(got) == ["B", "A", "never"]
    for name, rows in {"B": [0, 3, 5], "A": [2], "never": [1, 4]}.items():
        frames = got[name]
        assert (len(frames), frames.channels) == (len(rows), ("a", "b"))
        for column in ("time", "channel", "id", "length", "data"):
            assert getattr(frames, column).dtype == getattr(batch, column).dtype
            np.testing.assert_array_equal(getattr(frames, column), getattr(batch, column)[rows])


@given(st.lists(st.tuples(st.integers(0, 40), st.booleans(), st.sampled_from([DATA, DATA, REMOTE])), max_size=60))
def test_groups_like_a_plain_loop(frames: list[tuple[int, bool, int]]) -> None:
    database = Database(tuple(MessageLayout(f"m{k}", 3 * k, k % 2 == 0, 8, "", ()) for k in (4, 2, 9, 1)))
    n = len(frames)
    batch = batch_of([b""] * n, id=[f[0] for f in frames], extended=[f[1] for f in frames], kind=[f[2] for f in frames])
    groups, unknown = split_by_message(batch, database)
    keys = {(m.id, m.extended): m.name for m in database.messages}
    wanted: dict[str, list[int]] = {}
    counted: Counter[tuple[int, bool]] = Counter()
    for row, (number, extended, kind) in enumerate(frames):
        if kind == DATA and (number, extended) in keys:
            wanted.setdefault(keys[number, extended], []).append(row)
        elif kind == DATA:
            counted[number, extended] += 1
    assert {layout.name: part.time.tolist() for layout, part in groups} == wanted
    assert [layout.name for layout, _ in groups] == [m.name for m in database.messages if m.name in wanted]
    assert unknown == counted


def test_decodes_with_a_shipped_database_or_a_path(tmp_path: Path) -> None:
    batch = batch_of([b"\x10\x00\x00\x00\x00"], id=[0x11F])
    assert decode(batch, "byd_tang")["STEER"]["ANGLE"].to_pylist() == [1.6]
    path = tmp_path / "car.dbc"
    path.write_text('VERSION ""\nBS_:\nBU_:\nBO_ 287 STEER: 5 X\n SG_ ANGLE : 0|16@1- (0.1,0) [0|0] "deg" X\n')
    assert decode(batch, path)["STEER"]["ANGLE"].to_pylist() == [1.6]
    with pytest.raises(InputError) as caught:
        decode(batch, tmp_path / "missing.kcd")
    assert str(caught.value) == (
        f"{tmp_path}/missing.kcd: no such file. A database is a shipped name (byd_tang, oxts) or the path of a file"
    )


def test_shipped_database_equals_cantools() -> None:
    import cantools

    import wheelprint.schemas.databases as package

    wanted = cantools.database.load_file(Path(package.__path__[0]) / "byd_tang.dbc")
    database = load_database(["byd_tang"], Path())
    rng = np.random.default_rng(5)
    for message in wanted.messages:
        payloads = [rng.bytes(message.length) for _ in range(100)]
        got = decode_all(database.by_name[message.name], payloads)
        rows = [message.decode(payload, decode_choices=False) for payload in payloads]
        assert {name: set(map(type, column)) for name, column in got.items()} == {
            name: {type(rows[0][name])} for name in got
        }
        assert [{name: column[k] for name, column in got.items()} for k in range(100)] == rows


def test_batches_are_joined_whatever_their_channels_and_widths_are() -> None:
    one = batch_of([b"\x01", b"\x02"], time=[1, 2], channel=[0, 1], channels=("a", "b"))
    two = batch_of([b"\x03" * 12, b"\x04"], 64, time=[3, 4], channel=[1, 0], channels=("c", "a"), fd=[1, 0])
    joined = FrameBatch.join([one, two])
    expected = pa.Table.from_batches([one.to_arrow(), two.to_arrow()])
    assert pa.Table.from_batches([joined.to_arrow()]).equals(expected.combine_chunks())
    assert FrameBatch.join([one]) is one
