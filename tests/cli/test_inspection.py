"""`wheelprint inspect`: everything in JSON, and what a person sees on a narrow terminal."""

from __future__ import annotations

import json
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer
from typer.testing import CliRunner

from wheelprint.cli import app
from wheelprint.ingest.oxts.ncom_writer import write_ncom

Command = Callable[..., Any]

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
"""2023-11-14T22:13:20Z."""
DBC = """VERSION ""

BU_: CAR

BO_ 291 STEER: 8 CAR
 SG_ ANGLE : 0|16@1- (0.1,0) [0|0] "deg" CAR

BO_ 292 GONE: 8 CAR
 SG_ NOTHING : 0|8@1+ (1,0) [0|0] "" CAR
"""


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    """A CAN log of 20 s with a gap of 3 s, a navigation log that locks after 5 s and is two hours off, a database."""
    lines = []
    for n in range(2000):
        seconds = n / 100 + (3 if n >= 1000 else 0)
        lines.append(f"({START // SECOND + seconds:.6f}) can0 123#{n:04X}\n")
        if n % 100 == 0:
            lines.append(f"({START // SECOND + seconds:.6f}) can0 18FEF100#{'00' * (n // 250 + 1)}\n")
    lines.insert(3, "(1700000000.0x) can0 broken\n")
    (tmp_path / "can.log").write_text("".join(lines))
    time = START + 2 * 3600 * SECOND + np.arange(0, 2300) * SECOND // 100
    status = np.where(np.arange(2300) < 300, 3, 4)
    status[1000:1100] = 3
    write_ncom(
        tmp_path / "nav.ncom", time=time, latitude=52.0, longitude=8.0, altitude=100.0,
        velocity=np.tile([10.0, 0.0, 0.0], (2300, 1)), orientation=np.zeros((2300, 3)),
        acceleration=np.tile([0.0, 0.0, -9.8], (2300, 1)), angular_rate=np.zeros((2300, 3)), status=status,
    )  # fmt: skip
    (tmp_path / "car.dbc").write_text(DBC)
    return tmp_path


def log_of(answer: Any, name: str) -> dict[str, Any]:
    (found,) = [log for log in answer.content["logs"] if log["path"].endswith(name)]
    return dict(found)


def test_json_carries_messages_with_rate_gaps_and_name(drive: Path, wheelprint: Command) -> None:
    answer = wheelprint("inspect", drive / "can.log", "--database", drive / "car.dbc")
    log = log_of(answer, "can.log")
    steer, unknown = log.pop("messages")
    assert log == {
        "path": str(drive / "can.log"), "format": "candump", "holds": "can", "start": "2023-11-14T22:13:20.000Z",
        "stop": "2023-11-14T22:13:42.990Z", "accepted": 2020, "rejected": 1, "truncated": False,
        "rejections": [{"where": "line 4", "reason": log["rejections"][0]["reason"]}], "remarks": [],
        "stamps": {
            "backwards": {"count": 0, "worst_s": 0.0, "at": None},
            "repeated": {"count": 20, "most_on_one_stamp": 2, "at": "2023-11-14T22:13:20.000Z"},
            "gaps": {"count": 1, "longest_s": 3.01, "at": "2023-11-14T22:13:29.990Z"},
        },
        "doubt": None, "frames": {"data": 2020, "remote": 0, "error": 0}, "frames_of_further_messages": 0,
    }  # fmt: skip
    assert steer == {
        "channel": "can0", "id": 0x123, "extended": False, "name": "STEER", "bytes": [2, 2], "database_bytes": 8,
        "count": 2000, "start": "2023-11-14T22:13:20.000Z", "stop": "2023-11-14T22:13:42.990Z", "rate_hz": 100.0,
        "gaps": 1, "longest_interval_s": 3.01, "longest_interval_at": "2023-11-14T22:13:29.990Z",
    }  # fmt: skip
    assert (unknown["id"], unknown["extended"], unknown["name"]) == (0x18FEF100, True, None)
    assert (unknown["bytes"], unknown["database_bytes"], unknown["count"]) == ([1, 8], None, 20)
    assert answer.status == 3
    assert len(answer.problems) == 1


def test_json_carries_navigation_status_over_time_and_accuracy(drive: Path, wheelprint: Command) -> None:
    log = log_of(wheelprint("inspect", drive / "nav.ncom"), "nav.ncom")
    assert [tuple(period.values()) for period in log["status"]] == [
        ("2023-11-15T00:13:20.000Z", "2023-11-15T00:13:22.990Z", 300, 3, "locking"),
        ("2023-11-15T00:13:23.000Z", "2023-11-15T00:13:29.990Z", 700, 4, "locked"),
        ("2023-11-15T00:13:30.000Z", "2023-11-15T00:13:30.990Z", 100, 3, "locking"),
        ("2023-11-15T00:13:31.000Z", "2023-11-15T00:13:42.990Z", 1200, 4, "locked"),
    ]
    assert list(log["status"][0]) == ["from", "to", "samples", "code", "name"]
    assert (log["samples"]["count"], log["samples"]["rate_hz"], log["samples"]["gaps"]) == (2300, 100.0, 0)
    accuracy = log["accuracy_m"]
    assert accuracy["best"] <= accuracy["median"] <= accuracy["worst"]
    assert accuracy["worst"] == pytest.approx(0.02, rel=0.02)  # Whole millimetres north and east.


