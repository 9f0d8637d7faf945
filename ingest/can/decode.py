"""Decoding of CAN frames, a column at a time: bits to raw numbers to physical values."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ...schemas.tables import FRAMES
from .database import Database, MessageLayout, SignalLayout, load_database
from .frames import DATA, FrameBatch
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
    return {layout.name: pa.Table.from_batches([decode_message(layout, batch, rows)]) for layout, rows in groups}


def split_by_message(
    batch: FrameBatch, database: Database
) -> tuple[list[tuple[MessageLayout, npt.NDArray[np.intp]]], Counter[tuple[int, bool]]]:
    """Group data frames by message; remote and error frames carry no signals and are left aside.

    Returns:
        Messages that occur, in the database's order, each with the ascending indexes of its frames; and how many
        frames no message stands for, by identifier and whether it is extended.
    """
    messages = database.messages
    rows = np.flatnonzero(batch.kind == DATA)
    identifiers, extended = batch.id[rows], batch.extended[rows]
    if all(message.channel is None for message in messages):
        group = find_messages(messages, identifiers, extended, "")
    else:
        group = np.full(len(rows), len(messages), np.uint16)
        for index, channel in enumerate(batch.channels):
            here = np.flatnonzero(batch.channel[rows] == index)
            group[here] = find_messages(messages, identifiers[here], extended[here], channel)
    # numpy sorts 16-bit integers by counting, in linear time.
    rows = rows[np.argsort(group, kind="stable")]
    counts = np.bincount(group, minlength=len(messages) + 1)
    parts = np.split(rows, np.cumsum(counts)[:-1])
    others = group == len(messages)
    keys = identifiers[others] | extended[others].astype(np.int64) << 32
    unknown, frames = np.unique(keys, return_counts=True)
    return (
        [(layout, part) for layout, part in zip(messages, parts, strict=False) if len(part)],
        Counter({(int(key) & 0xFFFFFFFF, bool(key >> 32)): int(n) for key, n in zip(unknown, frames, strict=True)}),
    )


def decode_message(layout: MessageLayout, batch: FrameBatch, rows: npt.NDArray[np.intp]) -> pa.RecordBatch:
    """Return the frames `rows` of a batch, all of one message, in the schema `message_schema`."""
    schema = message_schema(layout)
    signals = decode_payloads(layout, batch.data.take(rows, axis=0), batch.length[rows])
    channels = pa.array(batch.channels, pa.string()).take(pa.array(batch.channel[rows]))
    addresses = [
        pa.array((batch.id[rows] >> shift).astype(np.uint8)) for shift in (0, 8)[: len(_address_fields(layout))]
    ]
    return pa.RecordBatch.from_arrays(
        [pa.array(batch.time[rows], schema.field("time").type), channels, *addresses, *signals.values()], schema=schema
    )


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
    words = _Words(data)
    shortest = int(length.min(initial=data.shape[1]))
    by_name = {signal.name: signal for signal in layout.signals}
    absences: dict[str, npt.NDArray[np.bool_] | None] = {}

    def absence(signal: SignalLayout) -> npt.NDArray[np.bool_] | None:
        """Return where a signal is not there, or None where it is everywhere."""
        if signal.name not in absences:
            stop = signal.first_bit + signal.length
            absent = None if stop <= 8 * shortest else length.astype(np.int32) * 8 < stop
            if signal.multiplexer is not None:
                multiplexer = by_name[signal.multiplexer]
                values = np.array(signal.multiplexer_values, np.uint64)
                for other in (np.isin(words.bits(multiplexer), values, invert=True), absence(multiplexer)):
                    absent = other if absent is None else absent if other is None else absent | other
            absences[signal.name] = absent
        return absences[signal.name]

    columns = {}
    for signal in layout.signals:
        kind, absent = value_type(signal), absence(signal)
        if pa.types.is_fixed_size_binary(kind):
            values: npt.NDArray[Any] = _long_bits(signal, data)
        else:
            values = _physical(signal, words.bits(signal), kind)
        if signal.is_float:
            missing = np.isnan(values)
            absent = missing if absent is None else absent | missing
        columns[signal.column] = pa.array(values, kind, mask=absent)
    return columns


class _Words:
    """Payloads as columns of 64-bit words in both byte orders; the words are made when they are first asked for."""

    def __init__(self, data: npt.NDArray[np.uint8]) -> None:
        self._data = np.ascontiguousarray(data)
        self._words: dict[bool, npt.NDArray[np.uint64]] = {}

    def bits(self, signal: SignalLayout) -> npt.NDArray[np.uint64]:
        """Return the (n,) bits of a signal of up to 64 as unsigned numbers; zeros where it is outside all payloads."""
        n, width = self._data.shape
        if signal.first_bit + signal.length > 8 * width:
            return np.zeros(n, np.uint64)
        if signal.big_endian not in self._words:
            words = self._data.view(">u8" if signal.big_endian else "<u8").astype(np.uint64)
            self._words[signal.big_endian] = np.ascontiguousarray(words.T)
        words = self._words[signal.big_endian]
        word, shift = divmod(signal.first_bit, 64)
        beyond = shift + signal.length - 64
        bits: npt.NDArray[np.uint64]
        if signal.big_endian:
            bits = words[word] << np.uint64(shift)
            if beyond > 0:
                bits |= words[word + 1] >> np.uint64(64 - shift)
            bits >>= np.uint64(64 - signal.length)
        else:
            bits = words[word] >> np.uint64(shift)
            if beyond > 0:
                bits |= words[word + 1] << np.uint64(64 - shift)
            bits &= np.uint64((1 << signal.length) - 1)
        return bits


def _physical(signal: SignalLayout, bits: npt.NDArray[np.uint64], kind: pa.DataType) -> npt.NDArray[np.generic]:
    scale, offset, identity = signal.scale, signal.offset, signal.scale == 1 and signal.offset == 0
    if signal.is_float:
        size = signal.length // 8
        # Any bits may come: a signalling NaN or a product beyond float64 is no reason to warn.
        with np.errstate(all="ignore"):
            floats = bits.astype(f"u{size}").view(f"f{size}").astype(np.float64)
            return floats if identity else floats * float(scale) + float(offset)
    raw: npt.NDArray[np.int64] | npt.NDArray[np.uint64] = bits
    if signal.signed:
        spare = np.int64(64 - signal.length)
        raw = bits.view(np.int64) << spare >> spare
    if pa.types.is_integer(kind):
        # Modulo 2^64 the result is right whatever lies between, because it fits.
        modulo = raw.view(np.uint64)
        if not identity:
            modulo = modulo * np.uint64(int(scale) % 2**64) + np.uint64(int(offset) % 2**64)
        return modulo.view(kind.to_pandas_dtype())
    if isinstance(scale, int) and max(map(abs, raw_range(signal))) * abs(scale) > _EXACT:
        # The product must not be rounded before the offset is added; Python's integers do not.
        return (raw.astype(object) * scale + offset).astype(np.float64)
    return raw.astype(np.float64) * float(scale) + float(offset)


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
