"""What a raw log holds, told without converting it, in bounded memory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Literal, cast

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from .account import Account
from .cadence import Cadence
from .cameras import LATEST, CameraIndex, are_frames, image_folders, is_image
from .can.database import Database, MessageLayout
from .can.frames import DATA, KINDS, FrameBatch
from .can.matching import find_messages
from .content import head
from .mcap_container import Topic, is_mcap, messages
from .mcap_frames import holds_frames
from .mcap_navigation import tells_navigation
from .readers import FrameReader, NavigationReader, recognise
from .stamps import Stamps

Kind = Literal["can", "nav", "camera"]
Advance = Callable[[int], None]
"""Told how many bytes of a file have been read."""

MOST_MESSAGES = 5000
"""No car has so many; in a damaged log every identifier may occur."""
MOST_PERIODS = 1000
BATCH = 4096
UNKNOWN_STATUS = -1
OXTS_STATUSES = {
    0: "nothing valid", 1: "raw IMU", 2: "initialising", 3: "locking", 4: "locked", 5: "unlocked", 6: "expired",
    7: "blocked", 10: "status only", 20: "trigger, initialising", 21: "trigger, locking", 22: "trigger, locked",
}  # fmt: skip
GGA_STATUSES = {
    0: "no fix", 1: "GNSS", 2: "differential", 3: "PPS", 4: "RTK fixed", 5: "RTK float", 6: "dead reckoning",
    7: "manual", 8: "simulator",
}  # fmt: skip
"""Quality of a fix in NMEA 0183's GGA, which `nav_status` is in NMEA logs."""

_ACCURACIES = 10.0 ** (np.arange(-60, 81) / 20)
"""m; upper ends of the classes in which accuracies are counted, each 12 % wider than the one before."""


@dataclass(slots=True)
class MessageCount:
    """What was seen of a message on one bus.

    Attributes:
        cadence: When its frames came.
        shortest: Payload bytes of the shortest data frame.
        longest: Of the longest.
        layout: The database's message; None where no database knows it.
    """

    cadence: Cadence
    shortest: int
    longest: int
    layout: MessageLayout | None


@dataclass(slots=True)
class StatusPeriod:
    """A time of one navigation status.

    Attributes:
        status: As the unit codes it, `UNKNOWN_STATUS` where it tells none.
        start: First stamp, ns.
        stop: Last stamp, ns.
        samples: Samples in it.
    """

    status: int
    start: int
    stop: int
    samples: int


