"""Any CSV or Parquet by the columns that the project file names."""

from __future__ import annotations

import csv
import gzip
import pickle
import random
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from wheelprint.ingest.account import Account
from wheelprint.ingest.mapped_table import BLOCK, MappedTable, mapped_table
from wheelprint.ingest.table_time import parse_times
from wheelprint.schemas.config import Nav, TimeColumn
from wheelprint.schemas.errors import InputError

START = 1_715_562_000_000_000_000  # 2024-05-13T01:00:00Z
GPS_START = 1_715_562_000 - 315_964_800 + 18
COLUMNS: dict[str, Any] = {
    "latitude": "Lat",
    "longitude": "Lon",
    "heading_clockwise": "Heading",
    "nav_speed": {"column": "Speed", "unit": "km/h"},
    "nav_yaw_rate": {"column": "Rate", "unit": "rad/s", "sign": -1},
    "altitude": {"column": "Height", "scale": 0.5},
}


def nav(columns: dict[str, Any] | None = None, **other: Any) -> Nav:
    content = {"files": "*.csv", "time": {"column": "Time", "format": "unix-s"}, "columns": columns or COLUMNS}
    return Nav.model_validate(content | other)


def read(path: Path, how: Nav) -> tuple[list[dict[str, Any]], Account]:
    account = Account()
    batches = list(MappedTable(path, how).batches(account))
    rows = [row for batch in batches for row in batch.to_pylist()]
    return [{name: value for name, value in row.items() if value is not None} for row in rows], account


