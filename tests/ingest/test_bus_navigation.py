"""Navigation of an OxTS unit on CAN: what a simulated logger wrote comes back as the drive that it was."""

from __future__ import annotations

import json
import shutil
from datetime import UTC, datetime, timedelta
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from wheelprint.ingest.bus_navigation import read_bus_navigation
from wheelprint.ingest.can.database import load_database
from wheelprint.ingest.clock import ClockEstimate
from wheelprint.ingest.convert import plan_conversion
from wheelprint.ingest.gps_clock import clock_from_gps
from wheelprint.ingest.mapping import resolve_navigation
from wheelprint.ingest.oxts.can_writer import encode_oxts
from wheelprint.modeling.simulation.campaign import FIRST_START, Campaign, Trip, simulate
from wheelprint.modeling.simulation.driver import Driver
from wheelprint.modeling.simulation.logs import CanClock
from wheelprint.schemas import databases
from wheelprint.schemas.config import Nav
from wheelprint.schemas.project import Project
from wheelprint.schemas.tasks import Outcome

OFFSET, DRIFT, LATENCY = 0.834, 22.0, 0.004
SECOND = 1_000_000_000
DATE_TIME, MILLI_TIME = " 600#", " 630#"
Values = npt.NDArray[np.float64]


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulated")
    simulate(
        folder,
        Campaign((Trip(Driver("Anna"), "a", FIRST_START, 2.0, CanClock(OFFSET, DRIFT)),), seed=3, navigation="can"),
    )
    return folder


def converted(simulated: Path, folder: Path, *, without: tuple[str, ...] = (), nav: str = "") -> tuple[Outcome, Path]:
    project = folder / "project"
    shutil.copytree(simulated, project)
    log = project / "raw" / "Anna" / "a" / "oxts.log"
    lines = log.read_text().splitlines(keepends=True)
    log.write_text("".join(line for line in lines if not any(one in line for one in without)))
    with (project / "wheelprint.toml").open("a") as file:
        file.write(nav)
    (task,), problems = plan_conversion(Project(project))
    assert problems == []
    return task.run(**task.arguments), project


def truth(simulated: Path) -> tuple[npt.NDArray[np.int64], dict[str, Values]]:
    table = pq.read_table(simulated / "truth" / "Anna" / "a.parquet")
    time = table["time"].cast(pa.int64()).to_numpy()
    return time, {name: table[name].to_numpy() for name in table.column_names if name != "time"}


def agree(found: pa.Table, name: str, true: tuple[npt.NDArray[np.int64], Values], within: float) -> None:
    time = found["time"].cast(pa.int64()).to_numpy()
    values = found[name].to_numpy(zero_copy_only=False).astype(float)
    wanted = np.interp(time - true[0][0], true[0] - true[0][0], true[1])
    known = np.isfinite(values)
    assert known.mean() > 0.15
    error = values[known] - wanted[known]
    if name in ("course", "heading"):
        error = (error + 180) % 360 - 180
    assert np.sqrt(np.mean(error**2)) < within, name


