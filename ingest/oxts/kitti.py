"""Reader of the navigation part (`oxts/`) of KITTI raw recordings."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from ...schemas.errors import InputError
from ..account import Account
from ..number_table import parse_rows
from ..text import Line, lines, number_of, quote, time_of
from .ncom_layout import INITIALISING, LOCKED, LOCKING, RAW_IMU

if TYPE_CHECKING:
    import pyarrow as pa

    from ..navigation import Samples

BATCH = 4096
"""Frames of a batch."""
LARGEST_FRAME = 4096
"""Bytes; a frame has about 450."""

COLUMNS = (
    "lat", "lon", "alt", "roll", "pitch", "yaw", "vn", "ve", "vf", "vl", "vu", "ax", "ay", "az", "af", "al", "au",
    "wx", "wy", "wz", "wf", "wl", "wu", "pos_accuracy", "vel_accuracy", "navstat", "numsats", "posmode", "velmode",
    "orimode",
)  # fmt: skip
"""The values of a frame, in order."""
_STATUS = COLUMNS.index("navstat")
_BLANKS = len(COLUMNS) - 1

_STAMP = re.compile(rb"(\d{4}-\d\d-\d\d) (\d\d:\d\d:\d\d)\.(\d{9})")
_FRAME = re.compile(r"(\d{1,18})\.txt")


@dataclass(frozen=True, slots=True)
class Kitti:
    """The `timestamps.txt` of an `oxts` folder, with its frames `data/0000000000.txt` and so on beside it.

    Line n of the stamps (from 0) and the frame of number n are one record: they are paired by number, since recordings
    have more stamps than frames, or blank ones. The stamps are those of the recording computer and name no time zone;
    they are taken as UTC (KITTI's own are likely Karlsruhe's, two hours ahead of it), which the schema's metadata says
    as `utc_from`. A frame's axes are forward, left, up; pitch is positive nose down, roll right side down; `vl`, which
    is rightward although documented as leftward, is not used.

    Attributes:
        path: `timestamps.txt`, plain or compressed.
    """

    format: ClassVar[str] = "kitti"
    kind: ClassVar[str] = "nav"

    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether the first line of `head` that is not blank is a stamp, such as `2011-09-26 13:02:25.964389445`.

        A file of less than a line is none.
        """
        line = head.lstrip(b"\r\n \t").partition(b"\n")[0]
        return _STAMP.fullmatch(line.strip()) is not None

    def parts(self) -> list[Path]:
        """Return the stamps and all frames, in the order of their numbers: the files this recording consists of.

        Raises:
            InputError: There is no folder of frames beside the stamps, or it cannot be read.
        """
        return [self.path, *(path for _, path in self._frames())]

    def batches(self, account: Account) -> Iterator[pa.RecordBatch]:
        """Yield the navigation samples in the order of time, in the schema `NAVIGATION`.

        As in NCOM, frames of navigation status 3 and 4 are whole; those of 1 and 2 give accelerations and yaw rate
        alone, all others their status alone. Gravity is removed, see `remove_gravity`. `position_accuracy` is KITTI's
        `pos_accuracy`, which is √(σ_north² + σ_east²).

        Args:
            account: Every pair of stamp and frame is one record, and so is a stamp or a frame without its other half,
                which is rejected, as are damaged pairs and those whose time does not increase.

        Raises:
            InputError: The stamps cannot be read, or there is no folder of frames beside them.
        """
        from ..navigation import navigation_batches

        frames: dict[int, Path] = {}
        for number, path in self._frames():
            if frames.setdefault(number, path) != path:
                reason = f"{path.name} has the same number as {frames[number].name}; the latter is taken"
                account.reject(f"frame {number}", reason)
        metadata = {"utc_from": "stamps without time zone, taken as UTC"}
        stamps = 0

        def read(account: Account) -> Iterator[Samples]:
            nonlocal stamps
            stamps, numbered = 0, lines(self.path, account)
            while batch := list(islice(numbered, BATCH)):
                stamps = batch[-1].number
                # A blank line at the end is no record, but one that takes the place of a stamp is.
                if records := [line for line in batch if line.text or line.number - 1 in frames]:
                    yield _samples(records, frames, account)

        yield from navigation_batches(read, account, metadata, unit="frame", record="frame")
        for number in frames:
            if number >= stamps:
                missing = f"{self.path.name} has no line {number + 1} with its stamp, but {stamps}"
                account.reject(f"frame {number}", f"{missing}; stamps were lost or cut off")

    def _frames(self) -> list[tuple[int, Path]]:
        folder = self.path.parent / "data"
        try:
            files = sorted(folder.iterdir())
        except OSError as error:
            reason = (
                f"holds the stamps of a KITTI recording, but the folder {folder.name} of its frames "
                f"({folder.name}/0000000000.txt and so on), which must stand beside it, cannot be read: "
                f"{error.strerror}. Copy the whole oxts folder"
            )
            raise InputError(self.path, "", reason) from None
        found = [(int(match[1]), file) for file in files if (match := _FRAME.fullmatch(file.name))]
        return sorted(found, key=lambda frame: frame[0])


