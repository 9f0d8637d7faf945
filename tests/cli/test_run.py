"""From raw logs to the report with one command, on two simulated drivers of whom one hardly drove."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from wheelprint import Project
from wheelprint.modeling.simulation.campaign import draw_campaign, simulate
from wheelprint.schemas.tables import EVENT_COLUMNS, LOOKAHEAD_COLUMNS, MOTION_PRIMITIVE_COLUMNS, TRACK_COLUMNS

Command = Callable[..., Any]
SETTINGS = """
[dataset]
folds = 4
[models]
minimum_minutes = 2
lookahead = { components = [3], starts = 1 }
motion_primitives = { path_types = [1], components = [1], future_steps = 10 }
"""


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project after `wheelprint run`; what the run said is in said.json."""
    from typer.testing import CliRunner

    from wheelprint.cli import app

    folder = tmp_path_factory.mktemp("ran")
    campaign = draw_campaign(seed=5, drivers=2, recordings=1, minutes=4.0)
    long, short = campaign.trips
    simulate(folder, replace(campaign, trips=(long, replace(short, minutes=1.5, emergencies=(), nav_gaps=()))))
    with (folder / "wheelprint.toml").open("a", encoding="utf-8") as file:
        file.write(SETTINGS)
    result = CliRunner().invoke(app, ["run", "--project", str(folder), "--workers", "1", "--json"])
    (folder / "said.json").write_text(json.dumps({"status": result.exit_code, **json.loads(result.stdout)}))
    return folder


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_a_driver_with_too_little_is_said_and_the_other_goes_through(ran: Path) -> None:
    said = json.loads((ran / "said.json").read_text())
    assert said["status"] == 3
    problems = [f"{p['path']}: {p['where']}: {p['reason']}" for p in said["problems"]]
    assert len(problems) == 1
    assert problems[0].startswith(
        f"{ran}/wheelprint.toml: models.minimum_minutes: driver 'driver02' is not modelled: 1."
    )
    assert problems[0].endswith(
        "minutes of ordinary driving were found, and 2 are needed; add recordings, decide about proposed events "
        "(`wheelprint review`), or lower models.minimum_minutes"
    )


def test_the_manifest_and_the_report_know_it_too(ran: Path) -> None:
    (problem,) = Project(ran).manifest["stages"]["train"]["problems"]
    assert "driver 'driver02' is not modelled" in problem["reason"]
    assert "driver &#39;driver02&#39; is not modelled" in (ran / "report" / "index.html").read_text(encoding="utf-8")


def test_every_file_of_the_design_is_there(ran: Path) -> None:
    one = "driver=driver01/recording=drive01"
    for name in (
        "manifest.json", "events.csv", f"signals/{one}/can.log.STEER.parquet", f"synced/{one}/part-0.parquet",
        f"dataset/{one}/part-0.parquet", "results/lookahead.csv", "results/motion_primitives.csv", "results/track.csv",
        "report/index.html",
    ):  # fmt: skip
        assert (ran / name).is_file(), name
    assert {folder.name for folder in (ran / "models").iterdir()} == {
        "lookahead_general",
        "lookahead_velocity",
        "motion_primitives",
    }
    assert not list(ran.rglob("*.pkl"))
    assert not list(ran.rglob(".draft-*"))


def test_tables_have_the_columns_that_other_programs_read(ran: Path) -> None:
    lookahead, primitives = rows(ran / "results" / "lookahead.csv"), rows(ran / "results" / "motion_primitives.csv")
    assert tuple(lookahead[0]) == LOOKAHEAD_COLUMNS
    assert tuple(primitives[0]) == MOTION_PRIMITIVE_COLUMNS
    assert tuple(rows(ran / "events.csv")[0]) == EVENT_COLUMNS
    assert {row["model"] for row in lookahead} == {"general", "velocity", "persistence", "ridge"}
    assert {row["model"] for row in primitives} == {
        "persistence", "ridge", "kinematic", "ridge_curvature", "curvature_mixture",
    }  # fmt: skip
    assert {(row["driver"], row["fold"]) for row in primitives} == {("driver01", str(fold)) for fold in range(4)}
    assert {row["split"] for row in lookahead} == {"train", "test"}