def write(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.write_bytes(text.encode(encoding))
    return path


def test_units_axes_and_signs(tmp_path: Path) -> None:
    path = write(
        tmp_path / "a.csv",
        "Note,Time,Lat,Lon,Heading,Speed,Rate,Height\n"
        '"a, b",1715562000.1,48.0,11.0,90,36,0.1,1000\n'
        "x,1715562000.2,48.00001,11.0,180,-,NaN,\n",
    )
    rows, account = read(path, nav())
    assert account == Account(accepted=2)
    assert [row["time"].value for row in rows] == [START + 100_000_000, START + 200_000_000]
    first, second = rows
    assert first["heading"] == 0.0
    assert first["nav_speed"] == pytest.approx(10.0)
    assert first["nav_yaw_rate"] == pytest.approx(-np.degrees(0.1))
    assert (first["altitude"], first["x"], first["y"]) == (500.0, 0.0, 0.0)
    assert set(second) == {"time", "latitude", "longitude", "x", "y", "heading"}
    assert second["heading"] == -90.0
    assert second["y"] == pytest.approx(1.112, abs=0.001)


def test_velocity_and_accuracy_by_component_and_a_course_at_standstill(tmp_path: Path) -> None:
    path = write(
        tmp_path / "a.csv",
        "Time\tn\te\tsn\tse\tla\tlo\n1\t3\t4\t0.3\t0.4\t0\t0\n2\t0.1\t0\t0\t0\t1e-7\t0\n",
    )
    columns = {
        "velocity_north": "n", "velocity_east": "e", "position_accuracy_north": "sn", "position_accuracy_east": "se",
        "latitude": "la", "longitude": "lo",
    }  # fmt: skip
    rows, _ = read(path, nav(columns))
    assert rows[0]["nav_speed"] == 5.0
    assert rows[0]["course"] == pytest.approx(np.degrees(np.arctan2(3, 4)))
    assert rows[0]["position_accuracy"] == pytest.approx(0.5)
    # A unit without a fix tells the place where equator and meridian of Greenwich meet.
    assert "latitude" not in rows[0]
    assert rows[1]["latitude"] == 1e-7
    assert "course" not in rows[1]


@pytest.mark.parametrize(
    ("form", "cells", "more"),
    [
        ("unix-s", "1715562000.123456789", {}),
        ("unix-ms", "1715562000123.456789", {}),
        ("unix-us", "1715562000123456.789", {}),
        ("unix-ns", "1715562000123456789", {}),
        ("iso8601", "2024-05-13T01:00:00.123456789Z", {}),
        ("iso8601", "2024-05-13 03:00:00.123456789+02:00", {}),
        ("iso8601", "2024-05-12T21:30:00.1234567891-0330", {}),
        ("iso8601-utc", "2024-05-13 01:00:00.123456789", {}),
        ("iso8601-utc", '"2024-05-13T03:00:00,123456789+02"', {}),
        ("gps-s", f"{GPS_START}.123456789", {}),
        ("gps-ms", f"{GPS_START}123.456789", {}),
        ("gps-week-s", f"{GPS_START % 604_800}.123456789,{GPS_START // 604_800}", {"week": "W"}),
    ],
)
def test_stamps_are_exact(form: str, cells: str, more: dict[str, str], tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", f"Time,{'W,' if more else ''}v\n{cells},1\n")
    rows, account = read(path, nav({"nav_speed": "v"}, time={"column": "Time", "format": form, **more}))
    assert account == Account(accepted=1)
    assert rows[0]["time"].value == START + 123_456_789


@pytest.mark.parametrize(
    ("form", "cell", "expected"),
    [
        ("unix-s", "1.7e9", "seconds since 1970"),
        ("unix-s", "17155620001", "seconds since 1970"),
        ("unix-ns", "9999999999999999999", "nanoseconds since 1970"),
        ("iso8601", "2024-05-13T01:00:00",
         "a date and time with its zone, such as 2024-05-13T01:00:00.1Z (if they are all UTC: iso8601-utc)"),
        ("iso8601-utc", "2024-13-13T01:00:00", "a date and time, such as 2024-05-13T01:00:00.1"),
        ("iso8601-utc", "13.05.2024 01:00", "a date and time, such as 2024-05-13T01:00:00.1"),
        ("gps-s", "", "seconds since 1980"),
    ],
)  # fmt: skip
def test_what_is_no_stamp_is_rejected_with_its_line(form: str, cell: str, expected: str, tmp_path: Path) -> None:
    good = "2024-05-13T01:00:00Z" if "iso" in form else "1715562000"
    path = write(tmp_path / "a.csv", f"Time,v\n{good},1\n{cell},2\n")
    rows, account = read(path, nav({"nav_speed": "v"}, time={"column": "Time", "format": form}))
    assert len(rows) == 1
    assert account.rejections == [("line 3", f"expected {expected} as Time; found {cell!r}")]


def test_rows_that_are_none_are_accounted_with_their_lines(tmp_path: Path) -> None:
    path = write(
        tmp_path / "a.csv",
        "Time,v\n1,1\n\n2\n3,2,9\n4,abc\n5,1e20\n6,3\n6,4\n   \n7,5\n8",
    )
    rows, account = read(path, nav({"nav_speed": "v"}))
    assert [(row["time"].value // 10**9, row["nav_speed"]) for row in rows] == [(1, 1.0), (6, 3.0), (7, 5.0)]
    assert (account.accepted, account.rejected, account.truncated) == (3, 6, True)
    assert sorted(account.rejections, key=lambda one: int(one[0].split()[1])) == [
        ("line 4", "expected 2 cells as in the first line; found 1"),
        ("line 5", "expected 2 cells as in the first line; found 3"),
        ("line 6", "expected a number as v; found 'abc'"),
        ("line 7", "expected a number as v; found '1e20'"),
        (
            "line 9",
            "its time 1970-01-01T00:00:06.000Z is that of another line; repeated in recording, the first one is kept",
        ),
        ("line 12", "expected 2 cells as in the first line; found 1"),
    ]


def test_semicolons_and_decimal_commas(tmp_path: Path) -> None:
    text = "\ufeffZeit [s];Geschwindigkeit [m/s²];Höhe\r\n1,5;2,5;100,25\r\n2,5;3;\r\n"
    columns = {"nav_speed": "Geschwindigkeit [m/s²]", "altitude": "Höhe"}
    time = {"column": "Zeit [s]", "format": "unix-s"}
    rows, account = read(write(tmp_path / "a.csv", text), nav(columns, decimal=",", time=time))
    assert account == Account(accepted=2)
    assert [(row["time"].value, row["nav_speed"], row.get("altitude")) for row in rows] == [
        (1_500_000_000, 2.5, 100.25),
        (2_500_000_000, 3.0, None),
    ]
    _, account = read(tmp_path / "a.csv", nav({"nav_speed": "Geschwindigkeit [m/s²]"}, time=time))
    assert account.rejected == 2


def test_a_decimal_comma_that_was_not_said_is_guessed_at_in_the_reason(tmp_path: Path) -> None:
    _, account = read(write(tmp_path / "a.csv", "Time;v\n1;2,5\n"), nav({"nav_speed": "v"}))
    assert account.rejections == [
        ("line 2", "expected a number as v; found '2,5'; where commas are decimal marks, say nav.decimal = \",\"")
    ]


def test_columns_that_are_not_there_are_all_named(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "time;Latitude;Lon;Lon;Speed\n")
    with pytest.raises(InputError) as caught:
        read(path, nav())
    assert str(caught.value) == (
        f"{path}: line 1: there is no column 'Time' (did you mean 'time'?); there is no column 'Lat' (did you mean "
        "'Latitude'?); there are 2 columns 'Lon'; rename all but one; there is no column 'Heading'; there is no column "
        "'Rate'; there is no column 'Height'. The columns are 'time', 'Latitude', 'Lon', 'Lon', 'Speed'. Correct "
        "nav.columns and nav.time in wheelprint.toml"
    )


def test_a_unit_that_is_not_known(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "Time,v\n1,2\n")
    with pytest.raises(InputError) as caught:
        read(path, nav({"nav_speed": {"column": "v", "unit": "furlongs"}}))
    assert "nav.columns.nav_speed: 'furlongs' is not known as a unit of m/s (m/s, m/sec," in str(caught.value)


def test_a_long_compressed_file_and_lines_far_behind(tmp_path: Path) -> None:
    n = 150_000
    lines = [f"{k},{k % 50}.5,{'x' * (k % 7)}" for k in range(n)]
    bad = [20_001, 77_777, 149_999]
    for k in bad:
        lines[k] = "broken"
    text = "Time,v,n\n" + "\n".join(lines) + "\n"
    assert len(text) > 2 * BLOCK
    path = tmp_path / "a.csv"
    path.write_bytes(gzip.compress(text.encode()))
    rows, account = read(path, nav({"nav_speed": "v"}))
    assert (account.accepted, account.rejected, account.truncated) == (n - 3, 3, False)
    assert sorted(where for where, _ in account.rejections) == sorted(f"line {k + 2}" for k in bad)
    expected = [k for k in range(n) if k not in bad]
    assert [row["time"].value for row in rows] == [k * 10**9 for k in expected]
    assert [row["nav_speed"] for row in rows] == [k % 50 + 0.5 for k in expected]


def test_against_the_csv_module(tmp_path: Path) -> None:
    """The same rows by a loop over Python's own parser."""
    generator = random.Random(4)  # noqa: S311
    path = tmp_path / "a.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file, quoting=csv.QUOTE_ALL)
        writer.writerow(["Time", "text", "v", "h"])
        moment = datetime(2024, 5, 13, tzinfo=UTC)
        for _ in range(500):
            moment += timedelta(microseconds=generator.randrange(1, 10**6))
            shown = moment.astimezone(UTC).isoformat()
            writer.writerow([shown, 'a, "b"', repr(generator.uniform(0, 50)), generator.choice(["", "90", "1e2"])])
    rows, account = read(
        path,
        nav({"nav_speed": "v", "heading": "h"}, time={"column": "Time", "format": "iso8601"}),
    )
    assert account == Account(accepted=500)
    with path.open(newline="") as file:
        for row, cells in zip(rows, csv.DictReader(file), strict=True):
            moment = datetime.fromisoformat(cells["Time"])
            since = moment - datetime(1970, 1, 1, tzinfo=UTC)
            assert row["time"].value == since // timedelta(microseconds=1) * 1000
            assert row["nav_speed"] == float(cells["v"])
            assert row.get("heading") == (float(cells["h"]) if cells["h"] else None)


def test_parquet_of_numbers_and_timestamps(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    when = pa.array([START, START + 10**8, None], pa.timestamp("ns", "UTC"))
    table = pa.table(
        {"Time": when, "v": pa.array([1, None, 3], pa.int16()), "Lat": [48.0, 48.1, 99.0], "Lon": [11.0] * 3}
    )
    pq.write_table(table, path)
    columns = {"nav_speed": "v", "latitude": "Lat", "longitude": "Lon"}
    rows, account = read(path, nav(columns, time={"column": "Time", "format": "iso8601"}))
    assert [(row["time"].value, row.get("nav_speed"), row["latitude"]) for row in rows] == [
        (START, 1.0, 48.0),
        (START + 10**8, None, 48.1),
    ]
    assert account.rejections == [
        (
            "row 3",
            (
                "expected a date and time with its zone, such as 2024-05-13T01:00:00.1Z (if they are all UTC: "
                "iso8601-utc) as Time; found 'None'"
            ),
        )
    ]
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(InputError, match="no Parquet file, or one that was cut off"):
        read(path, nav(columns, time={"column": "Time", "format": "iso8601"}))


def test_floating_point_stamps() -> None:
    time = TimeColumn(column="t", format="unix-s")
    stamps, known = parse_times(pa.array([1_715_562_000.25, float("nan"), -1.0, None, 1e30]), None, time)
    assert known.tolist() == [True, False, False, False, False]
    assert stamps[0] == START + 250_000_000


def test_which_files_it_holds_for(tmp_path: Path) -> None:
    how = nav(files=["gps*.csv", "nav/*"])
    assert mapped_table("gps1.csv", tmp_path, how) is not None
    assert mapped_table("sub/gps1.csv", tmp_path, how) is not None
    assert mapped_table("nav/a.txt", tmp_path, how) is not None
    assert mapped_table("can.csv", tmp_path, how) is None
    assert mapped_table("gps1.csv", tmp_path, how.model_copy(update={"format": "ncom"})) is None
    reader = mapped_table("gps1.csv", tmp_path, how)
    assert pickle.loads(pickle.dumps(reader)) == reader


@pytest.mark.parametrize("cut", range(10, 400, 13))
def test_cut_anywhere_whole_rows_before_the_cut_arrive(cut: int, tmp_path: Path) -> None:
    text = "Time,v,w\n" + "".join(f"{k}.25,{k}.5,{k}\n" for k in range(10, 50))
    path = write(tmp_path / "a.csv", text[:cut])
    rows, account = read(path, nav({"nav_speed": "v"}))
    whole = text[:cut].count("\n") - 1
    assert [row["nav_speed"] for row in rows][:whole] == [k + 0.5 for k in range(10, 10 + whole)]
    assert len(rows) <= whole + 1
    rest = text[:cut].rpartition("\n")[2]
    assert account.truncated == (rest.count(",") < 2 and bool(rest))


def test_random_damage_ends_as_a_result_or_an_input_error(tmp_path: Path) -> None:
    text = ("Time,v,w\n" + "".join(f"{k}.25,{k}.5,{k}\n" for k in range(10, 60))).encode()
    generator = np.random.default_rng(3)
    path = tmp_path / "a.csv"
    for _ in range(150):
        damaged = bytearray(text)
        for place in generator.integers(0, len(text), generator.integers(1, 9)).tolist():
            damaged[place] = int(generator.integers(0, 256))
        path.write_bytes(damaged)
        try:
            rows, account = read(path, nav({"nav_speed": "v"}))
        except InputError:
            continue
        assert account.accepted == len(rows)
        assert len(account.rejections) == min(account.rejected, 100)


def test_in_a_project_the_mapping_comes_before_what_a_file_looks_like(tmp_path: Path) -> None:
    """A text export of OxTS that the mapping names: another column is taken for the speed."""
    from wheelprint.ingest.convert import plan_conversion
    from wheelprint.schemas.project import Project

    folder = tmp_path / "raw" / "anna" / "monday"
    folder.mkdir(parents=True)
    (tmp_path / "wheelprint.toml").write_text(
        "[vehicle]\nwheelbase = 2.7\n"
        '[nav]\nfiles = "nav*.csv"\ntime = { column = "Time()", format = "gps-s" }\n'
        '[nav.columns]\nlatitude = "Latitude(deg)"\nlongitude = "Longitude(deg)"\nnav_speed = "Speed(m/s)"\n'
    )
    lines = [f"{GPS_START + 0.1 * k:.3f},{48 + 1e-6 * k:.8f},11.0,7.5\n" for k in range(50)]
    (folder / "nav1.csv").write_text("Time(), Latitude(deg),Longitude(deg),Speed(m/s)\n" + "".join(lines))
    (task,), _ = plan_conversion(Project(tmp_path))
    entry = task.run(**task.arguments).entry
    (found,) = entry["inputs"]
    assert (found["format"], found["looks_like"], found["accepted"]) == ("columns", ["csv"], 50)
    table = Project(tmp_path).synced_file("anna", "monday")
    speeds = pq.read_table(table)["nav_speed"].drop_null().to_pylist()
    assert speeds == pytest.approx([7.5] * len(speeds))
    assert len(speeds) >= 49