def _samples(records: list[Line], frames: dict[int, Path], account: Account) -> Samples:
    from ..navigation import Samples, impossible_positions, inertial_signals

    count = len(records)
    time = np.zeros(count, np.int64)
    values = np.full((count, len(COLUMNS)), np.nan)
    doubts: dict[int, str] = {}
    contents: dict[int, bytes] = {}
    for index, line in enumerate(records):
        try:
            time[index] = _stamp(line, account)
            contents[index] = _content(frames.get(line.number - 1))
        except ValueError as error:
            doubts[index] = str(error)
    plain = {index: row for index, content in contents.items() if (row := content.strip()).count(b" ") == _BLANKS}
    parsed = parse_rows([*plain.values()], " ", len(COLUMNS), range(len(COLUMNS)), missing=()) if plain else None
    if parsed is not None and all(map(_is_status, np.unique(parsed[0][:, _STATUS]).tolist())):
        values[[*plain]] = parsed[0]
        contents = {index: content for index, content in contents.items() if index not in plain}
    for index, content in contents.items():
        try:
            values[index] = _frame(frames[records[index].number - 1].name, content, account)
        except ValueError as error:
            doubts[index] = str(error)
    column = dict(zip(COLUMNS, values.T, strict=True))
    valid = np.isin(column["navstat"], (LOCKING, LOCKED))
    inertial = valid | np.isin(column["navstat"], (RAW_IMU, INITIALISING))

    def pick(where: npt.NDArray[np.bool_], *names: str) -> npt.NDArray[np.float64]:
        return np.where(where[:, None], np.column_stack([column[name] for name in names]), np.nan)

    latitude, longitude, altitude, accuracy = pick(valid, "lat", "lon", "alt", "pos_accuracy").T
    doubts |= impossible_positions(latitude, longitude, altitude, "frame")
    yaw, pitch, roll = pick(valid, "yaw", "pitch", "roll").T
    left_up = np.array([1.0, -1.0, -1.0])
    signals = inertial_signals(
        latitude=latitude,
        longitude=longitude,
        altitude=altitude,
        velocity=pick(valid, "vn", "ve"),
        orientation=np.column_stack([np.pi / 2 - yaw, -pitch, roll]),
        specific_force=pick(inertial, "ax", "ay", "az") * left_up,
        yaw_rate=-pick(inertial, "wz")[:, 0],
    )
    signals |= {"nav_status": column["navstat"], "position_accuracy": accuracy}
    place = np.array([line.number - 1 for line in records], np.int64)
    return Samples(place, time, np.ones(count, bool), signals, doubts)


def _stamp(line: Line, account: Account) -> int:
    """Return a line's stamp, ns since 1970.

    Raises:
        ValueError: It is none.
    """
    match = _STAMP.fullmatch(line.text)
    time = time_of(match[1].decode(), match[2].decode(), match[3].decode()) if match else None
    if time is None:
        if not line.ended:
            account.truncated = True
        cut = "" if line.ended else "the file ends within it: "
        raise ValueError(
            f"line {line.number} of the stamps: {cut}expected a stamp such as 2011-09-26 13:02:25.964389445; "
            f"found {quote(line.text)}"
        )
    return time


def _content(path: Path | None) -> bytes:
    """Return a frame's file.

    Raises:
        ValueError: There is none, or it cannot be read.
    """
    if path is None:
        raise ValueError("has a stamp but no file in the folder data; the recording of frames stopped earlier")
    try:
        with path.open("rb", buffering=0) as file:
            return file.read(LARGEST_FRAME)
    except OSError as error:
        raise ValueError(f"{path.name} cannot be read: {error.strerror}") from None


def _frame(name: str, content: bytes, account: Account) -> list[float]:
    """Return a frame's values.

    Raises:
        ValueError: The file of this name does not hold them.
    """
    words = content.split()
    if len(words) != len(COLUMNS):
        account.truncated |= 0 < len(words) < len(COLUMNS) and not content.endswith(b"\n")
        raise ValueError(
            f"{name} has {len(words)} values, not {len(COLUMNS)}; "
            + ("the frame is damaged or cut off" if words else "the frame is blank")
        )
    values = []
    for column, word in zip(COLUMNS, words, strict=True):
        try:
            values.append(number_of(word))
        except ValueError as error:
            raise ValueError(f"{name}: {column}: {error}") from None
    status = values[_STATUS]
    if not _is_status(status):
        raise ValueError(f"{name}: expected a navigation status (0 to 255) as navstat; found {status:g}")
    return values


def _is_status(value: float) -> bool:
    return 0 <= value <= 255 and value % 1 == 0
