"""CSV exports of OxTS: GPS seconds are trusted, units are read from the names, nothing is lost in silence."""

from __future__ import annotations

import gzip
import json
import pickle
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from wheelprint.ingest.account import Account
from wheelprint.ingest.oxts.oxts_csv import OxtsCsv
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.tables import NAVIGATION

HEADER = (
    " Time(), Date, Local Time, Latitude(deg), Longitude(deg), Altitude(m), Velocity north(m/s), Velocity east(m/s),"
    " Acceleration Xv(m/s²), Acceleration Yv(m/s²), Acceleration Zv(m/s²), Heading(deg), Pitch(deg), Roll(deg),"
    " Angular rate Xv(deg/s), Angular rate Zv(deg/s), North position accuracy(m), East position accuracy(m),"
    " Navigation status(),\n"
)
ROW = ["1000000000.25", "2011-09-14", "02:46:39", "49.0", "8.4", "116.0", "3.0", "4.0", "0.5", "-0.25", "-9.80665",
       "30", "0", "0", "1", "-6", "0.03", "0.04", "4"]  # fmt: skip
# 2011-09-14 01:46:40 GPS, 15 s ahead of UTC.
START = int(datetime(2011, 9, 14, 1, 46, 25, 250_000, tzinfo=UTC).timestamp() * 1000) * 1_000_000
NO_TIME = "; the unit had no GNSS time yet, or the line is damaged"


def row(seconds: object = ROW[0], **changes: object) -> str:
    """A line with some cells changed: c3=… is the fourth."""
    cells = [str(seconds), *ROW[1:]]
    for place, value in changes.items():
        cells[int(place[1:])] = str(value)
    return ",".join(cells) + ",\n"


def read(folder: Path, content: str | bytes) -> tuple[pa.Table, Account]:
    path = folder / "nav.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    account = Account()
    batches = list(OxtsCsv(path).batches(account))
    return pa.Table.from_batches(batches, batches[0].schema if batches else NAVIGATION), account


def times(table: pa.Table) -> list[int]:
    stamps: list[int] = table["time"].cast(pa.int64()).to_pylist()
    return stamps


def test_a_line_in_wheelprints_axes_and_units(tmp_path: Path) -> None:
    table, account = read(tmp_path, HEADER + row() + row("1000000000.350000001", c3=49.0001))
    assert account == Account(accepted=2)
    assert table.schema.equals(NAVIGATION, check_metadata=False)
    assert times(table) == [START, START + 100_000_001]
    first = table.to_pylist()[0]
    del first["time"]
    assert first == pytest.approx({
        "latitude": 49.0, "longitude": 8.4, "altitude": 116.0, "x": 0.0, "y": 0.0,
        "course": np.degrees(np.arctan2(3, 4)), "heading": 60.0, "nav_speed": 5.0, "nav_yaw_rate": 6.0,
        "nav_longitudinal_acceleration": 0.5, "nav_lateral_acceleration": 0.25, "position_accuracy": 0.05,
        "nav_status": 4,
    })  # fmt: skip
    assert table["y"][1].as_py() == pytest.approx(11.12, abs=0.01)
    assert json.loads(table.schema.metadata[b"origin"]) == {"latitude": 49.0, "longitude": 8.4, "altitude": 116.0}
    assert table.schema.metadata[b"utc_from"] == b"leap second table"


def test_units_are_read_from_the_names(tmp_path: Path) -> None:
    header = "Time(),Latitude(rad),Longitude(rad),Velocity north(km/h),Velocity east(km/h),Angular rate Zv(rad/s)\r\n"
    table, account = read(tmp_path, header + "1000000000,0.5,0.25,36,0,-0.1\r\n")
    assert account == Account(accepted=1)
    found = {name: value for name, value in table.to_pylist()[0].items() if value is not None and name != "time"}
    assert found == pytest.approx({
        "latitude": np.degrees(0.5), "longitude": np.degrees(0.25), "x": 0.0, "y": 0.0, "course": 90.0,
        "nav_speed": 10.0, "nav_yaw_rate": np.degrees(0.1),
    })  # fmt: skip


def test_square_metres_of_windows_and_a_byte_order_mark(tmp_path: Path) -> None:
    for content in ((HEADER + row()).encode("latin-1"), b"\xef\xbb\xbf" + (HEADER + row()).encode()):
        table, account = read(tmp_path, content)
        assert OxtsCsv.sniff(content)
        assert account == Account(accepted=1)
        assert table["nav_longitudinal_acceleration"].to_pylist() == [0.5]


def test_empty_and_dash_are_missing(tmp_path: Path) -> None:
    table, account = read(tmp_path, HEADER + row(c3="", c4=" - ", c6="-", c11="", c16="", c18=""))
    assert account == Account(accepted=1)
    present = {name for name, value in table.to_pylist()[0].items() if value is not None}
    assert present == {"time"}
    table, _ = read(tmp_path, HEADER + row(c3="", c4=" - ", c6="-", c11="", c12="-"))
    present = {name for name, value in table.to_pylist()[0].items() if value is not None}
    motion = {"nav_yaw_rate", "nav_longitudinal_acceleration", "nav_lateral_acceleration"}
    assert present == {"time", "altitude", "position_accuracy", "nav_status"} | motion


