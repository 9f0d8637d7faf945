"""The clock estimate, on simulated drives whose offset and drift are known."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.ingest.clock import ClockEstimate, Series, estimate_clock, to_utc

SECOND = 10**9
EPOCH = 1_700_000_000 * SECOND
ADVICE = "; if the offset is known, give it as sync.clock in seconds"


@dataclass(frozen=True)
class Drive:
    """What both logs say of one drive, and the truth: CAN stamp - UTC at the first CAN stamp in s, and ppm."""

    can_speed: Series
    can_yaw_rate: Series
    nav_speed: Series
    nav_yaw_rate: Series
    offset: float
    drift: float


def wander(rng: np.random.Generator, seconds: int, every: float) -> npt.NDArray[np.float64]:
    """A smooth random signal at 50 Hz with unit variance and a time scale of `every` seconds."""
    width = int(every * 50)
    kernel = np.hanning(4 * width)
    signal = np.convolve(rng.standard_normal(seconds * 50 + len(kernel) - 1), kernel, "valid")
    return np.asarray(signal / np.sqrt((kernel**2).sum()))


def drop_outs(rng: np.random.Generator, time: npt.NDArray[np.float64], share: float) -> npt.NDArray[np.bool_]:
    """Single lost samples, and two or three longer gaps."""
    kept = rng.random(len(time)) > share
    for start in rng.uniform(0, time[-1], 3):
        kept &= (time < start) | (time > start + rng.uniform(0.3, 6))
    return kept


def simulate(
    seed: int, minutes: float, offset: float | None = None, drift: float | None = None, nav_rate: int = 50
) -> Drive:
    """A drive in town with stops: wheel speed of a worn tyre in steps of 0.07 km/h, noise and drop-outs everywhere."""
    rng = np.random.default_rng(seed)
    seconds = int(60 * minutes)
    offset = rng.uniform(-2, 2) if offset is None else offset
    drift = rng.uniform(-100, 100) if drift is None else drift
    fine = np.arange(seconds * 50) / 50
    speed = np.maximum(11 + 7 * wander(rng, seconds, 8) + 0.5 * wander(rng, seconds, 2), 0)
    yaw_rate = 0.8 * speed * wander(rng, seconds, 3)

    nav = np.arange(0.4, seconds - 1, 1 / nav_rate)
    nav = nav[drop_outs(rng, nav, 0.002)]
    nav_time = EPOCH + np.rint(nav * SECOND).astype(np.int64)
    nav_speed = np.abs(np.interp(nav, fine, speed) + 0.02 * rng.standard_normal(len(nav)))
    nav_yaw_rate = np.interp(nav, fine, yaw_rate) + 0.05 * rng.standard_normal(len(nav))

    can = np.sort(
        np.arange(0.7, seconds - 2, 0.05) + rng.uniform(-0.005, 0.005, len(np.arange(0.7, seconds - 2, 0.05)))
    )
    can = can[drop_outs(rng, can, 0.02)]
    can_time = EPOCH + np.rint((can + offset + 1e-6 * drift * (can - can[0])) * SECOND).astype(np.int64)
    step = 0.07 / 3.6
    can_speed = np.rint((0.98 * np.interp(can, fine, speed) + 0.05 * rng.standard_normal(len(can))) / step) * step
    can_speed[can_speed < 0.7] = 0
    can_yaw_rate = 1.03 * np.interp(can, fine, yaw_rate) + 0.4 + 0.3 * rng.standard_normal(len(can))
    return Drive(
        (can_time, can_speed), (can_time, can_yaw_rate), (nav_time, nav_speed), (nav_time, nav_yaw_rate), offset, drift
    )


def estimate(drive: Drive, *, with_yaw_rate: bool = True) -> ClockEstimate:
    return estimate_clock(
        *drive.can_speed,
        *drive.nav_speed,
        can_yaw_rate=drive.can_yaw_rate if with_yaw_rate else None,
        nav_yaw_rate=drive.nav_yaw_rate if with_yaw_rate else None,
    )


def error_ms(drive: Drive, found: ClockEstimate) -> float:
    """Largest error of the UTC stamps, at either end of the recording."""
    first, last = drive.can_speed[0][[0, -1]].tolist()
    elapsed = (last - first) / SECOND / (1 + 1e-6 * drive.drift)
    true_first = first - round(drive.offset * SECOND)
    true_last = true_first + round(elapsed * SECOND)
    errors = to_utc(np.array([first, last]), found) - np.array([true_first, true_last])
    return float(np.abs(errors).max() / 1e6)


@pytest.fixture(scope="module")
def town() -> Drive:
    return simulate(3, 5)


@pytest.fixture
def believing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Estimates of which three standard errors exceed 10 ms are applied all the same."""
    monkeypatch.setattr("wheelprint.ingest.clock.TOLERANCE_S", 0.060)


