"""When a camera's frames were taken, from what lies beside them; the frames themselves stay where they are."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path, PurePosixPath
from typing import ClassVar

import numpy as np
import pyarrow as pa

from ..schemas.errors import InputError
from ..schemas.tables import CAMERA_FRAMES
from .account import Account
from .content import blocks, head
from .foxglove_messages import decode_fields
from .mcap_container import Topic, is_mcap, messages
from .ros_messages import decode_cdr

IMAGES = frozenset({".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp"})
TIME_COLUMNS = ("time", "timestamp", "stamp", "timestamp_ns", "time_ns", "#timestamp", "#timestamp [ns]", "utc")
PATH_COLUMNS = ("path", "file", "filename", "file_name", "image", "frame_path")
FRAME_COLUMNS = (*PATH_COLUMNS, "frame", "frame_id", "frame_number")
LONGEST_LINE = 10_000
LATEST = np.iinfo(np.int64).max
FEWEST_IMAGES = 10
"""Fewer are somebody's pictures, not a camera's recording."""

_COUNT = re.compile(r"(?<![\d.])(?:(\d{19})|(\d{16})|(\d{13})|(\d{10})(?:\.(\d{1,9})|[_-](\d{9}|\d{6}))?)(?!\d)")
_DATE = re.compile(
    r"(?<!\d)(\d{4})([-_]?)(\d\d)\2(\d\d)[T _-]?(\d\d)([:_-]?)(\d\d)\6(\d\d)(?:[.,](\d{1,9})|[_-]?(\d{3}|\d{6}|\d{9}))?"
    r"(?!\d)(?:(Z)|([+-]\d\d):?(\d\d))?"
)


def stamp_in(text: str) -> int:
    """Return the stamp that stands in a text, ns since 1970, UTC.

    Either a count since 1970 (10 digits are seconds, with a fraction after a point, or of 6 or 9 digits after `_` or
    `-`; 13 ms; 16 µs; 19 ns) or date and time of day to the second at least, in ISO 8601 or with other separators or
    none; without a zone it is taken as UTC.

    Raises:
        ValueError: There is none.
    """
    if count := _COUNT.search(text):
        nanoseconds, microseconds, milliseconds, seconds, *fractions = count.groups()
        fraction = next((digits for digits in fractions if digits), "")
        whole = nanoseconds or microseconds or milliseconds or seconds + fraction
        stamp = int(whole.ljust(19, "0"))
        if stamp <= LATEST:
            return stamp
    elif date := _DATE.search(text):
        year, _, month, day, hour, _, minute, second, fraction, joined, _, zone, zone_minutes = date.groups()
        offset = timedelta(hours=int(zone), minutes=int(zone[0] + zone_minutes)) if zone else timedelta()
        zoned = timezone(offset)
        moment = datetime(int(year), int(month), int(day), int(hour), int(minute), int(second), tzinfo=zoned)
        stamp = (moment - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(seconds=1) * 1_000_000_000
        if 0 <= stamp <= LATEST - 10**9:
            return stamp + int((fraction or joined or "").ljust(9, "0"))
    raise ValueError(
        "expected a stamp since 1970 of 10 (s), 13 (ms), 16 (µs) or 19 (ns) digits, or date and time to the second"
    )


def is_image(topic: Topic) -> bool:
    """Tell whether the messages of a topic are frames: of ROS 2 or Foxglove."""
    return topic.schema.rpartition("/")[2].rpartition(".")[2] == "CompressedImage"


def image_folders(names: Iterable[str]) -> dict[str, list[str]]:
    """Return the names of images by the folder that they lie in (`.` at the top), all sorted."""
    folders: dict[str, list[str]] = {}
    for name in sorted(names):
        if PurePosixPath(name).suffix.lower() in IMAGES:
            folders.setdefault(PurePosixPath(name).parent.as_posix(), []).append(name)
    return folders


def are_frames(names: Sequence[str]) -> bool:
    """Tell whether the images of a folder are a camera's: there are ten or more, most with a stamp in their names."""

    def is_stamped(name: str) -> bool:
        try:
            return stamp_in(PurePosixPath(name).stem) >= 0
        except ValueError:
            return False

    return len(names) >= FEWEST_IMAGES and 2 * sum(map(is_stamped, names)) > len(names)


