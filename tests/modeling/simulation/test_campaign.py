from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pyarrow.parquet as pq
import pytest

from wheelprint.modeling.simulation.campaign import (
    FIRST_START,
    Campaign,
    Trip,
    check_campaign,
    demo_campaign,
    draw_campaign,
    publish_campaign,
    simulate,
    simulate_recording,
)
from wheelprint.modeling.simulation.driver import Driver
from wheelprint.modeling.simulation.logs import CanClock
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import Project


def content(directory: Path) -> dict[str, bytes]:
    return {
        path.relative_to(directory).as_posix(): path.read_bytes() for path in directory.rglob("*") if path.is_file()
    }


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    anna, marek = Driver("Anna"), Driver("Marek", lookahead_base=7.0)
    return Campaign(
        (
            Trip(anna, "a", FIRST_START, 0.5, CanClock(0.5, 10.0)),
            Trip(anna, "b", FIRST_START + 10**12, 0.5),
            Trip(marek, "a", FIRST_START, 0.5),
        ),
        seed=1,
    )


@pytest.fixture(scope="module")
def written(campaign: Campaign, tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("written")
    simulate(directory, campaign)
    return directory


def test_files(written: Path) -> None:
    assert sorted(content(written)) == [
        "raw/Anna/a/can.log",
        "raw/Anna/a/nav.ncom",
        "raw/Anna/b/can.log",
        "raw/Anna/b/nav.ncom",
        "raw/Marek/a/can.log",
        "raw/Marek/a/nav.ncom",
        "truth/Anna/a.centre_line.parquet",
        "truth/Anna/a.parquet",
        "truth/Anna/b.centre_line.parquet",
        "truth/Anna/b.parquet",
        "truth/Marek/a.centre_line.parquet",
        "truth/Marek/a.parquet",
        "truth/campaign.json",
        "wheelprint.toml",
    ]
    assert [recording.key for recording in Project(written).recordings()] == ["Anna/a", "Anna/b", "Marek/a"]


def test_same_campaign_gives_the_same_bytes_in_any_order_of_the_trips(
    campaign: Campaign, written: Path, tmp_path: Path
) -> None:
    restored = pickle.loads(pickle.dumps(campaign))
    entries = {index: simulate_recording(tmp_path, restored, index) for index in (2, 0, 1)}
    publish_campaign(tmp_path, restored, [entries[index] for index in range(3)])
    assert content(tmp_path) == content(written)


def test_simulating_again_replaces_what_was_simulated(campaign: Campaign, written: Path) -> None:
    before = content(written)
    simulate(written, campaign)
    assert content(written) == before


def test_another_seed_gives_other_drives(campaign: Campaign, written: Path, tmp_path: Path) -> None:
    simulate_recording(tmp_path, replace(campaign, seed=2), 0)
    other, before = content(tmp_path), content(written)
    assert all(other[name] != before[name] for name in other)
    # The same driver on another trip takes another road.
    first, second = (pq.read_table(written / "truth" / "Anna" / f"{name}.parquet", columns=["x"]) for name in "ab")
    assert not first.equals(second)


def test_a_project_file_that_is_there_is_kept(campaign: Campaign, tmp_path: Path) -> None:
    (tmp_path / "wheelprint.toml").write_text("mine", encoding="utf-8")
    publish_campaign(tmp_path, campaign, [])
    assert (tmp_path / "wheelprint.toml").read_text(encoding="utf-8") == "mine"


def test_campaign_json_says_everything(eventful: SimpleNamespace) -> None:
    recorded, trip = eventful.content, eventful.trip
    assert recorded["seed"] == 5
    assert recorded["car"]["steering_ratio"] == 15.7
    assert recorded["car"]["steering_offset"] == 2.3
    assert recorded["car"]["wheelbase"] == 2.82
    assert recorded["sensors"]["jitter"] == 0.0003
    law = recorded["drivers"]["王伟"]
    assert (law["lookahead_base"], law["lookahead_time"], law["lookahead_maximum"]) == (5.0, 0.6, 16.0)
    entry = recorded["recordings"]["王伟/drive one"]
    assert entry["clock"] == {"offset_s": trip.clock.offset, "drift_ppm": trip.clock.drift}
    assert (entry["start"], entry["stop"]) == ("2024-05-13T01:00:00.000Z", "2024-05-13T01:04:00.000Z")
    assert entry["can_gaps"] == [{"start": "2024-05-13T01:01:00.000Z", "stop": "2024-05-13T01:01:01.500Z"}]
    assert entry["nav_gaps"] == [{"start": "2024-05-13T01:01:30.000Z", "stop": "2024-05-13T01:01:32.000Z"}]
    assert entry["distance_m"] == pytest.approx(eventful.truth["arc_length"][-1])


def test_names_and_real_logs_are_checked_all_at_once(tmp_path: Path) -> None:
    trips = (
        Trip(Driver("a/b"), "one", FIRST_START, 1.0),
        Trip(Driver("Anna"), "..", FIRST_START, 1.0),
        Trip(Driver("Marek"), "one", FIRST_START, 1.0),
        Trip(Driver("Marek", lookahead_base=9.0), "one", FIRST_START, 1.0),
    )
    with pytest.raises(InputError) as caught:
        check_campaign(tmp_path, Campaign(trips))
    assert str(caught.value) == (
        f"{tmp_path}: nothing was simulated: Marek/one is there 2 times; 'a/b' cannot be the name of a folder; "
        "'..' cannot be the name of a folder; two drivers are called Marek. Choose other names or an empty folder"
    )

    real = tmp_path / "raw" / "Anna" / "one" / "can.log"
    real.parent.mkdir(parents=True)
    real.write_text("precious", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        simulate(tmp_path, Campaign((Trip(Driver("Anna"), "one", FIRST_START, 1.0),)))
    assert str(caught.value) == (
        f"{tmp_path}: nothing was simulated: raw/Anna/one is there and was not simulated. "
        "Choose other names or an empty folder"
    )
    assert content(tmp_path) == {"raw/Anna/one/can.log": b"precious"}


def test_too_many_emergencies_are_refused(tmp_path: Path) -> None:
    trip = Trip(Driver("Anna"), "one", FIRST_START, 0.5, emergencies=("swerve", "braking"))
    with pytest.raises(InputError) as caught:
        simulate(tmp_path, Campaign((trip,)))
    assert str(caught.value) == (
        f"{tmp_path}: Anna/one: 0.5 minutes on 50 roads have no room for 2 emergencies: swerve, braking. "
        "Ask for fewer of them or for more minutes"
    )


def test_demo_campaign() -> None:
    trips = demo_campaign().trips
    by_driver: dict[str, list[Trip]] = {}
    for trip in trips:
        by_driver.setdefault(trip.driver.name, []).append(trip)
    assert list(by_driver) == ["王伟", "Anna", "Marek", "Sofia"]
    for some in by_driver.values():
        assert 2 <= len(some) <= 3
        assert 8 <= sum(trip.minutes for trip in some) <= 10
        assert 2 <= sum(len(trip.emergencies) for trip in some) <= 3
    assert len({trip.clock.offset for trip in trips}) == len(trips)
    assert len({trip.driver.lookahead_base for trip in trips}) == 4


def test_drawn_campaign_grows_without_changing_what_was_there() -> None:
    small, large = draw_campaign(7, 2, 3, 5.0), draw_campaign(7, 3, 3, 5.0)
    assert small.trips == large.trips[:6]
    assert [trip.key for trip in small.trips[:4]] == [
        "driver01/drive01",
        "driver01/drive02",
        "driver01/drive03",
        "driver02/drive01",
    ]
    assert all(len(trip.emergencies) == 2 for trip in small.trips)
    assert draw_campaign(8, 2, 3, 5.0) != small
    assert {trip.clock.drift for trip in draw_campaign(7, 2, 1, 1.0, clock_offset=0.0, clock_drift=0.0).trips} == {0.0}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("minutes", [1.0, 2.0, 5.0])
def test_drawn_campaigns_have_room_for_their_emergencies(seed: int, minutes: float, tmp_path: Path) -> None:
    campaign = draw_campaign(seed, 1, 1, minutes)
    entry = simulate_recording(tmp_path, campaign, 0)
    assert len(entry["emergencies"]) == int(minutes // 2)


def test_navigation_on_the_second_bus(campaign: Campaign, tmp_path: Path) -> None:
    simulate(tmp_path, replace(campaign, trips=campaign.trips[:1], navigation="can"))
    assert sorted(path.name for path in (tmp_path / "raw" / "Anna" / "a").iterdir()) == ["can.log", "oxts.log"]
    assert 'database = ["byd_tang", "oxts"]' in (tmp_path / "wheelprint.toml").read_text()
    line = (tmp_path / "raw" / "Anna" / "a" / "oxts.log").read_text().partition("\n")[0]
    assert " can1 600#" in line
