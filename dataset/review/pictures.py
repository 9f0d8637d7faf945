"""The camera frames of a recording: what was taken when, and which file on disk that is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ...ingest.account import Account
from ...ingest.cameras import FRAME_INDEX, CameraIndex
from ...ingest.content import head
from ...schemas.errors import InputError
from ...schemas.project import Project, Recording
from ...schemas.store import read_table

MEDIA_TYPES = {
    ".bmp": "image/bmp",
    ".gif": "image/gif",
    ".jpeg": "image/jpeg",
    ".jpg": "image/jpeg",
    ".png": "image/png",
    ".webp": "image/webp",
}
"""What a browser shows, by the ending of a file's name."""

LONGEST_STRIP = 240
"""Frames of one camera that the page is told of at once."""


@dataclass(frozen=True, slots=True)
class Camera:
    """The frames of one camera that are image files which a browser shows.

    Attributes:
        name: Of the camera, its folder or its index.
        time: When each was taken, ns UTC (n_frames,), ascending.
        paths: Where each is, from `base` (n_frames).
        base: Folder that the paths start from.
        folder: Of the recording; nothing outside of it is a frame, be it by a link.
    """

    name: str
    time: NDArray[np.int64]
    paths: list[str]
    base: Path
    folder: Path

    def within(self, start: int, stop: int) -> dict[str, Any]:
        """Return number and time, ms UTC, of the frames within [start, stop), ns UTC, `LONGEST_STRIP` at most."""
        first, last = (int(place) for place in np.searchsorted(self.time, (start, stop)))
        numbers = range(first, last, max(1, -(-(last - first) // LONGEST_STRIP)))
        times = self.time[first : last : numbers.step] // 1_000_000
        return {"name": self.name, "numbers": list(numbers), "times": times.tolist()}

    def file(self, number: int) -> Path | None:
        """Return the image file of a frame, None where there is none within the recording's folder."""
        if not 0 <= number < len(self.paths):
            return None
        file = (self.base / self.paths[number]).resolve()
        is_frame = file.suffix.lower() in MEDIA_TYPES and file.is_relative_to(self.folder.resolve()) and file.is_file()
        return file if is_frame else None


def cameras_of(project: Project, recording: Recording) -> tuple[list[Camera], list[InputError]]:
    """Return the cameras of a recording whose frames are image files, and which indexes cannot be read.

    The indexes are those that were stored with the recording's signals, else what lies in its folder: a folder of
    images named by their time, or a CSV with times and paths.
    """
    cameras: list[Camera] = []
    problems: list[InputError] = []
    for name, base, read in _indexes(project, recording):
        try:
            table = read()
        except InputError as error:
            problems.append(error)
            continue
        rows = zip(
            table["camera"].to_pylist(), table["time"].cast(pa.int64()).to_pylist(), table["path"].to_pylist(),
            strict=True,
        )  # fmt: skip
        frames: dict[str, list[tuple[int, str]]] = {}
        for camera, time, path in rows:
            if path and Path(path).suffix.lower() in MEDIA_TYPES:
                frames.setdefault(camera or name, []).append((time, path))
        for camera, found in frames.items():
            times, paths = zip(*sorted(found), strict=True)
            cameras.append(Camera(camera, np.array(times, np.int64), list(paths), base, recording.folder))
    return cameras, problems


def _indexes(project: Project, recording: Recording) -> Iterator[tuple[str, Path, Callable[[], pa.Table]]]:
    """Yield name, folder that its paths start from, and reader of each index of frames."""
    stored = [
        path
        for path in sorted(project.signals_folder(recording.driver, recording.name).glob("*.parquet"))
        if _is_index(path)
    ]
    for path in stored:
        source = path.name.partition(".")[0]
        base = recording.folder / source
        yield source, base if base.is_dir() else recording.folder, partial(read_table, path)
    if stored or not recording.folder.is_dir():
        return
    for path in sorted(recording.folder.iterdir()):
        if path.is_dir() or (path.suffix.lower() in (".csv", ".txt") and CameraIndex.sniff(head(path))):
            base = path if path.is_dir() else path.parent
            yield path.stem, base, partial(CameraIndex(path).frames, Account())


def _is_index(path: Path) -> bool:
    """Tell whether a table of a recording's signals is an index of frames; what is no Parquet is none."""
    try:
        names: list[str] = pq.read_schema(path).names
    except (OSError, pa.ArrowInvalid):
        return False
    return names == list(FRAME_INDEX.names)
