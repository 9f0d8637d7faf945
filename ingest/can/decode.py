"""Decoding of CAN frames, a column at a time: bits to raw numbers to physical values."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ...schemas.tables import FRAMES
from .database import Database, MessageLayout, SignalLayout, load_database
from .frames import DATA, FrameBatch, MessageFrames
from .matching import find_messages, is_addressed, parameter_group

_EXACT = 2**53  # beyond it not every integer is a float64


def decode(frames: pa.Table | FrameBatch, database: Database | str | Path) -> dict[str, pa.Table]:
    """Decode every data frame that a database knows.

    Args:
        frames: Frames in the schema `FRAMES`, or a batch.
        database: A loaded database, a shipped name, or the path of a DBC, KCD, SYM or ARXML file.

    Returns:
        By name of message, in the database's order and only for messages that occur: a table in the schema
        `message_schema`, its rows in the order of the frames.

    Raises:
        InputError: The database cannot be loaded.
    """
    if not isinstance(database, Database):
        database = load_database([str(database)], Path())
    batch = frames if isinstance(frames, FrameBatch) else FrameBatch.from_arrow(frames)
    groups, _ = split_by_message(batch, database)
    return {
        layout.name: pa.Table.from_batches([decode_message(decoder_of(layout), part)]).cast(message_schema(layout))
        for layout, part in groups
    }


def split_by_message(
    batch: FrameBatch, database: Database
) -> tuple[list[tuple[MessageLayout, MessageFrames]], Counter[tuple[int, bool]]]:
    """Group data frames by message; remote and error frames carry no signals and are left aside.

    Returns:
        Messages that occur, in the database's order, each with its frames in the order of the batch; and how many
        frames no message stands for, by identifier and whether it is extended.
    """
    from .grouping import places_by_group, put

    messages = database.messages
    unknown, no_data = len(messages), len(messages) + 1
    if all(message.channel is None for message in messages):
        group = find_messages(messages, batch.id, batch.extended, "")
    else:
        group = np.full(len(batch), unknown, np.uint16)
        for index, channel in enumerate(batch.channels):
            here = np.flatnonzero(batch.channel == index)
            group[here] = find_messages(messages, batch.id[here], batch.extended[here], channel)
    group[batch.kind != DATA] = no_data
    places, begins = places_by_group(group, no_data + 1)
    words = np.ascontiguousarray(batch.data).view(np.uint64)
    ordered = MessageFrames(
        put(batch.time, places),
        put(batch.channel, places),
        batch.channels,
        put(batch.id, places),
        put(batch.length, places),
        put(words[:, 0] if words.shape[1] == 1 else words, places).view(np.uint8).reshape(batch.data.shape),
    )
    parts = [ordered.part(slice(*ends)) for ends in pairwise(begins[: unknown + 1].tolist())]
    left = np.flatnonzero(group == unknown)
    identifiers = batch.id[left] | batch.extended[left].astype(np.int64) << 32
    keys, frames = np.unique(identifiers, return_counts=True)
    return (
        [(layout, part) for layout, part in zip(messages, parts, strict=True) if len(part)],
        Counter({(int(key) & 0xFFFFFFFF, bool(key >> 32)): int(n) for key, n in zip(keys, frames, strict=True)}),
    )


@dataclass(frozen=True, slots=True)
class MessageDecoder:
    """A message and what is known of its columns before its first frame; see `decoder_of`.

    Attributes:
        layout: The message.
        schema: That of its decoded frames: `message_schema`, but for the channel, which is a dictionary of names.
        kinds: Types of the signals' columns.
        by_bits: Which of them compiled code only gets the bits of.
        places: (signals, 5), as `signal_bits.columns` takes it, and so the following ones.
        numbers: (signals, 2).
        integers: (signals, 2).
        multiplexers: By name of a multiplexer: the row behind those of the signals that holds its bits.
    """

    layout: MessageLayout
    schema: pa.Schema
    kinds: tuple[pa.DataType, ...]
    by_bits: tuple[bool, ...]
    places: npt.NDArray[np.int64]
    numbers: npt.NDArray[np.float64]
    integers: npt.NDArray[np.uint64]
    multiplexers: dict[str, int]


def decoder_of(layout: MessageLayout) -> MessageDecoder:
    """Return what decodes a message."""
    from .signal_bits import BITS, INTEGER, NUMBER

    by_name = {signal.name: signal for signal in layout.signals}
    kinds = tuple(value_type(signal) for signal in layout.signals)
    multiplexers = dict.fromkeys(signal.multiplexer for signal in layout.signals if signal.multiplexer is not None)
    by_bits = tuple(_needs_python(signal, kind) for signal, kind in zip(layout.signals, kinds, strict=True))
    wanted = [
        (signal, BITS if bits else INTEGER if pa.types.is_integer(kind) else NUMBER)
        for signal, kind, bits in zip(layout.signals, kinds, by_bits, strict=True)
    ] + [(by_name[name], BITS) for name in multiplexers]
    places = [
        # Of more than 64 bits there is nothing here; see `_long_bits`.
        (signal.first_bit, min(signal.length, 64), signal.big_endian, signal.signed, kind) for signal, kind in wanted
    ]  # fmt: skip
    schema = message_schema(layout)
    channel = schema.get_field_index("channel")
    return MessageDecoder(
        layout,
        schema.set(channel, schema.field(channel).with_type(pa.dictionary(pa.int32(), pa.string()))),
        kinds,
        by_bits,
        np.array(places, np.int64).reshape(-1, 5),
        np.array([(s.scale, s.offset) for s, _ in wanted], np.float64).reshape(-1, 2),
        np.array(
            [(int(s.scale) % 2**64, int(s.offset) % 2**64) if k == INTEGER else (0, 0) for s, k in wanted], np.uint64
        ).reshape(-1, 2),
        {name: len(kinds) + number for number, name in enumerate(multiplexers)},
    )


def decode_message(decoder: MessageDecoder, frames: MessageFrames) -> pa.RecordBatch:
    """Return frames, all of one message, in the decoder's schema."""
    schema, count = decoder.schema, len(frames)
    time = pa.Array.from_buffers(schema.field("time").type, count, [None, pa.py_buffer(frames.time)], 0)
    channels = pa.DictionaryArray.from_arrays(frames.channel.astype(np.int32), pa.array(frames.channels, pa.string()))
    fields = _address_fields(decoder.layout)
    addresses = [pa.array((frames.id >> shift).astype(np.uint8)) for shift in (0, 8)[: len(fields)]]
    signals = _decode(decoder, frames.data, frames.length)
    return pa.RecordBatch.from_arrays([time, channels, *addresses, *signals], schema=schema)


