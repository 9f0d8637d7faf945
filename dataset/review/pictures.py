"""The camera frames of a recording: what was taken when, and which file on disk that is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ...schemas.project import Project, Recording

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
        paths: Where each is within the recording's folder (n_frames).
        folder: Of the recording; nothing outside of it is a frame, be it by a link.
    """

    name: str
    time: NDArray[np.int64]
    paths: list[str]
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
        file = (self.folder / self.paths[number]).resolve()
        is_frame = file.suffix.lower() in MEDIA_TYPES and file.is_relative_to(self.folder.resolve()) and file.is_file()
        return file if is_frame else None


def cameras_of(project: Project, recording: Recording) -> list[Camera]:
    """Return the cameras of a recording whose frames are image files, from the index that `convert` stored.

    Raises:
        InputError: The index is damaged.
    """
    table = project.cameras(recording.driver, recording.name)
    frames: dict[str, list[tuple[int, str]]] = {}
    for camera, time, path in zip(
        table["camera"].to_pylist(), table["time"].cast(pa.int64()).to_pylist(), table["path"].to_pylist(), strict=True
    ):
        if path and Path(path).suffix.lower() in MEDIA_TYPES:
            frames.setdefault(camera, []).append((time, path))
    cameras = []
    for name, found in frames.items():
        times, paths = zip(*sorted(found), strict=True)
        cameras.append(Camera(name, np.array(times, np.int64), list(paths), recording.folder))
    return cameras
