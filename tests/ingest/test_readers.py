from __future__ import annotations

import gzip
import pickle
from pathlib import Path

import pytest

from wheelprint.ingest.readers import READERS, recognise
from wheelprint.schemas.errors import InputError

CANDUMP = b"(1715562000.500000) can0 11F#6400000000\n" * 50


def write(folder: Path, content: bytes) -> Path:
    path = folder / "log"
    path.write_bytes(content)
    return path


def message(path: Path) -> str:
    with pytest.raises(InputError) as error:
        recognise(path)
    return str(error.value)


def test_content_decides_and_not_the_name(tmp_path: Path) -> None:
    path = tmp_path / "navigation.ncom"
    path.write_bytes(CANDUMP)
    assert [reader.format for reader in recognise(path)] == ["candump"]
    path.write_bytes(gzip.compress(CANDUMP))
    assert [reader.format for reader in recognise(path)] == ["candump"]


def test_a_damaged_gzip_is_recognised_by_what_is_whole(tmp_path: Path) -> None:
    packed = gzip.compress(CANDUMP * 20_000, compresslevel=1)
    path = write(tmp_path, packed[:2048] + b"\xff" * 100)
    assert [reader.format for reader in recognise(path)] == ["candump"]


def test_unreadable_files_say_why(tmp_path: Path) -> None:
    assert message(tmp_path / "gone") == (
        f"{tmp_path}/gone: no such file; check the path, or whether the disk is mounted"
    )
    assert message(tmp_path) == f"{tmp_path}: cannot be read: Is a directory"
    assert message(write(tmp_path, b"")) == (
        f"{tmp_path}/log: holds nothing: empty, or gzip damaged from its start; the logger may have been stopped "
        "too early"
    )
    assert message(write(tmp_path, b"\x1f\x8b" + b"\xff" * 30)) == (
        f"{tmp_path}/log: holds nothing: empty, or gzip damaged from its start; the logger may have been stopped "
        "too early"
    )
    assert message(write(tmp_path, b"something else")) == (
        f"{tmp_path}/log: is of no format that is known here (asc, blf, candump, candump-console, crtd, csv, "
        "gvret csv, kitti, mcap, mf4, ncom, nmea, pcap, python-can csv, trc, xcom); it begins with b'something else'. "
        "Export it as one of these"
    )


def test_readers_are_small_and_picklable(tmp_path: Path) -> None:
    for reader in READERS:
        found = pickle.loads(pickle.dumps(reader(tmp_path / "log")))
        assert found.path == tmp_path / "log"
        assert len(pickle.dumps(found)) < 1000
        assert found.kind in ("can", "nav")
