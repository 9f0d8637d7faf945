"""KITTI's `oxts` folders: stamps and frames are paired by number, nothing is lost in silence."""

from __future__ import annotations

import gzip
import json
import pickle
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from wheelprint.ingest.account import Account
from wheelprint.ingest.oxts.kitti import Kitti
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.tables import NAVIGATION

FRAME = {
    "lat": 49.0, "lon": 8.4, "alt": 116.0, "roll": 0.0, "pitch": 0.0, "yaw": 0.5, "vn": 3.0, "ve": 4.0, "vf": 5.0,
    "vl": -0.1, "vu": 0.0, "ax": 0.5, "ay": 0.25, "az": 9.80665, "af": 0.5, "al": 0.25, "au": 9.8, "wx": 0.0,
    "wy": 0.0, "wz": 0.1, "wf": 0.0, "wl": 0.0, "wu": 0.1, "pos_accuracy": 0.05, "vel_accuracy": 0.01, "navstat": 4,
    "numsats": 11, "posmode": 6, "velmode": 6, "orimode": 6,
}  # fmt: skip
START = int(datetime(2011, 9, 26, 13, 2, 25, tzinfo=UTC).timestamp()) * 1_000_000_000


def frame(**changes: object) -> str:
    return " ".join(str(value) for value in {**FRAME, **changes}.values()) + "\n"


def stamp(number: int) -> str:
    return f"2011-09-26 13:02:25.{number:d}00000001\n"


def write(folder: Path, frames: dict[int, str], stamps: str) -> Path:
    (folder / "data").mkdir(exist_ok=True)
    for number, content in frames.items():
        (folder / "data" / f"{number:010d}.txt").write_text(content)
    path = folder / "timestamps.txt"
    path.write_bytes(stamps.encode())
    return path


def read(path: Path) -> tuple[pa.Table, Account]:
    account = Account()
    batches = list(Kitti(path).batches(account))
    return pa.Table.from_batches(batches, batches[0].schema if batches else NAVIGATION), account


def times(table: pa.Table) -> list[int]:
    stamps: list[int] = table["time"].cast(pa.int64()).to_pylist()
    return stamps


def test_a_frame_in_wheelprints_axes_and_units(tmp_path: Path) -> None:
    table, account = read(write(tmp_path, {0: frame(), 1: frame(lat=49.0001)}, stamp(0) + stamp(1)))
    assert account == Account(accepted=2)
    assert table.schema.equals(NAVIGATION, check_metadata=False)
    assert times(table) == [START + 1, START + 100_000_001]
    first = table.to_pylist()[0]
    del first["time"]
    assert first == pytest.approx({
        "latitude": 49.0, "longitude": 8.4, "altitude": 116.0, "x": 0.0, "y": 0.0,
        "course": np.degrees(np.arctan2(3, 4)), "heading": np.degrees(0.5), "nav_speed": 5.0,
        "nav_yaw_rate": np.degrees(0.1), "nav_longitudinal_acceleration": 0.5, "nav_lateral_acceleration": 0.25,
        "position_accuracy": 0.05, "nav_status": 4,
    })  # fmt: skip
    # 0.0001 deg of a meridian of 111.2 km per degree.
    assert table["y"][1].as_py() == pytest.approx(11.12, abs=0.01)
    assert table["x"][1].as_py() == pytest.approx(0, abs=1e-3)
    assert json.loads(table.schema.metadata[b"origin"]) == {"latitude": 49.0, "longitude": 8.4, "altitude": 116.0}
    assert table.schema.metadata[b"utc_from"] == b"stamps without time zone, taken as UTC"


def test_gravity_on_a_slope_is_removed(tmp_path: Path) -> None:
    """At rest, nose down by 0.1 and left side up by 0.2 rad: gravity pulls forwards and to the right."""
    g, pitch, roll = 9.80665, 0.1, 0.2
    measured = {"ax": -g * np.sin(pitch), "ay": g * np.cos(pitch) * np.sin(roll), "pitch": pitch, "roll": roll}
    table, _ = read(write(tmp_path, {0: frame(**measured)}, stamp(0)))
    assert table["nav_longitudinal_acceleration"][0].as_py() == pytest.approx(0, abs=1e-12)
    assert table["nav_lateral_acceleration"][0].as_py() == pytest.approx(0, abs=1e-12)