def test_navigation_comes_back_and_gps_time_tells_the_clock(simulated: Path, tmp_path: Path) -> None:
    outcome, project = converted(simulated, tmp_path)
    assert outcome.problems == ()
    clock = outcome.entry["clock"]
    assert clock["applied"]
    assert clock["reason"] == (
        "the unit's own time in MilliTime.MilliTime, told 12000 times in frames with the logger's stamps"
    )
    # What comes a little late is carried to when it was measured.
    assert clock["offset_s"] == pytest.approx(OFFSET + LATENCY, abs=0.001)
    assert clock["drift_ppm"] == pytest.approx(DRIFT, abs=2)
    assert clock["standard_error_ms"] < 1

    file = next((project / "signals").rglob("can.navigation.parquet"))
    table = pq.read_table(file)
    time, true = truth(simulated)
    true |= {f"nav_{name}": true[name] for name in ("speed", "yaw_rate", "longitudinal_acceleration")}
    true["nav_lateral_acceleration"] = true["lateral_acceleration"]
    moving = true["speed"] > 1
    for name, within in (
        ("latitude", 1e-6), ("longitude", 1e-6), ("altitude", 0.1), ("nav_speed", 0.02), ("nav_yaw_rate", 0.1),
        ("nav_longitudinal_acceleration", 0.1), ("nav_lateral_acceleration", 0.1),
    ):  # fmt: skip
        agree(table, name, (time, true[name]), within)
    at = table["time"].cast(pa.int64()).to_numpy()
    driving = np.interp(at, time, moving.astype(float)) == 1
    agree(table.filter(pa.array(driving)), "heading", (time, np.unwrap(true["heading"], period=360)), 1.0)
    agree(table.filter(pa.array(driving)), "course", (time, np.unwrap(true["course"], period=360)), 1.0)
    assert table["position_accuracy"].drop_null()[0].as_py() == pytest.approx(0.02, abs=0.001)
    origin = json.loads(table.schema.metadata[b"origin"])
    assert origin == outcome.entry["origin"]
    assert outcome.entry["navigation"]["latitude"] == {
        "message": "LatitudeLongitude", "signal": "PosLat", "channel": "can1", "samples": 12000,
    }  # fmt: skip

    # The messages of a cycle are one sample, unless the stamps' jitter parts them.
    assert 12_000 <= len(table) < 16_000

    # Both sides are on UTC: the bus's speed and the unit's belong to the same moments.
    synced = Project(project)
    rows = pq.read_table(synced.synced_file("Anna", "a"))
    agree(rows, "nav_speed", (time, true["speed"]), 0.02)
    agree(rows, "speed", (time, true["speed"]), 0.05)


def test_date_and_time_to_the_hundredth_tell_it_too(simulated: Path, tmp_path: Path) -> None:
    outcome, _ = converted(simulated, tmp_path, without=(MILLI_TIME,))
    clock = outcome.entry["clock"]
    assert clock["reason"].startswith("the unit's own time in DateTime, told 12000 times")
    assert clock["offset_s"] == pytest.approx(OFFSET + LATENCY, abs=0.001)


def test_without_gps_time_there_is_one_clock(simulated: Path, tmp_path: Path) -> None:
    outcome, project = converted(simulated, tmp_path, without=(MILLI_TIME, DATE_TIME))
    clock = outcome.entry["clock"]
    assert (clock["applied"], clock["offset_s"], clock["drift_ppm"]) == (True, 0.0, 0.0)
    assert clock["reason"] == (
        "navigation is on the clock of the CAN frames that it comes from, which tells no time of its own; UTC is the "
        "logger's"
    )
    table = pq.read_table(next((project / "signals").rglob("can.navigation.parquet")))
    assert table["time"][0].value - FIRST_START == pytest.approx((OFFSET + LATENCY) * 1e9, abs=2e6)
    late = "\n[nav]\nlatency = 0.25\n"
    _, project = converted(simulated, tmp_path / "late", without=(MILLI_TIME, DATE_TIME), nav=late)
    earlier = pq.read_table(next((project / "signals").rglob("can.navigation.parquet")))
    assert table["time"][0].value - earlier["time"][0].value == 250_000_000


def test_a_log_of_its_own_comes_before_the_bus_but_gps_time_still_tells_the_clock(
    simulated: Path, tmp_path: Path
) -> None:
    from wheelprint.ingest.oxts.ncom_writer import write_ncom

    raw = tmp_path / "with_ncom"
    shutil.copytree(simulated, raw)
    time, true = truth(simulated)
    still = np.zeros((len(time), 3))
    write_ncom(
        raw / "raw" / "Anna" / "a" / "nav.ncom", time=time, latitude=true["latitude"], longitude=true["longitude"],
        altitude=45.0, velocity=still, orientation=still, acceleration=still, angular_rate=still,
    )  # fmt: skip
    outcome, project = converted(raw, tmp_path)
    assert outcome.entry["navigation"] == {}
    assert outcome.entry["clock"]["offset_s"] == pytest.approx(OFFSET + LATENCY, abs=0.001)
    assert not list((project / "signals").rglob("can.navigation.parquet"))
    only_bus, project = converted(raw, tmp_path / "can", nav='\n[nav]\nformat = "can"\n')
    assert "nav.ncom" in only_bus.entry["ignored"]
    assert list((project / "signals").rglob("can.navigation.parquet"))


