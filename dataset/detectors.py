"""Proposals of emergencies and of what is no driving, which both papers leave out by hand, for a person to decide."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..schemas.config import Events, Threshold
from .calibration import estimate_steering
from .events import Event
from .excursions import excursions, risen_threshold
from .observations import Observations, unit_of
from .path import Floats
from .stretches import subtract

SHORTEST_DRIVING = 300.0
"""s; the share of emergencies in less driving than this says nothing about how somebody drives."""
USUAL_WHEELBASE = 2.7
"""m; only its product with the estimated steering ratio matters."""


@dataclass(frozen=True, slots=True)
class Detector:
    """One quantity that is large in an emergency.

    Attributes:
        kind: Kind of the events it proposes.
        signal: Canonical signal, or quantity of `DERIVED`, that it looks at.
        sign: 1: positive values count; -1: negative ones; 0: both.
        threshold: In the signal's unit; beyond it is an emergency, unless it has to rise for the driver.
        share: Of the driver's driving that may lie in its excursions; for more, the threshold rises.
        from_speed: m/s; slower driving is passed over.
        is_flag: Whether the car itself says so, which counts however short it is.
    """

    kind: str
    signal: str
    sign: int
    threshold: float
    share: float
    from_speed: float
    is_flag: bool = False


def emergency_detectors(settings: Events) -> tuple[Detector, ...]:
    """Return the detectors; one whose signal a recording lacks finds nothing in it."""
    moving, swerving = settings.standstill, max(settings.standstill, settings.swerve_speed)
    braking, accelerating = level(settings.hard_braking, settings), level(settings.hard_acceleration, settings)
    cornering = level(settings.hard_cornering, settings)
    raised = (0.5, settings.rarity)
    return (
        Detector("hard_braking", "longitudinal_acceleration", -1, *braking, moving),
        Detector("hard_braking", "nav_longitudinal_acceleration", -1, *braking, moving),
        Detector("hard_braking", "brake_pressure", 1, *level(settings.brake_pressure, settings), moving),
        Detector("hard_braking", "brake_pedal", 1, *level(settings.brake_pedal, settings), moving),
        Detector("hard_acceleration", "longitudinal_acceleration", 1, *accelerating, moving),
        Detector("hard_acceleration", "nav_longitudinal_acceleration", 1, *accelerating, moving),
        Detector("swerve", "steering_wheel_speed", 0, *level(settings.swerve_steering_speed, settings), swerving),
        Detector("swerve", "lateral_jerk", 0, *level(settings.swerve_lateral_jerk, settings), swerving),
        Detector("hard_cornering", "lateral_acceleration", 0, *cornering, swerving),
        Detector("hard_cornering", "nav_lateral_acceleration", 0, *cornering, swerving),
        Detector("skid", "yaw_rate_deviation", 0, *level(settings.skid, settings), swerving),
        Detector("abs", "abs_active", 1, *raised, moving, is_flag=True),
        Detector("esc", "esc_active", 1, *raised, moving, is_flag=True),
    )


def level(threshold: Threshold, settings: Events) -> tuple[float, float]:
    """Return the number that a threshold starts from, and the share of the driving that may lie beyond it."""
    return threshold.at_least, settings.rarity if threshold.quantile is None else 1 - threshold.quantile


def propose_events(
    recordings: Mapping[str, pa.Table], settings: Events, period: int, wheelbase: float = USUAL_WHEELBASE
) -> list[Event]:
    """Propose events in all recordings of one driver.

    Emergencies are excursions (see `excursions`) beyond a threshold for at least `minimum_duration` while the car
    moves, until the quantity is below `leave` times it, with `padding` on both sides; those that overlap or touch
    become one event of the most severe one's kind, whose note lists all quantities concerned. The kinds of `STATES`
    are events of their own without padding, and paddings end at standstill and reversing: what a person decides about
    braking says nothing about standing. Where navigation is not to be trusted, an emergency is one all the same, and
    only the rest is an event of that kind.

    A threshold rises until at most a share of the driver's driving, counted as five minutes where it is less, lies in
    its excursions: nobody drives in emergencies all the time. The share is `rarity`, or what its `quantile` leaves.

    Args:
        recordings: `driver/recording` -> synced table.
        settings: Thresholds.
        period: Of the grid, ns.
        wheelbase: m, for the yaw rate to be expected; the steering is estimated from this driver's driving.

    Returns:
        Events with decision `proposed`, sorted; severity is peak over threshold, 0 for `STATES`.
    """
    observed = [Observations.of(name, table, period) for name, table in recordings.items() if len(table)]
    if not observed:
        return []
    observed = _expecting_yaw_rates(observed, period, wheelbase)
    least = -(-round(settings.minimum_duration * 1e9) // period)
    run = _joined_runs(observed)
    found: dict[str, list[_Excursion]] = {one.recording: [] for one in observed}
    for detector in emergency_detectors(settings):
        amounts = [_amounts(one, detector) for one in observed]
        needed = 1 if detector.is_flag else least
        threshold = risen_threshold(
            np.concatenate(amounts),
            run,
            detector.threshold,
            detector.share,
            settings.leave,
            needed,
            round(SHORTEST_DRIVING * 1e9 / period),
        )
        for one, amount in zip(observed, amounts, strict=True):
            found[one.recording] += [
                _Excursion(*_padded(one, rows, settings.padding), detector, float(amount[rows].max()), threshold)
                for rows in excursions(amount, one.run, threshold, settings.leave * threshold, needed)
            ]
    slow = f"below {settings.standstill:g} m/s"
    backwards = f"course more than {settings.reversing:g} deg from heading, negative speed or reverse gear"
    proposals = []
    for one in observed:
        standing = _states(one, "standstill", one.speed < settings.standstill, least, lambda _: slow)
        reversing = _states(one, "reversing", one.reverses(settings), least, lambda _: backwards)
        distrusts = partial(_why_distrusted, one, settings=settings)
        distrusted = _states(one, "navigation", one.distrusts_navigation(settings), least, distrusts)
        emergencies = [_event(one.recording, group) for group in _touching(found[one.recording])]
        emergencies = subtract(emergencies, standing + reversing)
        proposals += standing + reversing + emergencies + subtract(distrusted, standing + reversing + emergencies)
    return sorted(proposals)


@dataclass(frozen=True, slots=True)
class _Excursion:
    start: int
    stop: int
    detector: Detector
    peak: float
    threshold: float

    @property
    def severity(self) -> float:
        return self.peak / self.threshold

    @property
    def note(self) -> str:
        signal, peak = self.detector.signal, self.peak * (self.detector.sign or 1)
        if self.detector.is_flag:
            return signal
        return f"{signal} {peak:.3g} {unit_of(signal)} (threshold {self.threshold:.3g})"


def _expecting_yaw_rates(observed: list[Observations], period: int, wheelbase: float) -> list[Observations]:
    """Return the same with yaw rates judged by the steering that the driving shows; if it does not, by nothing."""
    names = ("steering_wheel_angle", "yaw rate", "speed")
    series: dict[str, list[Floats]] = {name: [] for name in names}
    for one in observed:
        for name, values in zip(names, (one.values[names[0]], one.yaw_rate, one.speed), strict=True):
            series[name].append(np.append(np.where(one.run < 0, np.nan, values), np.nan))
    wheel, yaw_rate, speed = (np.concatenate(series[name]) for name in names)
    steering = estimate_steering(wheel, yaw_rate, speed, wheelbase, rate=1e9 / period)
    if steering.ratio is None or steering.offset is None:
        return observed
    understeer = steering.understeer or 0.0
    return [one.expecting(wheelbase, steering.ratio, steering.offset, understeer) for one in observed]


def _joined_runs(observed: Sequence[Observations]) -> NDArray[np.int64]:
    """Return the runs of all recordings one behind the other, so that none goes on in the next recording."""
    most = 1 + max(int(one.run.max()) for one in observed)
    return np.concatenate([np.where(one.run < 0, -1 - i, i * most + one.run) for i, one in enumerate(observed)])


def _amounts(observed: Observations, detector: Detector) -> Floats:
    """Return what the detector compares with its threshold (n_samples,), NaN where it passes over."""
    values = observed.values[detector.signal]
    amounts = np.abs(values) if detector.sign == 0 else detector.sign * values
    return np.where((observed.run < 0) | (observed.speed < detector.from_speed), np.nan, amounts)


def _padded(observed: Observations, rows: slice, padding: float) -> tuple[int, int]:
    """Return start and stop, ns, of rows with s added on both sides within the recording."""
    margin, time = round(padding * 1e9), observed.time
    start = max(int(time[rows.start]) - margin, int(time[0]))
    return start, min(int(time[rows.stop - 1]) + margin, int(time[-1])) + observed.period


def _states(
    observed: Observations, kind: str, mask: NDArray[np.bool_], least: int, why: Callable[[slice], str]
) -> list[Event]:
    """Return the events of one kind of `STATES`; `why` tells the note of some rows."""
    return [
        Event(observed.recording, *_padded(observed, rows, 0.0), kind, 0.0, "proposed", "", why(rows))
        for rows in excursions(mask.astype(np.float64), observed.run, 0.5, 0.5, least)
    ]


def _why_distrusted(observed: Observations, rows: slice, settings: Events) -> str:
    status = observed.values["nav_status"][rows]
    bad = sorted({int(value) for value in status[np.isin(status, settings.untrusted_status)]})
    reasons = [f"nav_status {', '.join(map(str, bad))}"] if bad else []
    accuracy = observed.values["position_accuracy"][rows]
    if np.any(accuracy > settings.navigation_accuracy):
        worst = float(np.nanmax(accuracy))
        reasons.append(f"position_accuracy {worst:.3g} m (threshold {settings.navigation_accuracy:.3g})")
    return "; ".join(reasons)


def _touching(found: Collection[_Excursion]) -> Iterator[list[_Excursion]]:
    """Yield the groups of excursions that overlap or touch."""
    group: list[_Excursion] = []
    stop = 0
    for excursion in sorted(found, key=lambda one: (one.start, one.stop)):
        if group and excursion.start > stop:
            yield group
            group = []
        stop = max(stop, excursion.stop) if group else excursion.stop
        group.append(excursion)
    if group:
        yield group


def _event(recording: str, group: Sequence[_Excursion]) -> Event:
    """Return the proposal that stands for excursions that touch; its note says the strongest one of each quantity."""
    by_severity = sorted(group, key=lambda one: (-one.severity, one.start, one.detector.signal))
    notes: dict[str, str] = {}
    for one in by_severity:
        notes.setdefault(one.detector.signal, one.note)
    return Event(
        recording,
        min(one.start for one in group),
        max(one.stop for one in group),
        by_severity[0].detector.kind,
        by_severity[0].severity,
        "proposed",
        "",
        "; ".join(notes.values()),
    )
