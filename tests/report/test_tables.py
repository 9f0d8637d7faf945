"""Tables from the manifest: counts, clocks, what was left out, clusters in the paper's units, provenance."""

from __future__ import annotations

import math
from typing import Any

import pytest

from wheelprint.report.blocks import Cell
from wheelprint.report.provenance import inputs_table, parameters_table, signals_table
from wheelprint.report.tables import (
    clock_table,
    clock_time,
    cluster_table,
    count,
    excluded_table,
    number,
    recordings_table,
    situations_table,
)
from wheelprint.schemas.config import Config, Sync, Vehicle


def rows(table: Any) -> list[list[str]]:
    return [[cell.text.strip() for cell in row] for row in table.rows]


@pytest.mark.parametrize(
    ("value", "digits", "shown"),
    [(None, 2, "–"), (math.nan, 2, "–"), (-1.005, 1, "−1.0"), (12345.678, 1, "12,345.7"), (0.0, 0, "0")],
)
def test_numbers_are_shown_with_a_true_minus_and_missing_ones_with_a_dash(
    value: float | None, digits: int, shown: str
) -> None:
    assert number(value, digits) == Cell(shown)


def test_counts_and_durations() -> None:
    assert count(1234567).text == "1,234,567"
    assert [clock_time(seconds) for seconds in (0, 59.6, 3599.6, 36_000)] == [
        "0:00:00",
        "0:01:00",
        "1:00:00",
        "10:00:00",
    ]


MANIFEST: dict[str, Any] = {
    "recordings": {
        "anna/ring": {
            "inputs": [
                {"path": "can.log", "format": "candump", "accepted": 1000, "rejected": 2, "truncated": True,
                 "sha256": "ab", "bytes": 5000},
                {"path": "nav.ncom", "format": "ncom", "accepted": 300, "rejected": 0, "truncated": False,
                 "sha256": "cd", "bytes": 21600},
            ],
            "clock": {"offset_s": -0.51239, "drift_ppm": 11.26, "residual_ms": 1.24, "standard_error_ms": None,
                      "correlation": 0.9987, "applied": False, "reason": "too short"},
            "signals": {"speed": {"message": "M", "signal": "V", "unit": "km/h", "factor": 1 / 3.6, "channel": "can1",
                                  "samples": 500, "out_of_range": 2}},
            "outputs": [
                {"path": "signals/x.parquet", "rows": 7},
                {"path": "synced/driver=anna/part-0.parquet", "rows": 650, "runs": 2, "rows_in_runs": 600},
            ],
        },
        "bert/lost": {"outputs": []},
    },
    "dataset": {
        "anna": {
            "outputs": [{"path": "dataset/x", "recording": "ring"}],
            "driven_s": 50.0,
            "excluded": {"gap": 5.0, "swerve": 10.0},
            "undecided": {"swerve": 4.0},
            "situations": {"highway": 30.0, "lane change": 5.0},
            "clusters": [
                {"label": 1, "share": 0.25, "duration_s": 8.29, "average_course_deviation_deg": 0.15,
                 "maximum_course_deviation_deg": 0.45, "average_speed_m_s": 33.45 / 3.6},
            ],
        }
    },
}  # fmt: skip


def test_records_in_are_accepted_plus_rejected_for_every_file_and_in_sum() -> None:
    table = recordings_table(MANIFEST, 0.1, trusted=False)
    assert rows(table) == [
        ["anna/ring", "can.log", "candump", "1,002", "1,000", "2", "yes", "650", "2", "0:01:00", "not aligned"],
        ["", "nav.ncom", "ncom", "300", "300", "0", "no", "", "", "", ""],
        ["", "sum", "", "1,302", "1,300", "2", "", "", "", "", ""],
    ]
    assert [cell.mark for cell in table.rows[0]] == ["", "", "", "", "", "alert", "alert", "", "", "", "alert"]


def test_a_clock_that_the_user_trusts_is_no_alarm() -> None:
    assert recordings_table(MANIFEST, 0.1, trusted=True).rows[0][-1] == Cell("trusted")
    assert clock_table(MANIFEST, trusted=True).rows[0][6] == Cell("no")
    assert clock_table(MANIFEST, trusted=False).rows[0][6] == Cell("no", "alert")


def test_the_clock_table() -> None:
    assert rows(clock_table(MANIFEST, trusted=False)) == [
        ["anna/ring", "−0.5124", "11.3", "1.2", "–", "0.999", "no", "too short"]
    ]


def test_what_was_left_out_adds_up_beside_what_was_synced() -> None:
    assert rows(excluded_table(MANIFEST, {"anna": 65.0})) == [
        ["anna", "in the dataset", "50.0", "76.9", "–"],
        ["", "left out: gap", "5.0", "7.7", "–"],
        ["", "left out: swerve", "10.0", "15.4", "4.0"],
        ["", "sum", "65.0", "100.0", "4.0"],
        ["", "synced", "65.0", "100.0", "–"],
    ]


def test_situations_add_up_to_the_dataset() -> None:
    assert rows(situations_table(MANIFEST)) == [
        ["anna", "highway", "30.0", "60.0"],
        ["", "lane change", "5.0", "10.0"],
        ["", "nothing says", "15.0", "30.0"],
    ]


def test_clusters_are_in_the_units_of_the_paper() -> None:
    table = cluster_table(MANIFEST)
    assert rows(table) == [
        ["anna", "1", "25.0", "8.29", "0.150", "0.450", "33.45"],
        ["MP, Table I", "1", "–", "8.29", "0.150", "0.450", "33.45"],
        ["MP, Table I", "2", "–", "0.24", "0.008", "0.010", "50.31"],
        ["MP, Table I", "3", "–", "1.15", "0.024", "0.050", "54.69"],
    ]
    assert [(c.title, c.unit) for c in table.columns[3:]] == [
        ("td", "s"), ("ave_cd", "°"), ("max_cd", "°"), ("ave_vel", "km/h"),
    ]  # fmt: skip


def test_inputs_have_their_hashes() -> None:
    assert rows(inputs_table(MANIFEST)) == [
        ["anna/ring", "can.log", "5,000", "ab"],
        ["anna/ring", "nav.ncom", "21,600", "cd"],
    ]


def test_signals_say_where_they_come_from_over_all_recordings() -> None:
    twice = {"recordings": {"a/1": MANIFEST["recordings"]["anna/ring"], "a/2": MANIFEST["recordings"]["anna/ring"]}}
    assert rows(signals_table(twice)) == [
        ["speed", "M.V", "can1", "km/h", "0.277777778", "2", "1,000", "4"],
    ]


def test_parameters_that_are_set_are_marked() -> None:
    config = Config(vehicle=Vehicle(wheelbase=2.82), sync=Sync(rate=20.0))
    shown = {key: (value, origin) for key, value, origin in rows(parameters_table(config))}
    assert shown["vehicle.wheelbase"] == ("2.82", "set in wheelprint.toml")
    assert shown["sync.rate"] == ("20.0", "set in wheelprint.toml")
    assert shown["sync.max_gap"] == ("0.5", "–")
    assert shown["models.motion_primitives.path_types"] == ("[1, 3, 27]", "–")
