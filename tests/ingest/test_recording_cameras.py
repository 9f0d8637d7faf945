"""A recording's cameras: found, named from the recording's folder, compared with the other logs' time."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import pyarrow as pa
import pytest
from mcap.writer import Writer

from wheelprint.ingest.cameras import CameraIndex
from wheelprint.ingest.can.database import Database
from wheelprint.ingest.recording_cameras import find_cameras, read_cameras
from wheelprint.ingest.recording_logs import RawLogs, read_logs, recording_files
from wheelprint.schemas.config import Nav
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import Project, Recording
from wheelprint.schemas.store import Manifest, fingerprint, read_table, sha256
from wheelprint.schemas.tables import CAMERA_FRAMES

START = 1_700_000_000
"""s since 1970: 2023-11-14T22:13:20Z."""


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    """A recording of twelve seconds of CAN."""
    folder = tmp_path / "raw" / "anna" / "monday"
    folder.mkdir(parents=True)
    lines = [f"({START + n / 10:.6f}) can0 123#{n:04X}\n" for n in range(120)]
    (folder / "can.log").write_text("".join(lines))
    return Recording("anna", "monday", folder)


def add_images(folder: Path, count: int = 12, start: int = START, suffix: str = ".jpg") -> list[str]:
    folder.mkdir(parents=True, exist_ok=True)
    names = [f"{1000 * (start + n)}{suffix}" for n in range(count)]
    for name in names:
        (folder / name).write_bytes(b"image")
    return names


def convert(recording: Recording) -> RawLogs:
    project = recording.folder.parents[2]
    folder = Project(project).signals_folder("anna", "monday")
    return read_logs(project, recording, Database(()), folder, Nav())


def stored(recording: Recording) -> list[tuple[int, str, str | None, int | None]]:
    path = Project(recording.folder.parents[2]).cameras_file("anna", "monday")
    table = read_table(path)
    assert table.schema.equals(CAMERA_FRAMES, check_metadata=True)
    table = table.set_column(0, "time", table["time"].cast(pa.int64()))
    return [tuple(row.values()) for row in table.to_pylist()]


def test_a_folder_of_images_is_one_input_and_none_of_them_is_ignored(recording: Recording) -> None:
    names = add_images(recording.folder / "camera" / "front")
    (recording.folder / "camera" / "front" / "calibration.png").write_bytes(b"")
    logs = convert(recording)

    assert logs.ignored == []
    can, camera = logs.inputs
    assert (can["kind"], can["accepted"]) == ("can", 120)
    rejection = {
        "where": "calibration.png",
        "reason": "expected a stamp since 1970 of 10 (s), 13 (ms), 16 (µs) or 19 (ns) digits, or date and time to the "
        "second; in the image's name",
    }
    sizes = {**dict.fromkeys(names, 5), "calibration.png": 0}
    assert camera == {
        "path": "camera/front", "sha256": fingerprint(sizes), "bytes": 60, "format": "camera", "kind": "camera",
        "accepted": 12, "rejected": 1, "truncated": False, "rejections": [rejection], "remarks": [],
        "start": "2023-11-14T22:13:20.000Z", "stop": "2023-11-14T22:13:31.000Z",
        "stamps": {
            "backwards": {"count": 0, "worst_s": 0.0, "at": None},
            "repeated": {"count": 0, "most_on_one_stamp": 0, "at": None},
            "gaps": {"count": 0, "longest_s": 0.0, "at": None},
        },
        "cameras": {
            "camera/front": {
                "count": 12, "start": "2023-11-14T22:13:20.000Z", "stop": "2023-11-14T22:13:31.000Z", "rate_hz": 1.0,
                "gaps": 0, "longest_interval_s": 1.0, "longest_interval_at": "2023-11-14T22:13:20.000Z",
            }
        },
        "clock": {
            "relation": "the frames' stamps are trusted to be UTC", "compared_with": "can", "common_s": 11.0,
        },
    }  # fmt: skip
    assert stored(recording) == [
        ((START + n) * 10**9, "camera/front", f"camera/front/{name}", None) for n, name in enumerate(names)
    ]
    assert [output["path"] for output in logs.outputs] == ["signals/driver=anna/recording=monday/cameras.parquet"]


def test_an_index_names_its_images_from_the_recording_and_goes_before_their_folder(recording: Recording) -> None:
    names = add_images(recording.folder / "cameras" / "left")
    rows = [f"{START + n}.25,left/{name}\n" for n, name in enumerate(names)]
    (recording.folder / "cameras" / "left.csv").write_text("time,path\n" + "".join(rows))
    logs = convert(recording)

    assert logs.problems == []
    assert [entry["path"] for entry in logs.inputs] == ["can.log", "cameras/left.csv"]
    assert logs.inputs[1]["sha256"] == sha256(recording.folder / "cameras" / "left.csv")
    assert stored(recording) == [
        (START * 10**9 + n * 10**9 + 250_000_000, "cameras/left.csv", f"cameras/left/{name}", None)
        for n, name in enumerate(names)
    ]


def test_images_that_are_named_and_absent_are_said_and_their_times_kept(recording: Recording) -> None:
    rows = "".join(f"{START + n},{n}.jpg\n" for n in range(3))
    (recording.folder / "1.jpg").write_bytes(b"")
    (recording.folder / "cam.csv").write_text(f"time,path\n{rows}")
    logs = convert(recording)
    assert [str(problem) for problem in logs.problems] == [
        (
            f"{recording.folder}/cam.csv: 2 of the 3 files that it names are not there, such as 0.jpg; their frames "
            "are kept by their times"
        )
    ]
    assert [row[2] for row in stored(recording)] == ["0.jpg", "1.jpg", "2.jpg"]


def test_pictures_are_no_camera_and_make_one_line_a_folder(recording: Recording) -> None:
    add_images(recording.folder / "few", 9)
    (recording.folder / "photo.png").write_bytes(b"")
    for number in range(30):
        (recording.folder / f"{number}.png").write_bytes(b"")
    (recording.folder / "notes.txt").write_text("sunny")
    (recording.folder / "one").mkdir()
    (recording.folder / "one" / "map.png").write_bytes(b"")
    logs = convert(recording)
    assert logs.ignored == [". (31 images)", "few (9 images)", "notes.txt", "one/map.png"]
    assert [entry["kind"] for entry in logs.inputs] == ["can"]
    assert not Project(recording.folder.parents[2]).cameras_file("anna", "monday").exists()


def test_frames_without_a_time_in_common_with_the_logs_are_a_problem(recording: Recording) -> None:
    add_images(recording.folder / "front", start=START + 7200)
    logs = convert(recording)
    assert [str(problem) for problem in logs.problems] == [
        (
            f"{recording.folder}/front: its frames (2023-11-15T00:13:20.000Z to 2023-11-15T00:13:31.000Z) and the CAN "
            "log (2023-11-14T22:13:20.000Z to 2023-11-14T22:13:31.900Z) have no time in common; frames are taken by "
            "their own stamps, which should be UTC: the camera's clock may be off, or the files are of another drive"
        )
    ]
    assert logs.inputs[1]["clock"] == {
        "relation": "the frames' stamps are trusted to be UTC", "compared_with": "can", "common_s": 0.0,
    }  # fmt: skip
    assert len(stored(recording)) == 12


def test_an_index_that_cannot_be_read_is_an_input_that_failed(recording: Recording) -> None:
    files = recording_files(recording)
    index = CameraIndex(recording.folder / "cam.csv")
    index.path.write_text("when,path\n1,2\n")
    sources, _ = read_cameras({"cam.csv": index}, recording, files)
    failed = sources["cam.csv"].failed
    assert isinstance(failed, InputError)
    assert failed.where == "line 1"
    assert len(sources["cam.csv"].frames) == 0


def test_images_of_an_mcap_file_stand_by_its_name_and_their_bytes(recording: Recording) -> None:
    output = BytesIO()
    writer = Writer(output, use_chunking=False)
    writer.start()
    schema = writer.register_schema("foxglove.CompressedImage", "json", b"{}")
    left, right = (writer.register_channel(f"/{side}", "json", schema) for side in ("left", "right"))
    for channel, n in ((left, 0), (right, 1), (left, 2)):
        time = (START + n) * 10**9
        writer.add_message(channel, time, f'{{"image": {n}}}'.encode(), time)
    writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it without types
    (recording.folder / "cam").mkdir()
    (recording.folder / "cam" / "drive.mcap").write_bytes(output.getvalue())
    logs = convert(recording)

    assert logs.problems == []
    camera = logs.inputs[-1]
    assert (camera["path"], camera["format"], camera["accepted"]) == ("cam/drive.mcap", "camera", 3)
    assert {name: facts["count"] for name, facts in camera["cameras"].items()} == {"/left": 2, "/right": 1}
    # A record of a message is its opcode 05, its length, 22 bytes of header and the data.
    places = [output.getvalue().find(f'{{"image": {n}}}'.encode()) - 22 - 9 for n in range(3)]
    assert stored(recording) == [
        ((START + n) * 10**9, side, "cam/drive.mcap", places[n]) for n, side in enumerate(("/left", "/right", "/left"))
    ]


def test_where_cameras_are_found(recording: Recording) -> None:
    add_images(recording.folder)
    (recording.folder / "cam.csv").write_text("time,frame\n1700000000,0\n")
    (recording.folder / "table.csv").write_text("time,speed\n1700000000,0\n")
    found, ignored = find_cameras(recording_files(recording), recording.folder)
    assert {name: index.path for name, index in found.items()} == {
        ".": recording.folder, "cam.csv": recording.folder / "cam.csv",
    }  # fmt: skip
    assert ignored == []


def test_the_project_gives_the_frames_that_the_manifest_confirms(recording: Recording) -> None:
    add_images(recording.folder / "front")
    logs = convert(recording)
    project = Project(recording.folder.parents[2])
    assert project.cameras("anna", "monday").equals(CAMERA_FRAMES.empty_table())
    Manifest(project.directory).record("recordings", "anna/monday", {"outputs": logs.outputs})
    frames = project.cameras("anna", "monday")
    assert frames.schema == CAMERA_FRAMES
    assert len(frames) == 12
    assert (recording.folder / frames["path"][0].as_py()).read_bytes() == b"image"
    assert project.cameras("bert", "monday").equals(CAMERA_FRAMES.empty_table())
