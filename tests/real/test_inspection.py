"""`wheelprint inspect` over real recordings: every record counted, rates and statuses as they are known."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from wheelprint.cli import app


def inspect(*arguments: str | Path) -> list[dict[str, Any]]:
    result = CliRunner().invoke(app, ["inspect", *map(str, arguments), "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.stdout
    logs: list[dict[str, Any]] = json.loads(result.stdout)["logs"]
    return logs


def test_one_drive_of_can_and_navigation(shared_data: Path) -> None:
    can, nav = inspect(shared_data / "rav4" / "can.log", shared_data / "rav4" / "nav.ncom",
                       "--database", shared_data / "rav4" / "rav4.dbc")  # fmt: skip
    assert (can["accepted"], can["rejected"], can["doubt"], nav["doubt"]) == (135_468, 0, None, None)
    assert sum(message["count"] for message in can["messages"]) == 135_468
    named = {(m["channel"], m["name"]): m for m in can["messages"] if m["name"]}
    speed = named["can0", "SPEED"]
    assert (speed["count"], speed["gaps"], speed["bytes"]) == (2487, 0, [8, 8])
    assert speed["rate_hz"] == pytest.approx(41.45, abs=0.01)
    assert (named["can0", "VSC1F02"]["database_bytes"], named["can0", "VSC1F02"]["bytes"]) == (6, [8, 8])
    assert [(period["samples"], period["name"]) for period in nav["status"]] == [(1200, "locked")]
    assert nav["samples"]["rate_hz"] == pytest.approx(20.0, abs=0.05)


def test_a_folder_is_all_that_lies_in_it(shared_data: Path) -> None:
    logs = inspect(shared_data / "kitti")
    assert [(Path(log["path"]).name, log["format"], log["accepted"], log["rejected"]) for log in logs] == [
        ("timestamps.txt", "kitti", 108, 0),
        ("timestamps.txt", "kitti", 2762, 0),
    ]


def test_real_oxts(shared_data: Path) -> None:
    (log,) = inspect(shared_data / "oxts" / "NAVsdk_example2.ncom")
    assert (log["accepted"], log["rejected"], log["samples"]["rate_hz"]) == (9201, 0, 250.0)
    assert [period["code"] for period in log["status"]] == [4]
    assert log["accuracy_m"]["samples"] > 9000