def test_what_is_mapped_and_is_not_there_is_said(tmp_path: Path) -> None:
    database = load_database(["oxts"], tmp_path)
    nav = Nav.model_validate(
        {
            "can": {
                "latitude": "LatitudeLongitude.PosLatt",
                "heading": {"signal": "HeadingPitchRoll.AngleHeading", "valid": "Nothing"},
                "gps_time": "DateTime.TimeYear",
                "nav_speed": {"signal": "Velocity.Speed2D", "sign": 1},
            }
        }
    )
    mapped, problems = resolve_navigation(nav, database, tmp_path / "wheelprint.toml")
    assert list(mapped) == ["nav_speed"]
    assert [(problem.where, problem.reason) for problem in problems] == [
        (
            "nav.can.latitude",
            "message LatitudeLongitude (0x601) has no signal PosLatt; did you mean PosLat or PosLon?",
        ),
        (
            "nav.can.heading",
            (
                "message HeadingPitchRoll (0x607) has no signal Nothing. Its signals are AngleHeading, AnglePitch and "
                "AngleRoll"
            ),
        ),
        (
            "nav.can.gps_time",
            (
                "the database gives DateTime.TimeYear the unit '', which is not known as a unit of s (s, sec, ms, µs, "
                'us, ns are); say what to multiply it by: gps_time = { signal = "DateTime.TimeYear", scale = … }'
            ),
        ),
    ]


