"""Which files belong to a recording."""

from __future__ import annotations

from pathlib import Path

import pytest

from wheelprint.ingest.recording_logs import recording_files
from wheelprint.schemas.project import Recording


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    folder = tmp_path / "raw" / "anna" / "monday"
    (folder / "camera").mkdir(parents=True)
    for name in ("can.log", ".hidden.log", "camera/1.jpg"):
        (folder / name).touch()
    return Recording("anna", "monday", folder)


def test_hidden_files_are_left_out_and_links_to_nothing_are_not(recording: Recording) -> None:
    (recording.folder / "gone.log").symlink_to(recording.folder / "nowhere.log")
    assert [*recording_files(recording)] == ["camera/1.jpg", "can.log", "gone.log"]


def test_a_linked_folder_is_followed_once(recording: Recording, tmp_path: Path) -> None:
    disk = tmp_path / "disk" / "navigation"
    disk.mkdir(parents=True)
    (disk / "nav.ncom").touch()
    (recording.folder / "nav").symlink_to(disk)
    (recording.folder / "same").symlink_to(disk)
    (recording.folder / "gone").symlink_to(tmp_path / "nowhere")
    files = recording_files(recording)
    assert [*files] == ["camera/1.jpg", "can.log", "gone", "nav/nav.ncom"]
    assert all(path == recording.folder / name for name, path in files.items())


def test_links_that_go_round_are_not_followed(recording: Recording, tmp_path: Path) -> None:
    (recording.folder / "camera" / "up").symlink_to(recording.folder)
    (recording.folder / "top").symlink_to(tmp_path)
    (recording.folder / "camera" / "here").symlink_to(recording.folder / "camera")
    disk = tmp_path / "disk"
    disk.mkdir()
    (disk / "nav.ncom").touch()
    (disk / "round").symlink_to(disk)
    (disk / "back").symlink_to(recording.folder)
    (recording.folder / "nav").symlink_to(disk)
    assert [*recording_files(recording)] == ["camera/1.jpg", "can.log", "nav/nav.ncom"]