@pytest.mark.parametrize(("status", "inertial"), [(0, False), (1, True), (2, True), (5, False)])
def test_the_navigation_status_rules_what_is_valid(tmp_path: Path, status: int, inertial: bool) -> None:
    table, account = read(tmp_path, HEADER + row(c18=status))
    assert account == Account(accepted=1)
    present = {name for name, value in table.to_pylist()[0].items() if value is not None}
    motion = {"nav_yaw_rate", "nav_longitudinal_acceleration", "nav_lateral_acceleration"} if inertial else set()
    assert present == {"time", "nav_status"} | motion


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (row("-"), f"expected GPS seconds since 1980 as Time(); found '-'{NO_TIME}"),
        (row("345600.1"), f"expected GPS seconds since 1980 as Time(); found '345600.1'{NO_TIME}"),
        (row("9000000000"), "Time() 9000000000 s is beyond the year 2233; the line is damaged"),
        (row(c3="north"), "expected a number; found 'north'"),
        (row(c18="4.5"), "expected a navigation status (0 to 255); found 4.5"),
        (row(c3="91"), "latitude 91 deg, longitude 8.4 deg, altitude 116 m is nowhere on earth; the line is damaged"),
        ("1000000000,2,3\n", "expected 20 cells as in the first line; found 3: '1000000000,2,3'"),
    ],
)
def test_damaged_lines_are_rejected(tmp_path: Path, line: str, reason: str) -> None:
    table, account = read(tmp_path, HEADER + row() + "\n" + line + row(1000000001))
    assert len(table) == 2
    assert account == Account(accepted=2, rejected=1, rejections=[("line 4", reason)])


def test_time_that_does_not_increase_is_rejected(tmp_path: Path) -> None:
    lines = [row(1000000000 + second) for second in (0, 3, 1, 1, 4)]
    table, account = read(tmp_path, HEADER + "".join(lines))
    assert len(table) == 3
    swapped = "is out of order with the lines around it; they changed places, or the clock was set"
    repeated = "is that of another line; repeated in recording, the first one is kept"
    assert account.rejections == [
        ("line 3", f"its time 2011-09-14T01:46:28.000Z {swapped}"),
        ("line 5", f"its time 2011-09-14T01:46:26.000Z {repeated}"),
    ]


def test_times_beyond_the_table_of_leap_seconds_are_said(tmp_path: Path) -> None:
    table, account = read(tmp_path, HEADER + row(1500000000))
    assert len(table) == 1
    reason = (
        "the log's times are GPS time, and the table of leap seconds ends on 2027-06-28: its times may be a second "
        "off. Update Wheelprint"
    )
    assert account == Account(accepted=1, remarks=[("", reason)])


def test_all_that_is_wrong_with_the_first_line_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        read(tmp_path, " Date, Latitude(deg), Velocity north(furlong),\n")
    assert str(error.value) == (
        f"{tmp_path / 'nav.csv'}: line 1: the unit of 'Velocity north(furlong)' is not known (known are m/s, m/sec, "
        "mps, meterpersec, ms-1, km/h, kmh, kph, kmph, mph, mi/h, miles/h, kn, kt, knot, knots); there is no column "
        "Time() in GPS seconds, nor Longitude. Export again with these columns, in these units"
    )


def test_cut_anywhere(tmp_path: Path) -> None:
    begin = (HEADER + row()).encode()
    last = row(1000000001).encode()
    for size in range(len(last) + 1):
        table, account = read(tmp_path, begin + last[:size])
        whole = size >= len(last) - 1
        assert len(table) == 1 + whole
        assert account.truncated == (size > 0 and not whole)
        assert account.rejected == account.truncated


def test_compressed_and_in_batches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wheelprint.ingest.oxts.oxts_csv.BATCH", 2)
    path = tmp_path / "nav.csv.gz"
    path.write_bytes(gzip.compress((HEADER + "".join(row(1000000000 + second) for second in range(5))).encode()))
    reader = pickle.loads(pickle.dumps(OxtsCsv(path)))
    account = Account()
    assert [len(batch) for batch in reader.batches(account)] == [2, 2, 1]
    assert account == Account(accepted=5)


def test_random_damage_ends_as_a_result_or_as_an_input_error(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    content = np.frombuffer((HEADER + "".join(row(1000000000 + second) for second in range(4))).encode(), np.uint8)
    results = 0
    for _ in range(200):
        damaged = content.copy()
        damaged[rng.integers(len(content), size=4)] = rng.integers(256, size=4)
        try:
            table, account = read(tmp_path, damaged.tobytes())
        except InputError:  # Of the first line.
            continue
        results += 1
        assert len(table) == account.accepted
    assert results > 30


def test_sniff() -> None:
    assert OxtsCsv.sniff(HEADER.encode())
    for other in (
        b"", b"Time,Latitude\n1,2\n", b"2011-09-26 13:02:25.594360375\n", b"(1436509052.249713) can0 044#2A\n",
        b"\xe7" * 144, b"$GPRMC,1\n", b"OggS\0", b"timestamp,arbitration_id,extended,remote,error,dlc,data\n",
    ):  # fmt: skip
        assert not OxtsCsv.sniff(other)