def test_yaw_over_the_end_of_its_circle(tmp_path: Path) -> None:
    table, _ = read(write(tmp_path, {0: frame(yaw=-3.0), 1: frame(yaw=np.pi)}, stamp(0) + stamp(1)))
    assert table["heading"].to_pylist() == pytest.approx([np.degrees(-3.0), -180.0])


@pytest.mark.parametrize(("status", "inertial"), [(0, False), (1, True), (2, True), (5, False), (11, False)])
def test_the_navigation_status_rules_what_is_valid(tmp_path: Path, status: int, inertial: bool) -> None:
    table, account = read(write(tmp_path, {0: frame(navstat=status)}, stamp(0)))
    assert account == Account(accepted=1)
    present = {name for name, value in table.to_pylist()[0].items() if value is not None}
    motion = {"nav_yaw_rate", "nav_longitudinal_acceleration", "nav_lateral_acceleration"} if inertial else set()
    assert present == {"time", "nav_status"} | motion
    assert table.schema.metadata[b"origin"] == b"null"


def test_pairs_by_number_and_says_what_has_no_other_half(tmp_path: Path) -> None:
    frames = {0: frame(), 2: frame(vn=6.0), 3: "\n", 4: frame(), 7: frame()}
    path = write(tmp_path, frames, stamp(0) + stamp(1) + stamp(2) + stamp(3) + "\n" + stamp(5) + "\n")
    table, account = read(path)
    assert times(table) == [START + 1, START + 200_000_001]
    assert table["nav_speed"].to_pylist() == pytest.approx([5.0, 52**0.5])
    lost = "has a stamp but no file in the folder data; the recording of frames stopped earlier"
    assert account == Account(
        accepted=2,
        rejected=5,
        rejections=[
            ("frame 1", lost),
            ("frame 3", "0000000003.txt has 0 values, not 30; the frame is blank"),
            ("frame 4", "line 5 of the stamps: expected a stamp such as 2011-09-26 13:02:25.964389445; found ''"),
            ("frame 5", lost),
            ("frame 7", "timestamps.txt has no line 8 with its stamp, but 7; stamps were lost or cut off"),
        ],
    )


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (frame(wz="x"), "0000000000.txt: wz: expected a number; found 'x'"),
        (frame(vn="1_0"), "0000000000.txt: vn: expected a number; found '1_0'"),
        (frame(ax="inf"), "0000000000.txt: ax: expected a number; found 'inf'"),
        (frame(ax="1e99"), "0000000000.txt: ax: expected a number; found '1e99'"),
        (frame(navstat=4.5), "0000000000.txt: expected a navigation status (0 to 255) as navstat; found 4.5"),
        (frame(navstat=-1), "0000000000.txt: expected a navigation status (0 to 255) as navstat; found -1"),
        (frame(navstat="nan"), "0000000000.txt: expected a navigation status (0 to 255) as navstat; found nan"),
        (frame() + "1\n", "0000000000.txt has 31 values, not 30; the frame is damaged or cut off"),
        ("1 2 3\n", "0000000000.txt has 3 values, not 30; the frame is damaged or cut off"),
        (
            frame(lat=149.5),
            "latitude 149.5 deg, longitude 8.4 deg, altitude 116 m is nowhere on earth; the frame is damaged",
        ),
    ],
)
def test_damaged_frames_are_rejected(tmp_path: Path, content: str, reason: str) -> None:
    table, account = read(write(tmp_path, {0: content, 1: frame()}, stamp(0) + stamp(1)))
    assert times(table) == [START + 100_000_001]
    assert account == Account(accepted=1, rejected=1, rejections=[("frame 0", reason)])


@pytest.mark.parametrize(
    "line",
    ["2011-02-30 13:02:25.000000001", "2011-09-26 24:02:25.000000001", "9999-09-26 13:02:25.000000001", "13:02:25"],
)
def test_damaged_stamps_are_rejected(tmp_path: Path, line: str) -> None:
    _, account = read(write(tmp_path, {0: frame(), 1: frame()}, f"{line}\r\n{stamp(1)}"))
    reason = f"line 1 of the stamps: expected a stamp such as 2011-09-26 13:02:25.964389445; found '{line}'"
    assert account == Account(accepted=1, rejected=1, rejections=[("frame 0", reason)])