def test_what_the_unit_sends_is_what_cantools_decodes() -> None:
    import cantools

    path = Path(str(resources.files(databases) / "oxts.dbc"))
    peer = cantools.database.load_file(path)
    time = np.array([FIRST_START + 987_654_321, FIRST_START + 200 * 86_400 * SECOND])
    streams = encode_oxts(
        load_database(["oxts"], Path()), time=time, latitude=[48.1234567, -33.0], longitude=[11.5, -70.0],
        altitude=[500.123, -3.0], velocity=[[3.0, -4.0, 0.5], [0.0, 0.0, 0.0]],
        orientation=np.radians([[-90.0, 1.5, -2.5], [370.0, 0.0, 0.0]]), level_acceleration=[[1.25, -2.5], [0.0, 9.0]],
        angular_rate=np.radians([[0.1, 0.2, -15.0], [0.0, 0.0, 0.0]]), position_accuracy=0.05 * np.sqrt(2),
    )  # fmt: skip
    told: dict[str, list[dict[str, Any]]] = {}
    for identifier, _, payloads in streams:
        message = peer.get_message_by_frame_id(identifier)
        told[message.name] = [message.decode(payload.tobytes()[: message.length]) for payload in payloads]
    for k, stamp in enumerate(time.tolist()):
        gps = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=stamp // 1000, seconds=18)
        assert told["DateTime"][k] == {
            "TimeYear": gps.year % 100, "TimeCentury": 2000, "TimeMonth": gps.month, "TimeDay": gps.day,
            "TimeHour": gps.hour, "TimeMinute": gps.minute, "TimeSecond": gps.second,
            "TimeHSecond": gps.microsecond // 10_000 / 100,
        }  # fmt: skip
        since = gps - datetime(1980, 1, 6, tzinfo=UTC)
        assert told["MilliTime"][k] == {"MilliTime": since // timedelta(milliseconds=1), "UtcOffset": -18}
    first = {name: rows[0] for name, rows in told.items() if name not in {"DateTime", "MilliTime"}}
    assert {signal: pytest.approx(value) for message in first.values() for signal, value in message.items()} == {
        "PosLat": 48.1234567, "PosLon": 11.5, "Altitude": 500.123, "VelNorth": 3.0, "VelEast": -4.0, "VelDown": 0.5,
        "Speed2D": 5.0, "AccelForward": 1.25, "AccelLateral": -2.5, "AccelDown": 0, "AccelSlip": 0,
        "AngleHeading": 270.0, "AnglePitch": 1.5, "AngleRoll": -2.5, "AngRateX": 0.1, "AngRateY": 0.2,
        "AngRateZ": -15.0, "AccuracyNorth": 0.05, "AccuracyEast": 0.05, "AccuracyDown": 0, "PositionAccuracyAge": 0,
    }  # fmt: skip


def frames_of(folder: Path, name: str, time: Any, **columns: Any) -> dict[str, list[Path]]:
    table = pa.table({"time": pa.array(time, pa.timestamp("ns", "UTC")), "channel": ["can1"] * len(time), **columns})
    path = folder / f"{name}.parquet"
    pq.write_table(table, path)
    return {name: [path]}


def test_messages_that_belong_together_meet_at_the_stamps_of_the_first(tmp_path: Path) -> None:
    """As a VBOX sends them: latitude and longitude in messages of their own, only valid with a fix."""
    database = tmp_path / "box.dbc"
    database.write_text(
        'VERSION ""\nBO_ 1 Lat: 8 X\n SG_ Lat : 0|32@1- (1E-7,0) [0|0] "deg" X\n SG_ Fix : 32|8@1+ (1,0) [0|0] "" X\n'
        'BO_ 2 Lon: 8 X\n SG_ Lon : 0|32@1- (1E-7,0) [0|0] "deg" X\n'
        'BO_ 3 Speed: 8 X\n SG_ Knots : 0|16@1+ (0.01,0) [0|0] "kn" X\n SG_ Track : 16|16@1+ (0.01,0) [0|0] "deg" X\n'
    )
    nav = Nav.model_validate(
        {
            "can": {
                "latitude": {"signal": "Lat.Lat", "valid": "Fix"},
                "longitude": "Lon.Lon",
                "nav_speed": "Speed.Knots",
                "course_clockwise": "Speed.Track",
            }
        }
    )
    mapping, problems = resolve_navigation(nav, load_database([str(database)], tmp_path), tmp_path)
    assert problems == []
    time = np.arange(4) * 100_000_000
    files = {
        **frames_of(tmp_path, "Lat", time, Lat=[0.0, 48.0, 48.1, 48.2], Fix=[0, 1, 1, 1]),
        **frames_of(tmp_path, "Lon", time + 50_000_000, Lon=[11.0, 11.1, 11.2, 11.3]),
        **frames_of(
            tmp_path, "Speed", time + 60_000_000, Knots=[0.1, 10.0, 20.0, 30.0], Track=[90.0, 90.0, 0.0, 350.0]
        ),
    }
    found = read_bus_navigation(files, mapping, 500_000_000)
    assert found is not None
    table = found.table(ClockEstimate.fixed(-1.0, ""))
    rows = [row for row in table.to_pylist() if row["latitude"] is not None]
    assert [row["latitude"] for row in rows] == [48.0, 48.1, 48.2]
    assert [row["longitude"] for row in rows] == pytest.approx([11.05, 11.15, 11.25])
    assert rows[0]["time"].value == SECOND + 100_000_000
    assert rows[0]["x"] == pytest.approx(0, abs=1e-6)
    told = [row for row in table.to_pylist() if row["nav_speed"] is not None]
    assert [row["nav_speed"] for row in told] == pytest.approx(np.array([0.1, 10, 20, 30]) * 1852 / 3600)
    assert [row["course"] for row in told] == [None, 0.0, 90.0, 100.0]


def test_a_clock_that_was_set_on_the_way_is_not_believed() -> None:
    utc = 1_700_000_000 * SECOND + np.arange(600) * SECOND
    late = np.where(np.arange(600) < 300, 0, 2 * SECOND)
    clock = clock_from_gps(utc + late, utc, "A.B")
    assert not clock.applied
    assert clock.reason == "the stamps do not keep step with the time that A.B tells; one of the two clocks was set"


@pytest.mark.parametrize("minutes", [1, 5, 60])
def test_a_coarse_and_noisy_time_gives_offset_and_drift(minutes: int) -> None:
    """Once a second, up to 200 ms late, some of it wrong: as GNSS receivers tell it."""
    random = np.random.default_rng(minutes)
    utc = 1_700_000_000 * SECOND + np.arange(60 * minutes) * SECOND
    stamps = utc + 5 * SECOND + (80e-6 * (utc - utc[0])).astype(np.int64)
    told = utc - random.integers(0, 200_000_000, len(utc))
    told[random.choice(len(utc), len(utc) // 20)] += 17 * SECOND
    told[:3] = 0
    clock = clock_from_gps(stamps, told, "A.B")
    assert clock.standard_error_ms is not None
    middle = clock.offset_s + 1e-6 * clock.drift_ppm * 30 * minutes
    wanted = 5.1 + 80e-6 * 30 * minutes
    assert clock.applied
    assert abs(middle - wanted) < 4e-3 * clock.standard_error_ms
    if minutes == 60:
        assert clock.drift_ppm == pytest.approx(80, abs=5)