@pytest.mark.parametrize(("seed", "minutes"), [(2, 3), (3, 4), (4, 5), (5, 6), (6, 8), (7, 10), (8, 15), (9, 30)])
def test_offset_and_drift_are_found(seed: int, minutes: float) -> None:
    drive = simulate(seed, minutes)
    found = estimate(drive)
    assert found.applied, found.reason
    assert found.correlation is not None
    assert found.correlation > 0.99
    assert found.standard_error_ms is not None
    assert abs(found.offset_s - drive.offset) < 0.010
    assert error_ms(drive, found) < 3.5 * found.standard_error_ms


def test_speed_alone_is_enough() -> None:
    for seed in range(10, 16):
        drive = simulate(seed, 15)
        found = estimate(drive, with_yaw_rate=False)
        assert found.applied, found.reason
        assert abs(found.offset_s - drive.offset) < 0.010


@pytest.mark.usefixtures("believing")
def test_standard_errors_are_neither_boasts_nor_excuses() -> None:
    ratios = []
    for seed in range(20, 36):
        drive = simulate(seed, 3)
        found = estimate(drive)
        assert found.standard_error_ms is not None
        ratios.append(error_ms(drive, found) / found.standard_error_ms)
    assert 0.4 < np.sqrt(np.mean(np.square(ratios))) < 1.6


@pytest.mark.usefixtures("believing")
def test_short_recordings_keep_the_drift_near_zero_and_long_ones_find_it() -> None:
    for seed in range(40, 46):
        assert abs(estimate(simulate(seed, 1.5, drift=0)).drift_ppm) < 100
    assert estimate(simulate(40, 20, drift=80)).drift_ppm == pytest.approx(80, abs=4)


def test_shifting_the_stamps_shifts_the_offset_and_nothing_else(town: Drive) -> None:
    base = estimate(town)
    for seconds in (3, -5, 8 * 3600, -1_700_000_000):
        shift = seconds * SECOND
        moved = replace(
            town,
            can_speed=(town.can_speed[0] + shift, town.can_speed[1]),
            can_yaw_rate=(town.can_yaw_rate[0] + shift, town.can_yaw_rate[1]),
        )
        found = estimate(moved)
        assert found.applied
        assert found.offset_s - base.offset_s == pytest.approx(seconds, abs=2e-4)
        np.testing.assert_allclose(to_utc(moved.can_speed[0], found), to_utc(town.can_speed[0], base), atol=3e5, rtol=0)


def test_scale_bias_and_sign_of_the_car_do_not_matter(town: Drive) -> None:
    time, speed = town.can_speed
    _, yaw_rate = town.can_yaw_rate
    odd = replace(town, can_speed=(time, 3.6 * speed), can_yaw_rate=(time, 5 - 0.5 * yaw_rate))
    found, base = estimate(odd), estimate(town)
    assert found.offset_s == pytest.approx(base.offset_s, abs=1e-6)
    assert found.standard_error_ms == pytest.approx(base.standard_error_ms, rel=1e-3)


@pytest.mark.usefixtures("believing")
def test_wild_samples_hardly_matter(town: Drive) -> None:
    rng = np.random.default_rng(0)
    time, speed = town.can_speed
    wild = np.where(rng.random(len(speed)) < 0.003, 0.0, speed)
    found = estimate(replace(town, can_speed=(time, wild)))
    assert found.applied
    assert error_ms(town, found) < 10


def test_missing_samples_and_their_order_do_not_matter(town: Drive) -> None:
    time, speed = town.can_speed
    extra = np.full(50, np.nan)
    jumbled = np.random.default_rng(0).permutation(len(time) + 50)
    longer = (np.concatenate((time, time[:50] + 1000))[jumbled], np.concatenate((speed, extra))[jumbled])
    assert estimate(replace(town, can_speed=longer)).offset_s == estimate(town).offset_s


