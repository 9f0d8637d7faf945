"""What the raw logs gave, as the report says it."""

from __future__ import annotations

from typing import Any

import pytest

from wheelprint.report.blocks import Table
from wheelprint.report.sources import cameras_table, frames_table, repairs_table, stamps_table

QUIET = {
    "backwards": {"count": 0, "worst_s": 0.0, "at": None},
    "repeated": {"count": 3, "most_on_one_stamp": 2, "at": "2023-11-14T22:13:20.000Z"},
    "gaps": {"count": 0, "longest_s": 0.0, "at": None},
}
CAN = {
    "path": "can.log", "kind": "can", "accepted": 1010, "rejected": 2, "decoded": 700, "unknown": 300, "remote": 7,
    "errors": 3, "unknown_ids": {"0x100": 200, "0x101": 100}, "stamps": QUIET,
}  # fmt: skip
NAV = {"path": "nav.ncom", "kind": "nav", "accepted": 50, "rejected": 0, "stamps": QUIET}


def manifest(*inputs: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"recordings": {"anna/ring": {"inputs": list(inputs), "outputs": [{"path": "x"}], **more}}}


def rows(table: Table | None) -> list[list[str]]:
    assert table is not None
    return [[cell.text for cell in row] for row in table.rows]


def marks(table: Table | None) -> list[str]:
    assert table is not None
    return [column.title for row in table.rows for column, cell in zip(table.columns, row, strict=True) if cell.mark]


def test_frames_in_are_the_sum_of_what_became_of_them() -> None:
    table = frames_table(manifest(CAN, NAV))
    assert rows(table) == [["anna/ring", "can.log", "1,012", "700", "300", "7", "3", "2", "2", "69.2"]]
    assert marks(table) == ["Rejected"]


def test_a_sum_that_does_not_hold_stands_out() -> None:
    assert marks(frames_table(manifest(CAN | {"accepted": 1011}))) == ["Frames in", "Rejected"]


def test_stamps_of_logs_that_go_back_or_leave_time_out() -> None:
    odd = QUIET | {
        "backwards": {"count": 1, "worst_s": 0.7, "at": "2023-11-14T22:13:50.100Z"},
        "gaps": {"count": 1200, "longest_s": 12.5, "at": "2023-11-14T22:14:00.000Z"},
    }
    table = stamps_table(manifest(CAN | {"stamps": odd}, NAV))
    assert rows(table) == [
        [
            "anna/ring",
            "can.log",
            "1",
            "0.700",
            "2023-11-14 22:13:50.100",
            "1,200",
            "12.50",
            "2023-11-14 22:14:00.000",
            "3",
        ]
    ]
    assert marks(table) == ["Go back"]


@pytest.mark.parametrize(("common", "alert"), [(59.8, []), (0.0, ["In common with the logs"]), (None, [])])
def test_cameras(common: float | None, alert: list[str]) -> None:
    frames = {"count": 600, "rate_hz": 10.0, "gaps": 1, "longest_interval_s": 1.234}
    clock = {} if common is None else {"common_s": common}
    camera = {"path": "front", "kind": "camera", "cameras": {"front": frames}, "clock": clock, "stamps": QUIET}
    table = cameras_table(manifest(CAN, camera))
    said = "–" if common is None else f"{common:.1f}"
    assert rows(table) == [["anna/ring", "front", "600", "10.00", "1", "1.23", said]]
    assert marks(table) == alert


def test_repairs_are_said_once() -> None:
    both = manifest(CAN, database_repairs=["a.dbc: line 3: A and B overlap; both are kept", "b.dbc: no length; 8"])
    both["recordings"]["bert/ring"] = both["recordings"]["anna/ring"]
    assert rows(repairs_table(both)) == [["a.dbc", "line 3: A and B overlap; both are kept"], ["b.dbc", "no length; 8"]]


def test_where_there_is_nothing_there_is_no_table() -> None:
    nothing = manifest(NAV)
    assert [make(nothing) for make in (frames_table, stamps_table, cameras_table, repairs_table)] == [None] * 4