def test_time_that_does_not_increase_is_rejected(tmp_path: Path) -> None:
    path = write(tmp_path, dict.fromkeys(range(5), frame()), stamp(0) + stamp(3) + stamp(1) + stamp(1) + stamp(4))
    table, account = read(path)
    assert times(table) == [START + 1, START + 100_000_001, START + 400_000_001]
    swapped = "is out of order with the frames around it; they changed places, or the clock was set"
    repeated = "is that of another frame; repeated in recording, the first one is kept"
    assert account.rejections == [
        ("frame 1", f"its time 2011-09-26T13:02:25.300Z {swapped}"),
        ("frame 3", f"its time 2011-09-26T13:02:25.100Z {repeated}"),
    ]


def test_two_frames_of_one_number(tmp_path: Path) -> None:
    path = write(tmp_path, {1: frame()}, stamp(0) + stamp(1))
    (tmp_path / "data" / "1.txt").write_text(frame())
    (tmp_path / "data" / "0.txt").write_text(frame())
    (tmp_path / "data" / "readme.txt").write_text("nothing")
    table, account = read(path)
    assert len(table) == 2
    reason = "1.txt has the same number as 0000000001.txt; the latter is taken"
    assert account == Account(accepted=2, rejected=1, rejections=[("frame 1", reason)])


def test_cut_anywhere_in_the_stamps(tmp_path: Path) -> None:
    content = "".join(stamp(number) for number in range(4))
    length = len(stamp(0))
    for size in range(len(content) + 1):
        table, account = read(write(tmp_path, dict.fromkeys(range(4), frame()), content[:size]))
        # Without its line end the last stamp is still whole.
        assert len(table) == (size + 1) // length
        assert account.accepted + account.rejected == 4
        assert account.truncated == (0 < size % length < length - 1)


def test_cut_anywhere_in_the_last_frame(tmp_path: Path) -> None:
    content = frame()
    for size in range(len(content) + 1):
        table, account = read(write(tmp_path, {0: frame(), 1: content[:size]}, stamp(0) + stamp(1)))
        whole = size >= len(content) - 1
        assert len(table) == 1 + whole
        assert account.truncated == (size > 0 and not whole)


def test_no_folder_of_frames(tmp_path: Path) -> None:
    path = tmp_path / "timestamps.txt"
    path.write_text(stamp(0))
    with pytest.raises(InputError) as error:
        read(path)
    assert str(error.value) == (
        f"{path}: holds the stamps of a KITTI recording, but the folder data of its frames (data/0000000000.txt and so "
        "on), which must stand beside it, cannot be read: No such file or directory. Copy the whole oxts folder"
    )


def test_compressed_stamps_batches_and_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wheelprint.ingest.oxts.kitti.BATCH", 2)
    path = write(tmp_path, dict.fromkeys(range(5), frame()), "")
    path.write_bytes(gzip.compress("".join(map(stamp, range(5))).encode()))
    reader = pickle.loads(pickle.dumps(Kitti(path)))
    account = Account()
    assert [len(batch) for batch in reader.batches(account)] == [2, 2, 1]
    assert account == Account(accepted=5)
    assert reader.parts() == [path, *(tmp_path / "data" / f"{number:010d}.txt" for number in range(5))]


def test_random_damage_ends_as_a_result(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    stamps = np.frombuffer("".join(map(stamp, range(4))).encode(), np.uint8)
    content = np.frombuffer(frame().encode(), np.uint8)
    for _ in range(100):
        damaged = stamps.copy()
        damaged[rng.integers(len(stamps), size=3)] = rng.integers(256, size=3)
        path = write(tmp_path, dict.fromkeys(range(4), frame()), "")
        path.write_bytes(damaged.tobytes())
        hit = content.copy()
        hit[rng.integers(len(content), size=2)] = rng.integers(256, size=2)
        (tmp_path / "data" / "0000000002.txt").write_bytes(hit.tobytes())
        table, account = read(path)
        assert len(table) == account.accepted
        assert account.accepted + account.rejected >= 4


def test_sniff() -> None:
    assert Kitti.sniff(stamp(0).encode())
    assert Kitti.sniff(b"2011-09-26 13:02:25.594360375\r\n2011-09-26")
    for other in (
        b"", b"2011-09-26 13:02:25.59", b"2011-09-26 13:02:25.594360375 1\n", b"(1436509052.249713) can0 044#2A\n",
        b"\xe7" * 144, frame().encode(), b"$GPRMC,1\n", b"OggS\0", b" Time(), Date,\n",
    ):  # fmt: skip
        assert not Kitti.sniff(other)