def test_json_tells_the_hours_that_lie_between_two_logs(drive: Path, wheelprint: Command) -> None:
    answer = wheelprint("inspect", drive)
    assert answer.content["overlap"] == [
        {
            "file": str(drive / "can.log"), "holds": "can", "and_file": str(drive / "nav.ncom"), "and_holds": "nav",
            "common_s": 0.0, "between_s": 7177.01, "time_zone_s": -7200.0,
        }
    ]  # fmt: skip
    assert log_of(answer, "can.log")["doubt"] == (
        f"it has nothing in common with {drive}/nav.ncom, but 2 hours later it would: the stamps of one of them may be "
        "local time"
    )


def test_the_databases_are_those_of_the_project_file_here(
    drive: Path, wheelprint: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    (drive / "wheelprint.toml").write_text('[vehicle]\nwheelbase = 2.8\n[can]\ndatabase = ["car.dbc"]\n')
    monkeypatch.chdir(drive)
    assert log_of(wheelprint("inspect", "can.log"), "can.log")["messages"][0]["name"] == "STEER"


def test_an_mcap_file_and_a_folder_of_images(tmp_path: Path, wheelprint: Command) -> None:
    output = BytesIO()
    writer = Writer(output)
    writer.start()
    schema = {
        name: writer.register_schema(name, "json", b"{}") for name in ("can.Frame", "Pose", "foxglove.CompressedImage")
    }
    topic = {name: writer.register_channel(f"/{name}", "json", number) for name, number in schema.items()}
    for n in range(30):
        time = START + n * SECOND // 10
        writer.add_message(topic["can.Frame"], time, json.dumps({"id": 1, "data": [n]}).encode(), time)
        writer.add_message(topic["Pose"], time, b"{}", time)
        if n < 10 or n >= 20:
            writer.add_message(topic["foxglove.CompressedImage"], time, b"{}", time)
    writer.finish()  # type: ignore[no-untyped-call]
    (tmp_path / "drive.mcap").write_bytes(output.getvalue())
    (tmp_path / "front").mkdir()
    for n in range(12):
        (tmp_path / "front" / f"{START // SECOND + n}.jpg").write_bytes(b"")

    answer = wheelprint("inspect", tmp_path)
    assert answer.status == 0
    holds = {(Path(log["path"]).name, log["holds"]): log for log in answer.content["logs"]}
    assert list(holds) == [("drive.mcap", "can"), ("drive.mcap", "camera"), ("front", "camera")]
    image = holds["drive.mcap", "camera"]["cameras"]["/foxglove.CompressedImage"]
    assert (image["count"], image["rate_hz"], image["gaps"], image["longest_interval_s"]) == (20, 10.0, 1, 1.1)
    assert holds["front", "camera"]["cameras"]["front"]["count"] == 12
    topics = answer.content["topics"][str(tmp_path / "drive.mcap")]
    assert [(found["topic"], found["schema"], found["count"], found["read_as"]) for found in topics] == [
        ("/can.Frame", "can.Frame", 30, "can"),
        ("/Pose", "Pose", 30, None),
        ("/foxglove.CompressedImage", "foxglove.CompressedImage", 20, "camera"),
    ]


def shown(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> list[str]:
    """Return what a person sees of it: 100 columns, without blanks at the ends of lines."""
    monkeypatch.setattr("wheelprint.output.WIDTH_OF_FILES", 100)
    result = CliRunner().invoke(app, ["inspect", *map(str, arguments)], catch_exceptions=False)
    return [line.rstrip() for line in result.stdout.splitlines()]


def test_what_a_person_sees(drive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = shown(monkeypatch, drive / "can.log", drive / "nav.ncom", "--database", drive / "car.dbc")
    assert max(map(len, lines)) <= 100
    said = [" ".join(line.split()) for line in lines]
    for line in (
        "can.log: 2,020 data frames, 2 messages of which the database knows 1",
        "can0 123 STEER 2000 100 1 3.01 10 2, database 8",
        "can0 18FEF100x unknown 20 1 1 4 9 1–8",
        "nav.ncom: 2,300 samples at 100 Hz; accuracy 0.02 m",
        "2023-11-15 00:13:23.000 00:13:29.990 6.99 700 4 locked",
        "can.log more than 1 s after it 1 3.01 s 2023-11-14 22:13:29.990",
    ):
        assert line in said
    timeline = said.index("When, by the logs' own stamps, and the gap to the log of that kind before") + 4
    assert said[timeline : timeline + 7] == [
        "2023-11-14 22:13:20 22:13:42",
        f"can.log can {'━' * 54} 22.99",
        "— 1 h 59 min later —",
        "2023-11-15 00:13:20 00:13:42",
        f"nav.ncom nav {'━' * 54} 22.99",
        "",
        "What does not fit",
    ]


def test_logs_that_overlap_are_drawn_on_one_scale(drive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (drive / "can.log").read_text()
    for name, shift in (("late.log", 11.5), ("after.log", 40.0)):
        moved = [line.replace("can0", "can1") for line in text.splitlines(keepends=True) if "x" not in line]
        times = [float(line[1 : line.index(")")]) + shift for line in moved]
        rest = [line[line.index(")") :] for line in moved]
        (drive / name).write_text("".join(f"({time:.6f}{end}" for time, end in zip(times, rest, strict=True)))
    lines = shown(monkeypatch, drive / "can.log", drive / "late.log", drive / "after.log")
    bars = {line.split()[0]: line for line in lines if "━" in line and "can " in line}
    assert bars["can.log"].split() == ["can.log", "can", "━" * 20 + "·" * 33, "22.99"]
    assert bars["late.log"].split()[3:] == ["22.99"]
    assert bars["after.log"].split()[3:] == ["22.99", "5.51"]