@dataclass(slots=True)
class Accuracy:
    """What a navigation unit says of the accuracy of its position, m.

    Attributes:
        best: The smallest.
        worst: The largest.
        samples: Samples that tell one.
    """

    best: float = np.inf
    worst: float = 0.0
    samples: int = 0
    _counts: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(_ACCURACIES) + 1, np.int64))

    def add(self, accuracy: npt.NDArray[np.float64]) -> None:
        """Count samples, (n,) m, NaN where there is none."""
        told = accuracy[np.isfinite(accuracy)]
        if len(told):
            self.best, self.worst = min(self.best, float(told.min())), max(self.worst, float(told.max()))
            self.samples += len(told)
            self._counts += np.bincount(np.searchsorted(_ACCURACIES, told), minlength=len(self._counts))

    @property
    def median(self) -> float:
        """The median, known to 12 %."""
        place = int(np.searchsorted(np.cumsum(self._counts), (self.samples + 1) // 2))
        return float(np.clip(_ACCURACIES[min(place, len(_ACCURACIES) - 1)], self.best, self.worst))


@dataclass(slots=True)
class Inspection:
    """What a file holds of one kind of records.

    Attributes:
        path: The file, or a camera's folder.
        format: Its format.
        kind: `can`, `nav` or `camera`.
        account: Accepted and rejected records.
        stamps: What the log's stamps show.
        messages: CAN: what was seen of each message, by channel, identifier and whether that is extended.
        other_frames: CAN: data frames of further messages, beyond `MOST_MESSAGES`.
        frame_kinds: CAN: data, remote and error frames.
        samples: Navigation: when its samples came.
        periods: Navigation: its status over time.
        more_periods: Navigation: changes of status beyond `MOST_PERIODS`.
        accuracy: Navigation: of its position.
        cameras: When each camera took its frames.
    """

    path: Path
    format: str
    kind: Kind
    account: Account = field(default_factory=Account)
    stamps: Stamps = field(default_factory=Stamps)
    messages: dict[tuple[str, int, bool], MessageCount] = field(default_factory=dict)
    other_frames: int = 0
    frame_kinds: Counter[str] = field(default_factory=Counter)
    samples: Cadence = field(default_factory=Cadence)
    periods: list[StatusPeriod] = field(default_factory=list)
    more_periods: int = 0
    accuracy: Accuracy = field(default_factory=Accuracy)
    cameras: dict[str, Cadence] = field(default_factory=dict)

    def status_name(self, status: int) -> str:
        """Return what a navigation status means."""
        if status == UNKNOWN_STATUS:
            return "not told"
        return (GGA_STATUSES if self.format == "nmea" else OXTS_STATUSES).get(status, "reserved")


@dataclass(slots=True)
class TopicCount:
    """A topic of an MCAP file.

    Attributes:
        topic: Its name, schema and encoding.
        cadence: When its messages were logged.
    """

    topic: Topic
    cadence: Cadence

    @property
    def purpose(self) -> str:
        """What it can be read as: `can`, `nav` or `camera`; empty: it is not read."""
        if is_image(self.topic):
            return "camera"
        return "can" if holds_frames(self.topic) else "nav" if tells_navigation(self.topic) else ""


def files_of(path: Path) -> list[Path]:
    """Return what to inspect for a path: itself, or for a folder of logs its files and camera folders, sorted."""
    if not path.is_dir():
        return [path]
    inside = [part for part in sorted(path.rglob("*")) if part.is_file() and not part.name.startswith(".")]
    images = {Path(folder): names for folder, names in image_folders(map(str, inside)).items()}
    inner = {Path(name) for names in images.values() for name in names}
    for stamps in inside:
        if stamps.name == "timestamps.txt":  # Of a recording of KITTI, whose frames are files of their own.
            inner |= {part for part in inside if part.parent == stamps.parent / "data"}
    return sorted(
        [part for part in inside if part not in inner] + [f for f, names in images.items() if are_frames(names)]
    )


def inspect_log(path: Path, database: Database, advance: Advance = lambda _: None) -> list[Inspection]:
    """Read a log whole and tell what it holds, for each kind of record in it.

    Args:
        path: The log, or a camera's folder of images.
        database: Names the messages it knows.
        advance: Told how far the reading is.

    Raises:
        InputError: The file is missing, of no known format, or damaged beyond what its reader can go on from.
    """
    camera = CameraIndex(path) if path.is_dir() else CameraIndex.of(path)
    inspections = []
    if camera is None or camera.is_container:
        for reader in recognise(path):
            found = Inspection(path, reader.format, cast("Kind", reader.kind))
            if reader.kind == "can":
                for batch in cast("FrameReader", reader).batches(found.account):
                    _look_at_frames(found, batch, database)
                    advance(found.account.bytes_read)
            else:
                for samples in cast("NavigationReader", reader).batches(found.account):
                    _look_at_samples(found, samples)
                    advance(found.account.bytes_read)
            inspections.append(found)
    if camera is not None:
        found = Inspection(path, camera.format, "camera")
        _look_at_images(found, camera.frames(found.account))
        inspections.append(found)
    return [found for found in inspections if found.account.accepted or found.account.rejected] or inspections[:1]


def topics_of(path: Path) -> list[TopicCount]:
    """Return all topics of an MCAP file, in the order in which it describes them; nothing of another file.

    Raises:
        InputError: The file is missing or cannot be read.
    """
    if path.is_dir() or not is_mcap(head(path)):
        return []
    found: dict[Topic, TopicCount] = {}
    waiting: dict[Topic, list[int]] = {}

    def is_seen(topic: Topic) -> bool:
        found.setdefault(topic, TopicCount(topic, Cadence()))
        return True

    for message in messages(path, Account(), is_seen):
        times = waiting.setdefault(message.topic, [])
        times.append(min(message.time, LATEST))
        if len(times) == BATCH:
            found[message.topic].cadence.add(np.array(times, np.int64))
            times.clear()
    for topic, times in waiting.items():
        found[topic].cadence.add(np.array(times, np.int64))
    return list(found.values())


def _look_at_frames(found: Inspection, batch: FrameBatch, database: Database) -> None:
    found.stamps.add(batch.time)
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
        channel, identifier, extended = batch.channels[key >> 32], key & 0x1FFF_FFFF, bool(key >> 31 & 1)
        length = batch.length[rows]
        count = found.messages.get((channel, identifier, extended))
        if count is None:
            if len(found.messages) == MOST_MESSAGES:
                found.other_frames += len(rows)
                continue
            index = int(find_messages(database.messages, batch.id[rows[:1]], batch.extended[rows[:1]], channel)[0])
            layout = database.messages[index] if index < len(database.messages) else None
            count = MessageCount(Cadence(), int(length.min()), int(length.max()), layout)
            found.messages[channel, identifier, extended] = count
        count.cadence.add(batch.time[rows])
        count.shortest = min(count.shortest, int(length.min()))
        count.longest = max(count.longest, int(length.max()))


def _look_at_samples(found: Inspection, samples: pa.RecordBatch) -> None:
    time = samples["time"].cast(pa.int64()).to_numpy()
    if not len(time):
        return
    found.stamps.add(time)
    found.samples.add(time)
    found.accuracy.add(samples["position_accuracy"].to_numpy(zero_copy_only=False).astype(np.float64))
    status = samples["nav_status"].fill_null(UNKNOWN_STATUS).to_numpy()
    begins = np.concatenate(([0], np.flatnonzero(np.diff(status)) + 1, [len(status)]))
    for begin, end in pairwise(begins.tolist()):
        start, stop, code = int(time[begin]), int(time[end - 1]), int(status[begin])
        if found.periods and not found.more_periods and found.periods[-1].status == code:
            found.periods[-1].stop = stop
            found.periods[-1].samples += end - begin
        elif len(found.periods) < MOST_PERIODS:
            found.periods.append(StatusPeriod(code, start, stop, end - begin))
        else:
            found.more_periods += 1


def _look_at_images(found: Inspection, frames: pa.Table) -> None:
    found.stamps.add(frames["time"].cast(pa.int64()).to_numpy())
    for camera in sorted(pc.unique(frames["camera"]).to_pylist()):
        cadence = found.cameras.setdefault(camera or found.path.name, Cadence())
        cadence.add(frames.filter(pc.equal(frames["camera"], camera))["time"].cast(pa.int64()).to_numpy())
