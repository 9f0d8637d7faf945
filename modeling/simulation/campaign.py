"""Campaigns of simulated drives: raw logs as a vehicle writes them, and the truth beside them."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pyarrow as pa

from ...ingest.can.candump_writer import write_candump
from ...ingest.can.database import load_database
from ...ingest.oxts.ncom_writer import write_ncom
from ...schemas.errors import InputError
from ...schemas.project import Recording
from ...schemas.store import publish_json, publish_table, publish_text
from ...schemas.times import iso_utc
from .car import Car
from .driver import Driver, Emergency, Intentions, Motion, drive, intend
from .logs import DATABASE, MAPPING, OXTS_DATABASE, SECOND, CanClock, Sensors, can_log, navigation_log, oxts_log
from .road import Road, generate_road
from .truth import PERIOD, Origin, centre_line_table, truth_table

FIRST_START = 1_715_562_000 * SECOND
"""2024-05-13T01:00:00Z in ns since 1970."""
HOUR, DAY = 3600 * SECOND, 86_400 * SECOND
ROADS_TRIED = 50
FASTEST = 30.0
"""m/s; a road is as long as a drive at this speed."""


@dataclass(frozen=True, slots=True)
class Trip:
    """One recording of one driver.

    Attributes:
        driver: Who drives.
        name: Of the recording and its folder.
        start: ns since 1970, UTC, a multiple of 10 ms.
        minutes: How long, min.
        clock: Of the CAN logger.
        emergencies: What happens on the way; the road decides where and in which order.
        can_gaps: (start, duration) in s since the start: no CAN frames are logged.
        nav_gaps: (start, duration) in s since the start: no navigation packets are logged.
    """

    driver: Driver
    name: str
    start: int
    minutes: float
    clock: CanClock = field(default_factory=CanClock)
    emergencies: tuple[Emergency, ...] = ()
    can_gaps: tuple[tuple[float, float], ...] = ()
    nav_gaps: tuple[tuple[float, float], ...] = ()

    @property
    def key(self) -> str:
        """`driver/recording`."""
        return f"{self.driver.name}/{self.name}"


@dataclass(frozen=True, slots=True)
class Campaign:
    """Everything that a simulation depends on: the same campaign gives the same bytes.

    Attributes:
        trips: The recordings. What is random in one depends on `seed` and its place here, on no other trip.
        seed: Of all that is random.
        car: What all drive.
        sensors: Of the car and the navigation unit.
        navigation: How it is recorded: `ncom`, a log of its own, or `can`, on the logger's second bus.
    """

    trips: tuple[Trip, ...]
    seed: int = 0
    car: Car = field(default_factory=Car)
    sensors: Sensors = field(default_factory=Sensors)
    navigation: Literal["ncom", "can"] = "ncom"


def demo_campaign(seed: int = 0) -> Campaign:
    """Return the campaign of `wheelprint demo`: four drivers, ten recordings, 36 minutes.

    Every CAN clock is wrong in its own way, each driver has two or three emergencies, one CAN log and one navigation
    log have a gap.
    """
    wang = Driver(
        "王伟", lookahead_base=4.0, lookahead_time=0.55, lateral_comfort=2.4, acceleration=1.9, deceleration=2.2,
        speed_factor=1.05, steering_noise=0.7, steering_smoothing=0.08,
    )  # fmt: skip
    anna = Driver(
        "Anna", lookahead_base=6.0, lookahead_time=0.8, lookahead_maximum=22.0, lateral_comfort=1.8, acceleration=1.3,
        deceleration=1.5, speed_factor=0.92, steering_noise=0.4, steering_smoothing=0.15,
    )  # fmt: skip
    marek = Driver(
        "Marek", lookahead_base=3.0, lookahead_time=0.9, lateral_comfort=2.3, acceleration=1.6, deceleration=1.9,
        speed_factor=1.0, steering_noise=0.6, steering_smoothing=0.1,
    )  # fmt: skip
    sofia = Driver(
        "Sofia", lookahead_base=8.0, lookahead_time=0.45, lateral_comfort=2.1, acceleration=1.4, deceleration=1.7,
        speed_factor=0.97, steering_noise=0.5, steering_smoothing=0.12,
    )  # fmt: skip

    def trip(
        driver: Driver, day: int, number: int, minutes: float, offset: float, drift: float, *emergencies: Emergency,
        can_gaps: tuple[tuple[float, float], ...] = (), nav_gaps: tuple[tuple[float, float], ...] = (),
    ) -> Trip:  # fmt: skip
        start = FIRST_START + day * DAY + number * HOUR
        return Trip(
            driver, f"drive{number + 1}", start, minutes, CanClock(offset, drift), emergencies, can_gaps, nav_gaps
        )

    return Campaign(
        (
            trip(wang, 0, 0, 3.0, 0.834, 22.0, "braking"),
            trip(wang, 0, 1, 3.0, 0.921, 21.0, "swerve"),
            trip(wang, 0, 2, 3.0, 1.007, 23.5, "braking"),
            trip(anna, 1, 0, 4.5, -1.372, -14.0, "swerve"),
            trip(anna, 1, 1, 4.5, -1.431, -15.5, "braking", nav_gaps=((130.0, 0.8),)),
            trip(marek, 2, 0, 3.0, 2.416, 48.0, "braking"),
            trip(marek, 2, 1, 3.0, 2.603, 47.0, "swerve", can_gaps=((95.0, 1.2),)),
            trip(marek, 2, 2, 3.0, 2.781, 46.0, "braking"),
            trip(sofia, 3, 0, 4.5, 0.118, -3.0, "braking", "swerve"),
            trip(sofia, 3, 1, 4.5, -0.255, -2.0, "swerve"),
        ),
        seed,
    )


def draw_campaign(
    seed: int,
    drivers: int,
    recordings: int,
    minutes: float,
    clock_offset: float = 0.8,
    clock_drift: float = 20.0,
) -> Campaign:
    """Draw a campaign of any size: drivers `driver01`, …, each with recordings `drive01`, ….

    Each recording has an emergency for every two minutes; each driver's last one has a gap in either log where it is
    two minutes long.

    Args:
        seed: Of the campaign and of its drivers.
        drivers: How many.
        recordings: Of each driver.
        minutes: Of each recording, min.
        clock_offset: s, mean of the CAN clocks' offsets, which lie within half of it around it.
        clock_drift: ppm, mean of their drifts, which lie likewise.
    """
    trips = []
    for d in range(drivers):
        # One generator for each driver: more drivers do not change the ones before.
        generator = np.random.default_rng([seed, d])
        driver = Driver(
            f"driver{d + 1:02d}",
            lookahead_base=generator.uniform(3, 7),
            lookahead_time=generator.uniform(0.45, 0.9),
            lookahead_maximum=generator.uniform(20, 32),
            lateral_comfort=generator.uniform(1.7, 2.7),
            acceleration=generator.uniform(1.2, 1.9),
            deceleration=generator.uniform(1.4, 2.3),
            speed_factor=generator.uniform(0.9, 1.06),
            steering_noise=generator.uniform(0.3, 0.8),
            steering_smoothing=generator.uniform(0.08, 0.16),
        )
        for r in range(recordings):
            clock = CanClock(
                round(clock_offset * generator.uniform(0.5, 1.5), 3),
                round(clock_drift * generator.uniform(0.5, 1.5), 1),
            )
            kinds: tuple[Emergency, Emergency] = ("braking", "swerve")
            gaps = ((60 * minutes * 0.4, 1.2),) if r == recordings - 1 and minutes >= 2 else ()
            trips.append(
                Trip(
                    driver,
                    f"drive{r + 1:02d}",
                    FIRST_START + d * DAY + r * (HOUR + round(minutes) * 60 * SECOND),
                    minutes,
                    clock,
                    tuple(kinds[(r + e) % 2] for e in range(int(minutes // 2))),
                    can_gaps=gaps,
                    nav_gaps=tuple((2 * start, duration) for start, duration in gaps),
                )
            )
    return Campaign(tuple(trips), seed)


def simulate(directory: Path, campaign: Campaign) -> list[Recording]:
    """Simulate a campaign into a project folder.

    It writes `raw/<driver>/<recording>/can.log` and `nav.ncom` (or `oxts.log`), `truth/<driver>/<recording>.parquet`,
    the road's centre line beside it (`<recording>.centre_line.parquet`, which `[lookahead] reference` can name),
    `truth/campaign.json` with all parameters, and `wheelprint.toml` where there is none.

    Args:
        directory: The project folder.
        campaign: What to simulate.

    Returns:
        The recordings, in the campaign's order.

    Raises:
        InputError: See `check_campaign`; or a trip is too short for its emergencies.
    """
    check_campaign(directory, campaign)
    entries = [simulate_recording(directory, campaign, index) for index in range(len(campaign.trips))]
    publish_campaign(directory, campaign, entries)
    return [Recording(trip.driver.name, trip.name, _raw_folder(directory, trip)) for trip in campaign.trips]


def check_campaign(directory: Path, campaign: Campaign) -> None:
    """Refuse a campaign that would write over real logs, or whose names cannot be folders.

    Raises:
        InputError: A name is there twice, stands for two drivers or cannot be a folder's, or a recording is there that
            was not simulated; it names all of them.
    """
    counts = Counter(trip.key for trip in campaign.trips)
    wrong = [f"{key} is there {count} times" for key, count in counts.items() if count > 1]
    drivers: dict[str, Driver] = {}
    for trip in campaign.trips:
        if drivers.setdefault(trip.driver.name, trip.driver) != trip.driver:
            wrong.append(f"two drivers are called {trip.driver.name}")
        wrong.extend(
            f"{name!r} cannot be the name of a folder"
            for name in (trip.driver.name, trip.name)
            if not name or name.startswith(".") or "/" in name or "\0" in name
        )
    if not wrong:
        wrong = [
            f"raw/{trip.key} is there and was not simulated"
            for trip in campaign.trips
            if _raw_folder(directory, trip).exists() and not _truth_file(directory, trip).exists()
        ]
    if wrong:
        reason = f"nothing was simulated: {'; '.join(dict.fromkeys(wrong))}. Choose other names or an empty folder"
        raise InputError(directory, "", reason)


def simulate_recording(directory: Path, campaign: Campaign, index: int) -> dict[str, Any]:
    """Simulate one trip of a campaign and write its logs and its truth; trips may be simulated in any process.

    Args:
        directory: The project folder.
        campaign: The trip's.
        index: Of the trip within the campaign.

    Returns:
        What `publish_campaign` needs to know of it.

    Raises:
        InputError: The trip is too short for its emergencies.
        IndexError: There is no such trip.
    """
    trip = campaign.trips[index]
    truth, road, origin, intentions, motion, (on_bus, in_navigation) = drive_trip(directory, campaign, index)
    publish_table(_truth_file(directory, trip), truth)
    publish_table(_centre_line_file(directory, trip), centre_line_table(motion, road, origin))
    folder = _raw_folder(directory, trip)
    database = load_database([DATABASE], directory)
    frames = can_log(on_bus, truth, campaign.car, campaign.sensors, trip.clock, trip.can_gaps, database)
    write_candump(folder / "can.log", [frames])
    navigation = navigation_log(in_navigation, truth, campaign.sensors, origin, trip.nav_gaps)
    if campaign.navigation == "can":
        oxts = load_database([OXTS_DATABASE], directory)
        start = int(truth["time"][0].value)
        write_candump(
            folder / "oxts.log", [oxts_log(in_navigation, navigation, campaign.sensors, trip.clock, start, oxts)]
        )
    else:
        write_ncom(folder / "nav.ncom", **asdict(navigation))
    return {
        "driver": trip.driver.name,
        "recording": trip.name,
        "start": iso_utc(trip.start),
        "stop": iso_utc(trip.start + len(truth) * PERIOD),
        "origin": asdict(origin),
        "clock": {"offset_s": trip.clock.offset, "drift_ppm": trip.clock.drift},
        "can_gaps": _intervals(trip.start, trip.can_gaps),
        "nav_gaps": _intervals(trip.start, trip.nav_gaps),
        "emergencies": _emergencies(truth, intentions, motion.emergency),
        "distance_m": float(motion.arc_length[-1]),
    }


class DrivenTrip(NamedTuple):
    """What happened on a trip, before anything measured it.

    Attributes:
        truth: In the schema `TRUTH`.
        road: What was driven on.
        origin: Where the drive begins.
        intentions: What the driver meant to do.
        motion: What the driver did.
        generators: Of the bus's noise and of navigation's.
    """

    truth: pa.Table
    road: Road
    origin: Origin
    intentions: Intentions
    motion: Motion
    generators: tuple[np.random.Generator, np.random.Generator]


def drive_trip(directory: Path, campaign: Campaign, index: int) -> DrivenTrip:
    """Drive one trip of a campaign; nothing is written.

    Args:
        directory: Named by errors.
        campaign: The trip's.
        index: Of the trip within the campaign, from 0.

    Raises:
        InputError: The trip is too short for its emergencies.
        IndexError: There is no such trip.
    """
    trip = campaign.trips[index]
    on_road, at_wheel, on_bus, in_navigation = np.random.default_rng([campaign.seed, index]).spawn(4)
    origin = Origin(on_road.uniform(39.88, 40.02), on_road.uniform(116.25, 116.45), 45.0)
    road, intentions, motion = _drive_somewhere((on_road, at_wheel), trip, campaign.car, directory)
    truth = truth_table(motion, road, campaign.car, trip.start, origin)
    return DrivenTrip(truth, road, origin, intentions, motion, (on_bus, in_navigation))


def publish_campaign(directory: Path, campaign: Campaign, entries: list[dict[str, Any]]) -> None:
    """Write `truth/campaign.json`, and `wheelprint.toml` where there is none.

    Args:
        directory: The project folder.
        campaign: What was simulated.
        entries: What `simulate_recording` returned for each trip.
    """
    drivers = {trip.driver.name: asdict(trip.driver) for trip in campaign.trips}
    content = {
        "seed": campaign.seed,
        "car": asdict(campaign.car),
        "sensors": asdict(campaign.sensors),
        "drivers": drivers,
        "recordings": {f"{entry['driver']}/{entry['recording']}": entry for entry in entries},
    }
    publish_json(directory / "truth" / "campaign.json", content)
    project = directory / "wheelprint.toml"
    if not project.exists():
        databases = (DATABASE, OXTS_DATABASE) if campaign.navigation == "can" else (DATABASE,)
        publish_text(project, project_file(campaign.car, databases))


def project_file(car: Car, databases: tuple[str, ...] = (DATABASE,)) -> str:
    """Return the text of a `wheelprint.toml` for simulated logs."""
    signals = "\n".join(f'{name} = "{place}"' for name, place in MAPPING.items())
    named = ", ".join(f'"{name}"' for name in databases)
    return f"""\