@dataclass(frozen=True, slots=True)
class CameraIndex:
    """The frames of a camera: a CSV with their times, a folder of images named by them, or an MCAP file.

    A CSV has a header with a column of times (`time`, `timestamp`, `stamp`, `utc`...) and, where there are files, one
    of their paths (`path`, `file`, `filename`, `image`...); or no header and the time first. It is separated by
    commas, semicolons or tabs. In MCAP every message whose schema is a `CompressedImage` is a frame; its stamp is the
    header's (CDR), its `timestamp` (JSON, protobuf), otherwise when it was logged.

    Attributes:
        path: File or folder.
    """

    format: ClassVar[str] = "camera"
    kind: ClassVar[str] = "camera"

    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether the first line of `head` names a column of times and one of images or frames, and no others.

        Folders and MCAP files are not recognised by this: they have no first bytes, or hold other things too.
        """
        line = head.partition(b"\n")[0].decode("utf-8-sig", "replace").strip()
        names = {name.strip().lower() for name in re.split("[,;\t]", line)}
        return bool(names & set(TIME_COLUMNS)) and bool(names & set(FRAME_COLUMNS)) and len(names) <= 4

    @classmethod
    def of(cls, path: Path) -> CameraIndex | None:
        """Return the index that a file is, or may hold beside other things (MCAP); None where it is neither."""
        try:
            start = head(path)
        except InputError:
            return None
        return cls(path) if cls.sniff(start) or is_mcap(start) else None

    @property
    def is_container(self) -> bool:
        """Whether it is a file that may hold other records, or no frame at all: MCAP."""
        return not self.path.is_dir() and is_mcap(head(self.path))

    def frames(self, account: Account) -> pa.Table:
        """Return the frames in the order of time, in the schema `CAMERA_FRAMES`, and count them in `account`.

        `camera` is the topic of an MCAP file, else empty; `path` is relative to the index or its folder.

        Raises:
            InputError: There is no such file or folder, it cannot be read, or a header has no column of times.
        """
        if self.path.is_dir():
            found = self._in_folder(account)
        elif self.is_container:
            found = self._in_mcap(account)
        else:
            found = self._in_csv(account)
        rows = sorted(found, key=lambda row: row[0])
        account.accepted += len(rows)
        columns = list(zip(*rows, strict=True)) or [()] * len(CAMERA_FRAMES)
        arrays = [pa.array(column, kind.type) for column, kind in zip(columns, CAMERA_FRAMES, strict=True)]
        return pa.Table.from_arrays(arrays, schema=CAMERA_FRAMES)

    def _in_folder(self, account: Account) -> Iterator[tuple[int, str, str | None, int | None]]:
        for path in sorted(self.path.iterdir()):
            if path.suffix.lower() in IMAGES:
                try:
                    yield stamp_in(path.stem), "", path.name, None
                except ValueError as error:
                    account.reject(path.name, f"{error}; in the image's name")

    def _in_mcap(self, account: Account) -> Iterator[tuple[int, str, str | None, int | None]]:
        for message in messages(self.path, account, is_image):
            time = 0
            try:
                if message.topic.encoding == "cdr":
                    time, _ = decode_cdr("sensor_msgs/msg/CompressedImage", message.data)
                elif message.topic.encoding == "json" or (
                    message.topic.encoding == "protobuf" and message.topic.definition
                ):
                    time, _ = decode_fields(message.topic, message.data)
            except ValueError as error:
                account.reject(message.where, str(error))
                continue
            time = time or message.time
            if 0 <= time <= LATEST:
                yield time, message.topic.name, None, message.offset
            else:
                account.reject(message.where, "its time is not within the years 1970 to 2262")

    def _in_csv(self, account: Account) -> Iterator[tuple[int, str, str | None, int | None]]:
        time_column, path_column, separator = 0, None, ","
        for number, line in enumerate(self._lines(account), 1):
            if not line.strip():
                continue
            if number == 1:
                separator = next((mark for mark in ";\t," if mark in line), ",")
            try:
                cells = [cell.strip() for cell in next(csv.reader([line], delimiter=separator, strict=True))]
            except csv.Error as error:
                account.reject(f"line {number}", f"is no line of CSV ({error})")
                continue
            if number == 1 and not any(character.isdigit() for character in cells[0]):
                names = [cell.lower() for cell in cells]
                time_column = next((names.index(name) for name in TIME_COLUMNS if name in names), -1)
                path_column = next((names.index(name) for name in PATH_COLUMNS if name in names), None)
                if time_column < 0:
                    expected = f"expected a column of times, one of {', '.join(TIME_COLUMNS)}; found {', '.join(cells)}"
                    raise InputError(self.path, "line 1", f"{expected}. Name the column in the header")
                continue
            if number == 1 and len(cells) > 1 and Path(cells[1]).suffix.lower() in IMAGES:
                path_column = 1
            try:
                stamp = stamp_in(cells[time_column] if time_column < len(cells) else "")
            except ValueError as error:
                account.reject(f"line {number}", f"{error}; found {line[:80]!r}")
                continue
            named = path_column is not None and path_column < len(cells)
            yield stamp, "", (cells[path_column] or None) if named and path_column is not None else None, None

    def _lines(self, account: Account) -> Iterator[str]:
        carry = b""
        for block in blocks(self.path, account):
            *lines, carry = (carry + block).split(b"\n")
            yield from (line[:LONGEST_LINE].decode("utf-8-sig", "replace") for line in lines)
            # A line has no end in a file of another kind; enough of it is kept to reject it.
            carry = carry[:LONGEST_LINE]
        if carry:
            yield carry.decode("utf-8-sig", "replace")