@pytest.mark.usefixtures("believing")
def test_the_reason_names_what_each_signal_says(town: Drive) -> None:
    found = estimate(town)
    speed = estimate(town, with_yaw_rate=False)
    assert speed.reason == f"estimated from speed ({speed.offset_s:.3f} ± {(speed.standard_error_ms or 0) / 1e3:.3f} s)"
    assert re.fullmatch(
        r"estimated from speed \(-?\d\.\d{3} ± 0\.0\d\d s\) and yaw rate \(-?\d\.\d{3} ± 0\.0\d\d s\)", found.reason
    )


def refuses(found: ClockEstimate, reason: str) -> None:
    assert found.reason == reason
    assert not found.applied
    assert (found.offset_s, found.drift_ppm) == (0.0, 0.0)
    stamps = np.array([EPOCH, EPOCH + 1, EPOCH + 3600 * SECOND])
    np.testing.assert_array_equal(to_utc(stamps, found), stamps)


def test_another_drive_is_refused(town: Drive) -> None:
    other = simulate(50, 5)
    for drive in (town, replace(town, nav_speed=(town.nav_speed[0] + 10**6 * SECOND, town.nav_speed[1]))):
        mixed = replace(drive, can_speed=other.can_speed)
        found = estimate(mixed, with_yaw_rate=False)
        assert not found.applied
        assert found.reason.endswith(ADVICE)


def test_too_short_an_overlap_is_refused(town: Drive) -> None:
    time, speed = town.can_speed
    short = replace(town, can_speed=(time[:400], speed[:400]))
    refuses(
        estimate(short, with_yaw_rate=False),
        "no overlap: CAN and navigation have less than 30 s of driving in common within ±10 s, and do not agree "
        f"elsewhere{ADVICE}",
    )


def test_a_constant_speed_is_refused(town: Drive) -> None:
    time, speed = town.can_speed
    cruising = replace(town, can_speed=(time, np.full_like(speed, 20.0)))
    refuses(
        estimate(cruising, with_yaw_rate=False),
        f"too little excitation: neither speed nor yaw rate changes{ADVICE}",
    )


