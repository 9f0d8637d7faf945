"""The detectors on signals whose emergencies are known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
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
        name: pa.array(
            values, SYNCED.field(name).type, from_pandas=True, safe=False, mask=values < 0 if name == "run" else None
        )
        for name, values in signals.items()
    }
    return pa.table(columns, schema=SYNCED)


def pulse(samples: int, first: int, length: int, height: float) -> NDArray[np.float64]:
    values = np.zeros(samples)
    values[first : first + length] = height
    return values


def propose(tables: Mapping[str, pa.Table] | pa.Table, **settings: Any) -> list[Event]:
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
        ("lateral_acceleration", -6.1, "hard_cornering"),
        ("nav_lateral_acceleration", 6.1, "hard_cornering"),
        ("longitudinal_acceleration", 4.6, "hard_acceleration"),
        ("nav_longitudinal_acceleration", 4.6, "hard_acceleration"),
        ("brake_pedal", 85.1, "hard_braking"),
        ("abs_active", 1.0, "abs"),
        ("esc_active", 1.0, "esc"),
    ],
)
def test_every_signal_finds_its_emergency(signal: str, height: float, kind: str) -> None:
    found = propose(synced(600, **{signal: pulse(600, 200, 5, height)}), padding=0)
    assert seconds(found) == [(20.0, 20.5, kind)]
    assert signal in found[0].note


@pytest.mark.parametrize(
    ("signal", "height"),
    [
        ("longitudinal_acceleration", 4.5),
        ("longitudinal_acceleration", -5.0),
        ("brake_pressure", -4.0),
        ("lateral_acceleration", 6.0),
        ("abs_active", 0.0),
    ],
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
        (9.0, 14.5, "hard_cornering"),
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
    assert 0 < share <= Events().rarity
    assert any(e.start <= START + 900 * SECOND < e.stop for e in found)
    assert covered(time, propose(table, padding=0, rarity=0.999)).mean() > 0.4


def test_rarity_counts_over_all_recordings_of_the_driver() -> None:
    quiet = synced(18_000, lateral_acceleration=np.zeros(18_000))
    wild = synced(2000, lateral_acceleration=pulse(2000, 500, 200, 7.0))
    assert seconds(propose({"anna/ring": wild, "anna/town": quiet}, padding=0)) == [(50.0, 70.0, "hard_cornering")]
    assert propose({"anna/ring": wild}, padding=0) == []


def test_one_emergency_in_a_short_drive_stays_one() -> None:
    assert seconds(propose(synced(300, brake_pressure=pulse(300, 100, 30, 100.0)))) == [(9.0, 14.0, "hard_braking")]


def test_nothing_from_nothing() -> None:
    assert propose({}) == []
    assert propose(synced(0)) == []
    assert propose(synced(600)) == []


def test_an_emergency_lasts_until_its_quantity_has_left() -> None:
    braking = np.interp(
        np.arange(600), [0, 200, 210, 213, 214, 219, 220, 223, 230, 240], [0, 0, -6, -6, -4, -4, -6, -6, -4, 0]
    )
    table = synced(600, longitudinal_acceleration=braking)
    (one,) = propose(table, padding=0)
    inside = covered(START + np.arange(600) * PERIOD, [one])
    np.testing.assert_array_equal(inside, braking < -0.7 * 5)
    assert len(propose(table, padding=0, leave=1)) == 2


def test_what_swings_about_the_threshold_counts_in_all() -> None:
    braking = np.where(np.arange(600) % 2, -5.2, -4.8) * pulse(600, 200, 6, 1.0)
    assert seconds(propose(synced(600, longitudinal_acceleration=braking), padding=0)) == [(20.0, 20.6, "hard_braking")]
    assert propose(synced(600, longitudinal_acceleration=braking), minimum_duration=0.4) == []


def test_a_flag_of_the_car_counts_however_short_it_is() -> None:
    (one,) = propose(synced(600, esc_active=pulse(600, 200, 1, 1.0)), padding=0)
    assert (one.kind, one.severity, one.note) == ("esc", 2.0, "esc_active")
    assert one.stop - one.start == PERIOD


@pytest.mark.parametrize("name", ["lateral_acceleration", "nav_lateral_acceleration"])
def test_a_jerk_is_a_swerve(name: str) -> None:
    lateral = np.interp(np.arange(3600), [0, 300, 310, 316, 330, 3600], [0, 0, -5.5, 5.5, 0, 0])
    (one,) = propose(synced(3600, **{name: lateral}))
    assert (one.kind, one.note) == ("swerve", "lateral_jerk 18.3 m/s³ (threshold 15)")
    assert propose(synced(3600, **{name: lateral}), swerve_lateral_jerk=19) == []


def test_the_rate_of_the_speed_stands_in_for_acceleration() -> None:
    speed = np.interp(np.arange(600), [0, 200, 215, 600], [20, 20, 8, 8])
    (one,) = propose(synced(600, nav_speed=speed, speed=speed), padding=0)
    assert (one.kind, one.note) == ("hard_braking", "longitudinal_acceleration -8 m/s² (threshold 5)")
    known = np.zeros(600)
    assert propose(synced(600, nav_speed=speed, speed=speed, nav_longitudinal_acceleration=known)) == []


@pytest.mark.parametrize("name", ["yaw_rate", "nav_yaw_rate", "course"])
def test_speed_times_yaw_rate_stands_in_for_lateral_acceleration(name: str) -> None:
    yaw_rate = np.interp(np.arange(600), [0, 200, 220, 240, 260], [0, 0, 20, 20, 0])
    values = np.cumsum(yaw_rate) / 10 + 170
    (one,) = propose(synced(600, **{name: (values + 180) % 360 - 180 if name == "course" else yaw_rate}))
    assert one.kind == "hard_cornering"
    assert one.severity == pytest.approx(20 * np.radians(20) / 6, rel=0.01)


def winding(seed: int, samples: int = 3000) -> dict[str, NDArray[np.float64]]:
    """A car of 2.7 m, ratio 15, offset 2 deg and some understeer on a winding road; the yaw rate follows by 0.1 s."""
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(samples)
    speed = 14 + 6 * np.sin(t / 20)
    angle = 3 * np.sin(t / 3) * (10 / speed) ** 2
    yaw_rate = np.degrees(speed * np.tan(np.radians(angle)) / (2.7 + 0.002 * speed**2))
    return {
        "nav_speed": speed,
        "steering_wheel_angle": 15 * angle + 2 + rng.normal(0, 0.1, samples),
        "yaw_rate": np.roll(yaw_rate, 1) + rng.normal(0, 0.1, samples),
    }


def test_a_skid_is_a_yaw_rate_that_nobody_steered() -> None:
    signals = winding(3)
    assert propose(synced(3000, **signals)) == []
    skidding = signals | {"yaw_rate": signals["yaw_rate"] + pulse(3000, 1500, 8, 25.0)}
    (one,) = propose(synced(3000, **skidding), padding=0)
    assert (one.kind, seconds([one])) == ("skid", [(150.0, 150.8, "skid")])
    assert one.severity == pytest.approx(2.5, abs=0.25)
    assert one.note.startswith("yaw_rate_deviation 2")
    assert "deg/s (threshold 10)" in one.note
    assert [e.kind for e in propose(synced(3000, **skidding), skid=40)] == ["hard_cornering"]


def test_without_a_steering_that_can_be_told_nothing_skids() -> None:
    signals = winding(3) | {"steering_wheel_angle": np.zeros(3000)}
    assert propose(synced(3000, **signals)) == []


def test_reversing_shows_in_course_and_heading_in_the_speeds_sign_and_in_the_gear() -> None:
    slow = {"nav_speed": np.full(600, 2.0)}
    back = pulse(600, 200, 50, 1.0)
    course = (170 + 180 * back + 180) % 360 - 180
    braking = pulse(600, 200, 5, 90.0) + pulse(600, 245, 5, 90.0)
    expected = [(20.0, 25.0, "reversing")]
    found = propose(synced(600, **slow, course=course, heading=np.full(600, 170.0)))
    assert seconds(found) == expected
    assert (found[0].severity, found[0].decision) == (0.0, "proposed")
    assert seconds(propose(synced(600, **slow, speed=2 - 4 * back))) == expected
    assert propose(synced(600, **slow, gear=1 + back)) == []
    assert seconds(propose(synced(600, **slow, gear=1 + back, brake_pressure=braking), reverse_gears=[2])) == [
        (19.0, 20.0, "hard_braking"), *expected, (25.0, 26.0, "hard_braking"),
    ]  # fmt: skip


def test_navigation_is_distrusted_for_its_status_or_accuracy_but_for_emergencies_and_standstill() -> None:
    signals = {
        "nav_status": np.where(np.arange(600) < 100, 3.0, 4.0),
        "position_accuracy": np.where(np.abs(np.arange(600) - 350) < 50, 7.0, 0.5),
        "nav_speed": np.where(np.arange(600) < 30, 0.0, 20.0),
        "longitudinal_acceleration": pulse(600, 340, 10, -8.0),
    }
    found = propose(synced(600, **signals))
    assert seconds(found) == [
        (0.0, 3.0, "standstill"), (3.0, 10.0, "navigation"), (30.1, 33.0, "navigation"), (33.0, 36.0, "hard_braking"),
        (36.0, 40.0, "navigation"),
    ]  # fmt: skip
    assert [e.note for e in found if e.kind == "navigation"] == [
        "nav_status 3", "position_accuracy 7 m (threshold 5)", "position_accuracy 7 m (threshold 5)",
    ]  # fmt: skip
    assert {e.severity for e in found if e.kind == "navigation"} == {0.0}
    trusted = propose(synced(600, **signals), untrusted_status=[], navigation_accuracy=10)
    assert seconds(trusted) == [(0.0, 3.0, "standstill"), (33.0, 36.0, "hard_braking")]


@given(st.floats(0.9, 0.999), st.integers(0, 5))
def test_a_quantile_is_the_share_of_driving_outside_of_emergencies(quantile: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    braking = -np.abs(np.convolve(rng.normal(0, 2, 6008), np.ones(9) / 3, "valid"))
    settings = {"padding": 0, "minimum_duration": 0, "leave": 1.0}
    found = propose(synced(6000, longitudinal_acceleration=braking), hard_braking={"quantile": quantile}, **settings)
    inside = covered(START + np.arange(6000) * PERIOD, [e for e in found if e.kind == "hard_braking"])
    assert 0 <= 1 - quantile - inside.mean() < 2 / 6000
    assert (braking[inside].max(initial=-np.inf)) <= braking[~inside].min()


def test_a_quantile_has_its_floor_and_a_number_rises_to_that_of_rarity() -> None:
    braking = -np.abs(np.random.default_rng(1).normal(0, 3, 6000))
    table = synced(6000, longitudinal_acceleration=braking)
    settings = {"padding": 0, "minimum_duration": 0, "rarity": 0.01}
    as_number = propose(table, hard_braking=2.0, **settings)
    assert as_number
    assert as_number == propose(table, hard_braking={"at_least": 2.0, "quantile": 0.99}, **settings)
    assert propose(table, hard_braking={"at_least": 50.0, "quantile": 0.9}, **settings) == []


def test_nobody_who_never_brakes_brakes_hard() -> None:
    assert propose(synced(6000, brake_pressure=np.zeros(6000)), brake_pressure={"quantile": 0.5}) == []
