"""How well the clocks and the steering of simulated campaigns come back: `python benchmarks/clock_recovery.py SEEDS`.

Each seed is a campaign of one car (its own steering ratio, offset and understeer) with two recordings of different
drivers on different roads, one of 2 to 30 minutes, one of 30 to 60, with town, ring road and highway, red lights, a
standstill at the beginning, emergencies, a drop-out of the CAN log and one of navigation, a CAN clock with an offset of
-2 to 2 s and a drift of -100 to 100 ppm. Signals are what the readers give: noise, sampling, jitter, quantisation and
gaps are the simulator's. It does not simulate latency of the bus or of navigation, slip of the tyres, worn tyres,
slopes, or a clock whose drift changes on the way.

The clock is estimated from speed and yaw rate, and in the short recordings once more from less than that.
It must hold that every estimate from speed or yaw rate is within 10 ms from the first stamp to the last and, in
recordings of half an hour or more, within 5 ppm, or else is not applied; that in 95 % of the campaigns both clocks from
speed and yaw rate are within; and that the steering ratio is within 1 % and its offset within 0.2 deg in every
campaign. It ends 1 where it does not. Steering as the only signal tells a tenth of a second: it may never be applied.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wheelprint.dataset.calibration import estimate_steering
from wheelprint.dataset.steering import steering_series
from wheelprint.ingest.clock import ClockEstimate, estimate_clock, to_utc
from wheelprint.modeling.simulation.campaign import Campaign, draw_campaign
from wheelprint.modeling.simulation.car import Car
from wheelprint.modeling.simulation.driver import Emergency
from wheelprint.modeling.simulation.logs import CanClock
from wheelprint.modeling.simulation.recorded import Recorded, record_trip, synced_table

OFFSET_MS, DRIFT_PPM, LONG_MINUTES = 10.0, 5.0, 30.0
RATIO_PERCENT, STEERING_OFFSET_DEG = 1.0, 0.2
REQUIRED = 0.95
PERIOD, MAX_GAP = 100_000_000, 500_000_000
EMERGENCIES: tuple[Emergency, ...] = ("braking", "swerve", "braking")
SOURCES = {
    "speed and yaw rate": ("speed", "yaw_rate"),
    "speed": ("speed",),
    "yaw rate": ("yaw_rate",),
    "steering": ("steering_wheel_angle",),
}
"""What the bus is taken to measure."""
FIRST = next(iter(SOURCES))


class Clock(NamedTuple):
    """How one clock came back.

    Attributes:
        minutes: Of the recording.
        found: The estimate.
        start_ms: Error of the UTC stamps at the first CAN stamp.
        stop_ms: At the last one.
        drift_ppm: Error of the drift.
    """

    minutes: float
    found: ClockEstimate
    start_ms: float
    stop_ms: float
    drift_ppm: float

    @property
    def error_ms(self) -> float:
        """Largest error within the recording."""
        return max(abs(self.start_ms), abs(self.stop_ms))

    @property
    def within(self) -> bool:
        """Whether it is as promised."""
        return self.error_ms < OFFSET_MS and (self.minutes < LONG_MINUTES or abs(self.drift_ppm) < DRIFT_PPM)


class Steering(NamedTuple):
    """How the steering of one car came back: error and standard error, of the ratio in %, of the offset in deg."""

    ratio: float
    ratio_error: float
    offset: float
    offset_error: float


class Outcome(NamedTuple):
    """Of one campaign."""

    seed: int
    clocks: dict[str, list[Clock]]
    steering: Steering


def draw(seed: int, short: tuple[float, float] = (2.0, 30.0), long: tuple[float, float] = (30.0, 60.0)) -> Campaign:
    """Draw a campaign with a short and a long recording, minutes each from a range."""
    random = np.random.default_rng([2024, seed])
    minutes = (float(np.exp(random.uniform(*np.log(short)))), float(random.uniform(*long)))
    trips = []
    for trip, length in zip(draw_campaign(seed, 2, 1, 1.0).trips, minutes, strict=True):
        gaps = [
            ((60 * length * random.uniform(0.1, 0.9), random.uniform(*duration)),)
            for duration in ((1.0, 10.0), (2.0, 20.0))
        ]
        trips.append(
            replace(
                trip,
                minutes=round(length, 2),
                clock=CanClock(random.uniform(-2, 2), random.uniform(-100, 100)),
                emergencies=EMERGENCIES[: int(length / 10)],
                can_gaps=gaps[0],
                nav_gaps=gaps[1],
            )
        )
    car = Car(
        steering_ratio=random.uniform(13, 18),
        steering_offset=random.uniform(-5, 5),
        understeer_gradient=random.uniform(0.001, 0.003),
    )
    return Campaign(tuple(trips), seed, car)


def estimate(recorded: Recorded, names: Sequence[str]) -> ClockEstimate:
    """Estimate the clock from some of the bus's signals."""
    can, nav = recorded.can, recorded.navigation
    series = {name: (can[name].time, can[name].values) for name in names}
    time, speed = series.get("speed", (np.array([], np.int64), np.array([])))
    return estimate_clock(
        time,
        speed,
        nav["nav_speed"].time,
        nav["nav_speed"].values,
        can_yaw_rate=series.get("yaw_rate"),
        nav_yaw_rate=(nav["nav_yaw_rate"].time, nav["nav_yaw_rate"].values),
        can_steering=series.get("steering_wheel_angle"),
    )


