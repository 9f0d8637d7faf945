"""The detectors on signals whose emergencies are known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray

from wheelprint.dataset.detectors import propose_events
from wheelprint.dataset.events import Event, covered
from wheelprint.schemas.config import Events
from wheelprint.schemas.tables import SYNCED

PERIOD = 100_000_000
START = 1_795_420_800 * 10**9
SECOND = 10**9


def synced(samples: int, **signals: NDArray[np.float64]) -> pa.Table:
    """A synced table at 20 m/s of one run, with these signals in place."""
    columns: dict[str, Any] = {f.name: pa.nulls(samples, f.type) for f in SYNCED}
    columns["time"] = pa.array(START + np.arange(samples) * PERIOD).cast(SYNCED.field("time").type)
    columns["run"] = pa.array(np.zeros(samples, np.int32))
    columns["nav_speed"] = pa.array(np.full(samples, 20.0))
    columns |= {
        name: pa.array(values, SYNCED.field(name).type, from_pandas=True, mask=values < 0 if name == "run" else None)
        for name, values in signals.items()
    }
    return pa.table(columns, schema=SYNCED)


def pulse(samples: int, first: int, length: int, height: float) -> NDArray[np.float64]:
    values = np.zeros(samples)
    values[first : first + length] = height
    return values


def propose(tables: Mapping[str, pa.Table] | pa.Table, **settings: float) -> list[Event]:
    recordings = {"anna/ring": tables} if isinstance(tables, pa.Table) else tables
    return propose_events(recordings, Events.model_validate(settings), PERIOD)


def seconds(events: list[Event]) -> list[tuple[float, float, str]]:
    return [((e.start - START) / SECOND, (e.stop - START) / SECOND, e.kind) for e in events]


def test_hard_braking_with_padding_severity_and_note() -> None:
    braking = pulse(600, 100, 12, -8.0) + pulse(600, 105, 1, -1.5)
    assert propose(synced(600, longitudinal_acceleration=braking)) == [
        Event(
            "anna/ring", START + 9 * SECOND, START + 12_200_000_000, "hard_braking", 1.9, "proposed", "",
            "longitudinal_acceleration -9.5 m/s² (threshold 5)",
        )
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("signal", "height", "kind"),
    [
        ("longitudinal_acceleration", -5.1, "hard_braking"),
        ("nav_longitudinal_acceleration", -5.1, "hard_braking"),
        ("brake_pressure", 80.1, "hard_braking"),
        ("steering_wheel_speed", -361.0, "swerve"),
        ("steering_wheel_speed", 361.0, "swerve"),
        ("lateral_acceleration", -6.1, "swerve"),
        ("nav_lateral_acceleration", 6.1, "swerve"),
    ],
)
def test_every_signal_finds_its_emergency(signal: str, height: float, kind: str) -> None:
    found = propose(synced(600, **{signal: pulse(600, 200, 5, height)}), padding=0)
    assert seconds(found) == [(20.0, 20.5, kind)]
    assert signal in found[0].note


@pytest.mark.parametrize(
    ("signal", "height"),
    [("longitudinal_acceleration", 9.0), ("longitudinal_acceleration", -5.0), ("brake_pressure", -90.0)],
)
def test_the_other_sign_and_the_threshold_itself_are_no_emergency(signal: str, height: float) -> None:
    assert propose(synced(600, **{signal: pulse(600, 200, 20, height)})) == []


def test_the_steering_wheel_angle_stands_in_for_its_speed() -> None:
    angle = np.interp(np.arange(600), [0, 300, 305, 310, 600], [0, 0, 200, -10, -10])
    found = propose(synced(600, steering_wheel_angle=angle), padding=0)
    assert seconds(found) == [(30.1, 30.5, "swerve"), (30.6, 31.0, "swerve")]
    assert found[1].note == "steering_wheel_speed 420 deg/s (threshold 360)"


def test_the_angles_speed_is_not_taken_across_runs() -> None:
    run = np.repeat([0.0, 1.0], 300)
    angle = np.where(run == 0, 0.0, 500.0)
    assert propose(synced(600, steering_wheel_angle=angle, run=run), minimum_duration=0) == []


def test_short_excursions_are_ignored_and_runs_divide_them() -> None:
    braking = pulse(600, 100, 2, -9.0) + pulse(600, 200, 3, -9.0) + pulse(600, 300, 4, -9.0)
    run = np.where(np.arange(600) < 302, 0.0, 1.0)
    run[600 - 1] = -1.0
    found = propose(synced(600, longitudinal_acceleration=braking, run=run), padding=0)
    assert seconds(found) == [(20.0, 20.3, "hard_braking")]


def test_nothing_is_proposed_in_gaps_and_paddings_end_with_the_recording() -> None:
    braking = pulse(600, 0, 5, -9.0) + pulse(600, 300, 10, -9.0) + pulse(600, 590, 10, -9.0)
    run = np.where(abs(np.arange(600) - 305) < 20, -1.0, np.where(np.arange(600) < 300, 0.0, 1.0))
    found = propose(synced(600, longitudinal_acceleration=braking, run=run))
    assert seconds(found) == [(0.0, 1.5, "hard_braking"), (58.0, 60.0, "hard_braking")]


def test_touching_proposals_become_one_of_the_worst_kind() -> None:
    table = synced(
        900,
        longitudinal_acceleration=pulse(900, 100, 5, -6.0) + pulse(900, 130, 5, -7.0),
        lateral_acceleration=pulse(900, 125, 10, 12.0),
        brake_pressure=pulse(900, 500, 10, 100.0) + pulse(900, 531, 10, 90.0),
    )
    found = propose(table)
    assert seconds(found) == [
        (9.0, 14.5, "swerve"),
        (49.0, 52.0, "hard_braking"),
        (52.1, 55.1, "hard_braking"),
    ]
    assert (found[0].severity, found[0].note) == (
        2.0,
        "lateral_acceleration 12 m/s² (threshold 6); longitudinal_acceleration -7 m/s² (threshold 5)",
    )


def test_standing_is_an_event_of_its_own_where_paddings_end() -> None:
    speed = np.interp(np.arange(900), [0, 300, 315, 500, 550, 900], [12, 12, 0, 0, 12, 12])
    table = synced(
        900,
        nav_speed=speed,
        longitudinal_acceleration=pulse(900, 300, 15, -8.0),
        brake_pressure=pulse(900, 400, 50, 120.0),
        steering_wheel_speed=pulse(900, 420, 20, 500.0),
    )
    found = propose(table)
    assert seconds(found) == [(29.0, 31.4, "hard_braking"), (31.4, 50.5, "standstill")]
    assert found[1] == Event(
        "anna/ring", START + 31_400_000_000, START + 50_500_000_000, "standstill", 0.0, "proposed", "", "below 1 m/s"
    )


def test_the_cars_speed_stands_in_for_navigations() -> None:
    nav_speed = np.where(np.arange(600) < 300, np.nan, 20.0)
    table = synced(600, nav_speed=nav_speed, speed=np.full(600, -0.5))
    assert seconds(propose(table)) == [(0.0, 30.0, "standstill")]


def test_without_any_speed_everything_is_driving() -> None:
    table = synced(600, nav_speed=np.full(600, np.nan), brake_pressure=pulse(600, 100, 10, 100.0))
    assert seconds(propose(table)) == [(9.0, 12.0, "hard_braking")]


def test_turning_the_wheel_fast_while_manoeuvring_is_no_swerve() -> None:
    table = synced(600, nav_speed=np.full(600, 4.0), steering_wheel_speed=pulse(600, 100, 20, 600.0))
    assert propose(table) == []
    assert seconds(propose(table, swerve_speed=3.0, padding=0)) == [(10.0, 12.0, "swerve")]


def ordinary(seed: int) -> pa.Table:
    """Twenty minutes in town and on a main road, at the upper end of what ordinary drivers do."""
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(12_000)
    speed = 12 + 10 * np.sin(2 * np.pi * t / 90)
    angle = 250 * np.sin(2 * np.pi * t / 7) * np.exp(-((speed / 8) ** 2)) + 10 * np.sin(t)
    return synced(
        12_000,
        nav_speed=speed,
        longitudinal_acceleration=np.gradient(speed, 0.1) * 3.5 + rng.normal(0, 0.3, 12_000),
        lateral_acceleration=3.5 * np.sin(t / 3) + rng.normal(0, 0.4, 12_000),
        brake_pressure=np.clip(-np.gradient(speed, 0.1), 0, None) * 20,
        steering_wheel_angle=angle,
    )


def test_ordinary_driving_is_left_alone() -> None:
    assert propose(ordinary(0)) == []


def test_a_racing_driver_is_not_cut_to_pieces_but_their_worst_moments_are_found() -> None:
    rng = np.random.default_rng(1)
    lateral = 11 * np.sin(2 * np.pi * 0.1 * np.arange(18_000) / 9) + rng.normal(0, 0.3, 18_000)
    spin = pulse(18_000, 9000, 8, 14.0)
    table = synced(18_000, lateral_acceleration=np.where(spin > 0, spin, lateral))
    time = START + np.arange(18_000) * PERIOD
    found = propose(table, padding=0)
    share = covered(time, found).mean()
    assert share <= 0.02
    assert any(e.start <= START + 900 * SECOND < e.stop for e in found)
    assert covered(time, propose(table, padding=0, rarity=0.999)).mean() > 0.4


def test_rarity_counts_over_all_recordings_of_the_driver() -> None:
    quiet = synced(18_000, lateral_acceleration=np.zeros(18_000))
    wild = synced(2000, lateral_acceleration=pulse(2000, 500, 200, 7.0))
    assert seconds(propose({"anna/ring": wild, "anna/town": quiet}, padding=0)) == [(50.0, 70.0, "swerve")]
    assert propose({"anna/ring": wild}, padding=0) == []


def test_one_emergency_in_a_short_drive_stays_one() -> None:
    assert seconds(propose(synced(300, brake_pressure=pulse(300, 100, 30, 100.0)))) == [(9.0, 14.0, "hard_braking")]


def test_nothing_from_nothing() -> None:
    assert propose({}) == []
    assert propose(synced(0)) == []
    assert propose(synced(600)) == []