# Simulated drives. The truth is in truth/; nothing of it is used here.

[vehicle]
name = "BYD Tang, simulated"
wheelbase = {car.wheelbase}
steering_ratio = "estimate"
steering_offset = "estimate"

[can]
database = [{named}]

[can.signals]
{signals}

# To see how far ahead the drivers really look:
# [lookahead]
# definition = "refined"
# reference = "truth/{{driver}}/{{recording}}.centre_line.parquet"
"""


def _drive_somewhere(
    generators: tuple[np.random.Generator, np.random.Generator], trip: Trip, car: Car, directory: Path
) -> tuple[Road, Intentions, Motion]:
    """Return a road on which all emergencies of a trip happen, what the driver meant to do there, and did."""
    on_road, at_wheel = generators
    duration = 60 * trip.minutes
    for _ in range(ROADS_TRIED):
        road = generate_road(on_road, FASTEST * duration)
        intentions = intend(on_road, road, trip.driver, trip.emergencies, duration)
        if intentions is None:
            continue
        motion = drive(at_wheel, road, car, trip.driver, intentions, duration)
        if set(range(len(trip.emergencies))) <= set(motion.emergency.tolist()):
            return road, intentions, motion
    reason = (
        f"{trip.minutes:g} minutes on {ROADS_TRIED} roads have no room for {len(trip.emergencies)} emergencies: "
        f"{', '.join(trip.emergencies)}. Ask for fewer of them or for more minutes"
    )
    raise InputError(directory, trip.key, reason)


def _raw_folder(directory: Path, trip: Trip) -> Path:
    return directory / "raw" / trip.driver.name / trip.name


def _truth_file(directory: Path, trip: Trip) -> Path:
    return directory / "truth" / trip.driver.name / f"{trip.name}.parquet"


def _centre_line_file(directory: Path, trip: Trip) -> Path:
    return directory / "truth" / trip.driver.name / f"{trip.name}.centre_line.parquet"


def _intervals(start: int, gaps: tuple[tuple[float, float], ...]) -> list[dict[str, str]]:
    return [
        {"start": iso_utc(first), "stop": iso_utc(first + round(duration * SECOND))}
        for begin, duration in gaps
        for first in [start + round(begin * SECOND)]
    ]


def _emergencies(truth: pa.Table, intentions: Intentions, emergency: Any) -> list[dict[str, Any]]:
    time = truth["time"].cast(pa.int64()).to_numpy()
    described = []
    for i, kind in enumerate(intentions.emergencies):
        rows = np.flatnonzero(emergency == i)
        described.append(
            {
                "kind": kind,
                "start": iso_utc(int(time[rows[0]])),
                "stop": iso_utc(int(time[rows[-1]]) + PERIOD),
                "strength_m_s2": float(intentions.strengths[i]),
            }
        )
    return described
