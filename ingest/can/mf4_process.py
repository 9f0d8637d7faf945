"""The process in which asammdf reads: the frames of an MF4 file on standard output, as an Arrow stream.

    python -m wheelprint.ingest.can.mf4_process FILE TEMPORARY_FOLDER

Batches have the schema `FRAMES`; each may carry notes (JSON in its metadata): `error`, why there is nothing to read;
and on the last batch, which is always there, `rejections` (place, reason), `rejected` (their number) and `truncated`.
"""

from __future__ import annotations

import json
import os
import re
import resource
import struct
import sys
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ...schemas.tables import FRAMES
from ..account import Account
from .frames import DATA, ERROR, REMOTE, FrameBatch

if TYPE_CHECKING:
    from asammdf import MDF

PIECE = 1 << 17
"""Records of a group read at once."""
MEMORY = 1 << 30
"""Bytes that the process may fill, which takes 200 MB for a sound file."""
SECONDS, BYTES_PER_SECOND = 9, 100_000
"""Of computing: to begin with, and what a sound file passes at least, so that a damaged one cannot hold us for ever."""

GROUP = re.compile(r"CAN_(Data|Remote|Error)Frame(?:_\w+)?(?:\.|$)")
KINDS = {"Data": DATA, "Remote": REMOTE, "Error": ERROR}
LENGTHS = np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64], np.int64)
"""Payload bytes by DLC."""
LATEST = np.iinfo(np.int64).max

DAMAGE: tuple[type[Exception], ...] = (
    AttributeError, EOFError, IndexError, KeyError, MemoryError, OSError, OverflowError, RuntimeError, TypeError,
    ValueError, struct.error, zlib.error,
)  # fmt: skip
with suppress(ImportError):
    from isal.igzip_lib import IsalError

    DAMAGE = (*DAMAGE, IsalError)  # type: ignore[arg-type]  # isal's stubs call the class an instance
"""What asammdf raises of damaged blocks; of anything else the process ends, which the reader sees."""


@dataclass(slots=True)
class Piece:
    """Frames of one group that were read and not yet passed on.

    Attributes:
        frames: In the order of time.
        last: Later frames of the group are not expected before this time.
    """

    frames: FrameBatch
    last: int


def main(path: Path, folder: str) -> None:
    """Write the frames of a file to standard output, within bounds of memory and time."""
    seconds = SECONDS + path.stat().st_size // BYTES_PER_SECOND
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    # What asammdf prints must not come between the frames.
    with os.fdopen(os.dup(1), "wb") as output:
        os.dup2(2, 1)
        write_frames(path, folder, output)


def write_frames(path: Path, folder: str, output: IO[bytes]) -> None:
    """Write the frames of a file to a stream.

    Args:
        path: The file, not compressed as a whole.
        folder: For temporary files.
        output: Where the Arrow stream goes.
    """
    account = Account()
    with pa.ipc.new_stream(output, FRAMES) as stream:

        def note(**notes: object) -> None:
            nothing = pa.RecordBatch.from_pylist([], FRAMES)
            stream.write_batch(nothing, custom_metadata={"notes": json.dumps(notes)})

        from asammdf import MDF
        from asammdf.blocks.utils import MdfException

        try:
            log = MDF(path, temporary_folder=folder, process_bus_logging=False)
        except (MdfException, *DAMAGE) as error:
            note(error=f"cannot be read as MDF 4 ({_brief(error)}); it is damaged, or was cut off within its tables")
            return
        groups = _frame_groups(log, account)
        if not groups:
            names = sorted({group.channel_group.acq_name or "without a name" for group in log.groups})
            note(
                error="logs no CAN bus: none of its groups is CAN_DataFrame, CAN_RemoteFrame or CAN_ErrorFrame; it has "
                f"{', '.join(names[:10]) or 'none'}. Set the logger to record the bus's frames, not decoded signals"
            )
            return
        # A header without a zone (flag 1) counts as UTC: there is nothing better.
        start = int(log.header.abs_time)
        for batch in _in_order([_pieces(log, group, kind, start, account) for group, kind in groups.items()]):
            for first in range(0, len(batch), PIECE):
                # Not more than FrameBatch may have, however many groups there are.
                stream.write_batch(_rows(batch, slice(first, first + PIECE)).to_arrow())
        note(rejections=account.rejections, rejected=account.rejected, truncated=account.truncated)


