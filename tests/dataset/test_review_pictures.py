"""Camera frames of the review page: those of the stored index, and never outside of the recording's folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pytest

from wheelprint.dataset.review.pictures import LONGEST_STRIP, Camera, cameras_of
from wheelprint.schemas.project import Project, Recording
from wheelprint.schemas.store import Manifest, describe_output, publish_table
from wheelprint.schemas.tables import CAMERA_FRAMES

SECOND = 1_000_000_000
START = 1_700_000_000


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    folder = tmp_path / "raw" / "王小明" / "环路 1"
    folder.mkdir(parents=True)
    return Recording("王小明", "环路 1", folder)


def cameras(recording: Recording, *frames: tuple[int, str, str | None]) -> list[Camera]:
    """The cameras of an index with these frames: seconds from the start, camera and path."""
    columns: Sequence[Sequence[object]] = [
        [(START + second) * SECOND for second, _, _ in frames],
        [camera for _, camera, _ in frames],
        [path for _, _, path in frames],
        [None] * len(frames),
    ]
    arrays = [pa.array(column, f.type) for column, f in zip(columns, CAMERA_FRAMES, strict=True)]
    project = Project(recording.folder.parents[2])
    path = project.cameras_file(recording.driver, recording.name)
    publish_table(path, pa.Table.from_arrays(arrays, schema=CAMERA_FRAMES))
    outputs = [describe_output(project.directory, path)]
    Manifest(project.directory).record("recordings", recording.key, {"outputs": outputs})
    return cameras_of(project, recording)


def test_without_an_index_there_are_no_cameras(recording: Recording) -> None:
    assert cameras_of(Project(recording.folder.parents[2]), recording) == []


def test_the_frames_of_each_camera_by_number(recording: Recording) -> None:
    (recording.folder / "front").mkdir()
    for name in "abc":
        (recording.folder / "front" / f"{name}.jpg").write_bytes(b"jpeg")
    front, rear = cameras(
        recording,
        (0, "front", "front/a.jpg"),
        (0, "rear", "r.png"),
        (1, "front", "front/b.jpg"),
        (2, "front", "front/c.jpg"),
        (2, "unknown.csv", None),
        (3, "/camera/topic", "drive.mcap"),
    )
    assert (front.name, rear.name) == ("front", "rear")
    assert front.within(START * SECOND, (START + 2) * SECOND) == {
        "name": "front",
        "numbers": [0, 1],
        "times": [START * 1000, START * 1000 + 1000],
    }
    assert front.file(2) == recording.folder / "front" / "c.jpg"
    assert [front.file(3), front.file(-1)] == [None, None]
    assert rear.file(0) is None, "the index names a file that is not there"


def test_nothing_outside_of_the_recording_is_a_frame(recording: Recording, tmp_path: Path) -> None:
    for place in (tmp_path / "secret.jpg", recording.folder.parent / "other.jpg", recording.folder / "notes.txt"):
        place.write_bytes(b"secret")
    (recording.folder / "link.jpg").symlink_to(tmp_path / "secret.jpg")
    paths = ["../other.jpg", "../../../secret.jpg", f"{tmp_path}/secret.jpg", "link.jpg", "absent.jpg", "notes.txt"]
    (camera,) = cameras(recording, *((second, "front", path) for second, path in enumerate(paths)))
    assert len(camera.paths) == 5, "a text file is no image"
    assert [camera.file(number) for number in range(5)] == [None] * 5


def test_of_many_frames_some_are_told(recording: Recording) -> None:
    (camera,) = cameras(recording, *((second, "front", f"{second}.jpg") for second in range(1000)))
    told = camera.within(0, 2**62)
    assert len(told["numbers"]) == len(told["times"]) == 200 <= LONGEST_STRIP
    assert told["numbers"][:3] == [0, 5, 10]
