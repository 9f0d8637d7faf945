"""A batch of CAN frames as arrays: what every CAN reader yields and the decoder takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ...schemas.tables import FRAMES

DATA, REMOTE, ERROR = 0, 1, 2
KINDS = ("data", "remote", "error")


@dataclass(frozen=True, slots=True)
class FrameBatch:
    """Frames in the order of the file.

    Attributes:
        time: int64 (n,), stamps in ns since 1970, UTC as far as the logger knew.
        channel: int16 (n,), index into `channels`.
        channels: Names of the buses.
        id: uint32 (n,), identifiers without flag bits.
        extended: bool (n,), 29-bit identifier.
        fd: bool (n,), CAN FD frame.
        kind: uint8 (n,), `DATA`, `REMOTE` or `ERROR`.
        length: uint8 (n,), payload bytes: 0 to 64; of a remote frame the requested length is not a payload: 0.
        data: uint8 (n, 8) or (n, 64), payloads padded with zeros.
    """

    time: npt.NDArray[np.int64]
    channel: npt.NDArray[np.int16]
    channels: tuple[str, ...]
    id: npt.NDArray[np.uint32]
    extended: npt.NDArray[np.bool_]
    fd: npt.NDArray[np.bool_]
    kind: npt.NDArray[np.uint8]
    length: npt.NDArray[np.uint8]
    data: npt.NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.time)

    @staticmethod
    def join(batches: Sequence[FrameBatch]) -> FrameBatch:
        """Return the frames of at least one batch, one batch behind the other."""
        if len(batches) == 1:
            return batches[0]
        channels = tuple(dict.fromkeys(name for batch in batches for name in batch.channels))
        width = max(batch.data.shape[1] for batch in batches)

        def joined(name: str) -> npt.NDArray[Any]:
            return np.concatenate([getattr(batch, name) for batch in batches])

        return FrameBatch(
            joined("time"),
            np.concatenate([_renumber(batch.channel, batch.channels, channels) for batch in batches]),
            channels,
            joined("id"),
            joined("extended"),
            joined("fd"),
            joined("kind"),
            joined("length"),
            np.concatenate([_widen(batch.data, width) for batch in batches]),
        )

    def to_arrow(self) -> pa.RecordBatch:
        """Return the batch in the schema `FRAMES`."""
        present = np.arange(self.data.shape[1]) < self.length[:, None]
        offsets = np.concatenate(([0], np.cumsum(self.length, dtype=np.int32))).astype(np.int32)
        payloads = pa.Array.from_buffers(
            pa.binary(),
            len(self),
            [None, pa.py_buffer(offsets), pa.py_buffer(np.ascontiguousarray(self.data[present]))],
        )
        return pa.RecordBatch.from_arrays(
            [
                pa.array(self.time, FRAMES.field("time").type),
                pa.array(self.channels, pa.string()).take(pa.array(self.channel)),
                pa.array(self.id),
                pa.array(self.extended),
                pa.array(self.fd),
                pa.array(KINDS, pa.string()).take(pa.array(self.kind)),
                payloads,
            ],
            schema=FRAMES,
        )

    @classmethod
    def from_arrow(cls, frames: pa.Table) -> FrameBatch:
        """Return a table in the schema `FRAMES` as one batch."""
        frames = frames.combine_chunks()
        payloads = frames["data"].combine_chunks()
        if isinstance(payloads, pa.ChunkedArray):
            payloads = pa.concat_arrays(payloads.chunks) if payloads.num_chunks else pa.array([], pa.binary())
        n = len(frames)
        offsets = np.frombuffer(payloads.buffers()[1], np.int32)[payloads.offset : payloads.offset + n + 1]
        content = np.frombuffer(payloads.buffers()[2] or b"", np.uint8)[offsets[0] : offsets[-1]]
        length = np.diff(offsets).astype(np.uint8)
        data = np.zeros((n, 8 if n == 0 or length.max() <= 8 else 64), np.uint8)
        data[np.arange(data.shape[1]) < length[:, None]] = content
        channel = frames["channel"].combine_chunks().dictionary_encode()
        if isinstance(channel, pa.ChunkedArray):
            channel = channel.combine_chunks()
        kind = frames["kind"].to_numpy()
        return cls(
            time=frames["time"].to_numpy().astype("datetime64[ns]").astype(np.int64),
            channel=channel.indices.to_numpy().astype(np.int16),
            channels=tuple(channel.dictionary.to_pylist()),
            id=frames["id"].to_numpy().astype(np.uint32),
            extended=frames["extended"].to_numpy().astype(bool),
            fd=frames["fd"].to_numpy().astype(bool),
            kind=np.select([kind == name for name in KINDS], list(range(len(KINDS)))).astype(np.uint8),
            length=length,
            data=data,
        )


@dataclass(frozen=True, slots=True)
class MessageFrames:
    """What is decoded of the data frames of one message, in the order of the file.

    Attributes:
        time: int64 (n,), this and the following ones as in `FrameBatch`.
        channel: int16 (n,).
        channels: Names of the buses.
        id: uint32 (n,).
        length: uint8 (n,).
        data: uint8 (n, 8) or (n, 64).
    """

    time: npt.NDArray[np.int64]
    channel: npt.NDArray[np.int16]
    channels: tuple[str, ...]
    id: npt.NDArray[np.uint32]
    length: npt.NDArray[np.uint8]
    data: npt.NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.time)

    def part(self, rows: slice) -> MessageFrames:
        """Return some of the frames, without a copy."""
        return MessageFrames(
            self.time[rows], self.channel[rows], self.channels, self.id[rows], self.length[rows], self.data[rows]
        )


def _renumber(numbers: npt.NDArray[np.int16], names: tuple[str, ...], wanted: tuple[str, ...]) -> npt.NDArray[np.int16]:
    """Return indexes into `wanted` for indexes into `names`."""
    if names == wanted[: len(names)]:
        return numbers
    return np.array([wanted.index(name) for name in names], np.int16)[numbers]


def _widen(data: npt.NDArray[np.uint8], width: int) -> npt.NDArray[np.uint8]:
    return data if data.shape[1] == width else np.pad(data, ((0, 0), (0, width - data.shape[1])))