def _frame_groups(log: MDF, account: Account) -> dict[int, int]:
    """Return the kind of frame by the number of its group; say of the others what is left out."""
    kinds = {}
    for number, group in enumerate(log.groups):
        name = next((found for channel in group.channels if (found := GROUP.match(channel.name))), None)
        if name:
            kinds[number] = KINDS[name[1]]
        elif records := int(group.channel_group.cycles_nr):
            account.reject(
                _place(log, number), f"{records} records that are no CAN data, remote or error frames; left out"
            )
            account.rejected += records - 1
    return kinds


def _place(log: MDF, number: int) -> str:
    group = log.groups[number]
    named = (found[0].rstrip(".") for channel in group.channels if (found := GROUP.match(channel.name)))
    name = next(named, group.channel_group.acq_name)
    return f"group {number} ({name})" if name else f"group {number}"


def _pieces(log: MDF, number: int, kind: int, start: int, account: Account) -> Iterator[Piece]:
    """Yield the frames of a group by pieces, up to where it is damaged."""
    total = int(log.groups[number].channel_group.cycles_nr)
    first, size = 0, PIECE
    while first < total:
        wanted = min(size, total - first)
        try:
            piece, records = _read(log, number, kind, start, first, wanted, account)
        except DAMAGE as error:
            # The piece is halved until what can be read of it is read.
            if wanted > 1:
                size = wanted // 2
                continue
            _reject_rest(log, number, first, total, f"cannot be read ({_brief(error)})", account)
            return
        if records < wanted:
            _reject_rest(log, number, first + records, total, "are missing in the file", account)
            total = 0
        first += wanted
        if len(piece):
            yield Piece(piece, int(piece.time[-1]))


def _reject_rest(log: MDF, number: int, first: int, total: int, what: str, account: Account) -> None:
    account.truncated = True
    reason = f"records {first + 1} to {total} {what}; the recording was cut off or its copy is damaged"
    account.reject(_place(log, number), reason)
    account.rejected += total - first - 1


def _read(
    log: MDF, number: int, kind: int, start: int, first: int, count: int, account: Account
) -> tuple[FrameBatch, int]:
    """Return the sound frames among `count` records of a group, in the order of time, and how many there are."""
    channels = log.groups[number].channels
    indexes = {channel.name.rpartition(".")[2]: index for index, channel in reversed(list(enumerate(channels)))}

    def raw(index: int) -> npt.NDArray[np.generic]:
        values, _ = log.get(
            group=number,
            index=index,
            raw=True,
            samples_only=True,
            ignore_invalidation_bits=True,
            record_offset=first,
            record_count=count,
        )
        return np.asarray(values)

    master = log.masters_db[number]
    time, known = _nanoseconds(raw(master), channels[master].conversion, start)
    n = len(time)

    def field(name: str) -> npt.NDArray[np.int64] | None:
        if name not in indexes:
            return None
        values = raw(indexes[name])
        if len(values) != n:
            raise ValueError(f"{len(values)} values of {name} for {n} times")
        return values.astype(np.int64)

    zeros = np.zeros(n, np.int64)
    bus, identifier, flag, fd = field("BusChannel"), field("ID"), field("IDE"), field("EDL")
    length, code = field("DataLength"), field("DLC")
    bus = zeros if bus is None else bus
    identifier = zeros if identifier is None else identifier
    extended = identifier >> 31 & 1 if flag is None else flag
    identifier &= 0x1FFFFFFF
    if length is None:
        length = zeros if code is None else LENGTHS[np.minimum(code, 15)]
    data = np.zeros((n, 64), np.uint8)
    width = 0
    if kind == DATA and "DataBytes" in indexes:
        octets = raw(indexes["DataBytes"])
        octets = octets.reshape(len(octets), -1)[:, :64].astype(np.uint8)
        if len(octets) != n:
            raise ValueError(f"{len(octets)} payloads for {n} times")
        width = octets.shape[1]
        data[:, :width] = octets
    if kind != DATA:
        length = zeros
    data[np.arange(64) >= length[:, None]] = 0

    most = np.where((zeros if fd is None else fd) != 0, 64, 8)
    sound = np.ones(n, bool)
    for bad, reason in (
        (~known, "its time is not within the years 1970 to 2262"),
        ((extended == 0) & (identifier > 0x7FF) & (kind != ERROR), "its identifier is beyond 11 bits (7FF)"),
        (length > most, "its payload is longer than a frame of its kind has (8 bytes, CAN FD 64)"),
        (length > np.maximum(width, 0), "its payload is shorter than it says"),
    ):
        for record in np.flatnonzero(bad & sound).tolist():
            account.reject(f"{_place(log, number)}, record {first + record + 1}", f"{reason}; the record is damaged")
        sound &= ~bad
    buses = np.unique(bus)
    narrow = data[:, :8] if not len(data) or length.max() <= 8 else data
    batch = FrameBatch(
        time=time,
        channel=np.searchsorted(buses, bus).astype(np.int16),
        channels=tuple(str(value) for value in buses.tolist()),
        id=identifier.astype(np.uint32),
        extended=extended != 0,
        fd=zeros != 0 if fd is None else fd != 0,
        kind=np.full(n, kind, np.uint8),
        length=length.astype(np.uint8),
        data=narrow,
    )
    rows = np.flatnonzero(sound)
    return _rows(batch, rows[np.argsort(time[rows], kind="stable")]), n


