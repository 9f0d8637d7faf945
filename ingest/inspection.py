"""What a raw log holds, told without converting it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import numpy as np
import pyarrow as pa

from .account import Account
from .can.database import Database
from .can.frames import DATA, KINDS, FrameBatch
from .can.matching import find_messages
from .readers import FrameReader, NavigationReader, recognise

MessageKey = tuple[str, int, bool]
"""Channel, identifier, extended."""


@dataclass(slots=True)
class MessageCount:
    """How often a message was seen.

    Attributes:
        frames: Data frames.
        first: Stamp of the first, ns.
        last: Stamp of the last, ns.
        longest_gap: Longest time between two of them, ns.
        name: The database's name for it; None where no database knows it.
    """

    frames: int
    first: int
    last: int
    longest_gap: int
    name: str | None


@dataclass(slots=True)
class Inspection:
    """What a raw log holds.

    Attributes:
        path: The log.
        format: Its format.
        kind: `can` or `nav`.
        account: Accepted and rejected records.
        start: First stamp, ns; None where there is none.
        stop: Last stamp, ns.
        messages: CAN: what was seen of each message.
        frame_kinds: CAN: data, remote and error frames.
        statuses: Navigation: samples of each navigation status.
        samples: Navigation: samples.
    """

    path: Path
    format: str
    kind: str
    account: Account
    start: int | None = None
    stop: int | None = None
    messages: dict[MessageKey, MessageCount] = field(default_factory=dict)
    frame_kinds: Counter[str] = field(default_factory=Counter)
    statuses: Counter[int] = field(default_factory=Counter)
    samples: int = 0


def inspect_log(path: Path, database: Database) -> list[Inspection]:
    """Read a log whole and tell what it holds, for each kind of record in it.

    Args:
        path: The log.
        database: Names the messages it knows.

    Raises:
        InputError: The file is missing, of no known format, or damaged beyond what its reader can go on from.
    """
    readers = recognise(path)
    inspections = []
    for reader in readers:
        found = Inspection(path, reader.format, reader.kind, Account())
        if reader.kind == "can":
            for batch in cast("FrameReader", reader).batches(found.account):
                _count_frames(found, batch, database)
        else:
            for samples in cast("NavigationReader", reader).batches(found.account):
                _extend(found, samples["time"].cast(pa.int64()).to_numpy())
                found.samples += len(samples)
                found.statuses.update(samples["nav_status"].drop_null().to_pylist())
        if len(readers) == 1 or found.account.accepted or found.account.rejected:
            inspections.append(found)
    return inspections


def _extend(found: Inspection, time: np.ndarray[tuple[int], np.dtype[np.int64]]) -> None:
    if len(time):
        found.start = int(time.min()) if found.start is None else min(found.start, int(time.min()))
        found.stop = int(time.max()) if found.stop is None else max(found.stop, int(time.max()))


def _count_frames(found: Inspection, batch: FrameBatch, database: Database) -> None:
    _extend(found, batch.time)
    found.frame_kinds.update({kind: int(np.count_nonzero(batch.kind == code)) for code, kind in enumerate(KINDS)})
    data = np.flatnonzero(batch.kind == DATA)
    # One integer a message: channel, the extended flag, the identifier.
    keys = (
        (batch.channel[data].astype(np.int64) << 32)
        | (batch.extended[data].astype(np.int64) << 31)
        | batch.id[data].astype(np.int64)
    )
    order = np.argsort(keys, kind="stable")
    distinct, starts = np.unique(keys[order], return_index=True)
    for key, rows in zip(distinct.tolist(), np.split(data[order], starts[1:]), strict=True):
        identifier, extended = key & 0x1FFF_FFFF, bool(key >> 31 & 1)
        message = batch.channels[key >> 32], identifier, extended
        time = batch.time[rows]
        count = found.messages.get(message)
        if count is None:
            index = int(find_messages(database.messages, batch.id[rows[:1]], batch.extended[rows[:1]], message[0])[0])
            name = database.messages[index].name if index < len(database.messages) else None
            count = MessageCount(0, int(time[0]), int(time[0]), 0, name)
            found.messages[message] = count
        count.longest_gap = max(count.longest_gap, int(np.diff(time, prepend=count.last).max()))
        count.frames += len(rows)
        count.last = int(time[-1])