def message_schema(layout: MessageLayout) -> pa.Schema:
    """Return the schema of a decoded message: `time`, `channel`, then its signals in the database's order.

    A J1939 message has `source`, the sender's address, before its signals and, where it is sent to one receiver (PDU1),
    `destination`; its metadata have `pgn` (hexadecimal).

    Every signal's field has the metadata `unit`, `description`, `message`, `signal` and, where it has a value table,
    `choices`: JSON of the stored value (as text) to its name. The schema's metadata are `message`, `id` (hexadecimal),
    `extended` and `description`. A signal called like a frame's own column, such as `time`, is in `time_`.
    """
    return pa.schema(
        [
            FRAMES.field("time"),
            FRAMES.field("channel"),
            *_address_fields(layout),
            *(_signal_field(layout, signal) for signal in layout.signals),
        ],
        metadata={
            "message": layout.name,
            "id": f"0x{layout.id:X}",
            "extended": str(layout.extended).lower(),
            "description": layout.description,
        }
        | ({"pgn": f"0x{parameter_group(layout.id):X}"} if layout.j1939 else {}),
    )


def _address_fields(layout: MessageLayout) -> list[pa.Field]:
    if not layout.j1939:
        return []
    fields = [pa.field("source", pa.uint8(), metadata={"description": "J1939 address of the sender"})]
    if is_addressed(layout.id):
        fields.append(pa.field("destination", pa.uint8(), metadata={"description": "J1939 address of the receiver"}))
    return fields


def _signal_field(layout: MessageLayout, signal: SignalLayout) -> pa.Field:
    metadata = {
        "unit": signal.unit,
        "description": signal.description,
        "message": layout.name,
        "signal": signal.name,
    }
    if signal.choices:
        stored = {str(raw * signal.scale + signal.offset): name for raw, name in signal.choices}
        metadata["choices"] = json.dumps(stored, ensure_ascii=False)
    return pa.field(signal.column, value_type(signal), metadata=metadata)


