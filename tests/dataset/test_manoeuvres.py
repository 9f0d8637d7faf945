"""Lane changes, turns and highways on drives that are known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray

from wheelprint.dataset.events import Event
from wheelprint.dataset.manoeuvres import propose_situations
from wheelprint.dataset.situations import Situation
from wheelprint.schemas.angles import wrap_degrees
from wheelprint.schemas.config import Situations
from wheelprint.schemas.tables import SYNCED

PERIOD = 100_000_000
SECOND = 10**9
START = 1_795_420_800 * SECOND
Floats = NDArray[np.float64]


def synced(course: Floats, speed: Floats | float, run: Floats | float = 0.0) -> pa.Table:
    samples = len(course)
    columns: dict[str, Any] = {f.name: pa.nulls(samples, f.type) for f in SYNCED}
    columns["time"] = pa.array(START + np.arange(samples) * PERIOD).cast(SYNCED.field("time").type)
    columns["run"] = pa.array(np.broadcast_to(run, samples), pa.int32(), from_pandas=True, safe=False)
    columns["nav_speed"] = pa.array(np.broadcast_to(speed, samples), pa.float64())
    columns["course"] = pa.array(wrap_degrees(course), pa.float64())
    return pa.table(columns, schema=SYNCED)


def propose(table: pa.Table, *left_out: Event, **settings: Any) -> list[Situation]:
    return propose_situations({"anna/ring": table}, left_out, Situations.model_validate(settings), PERIOD)


def seconds(found: list[Situation]) -> list[tuple[float, float, str]]:
    return [((s.start - START) / SECOND, (s.stop - START) / SECOND, s.situation) for s in found]


def lane_change(samples: int, first: int, length: int, width: float, speed: float) -> Floats:
    """Course of a car that goes sideways as sin²: by `width` m, to the left, in `length` samples."""
    share = np.clip((np.arange(samples) - first) / length, 0, 1)
    sideways = width * (1 - np.cos(2 * np.pi * share)) / (length / 10)
    return np.degrees(np.arcsin(sideways / speed))


@pytest.mark.parametrize("speed", [12.0, 20.0])
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("direction", [0.0, 179.0])
def test_a_lane_change(side: int, direction: float, speed: float) -> None:
    noise = np.random.default_rng(1).normal(0, 0.04, 900)
    course = direction + side * lane_change(900, 400, 50, 3.5, speed) + noise
    (one,) = propose(synced(course, speed))
    assert (one.recording, one.situation, one.decision) == ("anna/ring", "lane change", "proposed")
    assert one.note.endswith("m to the left" if side > 0 else "m to the right")
    assert START + 39 * SECOND < one.start < START + 42 * SECOND
    assert START + 43 * SECOND < one.stop < START + 46 * SECOND


@pytest.mark.parametrize(
    "course",
    [
        lane_change(900, 400, 50, 1.5, 15.0),
        np.interp(np.arange(900), [0, 300, 400, 900], [0, 0, 40, 40]),
        np.interp(np.arange(900), [0, 900], [0, 300]),
        np.repeat([0.0, 1.2], 450),
        np.random.default_rng(2).normal(0, 0.3, 900),
    ],
    ids=["too narrow", "bend", "circle", "kink", "noise"],
)
def test_what_is_no_lane_change(course: Floats) -> None:
    assert propose(synced(course, 15.0)) == []


def test_there_and_back_are_two() -> None:
    course = lane_change(900, 400, 50, 3.5, 15.0) - lane_change(900, 450, 50, 3.5, 15.0)
    there, back = propose(synced(course, 15.0))
    assert there.note.endswith("to the left")
    assert back.note.endswith("to the right")


def test_going_round_something_slowly_is_no_lane_change() -> None:
    assert propose(synced(lane_change(900, 400, 50, 3.5, 6.0), 6.0)) == []


@pytest.mark.parametrize("side", [1, -1])
def test_a_turn_at_an_intersection(side: int) -> None:
    course = 150 + side * np.interp(np.arange(900), [0, 400, 440, 900], [0, 0, 90, 90])
    (one,) = propose(synced(course, 5.0))
    assert seconds([one]) == [(40.1, 44.1, "intersection")]
    assert one.note == f"turns by {side * 90} deg"
    assert propose(synced(course, 5.0), turn_angle=95) == []
    assert propose(synced(course, 5.0), turn_radius=10) == []
    assert propose(synced(course, 5.0), names=["highway", "lane change"]) == []


def test_highway_but_for_lane_changes_and_what_is_left_out() -> None:
    speed = np.interp(np.arange(2000), [0, 100, 150, 1400, 1450, 1500, 1600, 2000], [15, 15, 27, 27, 15, 15, 27, 27])
    found = propose(synced(lane_change(2000, 700, 50, 3.5, 27.0), speed))
    assert [one.situation for one in found] == ["highway", "lane change", "highway", "highway"]
    assert found[0].stop == found[1].start
    assert found[1].stop == found[2].start
    event = Event("anna/ring", START + 65 * SECOND, START + 80 * SECOND, "swerve", 1.5, "proposed", "", "")
    found = propose(synced(lane_change(2000, 700, 50, 3.5, 27.0), speed), event)
    assert [one.situation for one in found] == ["highway", "highway", "highway"]
    assert (found[0].stop, found[1].start) == (event.start, event.stop)


def test_nothing_reaches_across_runs() -> None:
    course = lane_change(900, 400, 50, 3.5, 15.0)
    run = np.repeat([0.0, 1.0], [425, 475])
    assert propose(synced(course, 15.0, run)) == []
    gap = np.where(np.abs(np.arange(900) - 425) < 3, np.nan, 0.0)
    assert propose(synced(course, 15.0, gap)) == []


def test_nothing_from_nothing() -> None:
    assert propose(synced(np.zeros(0), 1.0)) == []
    assert propose(synced(np.zeros(30), np.nan)) == []
