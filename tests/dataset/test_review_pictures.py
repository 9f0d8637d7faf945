"""Camera frames of the review page: found by their index, and never outside of the recording's folder."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pytest

from wheelprint.dataset.review.pictures import LONGEST_STRIP, Camera, cameras_of
from wheelprint.ingest.cameras import FRAME_INDEX
from wheelprint.schemas.project import Project, Recording
from wheelprint.schemas.store import publish_table

SECOND = 1_000_000_000
START = 1_700_000_000


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    folder = tmp_path / "raw" / "王小明" / "环路 1"
    folder.mkdir(parents=True)
    return Recording("王小明", "环路 1", folder)


def cameras(recording: Recording) -> list[Camera]:
    found, problems = cameras_of(Project(recording.folder.parents[2]), recording)
    assert problems == []
    return found


def test_a_folder_of_images_named_by_their_time(recording: Recording) -> None:
    (recording.folder / "front").mkdir()
    for second in (2, 0, 1):
        (recording.folder / "front" / f"{START + second}.jpg").write_bytes(b"jpeg")
    (recording.folder / "can.log").write_text("(1700000000.0) can0 1#\n", encoding="utf-8")
    (camera,) = cameras(recording)
    assert camera.name == "front"
    assert camera.within(START * SECOND, (START + 2) * SECOND) == {
        "name": "front",
        "numbers": [0, 1],
        "times": [START * 1000, START * 1000 + 1000],
    }
    assert camera.file(2) == recording.folder / "front" / f"{START + 2}.jpg"
    assert camera.file(3) is None
    assert camera.file(-1) is None


def test_a_csv_with_paths_and_one_without_images(recording: Recording) -> None:
    (recording.folder / "images").mkdir()
    (recording.folder / "images" / "0001.png").write_bytes(b"png")
    (recording.folder / "rear.csv").write_text(f"time,path\n{START}.5,images/0001.png\n", encoding="utf-8")
    (recording.folder / "times.csv").write_text(f"timestamp,frame\n{START}.5,7\n", encoding="utf-8")
    (camera,) = cameras(recording)
    assert (camera.name, camera.time.tolist()) == ("rear", [START * SECOND + SECOND // 2])
    assert camera.file(0) == recording.folder / "images" / "0001.png"


def test_a_stored_index_comes_first(recording: Recording) -> None:
    project = Project(recording.folder.parents[2])
    (recording.folder / "a.jpg").write_bytes(b"jpeg")
    rows = [(START * SECOND, "left", "a.jpg", None), (START * SECOND, "right", None, 17)]
    table = pa.Table.from_arrays(
        [pa.array(column, f.type) for column, f in zip(zip(*rows, strict=True), FRAME_INDEX, strict=True)],
        schema=FRAME_INDEX,
    )
    publish_table(project.signals_folder(recording.driver, recording.name) / "camera.frames.parquet", table)
    publish_table(project.signals_folder(recording.driver, recording.name) / "can.MOTION.parquet", table.drop("camera"))
    (camera,) = cameras(recording)
    assert (camera.name, camera.file(0)) == ("left", recording.folder / "a.jpg")


def test_nothing_outside_of_the_recording_is_a_frame(recording: Recording, tmp_path: Path) -> None:
    for place in (tmp_path / "secret.jpg", recording.folder.parent / "other.jpg", recording.folder / "notes.txt"):
        place.write_bytes(b"secret")
    (recording.folder / "link.jpg").symlink_to(tmp_path / "secret.jpg")
    paths = ["../other.jpg", "../../../secret.jpg", f"{tmp_path}/secret.jpg", "link.jpg", "absent.jpg", "notes.txt"]
    lines = "".join(f"{START + number},{path}\n" for number, path in enumerate(paths))
    (recording.folder / "index.csv").write_text("time,path\n" + lines, encoding="utf-8")
    (camera,) = cameras(recording)
    assert len(camera.paths) == 5, "a text file is no image"
    assert [camera.file(number) for number in range(5)] == [None] * 5


def test_of_many_frames_some_are_told(recording: Recording) -> None:
    lines = "".join(f"{START + number},{number}.jpg\n" for number in range(1000))
    (recording.folder / "index.csv").write_text("time,path\n" + lines, encoding="utf-8")
    (camera,) = cameras(recording)
    told = camera.within(0, 2**62)
    assert len(told["numbers"]) == len(told["times"]) == LONGEST_STRIP - 40
    assert told["numbers"][:3] == [0, 5, 10]


def test_a_damaged_index_is_told(recording: Recording) -> None:
    project = Project(recording.folder.parents[2])
    path = project.signals_folder(recording.driver, recording.name) / "camera.parquet"
    columns = [range(5000), ["front"] * 5000, [f"{number}.jpg" for number in range(5000)], [None] * 5000]
    arrays = [pa.array(column, f.type) for column, f in zip(columns, FRAME_INDEX, strict=True)]
    publish_table(path, pa.Table.from_arrays(arrays, schema=FRAME_INDEX))
    content = bytearray(path.read_bytes())
    content[2000] ^= 0xFF
    path.write_bytes(content)
    (path.parent / "can.MOTION.parquet").write_bytes(b"no Parquet at all")
    found, problems = cameras_of(project, recording)
    assert found == []
    assert [problem.path for problem in problems] == [str(path)]
    assert problems[0].reason.startswith("not a whole Parquet file (")
