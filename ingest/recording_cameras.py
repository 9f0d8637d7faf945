"""A recording's cameras: their frames found, kept as one index in `signals/`, and accounted for."""

from __future__ import annotations

import posixpath
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from ..schemas.errors import InputError
from ..schemas.project import Recording
from ..schemas.tables import CAMERA_FRAMES
from ..schemas.times import iso_utc
from .account import Account
from .cadence import SECOND, Cadence
from .cameras import CameraIndex, are_frames, image_folders

Span = tuple[int, int]
"""First and last stamp, ns."""


def find_cameras(files: Mapping[str, Path], folder: Path) -> tuple[dict[str, CameraIndex], list[str]]:
    """Find the camera sources among the files of a recording.

    Args:
        files: By their path within the recording.
        folder: The recording's.

    Returns:
        The sources by their path within the recording: indexes in CSV, MCAP files (which may hold no images at all)
        and folders of images; and what to say of images that are no frames: one line a folder.
    """
    images = image_folders(files)
    pictures = {name for names in images.values() for name in names}
    indexes = {name: CameraIndex.of(path) for name, path in files.items() if name not in pictures}
    found = {name: index for name, index in indexes.items() if index is not None}
    ignored: list[str] = []
    for place, names in images.items():
        if are_frames(names):
            found[place] = CameraIndex(folder / place)
        else:
            ignored += names if len(names) == 1 else [f"{place} ({len(names)} images)"]
    return found, ignored


@dataclass(frozen=True, slots=True)
class CameraSource:
    """What a source gave.

    Attributes:
        index: The source.
        account: Of it.
        frames: In the order of time, in the schema `CAMERA_FRAMES`.
        failed: Why it could not be read; None where it was.
    """

    index: CameraIndex
    account: Account
    frames: pa.Table
    failed: InputError | None = None


def read_cameras(
    indexes: Mapping[str, CameraIndex], recording: Recording, files: Iterable[str]
) -> tuple[dict[str, CameraSource], list[InputError]]:
    """Read every source of a recording.

    A folder whose images an index names is not read by itself: the index knows their times better.

    Args:
        indexes: By their path within the recording, see `find_cameras`.
        recording: The recording.
        files: Paths of all its files within it.

    Returns:
        What each source gave, MCAP files without images left out; and the indexes that name images which are not
        there.
    """
    present, named, problems = frozenset(files), set[str](), list[InputError]()
    sources: dict[str, CameraSource] = {}
    folders = image_folders(present)
    for name, index in sorted(indexes.items(), key=lambda item: (item[0] in folders, item[0])):
        if name in folders and not named.isdisjoint(folders[name]):
            continue
        account = Account()
        try:
            frames = _named(index.frames(account), name, recording, is_folder=name in folders)
        except InputError as error:
            sources[name] = CameraSource(index, account, CAMERA_FRAMES.empty_table(), error)
            continue
        paths = set(frames["path"].drop_null().to_pylist())
        named |= paths
        if absent := sorted(path for path in paths - present if not path.startswith(("/", "../"))):
            reason = f"{len(absent)} of the {len(paths)} files that it names are not there, such as {absent[0]}"
            problems.append(InputError(index.path, "", f"{reason}; their frames are kept by their times"))
        if len(frames) or any(", topic " in where for where, _ in account.rejections) or not index.is_container:
            sources[name] = CameraSource(index, account, frames)
    return sources, problems


def _named(frames: pa.Table, name: str, recording: Recording, *, is_folder: bool) -> pa.Table:
    """Return the frames with cameras and paths as they are named from the recording's folder."""
    topics = frames["camera"].to_pylist()
    base = name if is_folder else posixpath.dirname(name)

    def place(path: str | None, topic: str) -> str | None:
        if topic:
            return name
        if path is None:
            return None
        path = path.replace("\\", "/").removeprefix(f"{recording.folder.as_posix()}/")
        return path if path.startswith("/") else posixpath.normpath(posixpath.join(base, path))

    places = [place(path, topic) for path, topic in zip(frames["path"].to_pylist(), topics, strict=True)]
    cameras = pa.array([topic or name for topic in topics], pa.string())
    columns = [frames["time"], cameras, pa.array(places, pa.string()), frames["offset"]]
    return pa.table(columns, schema=CAMERA_FRAMES)


def camera_facts(frames: pa.Table) -> dict[str, Any]:
    """Return for each camera of a source how often it took a frame and where there are gaps."""
    facts = {}
    for camera in sorted(pc.unique(frames["camera"]).to_pylist()):
        cadence = Cadence()
        own = frames.filter(pc.equal(frames["camera"], camera))
        cadence.add(own["time"].cast(pa.int64()).to_numpy())
        facts[camera] = cadence.facts()
    return facts


def time_in_common(frames: pa.Table, others: Mapping[str, list[Span]]) -> tuple[dict[str, Any], str]:
    """Say how a source's clock stands to the rest of the recording.

    Args:
        frames: Of the source, not empty.
        others: Spans of the other logs by kind: navigation's (UTC), or else CAN's.

    Returns:
        Facts for the manifest, and what is wrong: the frames have no time in common with the rest; empty if nothing.
    """
    time = frames["time"].cast(pa.int64()).to_numpy()
    start, stop = int(time.min()), int(time.max())
    facts: dict[str, Any] = {"relation": "the frames' stamps are trusted to be UTC", "compared_with": None}
    kind = next((kind for kind in ("nav", "can") if others.get(kind)), None)
    if kind is None:
        return facts, ""
    spans = others[kind]
    common = max(min(stop, span[1]) - max(start, span[0]) for span in spans)
    facts |= {"compared_with": kind, "common_s": max(common, 0) / SECOND}
    if common >= 0:
        return facts, ""
    first, last = min(span[0] for span in spans), max(span[1] for span in spans)
    what = {"nav": "navigation", "can": "the CAN log"}[kind]
    return facts, (
        f"its frames ({iso_utc(start)} to {iso_utc(stop)}) and {what} ({iso_utc(first)} to {iso_utc(last)}) have no "
        "time in common; frames are taken by their own stamps, which should be UTC: the camera's clock may be off, "
        "or the files are of another drive"
    )