def test_noise_about_a_constant_speed_is_refused() -> None:
    rng = np.random.default_rng(1)
    time = EPOCH + np.arange(0, 300 * SECOND, SECOND // 20)
    found = estimate_clock(
        time, 20 + 0.05 * rng.standard_normal(len(time)), time, 20 + 0.02 * rng.standard_normal(len(time))
    )
    assert not found.applied
    assert found.offset_s == 0
    assert found.reason.startswith("CAN and navigation do not agree: correlation 0.")


def test_weak_excitation_is_refused_with_its_standard_error() -> None:
    rng = np.random.default_rng(2)
    time = EPOCH + np.arange(0, 60 * SECOND, SECOND // 20)
    speed = 20 + 0.25 * np.sin(2 * np.pi * np.arange(len(time)) / 20 / 35)
    found = estimate_clock(time, speed + 0.02 * rng.standard_normal(len(time)), time, speed)
    assert not found.applied
    assert found.reason == (
        f"too little excitation: the offset {found.reason.split()[5]} s has a standard error of "
        f"{found.standard_error_ms:.0f} ms, and three of them are more than 60 ms{ADVICE}"
    )


def test_a_periodic_drive_is_ambiguous() -> None:
    time = EPOCH + np.arange(0, 300 * SECOND, SECOND // 20)
    speed = 15 + 3 * np.sin(2 * np.pi * np.arange(len(time)) / 20 / 4)
    found = estimate_clock(time, speed, time, speed)
    assert not found.applied
    assert found.reason.startswith("ambiguous: offsets of ")
    assert found.reason.endswith(f" s explain the signals alike{ADVICE}")


def stepped(drive: Drive, size: int, at: float = 0.5, gap_s: float = 0.0) -> Drive:
    """The CAN clock is set by `size` ns at a share of the recording, while nothing is logged for a while."""

    def after(series: Series) -> Series:
        time, values = series
        middle = int(time[0] + at * (time[-1] - time[0]))
        kept = (time < middle) | (time >= middle + gap_s * SECOND)
        return np.where(time < middle, time, time + size)[kept], values[kept]

    return replace(drive, can_speed=after(drive.can_speed), can_yaw_rate=after(drive.can_yaw_rate))


@pytest.mark.parametrize("with_yaw_rate", [True, False])
@pytest.mark.parametrize(
    ("size_s", "gap_s"),
    [(0.08, 0.0), (0.4, 0.0), (-0.4, 0.0), (-0.08, 0.0), (3.0, 0.0), (-25.0, 0.0), (-3.0, 8.0), (-1.7e9, 0.0)],
)
def test_a_clock_that_was_set_on_the_way_is_found_with_place_and_size(
    town: Drive, size_s: float, gap_s: float, *, with_yaw_rate: bool
) -> None:
    """Forwards, backwards, over a stretch that was logged before, in a drop-out, and a logger that began anew."""
    drive = simulate(3, 8) if abs(size_s) < 0.1 else town
    found = estimate(stepped(drive, round(size_s * SECOND), gap_s=gap_s), with_yaw_rate=with_yaw_rate)
    assert not found.applied
    assert (found.offset_s, found.drift_ppm) == (0.0, 0.0)
    (step,) = found.steps
    first, last = drive.can_speed[0][[0, -1]].tolist()
    assert step.size_s == pytest.approx(size_s, abs=0.03)
    # Where the gap hides it, the step is said to be at the last stamp before.
    assert abs(step.time - (first + last) / 2) < 1.0 * SECOND
    place = datetime.fromtimestamp(step.time // SECOND, UTC).strftime("%Y-%m-%dT%H:%M:%S")
    assert found.reason == (
        f"the CAN clock was set on the way, by {step.size_s:+.3f} s after its stamp "
        f"{place}.{step.time % SECOND // 10**6:03d}Z; nothing is applied: cut the log there, and give each part a "
        "recording of its own"
    )


def test_a_drop_out_is_no_step_and_the_order_of_files_none_either(town: Drive) -> None:
    time, values = town.can_speed
    kept = (time < time[2000]) | (time > time[2400])
    gap = replace(town, can_speed=(time[kept], values[kept]))
    cut = len(time) // 2
    swapped = replace(
        town,
        can_speed=(np.concatenate((time[cut:], time[:cut])), np.concatenate((values[cut:], values[:cut]))),
    )
    for drive in (gap, swapped):
        found = estimate(drive)
        assert found.applied, found.reason
        assert found.steps == ()
        assert error_ms(town, found) < 10


def test_a_step_back_near_the_end_is_said_although_the_rest_is_too_short_to_align(town: Drive) -> None:
    drive = stepped(town, -2 * SECOND, at=0.97)
    found = estimate(drive, with_yaw_rate=False)
    (step,) = found.steps
    assert step.size_s == pytest.approx(-1.95, abs=0.05)
    assert not found.applied
    assert found.reason.startswith(f"the stamps of CAN go back {step}: its clock was set, or the logger began anew")


def test_stamps_that_no_drive_has(town: Drive) -> None:
    time = town.can_speed[0].copy()
    time[:10] = np.arange(10)
    refuses(
        estimate(replace(town, can_speed=(time, town.can_speed[1]))),
        "the stamps of CAN span 19676 days, its clock was set on the way",
    )


def test_repeated_stamps_are_counted(town: Drive) -> None:
    time, speed = town.can_speed
    again = np.repeat(np.arange(len(time)), np.where(np.arange(len(time)) % 100 == 0, 2, 1))
    found = estimate(replace(town, can_speed=(time[again], speed[again])))
    assert found.applied
    assert found.repeated_stamps == len(again) - len(time)
    assert found.reason.endswith(
        f"; {found.repeated_stamps} stamps of CAN are repeated, of each the last sample counts"
    )
    assert found.offset_s == estimate(town).offset_s


ROLLED_OVER = "navigation's dates are 1024 weeks behind CAN's: its GPS week rolled over, or it counts from another one"


@pytest.mark.parametrize(
    ("offset_s", "said"),
    [
        (8 * 3600, "the stamps of CAN look like local time, UTC+8"),
        (-3.5 * 3600, "the stamps of CAN look like local time, UTC-3:30"),
        (18, "the stamps of CAN look like GPS time, 18 s ahead of UTC"),
        (1024 * 7 * 86400, ROLLED_OVER),
        (-120, "the clocks are 2 whole min apart: a GPS minute may have been miscounted"),
    ],
)  # fmt: skip
def test_the_reason_says_which_clock_it_looks_like(town: Drive, offset_s: float, said: str) -> None:
    off = round((offset_s - town.offset) * SECOND)
    drive = replace(
        town,
        can_speed=(town.can_speed[0] + off, town.can_speed[1]),
        can_yaw_rate=(town.can_yaw_rate[0] + off, town.can_yaw_rate[1]),
    )
    found = estimate(drive)
    assert found.applied
    assert found.offset_s == pytest.approx(offset_s, abs=0.01)
    assert found.reason.endswith(f"; {said}")


def by_steering(drive: Drive) -> ClockEstimate:
    """The steering wheel angle of a car with some understeer, and nothing else on the bus."""
    can_time, can_yaw_rate = drive.can_yaw_rate
    speed = np.maximum(drive.can_speed[1], 1.0)
    angle = 15.0 * (2.8 + 0.002 * speed**2) * can_yaw_rate / speed
    nothing = np.array([], np.int64), np.array([])
    return estimate_clock(
        *nothing, *drive.nav_speed, nav_yaw_rate=drive.nav_yaw_rate, can_steering=(can_time, np.asarray(angle))
    )


def test_steering_is_the_last_resort() -> None:
    drive = simulate(7, 10, offset=1.5)
    found = by_steering(drive)
    assert (found.applied, found.offset_s, found.drift_ppm) == (False, 0.0, 0.0)
    assert found.standard_error_ms == pytest.approx(100, abs=1)
    said = re.fullmatch(
        r"steering tells no more: (\d\.\d\d\d) s, give or take the 0\.1 s or so by which the yaw rate follows it; "
        "map speed or yaw rate; if the offset is known, give it as sync.clock in seconds",
        found.reason,
    )
    assert said is not None
    assert float(said[1]) == pytest.approx(1.5, abs=0.02)
    both = estimate_clock(
        *drive.can_speed, *drive.nav_speed, nav_yaw_rate=drive.nav_yaw_rate, can_steering=drive.can_yaw_rate
    )
    assert "steering" not in both.reason


def test_steering_does_not_tell_a_small_offset_from_its_lead() -> None:
    found = by_steering(simulate(7, 10, offset=0.1))
    assert not found.applied
    assert (found.offset_s, found.drift_ppm) == (0.0, 0.0)
    assert re.fullmatch(
        r"steering agrees with an offset of 0: 0\.[01]\d\d s, give or take the 0\.1 s or so by which the yaw rate "
        "follows it; map speed or yaw rate; if the offset is known, give it as sync.clock in seconds",
        found.reason,
    )


def test_standing_still_says_nothing(town: Drive) -> None:
    parked = replace(
        town,
        can_speed=(town.can_speed[0], np.zeros(len(town.can_speed[0]))),
        nav_speed=(town.nav_speed[0], np.full(len(town.nav_speed[0]), 0.03)),
    )
    refuses(estimate(parked, with_yaw_rate=False), "CAN and navigation have no driving in common that both measured")
    nothing = (np.empty(0, np.int64), np.empty(0))
    refuses(
        estimate(replace(town, can_speed=nothing), with_yaw_rate=False),
        "CAN and navigation have no driving in common that both measured",
    )


def test_given_offsets() -> None:
    stamps = np.array([EPOCH, EPOCH + 1, EPOCH + 123_456_789_123_456_789], np.int64)
    trusted = ClockEstimate.trusted("the project file says so")
    np.testing.assert_array_equal(to_utc(stamps, trusted), stamps)
    assert not trusted.applied
    fixed = ClockEstimate.fixed(-1.25, "the project file says so")
    np.testing.assert_array_equal(to_utc(stamps, fixed), stamps + 1_250_000_000)
    assert fixed.applied


@given(
    st.integers(0, 2**62), st.lists(st.integers(0, 4 * 3600 * SECOND)), st.integers(-(10**10), 10**10),
    st.floats(-300, 300),
)  # fmt: skip
def test_utc_is_exact_to_a_nanosecond(reference: int, elapsed: list[int], offset_ns: int, drift: float) -> None:
    estimate = replace(ClockEstimate.fixed(offset_ns / SECOND, ""), drift_ppm=drift, reference=reference)
    stamps = np.array([reference + e for e in elapsed], np.int64)
    found = to_utc(stamps, estimate)
    assert found.dtype == np.int64
    for utc, e in zip(found.tolist(), elapsed, strict=True):
        assert abs(utc - (reference + e - offset_ns) + e * drift * 1e-6) <= 0.501