def test_the_simulated_truth_is_found(ran: Path) -> None:
    truth = json.loads((ran / "truth" / "campaign.json").read_text(encoding="utf-8"))
    manifest = Project(ran).manifest
    for key, entry in truth["recordings"].items():
        clock = manifest["recordings"][key]["clock"]
        assert clock["applied"]
        assert clock["offset_s"] == pytest.approx(entry["clock"]["offset_s"], abs=0.010)
    calibration = manifest["calibration"]
    assert calibration["steering_ratio"] == pytest.approx(truth["car"]["steering_ratio"], rel=0.02)
    assert calibration["steering_offset_deg"] == pytest.approx(truth["car"]["steering_offset"], abs=0.2)
    events = rows(ran / "events.csv")
    for emergency in truth["recordings"]["driver01/drive01"]["emergencies"]:
        assert any(
            event["start"] < emergency["stop"] and emergency["start"] < event["stop"]
            for event in events
            if event["kind"] != "standstill"
        )


def test_nothing_is_done_again(ran: Path, tmp_path: Path, wheelprint: Command) -> None:
    project = tmp_path / "project"
    shutil.copytree(ran, project, copy_function=shutil.copy2)
    again = wheelprint("run", "--project", project, "--workers", "1")
    assert again.status == 3
    assert all(not stage["done"] and not stage["failed"] for stage in again.content["stages"].values())

    events = rows(project / "events.csv")
    with (project / "events.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, EVENT_COLUMNS)
        table.writeheader()
        table.writerows({**event, "decision": "normal", "decided_by": "test"} for event in events)
    decided = wheelprint("build", "--project", project, "--workers", "1")
    assert decided.content["stages"]["build"]["done"]
    before, after = (Project(folder).manifest["dataset"]["driver01"]["driven_s"] for folder in (ran, project))
    assert after > before


def test_track(ran: Path, tmp_path: Path, wheelprint: Command) -> None:
    project = tmp_path / "project"
    shutil.copytree(ran, project, copy_function=shutil.copy2)
    before = rows(project / "results" / "track.csv")
    assert tuple(before[0]) == TRACK_COLUMNS
    assert {row["path"] for row in before} == {"test-track", "driver01/drive01"}
    off = wheelprint("track", "--project", project, "--driver", "driver01", "--path", "test-track", "--offset", "2")
    assert off.status == 0
    assert off.content["stages"]["track"]["done"] == ["driver01/test-track/+2 m"]
    after = rows(project / "results" / "track.csv")
    assert [row for row in after if row["offset"] == "0.0"] == before
    assert {row["path"] for row in after if row["offset"] == "2.0"} == {"test-track"}
    refused = wheelprint("track", "--project", project, "--driver", "driver02")
    assert refused.status == 1
    assert refused.problems == [
        f"{project}: driver02: no model of the lookahead distance was trained; there are those of driver01"
    ]


def test_predict_and_export(ran: Path, tmp_path: Path, wheelprint: Command) -> None:
    project = tmp_path / "project"
    shutil.copytree(ran, project, copy_function=shutil.copy2)
    assert wheelprint("predict", "--project", project, "--driver", "driver01").status == 0
    assert list((project / "predictions").rglob("*.parquet"))
    for form, count in (("csv", 2), ("json", 3), ("mcap", 2)):
        answer = wheelprint("export", "--project", project, "--to", form, "--out", tmp_path / form)
        assert answer.status == 0
        assert len(answer.content["tables"]["Exported"]) == count
        assert len(list((tmp_path / form).iterdir())) == count
    answer = wheelprint("export", "--project", project, "--to", "c", "--out", tmp_path / "c", "--driver", "driver01")
    assert answer.status == 0
    assert [path.name for path in sorted((tmp_path / "c").iterdir())] == [
        "lookahead_general.driver01.c.json", "lookahead_general.driver01.h",
        "lookahead_velocity.driver01.c.json", "lookahead_velocity.driver01.h",
        "motion_primitives.driver01.all.h", "motion_primitives.driver01.c.json",
    ]  # fmt: skip
    # The other driver's recording is new to this model, which comes from another project.
    new = wheelprint("predict", "--project", project, "--driver", "driver01", "--models", ran, "--recording",
                     "driver02/drive01")  # fmt: skip
    assert new.status == 0
    assert (project / "predictions" / "driver01" / "driver02.drive01.parquet").is_file()
    shutil.rmtree(project / "models")
    assert wheelprint("predict", "--project", project, "--driver", "driver01", "--models", ran).status == 0

    unknown = wheelprint("predict", "--project", project, "--driver", "nobody")
    assert unknown.status == 1
    assert "driver 'nobody' has no motion primitives; trained are those of driver01" in unknown.problems[0]
    assert wheelprint("export", "--project", project, "--to", "xls").problems == [
        "--to: xls: no such form; choose one of csv, json, mcap, onnx, c"
    ]