def _nanoseconds(
    raw: npt.NDArray[np.generic], conversion: object, start: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
    """Return stamps in ns since 1970, and which can be so told, of raw times.

    Counts of whole ns, as loggers write them, are added as integers: in seconds since 1970 a float64 has steps of
    238 ns.
    """
    factor, offset = getattr(conversion, "a", 1.0), getattr(conversion, "b", 0.0)
    per_count = round(factor * 1e9)
    whole = per_count > 0 and abs(factor * 1e9 - per_count) < 1e-6 * per_count
    # Records may come before the start that the header tells.
    earliest, latest = -start, LATEST - max(start, 0)
    if raw.dtype.kind in "iu" and whole:
        whole_counts = raw.astype(np.int64)
        known = (whole_counts >= -(-earliest // per_count)) & (whole_counts <= latest // per_count)
        counts = np.where(known, whole_counts, 0) * per_count
    else:
        values = raw.astype(np.float64)
        scaled = values * per_count if whole else values * (factor * 1e9)
        known = (scaled >= earliest) & (scaled < 0.999 * latest)
        counts = np.rint(np.where(known, scaled, 0)).astype(np.int64)
    time = counts + (start + round(offset * 1e9))
    return time, known & (time >= 0)


def _in_order(groups: list[Iterator[Piece]]) -> Iterator[FrameBatch]:
    """Merge groups by time, holding one piece of each."""
    waiting: dict[int, Piece] = {}
    while True:
        for number, group in enumerate(groups):
            if number not in waiting and (piece := next(group, None)):
                waiting[number] = piece
        if not waiting:
            return
        # Up to here no group can bring anything earlier any more; the group that ends first is used up.
        until = min(piece.last for piece in waiting.values())
        parts = []
        for number, piece in list(waiting.items()):
            place = int(np.searchsorted(piece.frames.time, until, "right"))
            if place == len(piece.frames):
                del waiting[number]
            else:
                waiting[number] = Piece(_rows(piece.frames, slice(place, None)), piece.last)
            if place:
                parts.append(_rows(piece.frames, slice(0, place)))
        merged = _joined(parts)
        yield merged if len(parts) == 1 else _rows(merged, np.argsort(merged.time, kind="stable"))


def _joined(parts: list[FrameBatch]) -> FrameBatch:
    if len(parts) == 1:
        return parts[0]
    channels = tuple(dict.fromkeys(name for part in parts for name in part.channels))
    wide = max(part.data.shape[1] for part in parts)
    return FrameBatch(
        time=np.concatenate([part.time for part in parts]),
        channel=np.concatenate(
            [np.array([channels.index(name) for name in part.channels], np.int16)[part.channel] for part in parts]
        ),
        channels=channels,
        id=np.concatenate([part.id for part in parts]),
        extended=np.concatenate([part.extended for part in parts]),
        fd=np.concatenate([part.fd for part in parts]),
        kind=np.concatenate([part.kind for part in parts]),
        length=np.concatenate([part.length for part in parts]),
        data=np.concatenate([np.pad(part.data, ((0, 0), (0, wide - part.data.shape[1]))) for part in parts]),
    )


def _rows(batch: FrameBatch, rows: slice | npt.NDArray[np.intp]) -> FrameBatch:
    return FrameBatch(
        batch.time[rows],
        batch.channel[rows],
        batch.channels,
        batch.id[rows],
        batch.extended[rows],
        batch.fd[rows],
        batch.kind[rows],
        batch.length[rows],
        batch.data[rows],
    )


def _brief(error: BaseException) -> str:
    return f"{type(error).__name__}: {str(error)[:200]}"


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
