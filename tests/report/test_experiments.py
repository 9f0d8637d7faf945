"""The section on the papers' experiments: both sides of every table, figures, what is missing or damaged."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wheelprint.modeling.claims import weigh_claims
from wheelprint.modeling.experiments import table_i, table_ii
from wheelprint.report.blocks import Gallery, Note, Table
from wheelprint.report.experiments import experiment_blocks
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import Project

HOSTILE = '<script>alert("x")<!--'


def primitives() -> list[dict[str, Any]]:
    """Results at the points of the paper's Table II: as the paper's and, over all windows, twice as large."""
    rng = np.random.default_rng(0)
    rows = []
    for fold in range(4):
        for point in table_ii([]):
            for windows, factor in (("1-1-1", 1.0), ("all", 2.0)):
                figures = {
                    "mean_error": factor * point["paper_error"] * float(rng.uniform(0.99, 1.01)),
                    "mean_variance": factor * point["paper_variance"],
                    "coverage_68": 0.7,
                    "samples": 200,
                    "fell_back": 50 if point["path_types"] == 27 else 0,
                }
                names = ("path_types", "past_steps", "components")
                where = {"driver": HOSTILE, "windows": windows, "future_path": True, "fold": fold}
                rows.append({**where, **{name: point[name] for name in names}, **figures})
    return rows


def lookahead() -> list[dict[str, Any]]:
    rng = np.random.default_rng(1)
    return [
        {
            "driver": HOSTILE, "model": model, "components": components, "regressors": regressors, "fold": fold,
            "split": split, "repeats": 20, "mean_error": level * float(rng.uniform(0.9, 1.1)), "mean_error_sd": 0.1,
            "mean_sd": 4.0, "mean_sd_sd": 0.1, "samples": 100,
        }
        for fold in range(4)
        for split in ("train", "test")
        for model, regressors, level in (("general", None, 1.0), ("velocity", 3, 0.7))
        for components in (3, 12)
    ]  # fmt: skip


def write_rows(path: Path, rows: Sequence[Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)


def write_experiments(project: Project) -> Path:
    """Write what both experiments leave behind."""
    place = project.results_folder / "experiments"
    cluster = {
        "driver": HOSTILE, "label": 1, "duration_s": 7.5, "average_course_deviation_deg": 0.2,
        "maximum_course_deviation_deg": 0.4, "average_speed_m_s": 10.0,
    }  # fmt: skip
    write_rows(place / "table_1.csv", table_i([{"rows": [cluster]}]))
    write_rows(place / "table_2.csv", table_ii(primitives()))
    write_rows(place / "lookahead.csv", lookahead())
    findings = [*weigh_claims(primitives(), "MP", 4), *weigh_claims(lookahead(), "PP", 4)]
    (place / "claims.json").write_text(json.dumps([asdict(finding) for finding in findings]), encoding="utf-8")
    time = np.round(np.arange(6) / 10, 1).tolist()
    method = {"mean": [1.0] * 5, "sd": [0.5] * 5, "mean_error": 1.0, "mean_sd": 0.5}
    situation = {
        "driver": HOSTILE, "fold": 0, "situation": "a", "time_s": time, "course_deviation": time, "speed": time,
        "path_type": ["1-1-1"] * 6, "driven": time,
        "methods": {"proposed": method, "general": {**method, "mean_error": 3.5}},
    }  # fmt: skip
    (place / "figure_2.json").write_text(json.dumps([{"rows": [situation]}]), encoding="utf-8")
    names = ("time", "distance", "x", "y", "deviation", "road_wheel_angle", "lookahead", "lookahead_sd")
    drive = {
        "driver": HOSTILE, "components": 12, "mean_deviation_m": 0.25, "largest_deviation_m": 1.5, "mean_sd_m": 3.25,
        **{name: [0.0, 1.0] for name in names},
    }  # fmt: skip
    track = {
        "rows": [{**drive, "model": model} for model in ("general", "velocity")],
        "track": {"x": [0, 1], "y": [0, 1]},
    }
    (place / "figure_6_7.json").write_text(json.dumps([track]), encoding="utf-8")
    return place


def test_what_was_not_run_says_what_runs_it(bare_project: Project) -> None:
    assert experiment_blocks(bare_project) == [
        Note("MP's Table II was not run on these drivers yet.", "wheelprint evaluate --experiment motion-primitives"),
        Note("PP's Fig. 5 was not run on these drivers yet.", "wheelprint evaluate --experiment lookahead"),
    ]


def test_tables_hold_both_sides(bare_project: Project) -> None:
    write_experiments(bare_project)
    claims, table_1, table_2 = (block for block in experiment_blocks(bare_project) if isinstance(block, Table))
    cells = [[cell.text for cell in row] for row in table_2.rows]
    assert len(cells) == 14
    assert cells[3][:6] == ["2", "27", "−1", "6", "2.84", "42.61"]
    assert abs(float(cells[3][6]) - 2.84) < 0.03
    assert cells[3][8] == "25.0"
    assert abs(float(cells[3][9]) - 5.68) < 0.06
    assert cells[3][12:] == ["800", "4"]
    assert [[cell.text for cell in row] for row in table_1.rows][-1] == [HOSTILE, "1", "7.50", "0.200", "0.400", "36.0"]
    told = {(row[0].text, row[3].text): row[-1].text for row in claims.rows}
    claim = "the two-level structure lowers the error: 27 path types against 1"
    assert told[claim, "1-1-1"].startswith("holds: −1")
    assert {row[-1].mark for row in claims.rows} == {"best", "alert", ""}


def test_figures_say_both_sides(bare_project: Project) -> None:
    write_experiments(bare_project)
    galleries = [block for block in experiment_blocks(bare_project) if isinstance(block, Gallery)]
    captions = [figure.caption for gallery in galleries for figure in gallery.figures]
    assert len(captions) == 4
    assert (
        "lower than the general one's by 2.50°; in the paper's situations by 5.26°, 1.03°, 0.54°, 0.41°" in captions[0]
    )
    assert "general: 0.25 m from the track on average, 1.50 m at most" in captions[2]
    fig_5 = galleries[1].figures[0].figure
    (stars,) = (trace for trace in fig_5.data if trace.name == "paper, velocity-based: test" and trace.xaxis == "x")
    assert list(zip(stars.x, stars.y, strict=True)) == [(3, 1.0), (15, 0.66)]


def test_damaged_results_are_named(bare_project: Project) -> None:
    place = write_experiments(bare_project)
    (place / "claims.json").write_text("{", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        experiment_blocks(bare_project)
    assert str(caught.value) == (
        f"{place / 'claims.json'}: not JSON (Expecting property name enclosed in double quotes: line 1 column 2 "
        "(char 1)); run `wheelprint evaluate --experiment` again"
    )
