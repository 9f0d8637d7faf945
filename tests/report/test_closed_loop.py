"""The section on closed loops: its tables, what is pooled, its figures, and what it says before anything was driven."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pytest

from wheelprint.report import closed_loop
from wheelprint.report.blocks import Gallery, Note, Section, Table
from wheelprint.report.closed_loop import closed_loop_blocks, drives
from wheelprint.report.page import render
from wheelprint.schemas.project import Project

HOSTILE = '<script>alert("x")<!--'


def row(path: str, law: str, control: str, error: float | None, **more: Any) -> dict[str, Any]:
    return {
        "driver": HOSTILE, "path": path, "offset": 0.0, "law": law, "control": control, "tracking_rms": 0.3,
        "tracking_95": 0.6, "tracking_max": 1.0, "steering_rate_rms": 20.0, "steering_change_rms": 100.0,
        "steering_error": error, "lookahead_error": error, "taken_over": 0.25, "distance": 100.0, "seconds": 10.0,
        **more,
    }  # fmt: skip


def cell(rows: list[dict[str, Any]]) -> dict[str, Any]:
    line = {
        "distance": [0.0, 1.0],
        "deviation": [0.0, None],
        "steering_wheel_angle": [1.0, 2.0],
        "lookahead": [5.0, 6.0],
    }
    own = [{"law": r["law"], "control": r["control"], **line} for r in rows]
    for drive in own[1:]:
        drive |= {"x": [0.0, 1.0], "y": [0.0, 0.1]}
    return {"rows": rows, "drives": own, "track": {"distance": [0.0, 1.0], "x": [0.0, 1.0], "y": [0.0, 0.0]}}


@pytest.fixture
def cells(monkeypatch: pytest.MonkeyPatch) -> Mapping[str, Any]:
    """Two recordings of one driver, of whom the second is three times as long, and the test track twice."""
    made = {}
    for number, seconds in ((1, 10.0), (2, 30.0)):
        path = f"{HOSTILE}/drive {number}"
        made[path] = cell([
            row(path, "driver", "", None, seconds=seconds),
            row(path, "general", "pursuit", 2.0, seconds=seconds),
            row(path, "velocity", "pursuit", number, seconds=seconds, tracking_rms=number, tracking_max=4.0),
            row(path, "velocity", "combined", 0.5, seconds=seconds),
        ])  # fmt: skip
    made["track"] = cell([row("test-track", "general", "pursuit", None)])
    made["track 3"] = cell([row("test-track", "general", "pursuit", None, offset=-3.0)])
    monkeypatch.setattr(closed_loop, "current_cells", lambda _: made)
    return made


@pytest.mark.usefixtures("cells")
def test_tables_pool_a_drivers_recordings_by_time(bare_project: Project) -> None:
    note, on_track, own, gallery = closed_loop_blocks(bare_project)
    assert isinstance(note, Note)
    assert isinstance(on_track, Table)
    assert isinstance(own, Table)
    assert [line[1].text for line in on_track.rows] == ["test track", "test track, begun −3 m to the left"]
    assert len(on_track.columns) == len(on_track.rows[0]) == 8
    assert [line[2].text for line in own.rows] == ["driver", "general", "velocity", "velocity, combined"]
    velocity = [one.text for one in own.rows[2]]
    assert velocity[:2] == [HOSTILE, "own"]
    assert velocity[3:5] == [f"{math.sqrt((10 * 1.0 + 30 * 4.0) / 40):.2f}", "4.00"]
    assert velocity[8:] == [f"{(10 * 1.0 + 30 * 2.0) / 40:.2f}", "1.75"]
    # The nearest of the laws alone stands out; the driver is not compared with itself.
    assert [line[8].mark for line in own.rows] == ["", "", "best", ""]
    assert own.rows[0][8].text == "–"
    assert [line[7].text for line in own.rows] == ["–", "–", "–", "25.0"]
    assert isinstance(gallery, Gallery)
    assert len(gallery.figures) == 2


def test_figures_show_every_drive_and_names_stay_text(cells: Mapping[str, Any], bare_project: Project) -> None:
    first = next(iter(cells.values()))
    figure = drives(first)
    named = [trace.name for trace in figure.data if trace.showlegend is not False]
    assert named == ["path", "driver", "general", "velocity", "velocity, combined"]
    # The driver was not drawn on the map here, the others are; each has three panels beside it.
    assert len(figure.data) == 1 + 3 + 4 * 3
    assert figure.layout.yaxis.scaleanchor == "x"
    page = render("car", [Section("closed-loop", "Closed loop", closed_loop_blocks(bare_project))])
    assert HOSTILE not in page


def test_before_anything_was_driven(bare_project: Project) -> None:
    assert closed_loop_blocks(bare_project) == [
        Note("Nothing was driven in closed loop with the models as they are now.", "wheelprint track")
    ]
