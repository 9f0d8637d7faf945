"""The data cards as the report shows them."""

from __future__ import annotations

from typing import Any

from wheelprint.report.data_cards import driving_table, folds_table, road_table

CARD: dict[str, Any] = {
    "driver": "anna",
    "driven_s": 3600.0,
    "distance_m": 50_000.0,
    "recordings": [{"recording": name} for name in "abcd"],
    "excluded": [
        {"kind": "gap", "seconds": 100.0, "share": 0.025, "undecided_s": 0.0},
        {"kind": "swerve", "seconds": 300.0, "share": 0.075, "undecided_s": 40.0},
    ],
    "segments": {"by_side": {"left": {"segments": 1200, "seconds": 900.0}, "neutral": {"segments": 7, "seconds": 1.0}}},
    "folds": {"by": "block", "samples": [17_999, 18_001], "recordings": [["a", "b", "c", "d"], ["d"]]},
    "road": {
        "speed_m_s": [
            {"from": 0.0, "to": 5.0, "seconds": 360.0, "distance_m": 1500.0},
            {"from": 5.0, "to": 10.0, "seconds": 0.0, "distance_m": 0.0},
            {"from": 30.0, "to": None, "seconds": 3240.0, "distance_m": 48_500.0},
        ],
        "curvature_1_m": [
            {"from": 0.0, "to": 0.001, "seconds": 1800.0, "distance_m": 20_000.0},
            {"from": 0.001, "to": 0.005, "seconds": 1700.0, "distance_m": 29_000.0},
            {"from": 0.05, "to": None, "seconds": 99.0, "distance_m": 990.0},
            {"from": None, "to": None, "seconds": 1.0, "distance_m": 10.0},
        ],
        "situation": [
            {"situation": None, "seconds": 3000.0, "distance_m": 30_000.0},
            {"situation": "highway", "seconds": 600.0, "distance_m": 20_000.0},
        ],
    },
}


def rows(table: Any) -> list[list[str]]:
    return [[cell.text.strip() for cell in row] for row in table.rows]


def test_a_driver_in_one_line() -> None:
    table = driving_table([CARD])
    assert rows(table) == [
        ["anna", "4", "1:00:00", "50.0", "10.0", "40.0", "1,200", "7", "0", "2 by block", "17,999 to 18,001"]
    ]
    assert table.rows[0][5].mark == "alert"


def test_the_mix_of_roads_in_the_papers_units() -> None:
    assert rows(road_table([CARD])) == [
        ["anna", "0 to 18 km/h", "0:06:00", "10.0", "1.50"],
        ["", "from 108 km/h", "0:54:00", "90.0", "48.50"],
        ["", "straight: radius over 1000 m", "0:30:00", "50.0", "20.00"],
        ["", "radius 200 to 1000 m", "0:28:20", "47.2", "29.00"],
        ["", "radius up to 20 m", "0:01:39", "2.8", "0.99"],
        ["", "curvature unknown: first of a run", "0:00:01", "0.0", "0.01"],
        ["", "no situation", "0:50:00", "83.3", "30.00"],
        ["", "highway", "0:10:00", "16.7", "20.00"],
    ]


def test_every_fold_with_its_recordings() -> None:
    assert rows(folds_table([CARD])) == [
        ["anna", "0", "17,999", "50.0", "a, b, c, …"],
        ["", "1", "18,001", "50.0", "d"],
    ]