def recover(seed: int, draw_from: Callable[[int], Campaign] = draw) -> Outcome:
    """Simulate a campaign and estimate its clocks and its steering."""
    campaign = draw_from(seed)
    clocks: dict[str, list[Clock]] = {source: [] for source in SOURCES}
    series = []
    for index, trip in enumerate(campaign.trips):
        recorded = record_trip(campaign, index)
        time = recorded.truth["time"].to_numpy().astype(np.int64)
        if not (recorded.truth["speed"].to_numpy()[: 2 * 100] == 0).all():
            raise RuntimeError(f"seed {seed}: the drive does not begin with a standstill")
        for source, names in SOURCES.items():
            if index and names != SOURCES[FIRST]:
                continue
            found = estimate(recorded, names)
            stamps = recorded.can[names[0]].time[[0, -1]]
            elapsed = (stamps - int(time[0]) - round(trip.clock.offset * 1e9)) / (1 + 1e-6 * trip.clock.drift)
            errors = (to_utc(stamps, found) - int(time[0]) - elapsed) / 1e6
            drift = found.drift_ppm - trip.clock.drift
            clocks[source].append(Clock(trip.minutes, found, float(errors[0]), float(errors[1]), drift))
        clock = clocks[FIRST][-1].found
        table = synced_table(recorded, clock, PERIOD, MAX_GAP)
        series.append(steering_series(table))
    wheel, yaw_rate, speed = np.concatenate(series, axis=1)
    car = campaign.car
    calibration = estimate_steering(wheel, yaw_rate, speed, car.wheelbase)
    share = 100 / car.steering_ratio
    nan = float("nan")
    steering = Steering(
        nan if calibration.ratio is None else share * (calibration.ratio - car.steering_ratio),
        nan if calibration.ratio_standard_error is None else share * calibration.ratio_standard_error,
        nan if calibration.offset is None else calibration.offset - car.steering_offset,
        nan if calibration.offset_standard_error is None else calibration.offset_standard_error,
    )
    return Outcome(seed, clocks, steering)


def summary(outcomes: Sequence[Outcome]) -> tuple[str, bool]:
    """Return the table of some campaigns, and whether what is promised holds."""
    head = (
        f"{'clock from':<20}{'logs':>5}{'within':>8}{'refused':>9}{'wrong':>7}{'worst ms':>10}{'at start':>10}"
        f"{'worst ppm':>11}{'error/se':>10}{'largest':>9}"
    )
    lines = [head]
    holds = True
    for source in SOURCES:
        clocks = [clock for outcome in outcomes for clock in outcome.clocks[source]]
        applied = [clock for clock in clocks if clock.found.applied]
        wrong = [clock for clock in applied if not clock.within]
        long = [abs(clock.drift_ppm) for clock in applied if clock.minutes >= LONG_MINUTES]
        ratios = [clock.error_ms / clock.found.standard_error_ms for clock in applied if clock.found.standard_error_ms]
        lines.append(
            f"{source:<20}{len(clocks):>5}{len(applied) - len(wrong):>8}{len(clocks) - len(applied):>9}{len(wrong):>7}"
            f"{max((clock.error_ms for clock in applied), default=0):>10.2f}"
            f"{max((abs(clock.start_ms) for clock in applied), default=0):>10.2f}{max(long, default=0):>11.2f}"
            f"{np.sqrt(np.mean(np.square(ratios or [np.nan]))):>10.2f}{max(ratios, default=np.nan):>9.2f}"
        )
        holds &= not wrong
    whole = [all(clock.found.applied and clock.within for clock in outcome.clocks[FIRST]) for outcome in outcomes]
    lines.append(f"campaigns with every clock within, from {FIRST}: {sum(whole)} of {len(outcomes)}")
    holds &= sum(whole) >= REQUIRED * len(outcomes)
    steering = np.array([outcome.steering for outcome in outcomes])
    ratio, ratio_error, offset, offset_error = steering.T
    good = (np.abs(ratio) < RATIO_PERCENT) & (np.abs(offset) < STEERING_OFFSET_DEG)
    lines.append(
        f"campaigns with steering within: {np.count_nonzero(good)} of {len(good)}; ratio: worst "
        f"{np.abs(ratio).max():.2f} %, error/se {np.sqrt(np.mean((ratio / ratio_error) ** 2)):.2f}; offset: worst "
        f"{np.abs(offset).max():.3f} deg, error/se {np.sqrt(np.mean((offset / offset_error) ** 2)):.2f}"
    )
    return "\n".join(lines), bool(holds and good.all())


def main() -> int:
    """Measure as many seeds as the command line says, from the second argument on (0)."""
    seeds, first = (int(argument) for argument in [*sys.argv[1:], "0"][:2])
    outcomes = []
    for seed in range(first, first + seeds):
        outcomes.append(recover(seed))
        for source, clocks in outcomes[-1].clocks.items():
            for clock in clocks:
                if clock.found.applied and clock.within:
                    continue
                what = f"{clock.error_ms:.2f} ms, {clock.drift_ppm:.2f} ppm" if clock.found.applied else "refused"
                print(f"seed {seed}, {clock.minutes:g} min, {source}: {what}: {clock.found.reason}", flush=True)
        print(f"seed {seed}: {outcomes[-1].steering}", file=sys.stderr, flush=True)
    table, holds = summary(outcomes)
    print(table)
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
