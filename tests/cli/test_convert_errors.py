"""Each thing that can be wrong with a project's input is one clear message; what is right still goes through."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from wheelprint.schemas.project import Project

Command = Callable[..., Any]
ONE, TWO = "driver01/drive01", "driver02/drive01"


def edit(project: Path, old: str, new: str) -> None:
    path = project / "wheelprint.toml"
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")


def synced_rows(project: Path) -> dict[str, int]:
    table = Project(project).synced().to_pandas()
    return {f"{driver}/{name}": len(rows) for (driver, name), rows in table.groupby(["driver", "recording"])}


def test_all_is_well(project: Path, wheelprint: Command) -> None:
    answer = wheelprint("convert", "--project", project, "--workers", "1")
    assert (answer.status, answer.problems) == (0, [])
    rows = synced_rows(project)
    assert set(rows) == {ONE, TWO}
    assert all(1190 <= n <= 1220 for n in rows.values())

    again = wheelprint("convert", "--project", project, "--workers", "1")
    stage = again.content["stages"]["convert"]
    assert stage.pop("seconds") > 0
    assert stage == {"done": [], "current": [ONE, TWO], "failed": []}


def test_a_missing_navigation_log(project: Path, wheelprint: Command) -> None:
    (project / "raw" / ONE / "nav.ncom").unlink()
    answer = wheelprint("convert", "--project", project, "--workers", "1")
    assert answer.status == 3
    assert answer.problems == [
        (
            f"{project}/raw/{ONE}: : no navigation with a valid position; without it there is no path, and no dataset, "
            "from this recording. The bus has speed and yaw rate: nav.dead_reckoning = true makes a path of them, "
            "which drifts"
        )
    ]
    assert TWO in synced_rows(project)


def test_a_path_from_the_bus(project: Path, wheelprint: Command) -> None:
    (project / "raw" / ONE / "nav.ncom").unlink()
    with (project / "wheelprint.toml").open("a", encoding="utf-8") as settings:
        settings.write("\n[nav]\ndead_reckoning = true\n")
    assert wheelprint("convert", "--project", project, "--workers", "1").status == 0
    facts = Project(project).manifest["recordings"][ONE]["path_from_bus"]
    assert facts["source"] == "bus: speed and yaw rate integrated"
    assert Project(project).manifest["recordings"][TWO]["path_from_bus"] is None
    driver, name = ONE.split("/")
    synced = Project(project).synced(driver).to_pandas()
    path = synced[(synced["recording"] == name) & synced["x"].notna()]
    truth = pq.read_table(project / "truth" / driver / f"{name}.parquet").to_pandas()
    driven = sum(np.hypot(np.diff(run["x"]), np.diff(run["y"])).sum() for _, run in path.groupby("run"))
    assert driven == pytest.approx(np.hypot(np.diff(truth["x"]), np.diff(truth["y"])).sum(), rel=0.02)


def test_a_link_to_a_file_that_is_gone(project: Path, wheelprint: Command) -> None:
    (project / "raw" / ONE / "more.log").symlink_to(project / "gone.log")
    answer = wheelprint("convert", "--project", project, "--workers", "1")
    assert answer.status == 3
    assert answer.problems == [
        f"{project}/raw/{ONE}/more.log: : no such file; check the path, or whether the disk is mounted"
    ]
    assert set(synced_rows(project)) == {ONE, TWO}


def test_a_missing_file_among_those_to_inspect(project: Path, wheelprint: Command) -> None:
    answer = wheelprint("inspect", project / "raw" / ONE / "nav.ncom", project / "gone.log")
    assert answer.status == 3
    assert answer.problems == [f"{project}/gone.log: : no such file; check the path, or whether the disk is mounted"]
    assert wheelprint("inspect", project / "gone.log").status == 1


def test_a_signal_that_the_database_does_not_have(project: Path, wheelprint: Command) -> None:
    edit(project, 'STEER.ANGLE"', 'STEER.ANGEL"')
    answer = wheelprint("convert", "--project", project, "--workers", "1")
    assert answer.status == 3
    assert answer.problems == [
        (
            f"{project}/wheelprint.toml: can.signals.steering_wheel_angle: message STEER (0x11F) has no signal ANGEL; "
            "did you mean ANGLE?"
        )
    ]
    table = Project(project).synced()
    assert table["steering_wheel_angle"].null_count == len(table)
    assert table["speed"].null_count < 0.1 * len(table)


def test_a_signal_that_is_positive_to_the_right(project: Path, wheelprint: Command) -> None:
    edit(project, 'yaw_rate = "INERTIA.YAW_RATE"', 'yaw_rate = { signal = "INERTIA.YAW_RATE", sign = -1 }')
    answer = wheelprint("convert", "--project", project, "--workers", "1")
    assert answer.status == 3
    assert len(answer.problems) == 2
    for problem, key in zip(answer.problems, (ONE, TWO), strict=True):
        assert problem.startswith(
            f"{project}/raw/{key}: can.signals.yaw_rate: yaw_rate goes against navigation's yaw rate (correlation -"
        )
        assert problem.endswith('): its sign is wrong. Write yaw_rate = { signal = "INERTIA.YAW_RATE", sign = 1 }')


def test_a_unit_that_is_not_known(project: Path, wheelprint: Command) -> None:
    shipped = Path(__file__).resolve().parents[2] / "schemas" / "databases" / "byd_tang.dbc"
    text = shipped.read_text(encoding="utf-8")
    assert '"km/h"' in text
    (project / "car.dbc").write_text(text.replace('"km/h"', '"furlong/h"'), encoding="utf-8")
    edit(project, '"byd_tang"', '"car.dbc"')
    answer = wheelprint("convert", "--project", project, "--workers", "1")
    assert answer.status == 3
    assert len(answer.problems) == 1
    assert answer.problems[0].startswith(
        f"{project}/wheelprint.toml: can.signals.speed: the database gives MOTION.Speed the unit 'furlong/h', which is "
        "not known as a unit of m/s ("
    )
    assert answer.problems[0].endswith('say what to multiply it by: speed = { signal = "MOTION.Speed", scale = … }')
    assert set(synced_rows(project)) == {ONE, TWO}


def test_a_database_that_does_not_load_and_one_that_is_missing(project: Path, wheelprint: Command) -> None:
    (project / "broken.dbc").write_text('VERSION ""\nBO_ 1 A: 8 X\n SG_ B : oops\n', encoding="utf-8")
    edit(project, '"byd_tang"', '"byd_tang", "broken.dbc", "gone.dbc"')
    answer = wheelprint("convert", "--project", project, "--workers", "1")
    assert answer.status == 3
    assert [problem.split(": ")[0] for problem in answer.problems] == [
        f"{project}/broken.dbc",
        f"{project}/gone.dbc",
    ]
    assert "line 3" in answer.problems[0]
    assert "no such file" in answer.problems[1]
    assert set(synced_rows(project)) == {ONE, TWO}


def test_the_only_database_does_not_load(project: Path, wheelprint: Command) -> None:
    edit(project, '"byd_tang"', '"gone.dbc"')
    answer = wheelprint("convert", "--project", project, "--workers", "1")
    assert answer.status == 3
    assert "gone.dbc" in answer.problems[0]
    table = Project(project).synced()
    assert table["nav_speed"].null_count < 0.05 * len(table)


def test_logs_of_two_drives_mixed_up(project: Path, wheelprint: Command) -> None:
    shutil.copy(project / "raw" / TWO / "nav.ncom", project / "raw" / ONE / "nav.ncom")
    answer = wheelprint("convert", "--project", project, "--workers", "1")
    assert answer.status == 3
    assert len(answer.problems) == 1
    assert answer.problems[0].startswith(f"{project}/raw/{ONE}: : the CAN log (2024-05-13T01:00:")
    assert "have no time in common; the logs of two drives may have been mixed up" in answer.problems[0]
    assert set(synced_rows(project)) == {TWO}


def test_a_frame_from_1970(project: Path, wheelprint: Command) -> None:
    path = project / "raw" / ONE / "can.log"
    path.write_bytes(b"(0000000001.000000) can0 121#0000\n" + path.read_bytes())
    answer = wheelprint("convert", "--project", project, "--workers", "1")
    assert answer.status == 3
    assert len(answer.problems) == 1
    assert answer.problems[0].startswith(
        f"{project}/raw/{ONE}: : the CAN log goes from 1970-01-01T00:00:01.000Z to 2024-05-13T01:0"
    )
    assert answer.problems[0].endswith("remove those records, or give each recording its folder")
    assert set(synced_rows(project)) == {TWO}


def test_a_recording_that_holds_nothing(project: Path, wheelprint: Command) -> None:
    (project / "raw" / "driver01" / "empty").mkdir()
    answer = wheelprint("convert", "--project", project, "--workers", "1")
    assert answer.status == 3
    assert answer.problems == [
        f"{project}/raw/driver01/empty: : it holds no log. A recording is a folder with a CAN log and a navigation log"
    ]
    assert set(synced_rows(project)) == {ONE, TWO}


def test_damaged_lines_are_counted_and_the_rest_is_converted(project: Path, wheelprint: Command) -> None:
    path = project / "raw" / ONE / "can.log"
    lines = path.read_bytes().splitlines(keepends=True)
    lines[10] = b"(1715562000.1) can0 123#001\n"
    path.write_bytes(b"".join(lines))
    answer = wheelprint("convert", "--project", project, "--workers", "1")
    assert answer.status == 3
    assert len(answer.problems) == 1
    assert answer.problems[0].startswith(f"{path}: line 11: 1 of {len(lines)} records rejected: ")
    can, nav = Project(project).manifest["recordings"][ONE]["inputs"]
    assert (can["accepted"], can["rejected"]) == (len(lines) - 1, 1)
    assert can["accepted"] == can["decoded"] + can["unknown"] + can["remote"] + can["errors"]
    assert nav["accepted"] * 72 == (project / "raw" / ONE / "nav.ncom").stat().st_size


@pytest.mark.parametrize("command", ["convert", "build", "train", "evaluate", "report", "run"])
def test_a_folder_that_is_no_project(command: str, tmp_path: Path, wheelprint: Command) -> None:
    answer = wheelprint(command, "--project", tmp_path)
    assert answer.status == 1
    assert answer.problems == [
        (
            f"{tmp_path}/wheelprint.toml: : no such file. A project is a folder with this file; "
            "`wheelprint init` writes one"
        )
    ]


def test_raw_is_never_written_to(project: Path, wheelprint: Command) -> None:
    before = {path: path.read_bytes() for path in (project / "raw").rglob("*") if path.is_file()}
    wheelprint("convert", "--project", project, "--workers", "1")
    assert {path: path.read_bytes() for path in (project / "raw").rglob("*") if path.is_file()} == before