def value_type(signal: SignalLayout) -> pa.DataType:
    """Return the type of a signal's column.

    int64 (uint64 where only that holds every value) for integers with integer scale and offset; float64 for others;
    the bits themselves, most significant first and filled up with zeros on the left, for more than 64 of them.
    """
    if signal.length > 64:
        return pa.binary((signal.length + 7) // 8)
    if signal.is_float or not isinstance(signal.scale, int) or not isinstance(signal.offset, int):
        return pa.float64()
    ends = [raw * signal.scale + signal.offset for raw in raw_range(signal)]
    for kind, low, high in ((pa.int64(), -(2**63), 2**63 - 1), (pa.uint64(), 0, 2**64 - 1)):
        if low <= min(ends) and max(ends) <= high:
            return kind
    return pa.float64()


def raw_range(signal: SignalLayout) -> tuple[int, int]:
    """Return the smallest and the largest raw value of an integer signal."""
    if signal.signed:
        return -(1 << (signal.length - 1)), (1 << (signal.length - 1)) - 1
    return 0, (1 << signal.length) - 1


def decode_payloads(
    layout: MessageLayout, data: npt.NDArray[np.uint8], length: npt.NDArray[np.uint8]
) -> dict[str, pa.Array]:
    """Decode payloads of one message.

    A signal is null in frames that are too short to hold all of it, in frames whose multiplexer selects others, and
    where a float is not a number (NaN, which senders use for "not available"). Other values are those of cantools,
    bit for bit; integers that neither int64 nor uint64 holds are rounded to float64.

    Args:
        layout: The message.
        data: (n, w) payloads, w = 8 or 64, padded with zeros.
        length: (n,) payload bytes.

    Returns:
        By column, in the database's order: (n,) physical values.
    """
    decoded = _decode(decoder_of(layout), data, length)
    return dict(zip((signal.column for signal in layout.signals), decoded, strict=True))


def _decode(decoder: MessageDecoder, data: npt.NDArray[np.uint8], length: npt.NDArray[np.uint8]) -> list[pa.Array]:
    """Return the columns of a message's signals, in the database's order."""
    from .signal_bits import columns

    signals = decoder.layout.signals
    payloads = np.ascontiguousarray(data).view("<u8").astype(np.uint64, copy=False)
    values = columns(payloads, decoder.places, decoder.numbers, decoder.integers)
    absences = _absences(decoder, values, length)

    decoded = []
    for signal, kind, by_bits, column in zip(signals, decoder.kinds, decoder.by_bits, values, strict=False):
        if pa.types.is_fixed_size_binary(kind):
            decoded.append(pa.array(_long_bits(signal, data), kind, mask=absences[signal.name]))
            continue
        physical, absent = _physical(signal, column) if by_bits else column, absences[signal.name]
        if signal.is_float:
            missing = np.isnan(physical)
            absent = missing if absent is None else absent | missing
        present = None if absent is None else pa.py_buffer(np.packbits(~absent, bitorder="little"))
        decoded.append(pa.Array.from_buffers(kind, len(column), [present, pa.py_buffer(physical)]))
    return decoded


def _absences(
    decoder: MessageDecoder, values: npt.NDArray[np.uint64], length: npt.NDArray[np.uint8]
) -> dict[str, npt.NDArray[np.bool_] | None]:
    """Return by signal in which frames it is not there; None: it is in all."""
    absences: dict[str, npt.NDArray[np.bool_] | None] = {}
    shortest = int(length.min(initial=64))
    selections: dict[tuple[str, tuple[int, ...]], npt.NDArray[np.bool_]] = {}
    by_name = {signal.name: signal for signal in decoder.layout.signals}
    left = list(reversed(decoder.layout.signals))
    while left:
        signal = left.pop()
        if signal.multiplexer is not None and signal.multiplexer not in absences:
            left += [signal, by_name[signal.multiplexer]]
            continue
        stop = signal.first_bit + signal.length
        absent = None if stop <= 8 * shortest else length.astype(np.int32) * 8 < stop
        if signal.multiplexer is not None:
            key = (signal.multiplexer, signal.multiplexer_values)
            if key not in selections:
                bits, selecting = values[decoder.multiplexers[signal.multiplexer]], signal.multiplexer_values
                selections[key] = (
                    bits != selecting[0]
                    if len(selecting) == 1
                    else np.isin(bits, np.array(selecting, np.uint64), invert=True)
                )
            for other in (selections[key], absences[signal.multiplexer]):
                absent = other if absent is None else absent if other is None else absent | other
        absences[signal.name] = absent
    return absences


def _needs_python(signal: SignalLayout, kind: pa.DataType) -> bool:
    """Tell whether compiled code gets a signal's bits only: IEEE 754, more than 64 of them, or beyond float64's 53."""
    if signal.is_float or signal.length > 64:
        return True
    largest = max(map(abs, raw_range(signal))) * abs(signal.scale)
    return pa.types.is_floating(kind) and isinstance(signal.scale, int) and largest > _EXACT


def _physical(signal: SignalLayout, bits: npt.NDArray[np.uint64]) -> npt.NDArray[np.float64]:
    scale, offset = signal.scale, signal.offset
    if signal.is_float:
        size = signal.length // 8
        # Any bits may come: a signalling NaN or a product beyond float64 is no reason to warn.
        with np.errstate(all="ignore"):
            floats = bits.astype(f"u{size}").view(f"f{size}").astype(np.float64)
            return floats if scale == 1 and offset == 0 else floats * float(scale) + float(offset)
    raw: npt.NDArray[np.int64] | npt.NDArray[np.uint64] = bits
    if signal.signed:
        spare = np.int64(64 - signal.length)
        raw = bits.view(np.int64) << spare >> spare
    # The product must not be rounded before the offset is added; Python's integers do not.
    return (raw.astype(object) * scale + offset).astype(np.float64)


def _long_bits(signal: SignalLayout, data: npt.NDArray[np.uint8]) -> npt.NDArray[np.object_]:
    """Return the bits of a signal of more than 64, most significant first."""
    stop = signal.first_bit + signal.length
    bits = np.zeros((len(data), max(stop, 8 * data.shape[1])), np.uint8)
    bits[:, : 8 * data.shape[1]] = np.unpackbits(data, axis=1, bitorder="big" if signal.big_endian else "little")
    number = bits[:, signal.first_bit : stop]
    if not signal.big_endian:
        number = number[:, ::-1]
    rows = np.packbits(np.pad(number, ((0, 0), (-signal.length % 8, 0))), axis=1)
    return np.array([row.tobytes() for row in rows], object)
