"""Proposals of emergencies and standstill for a person to decide about; both papers leave such driving out by hand."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..schemas.config import Events
from ..schemas.signals import SIGNALS
from .events import Event, subtract
from .path import Floats, begins_run

SHORTEST_DRIVING = 300.0
"""s; the share of emergencies in less driving than this says nothing about how somebody drives."""


@dataclass(frozen=True, slots=True)
class Detector:
    """One quantity that is large in an emergency.

    Attributes:
        kind: Kind of the events it proposes.
        signal: Canonical signal it looks at.
        sign: 1: positive values count; -1: negative ones; 0: both.
        threshold: In the signal's unit; beyond it is an emergency.
        from_speed: m/s; slower driving is passed over.
    """

    kind: str
    signal: str
    sign: int
    threshold: float
    from_speed: float


def emergency_detectors(settings: Events) -> tuple[Detector, ...]:
    """Return the detectors; one whose signal a recording lacks finds nothing in it."""
    moving, swerving = settings.standstill, max(settings.standstill, settings.swerve_speed)
    lateral, steering = settings.swerve_lateral_acceleration, settings.swerve_steering_speed
    return (
        Detector("hard_braking", "longitudinal_acceleration", -1, settings.hard_braking, moving),
        Detector("hard_braking", "nav_longitudinal_acceleration", -1, settings.hard_braking, moving),
        Detector("hard_braking", "brake_pressure", 1, settings.brake_pressure, moving),
        Detector("swerve", "steering_wheel_speed", 0, steering, swerving),
        Detector("swerve", "lateral_acceleration", 0, lateral, swerving),
        Detector("swerve", "nav_lateral_acceleration", 0, lateral, swerving),
    )


def propose_events(recordings: Mapping[str, pa.Table], settings: Events, period: int) -> list[Event]:
    """Propose events in all recordings of one driver.

    Hard braking and swerving are excursions beyond a threshold for at least `minimum_duration` while the car moves,
    with `padding` on both sides; those that overlap or touch become one event of the most severe one's kind, whose
    note lists all signals concerned. `standstill` is an event of its own without padding, and paddings end at it:
    what a person decides about braking says nothing about standing.

    The threshold of an emergency detector rises until at most the share `rarity` of the driver's driving, counted as
    five minutes where it is less, lies beyond it: nobody drives in emergencies all the time.

    Args:
        recordings: `driver/recording` -> synced table.
        settings: Thresholds.
        period: Of the grid, ns.

    Returns:
        Events with decision `proposed`, sorted; severity is peak over threshold, 0 for standstill.
    """
    drives = [_Drive.of(name, table, period) for name, table in recordings.items() if len(table)]
    least = -(-round(settings.minimum_duration * 1e9) // period)
    excursions: dict[str, list[_Excursion]] = {drive.recording: [] for drive in drives}
    for detector in emergency_detectors(settings):
        amounts = [drive.amounts(detector) for drive in drives]
        threshold = _risen(detector.threshold, np.concatenate(amounts), settings.rarity, period) if drives else 0.0
        for drive, amount in zip(drives, amounts, strict=True):
            excursions[drive.recording] += [
                _Excursion(start, stop, detector, float(amount[rows].max()), threshold)
                for start, stop, rows in drive.stretches(amount > threshold, least, settings.padding)
            ]
    proposals = []
    for drive in drives:
        standstills = [
            Event(drive.recording, start, stop, "standstill", 0.0, "proposed", "", f"below {settings.standstill:g} m/s")
            for start, stop, _ in drive.stretches(drive.speed < settings.standstill, least, 0.0)
        ]
        emergencies = [_event(drive.recording, group) for group in _touching(excursions[drive.recording])]
        proposals += standstills + subtract(emergencies, standstills)
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
        peak = self.peak * (self.detector.sign or 1)
        return (
            f"{self.detector.signal} {peak:.3g} {SIGNALS[self.detector.signal].unit} (threshold {self.threshold:.3g})"
        )


@dataclass(frozen=True, slots=True)
class _Drive:
    """One recording as the detectors see it.

    Attributes:
        recording: `driver/recording`.
        time: ns UTC (n_samples,).
        run: Number of the run, -1 outside.
        speed: m/s, of navigation or else of the car; NaN outside runs and where unknown.
        signals: Values of the detectors' signals.
        period: ns.
    """

    recording: str
    time: NDArray[np.int64]
    run: NDArray[np.int64]
    speed: Floats
    signals: Mapping[str, Floats]
    period: int

    @classmethod
    def of(cls, recording: str, table: pa.Table, period: int) -> _Drive:
        def values(name: str) -> Floats:
            column: Floats = table[name].cast(pa.float64()).to_numpy()
            return column

        run = table["run"].fill_null(-1).to_numpy().astype(np.int64)
        speed = np.where(np.isnan(values("nav_speed")), np.abs(values("speed")), values("nav_speed"))
        signals = {detector.signal: values(detector.signal) for detector in emergency_detectors(Events())}
        if np.isnan(signals["steering_wheel_speed"]).all():
            signals["steering_wheel_speed"] = _rate(values("steering_wheel_angle"), run, period)
        time = table["time"].cast(pa.int64()).to_numpy()
        return cls(recording, time, run, np.where(run < 0, np.nan, speed), signals, period)

    def amounts(self, detector: Detector) -> Floats:
        """Return what the detector compares with its threshold (n_samples,), NaN where it passes over."""
        values = self.signals[detector.signal]
        amounts = np.abs(values) if detector.sign == 0 else detector.sign * values
        return np.where((self.run < 0) | (self.speed < detector.from_speed), np.nan, amounts)

    def stretches(self, mask: NDArray[np.bool_], least: int, padding: float) -> Iterator[tuple[int, int, slice]]:
        """Yield start and stop, padded by s, and the rows of every stretch of a run with at least so many samples."""
        margin = round(padding * 1e9)
        begins = mask & (begins_run(self.run) | ~np.roll(mask, 1))
        ends = mask & np.roll(begins_run(self.run) | ~mask, -1)
        for first, last in zip(np.flatnonzero(begins).tolist(), np.flatnonzero(ends).tolist(), strict=True):
            if last - first + 1 >= least:
                start = max(int(self.time[first]) - margin, int(self.time[0]))
                stop = min(int(self.time[last]) + margin, int(self.time[-1])) + self.period
                yield start, stop, slice(first, last + 1)


def _rate(angle: Floats, run: NDArray[np.int64], period: int) -> Floats:
    """Return the rate of change per s between the neighbours of each sample, NaN at the ends of runs."""
    rate = np.full(len(angle), np.nan)
    inner = np.flatnonzero(run[2:] == run[:-2]) + 1
    rate[inner] = (angle[inner + 1] - angle[inner - 1]) / (2e-9 * period)
    return rate


def _risen(threshold: float, amounts: Floats, rarity: float, period: int) -> float:
    """Return the threshold, or the amount beyond which lies just the allowed share, if that is higher."""
    known = amounts[~np.isnan(amounts)]
    allowed = int(rarity * max(len(known), SHORTEST_DRIVING * 1e9 / period))
    if len(known) <= allowed:
        return threshold
    place = len(known) - 1 - allowed
    return max(threshold, float(np.partition(known, place)[place]))


def _touching(excursions: Collection[_Excursion]) -> Iterator[list[_Excursion]]:
    """Yield the groups of excursions that overlap or touch."""
    group: list[_Excursion] = []
    stop = 0
    for excursion in sorted(excursions, key=lambda one: (one.start, one.stop)):
        if group and excursion.start > stop:
            yield group
            group = []
        stop = max(stop, excursion.stop) if group else excursion.stop
        group.append(excursion)
    if group:
        yield group


def _event(recording: str, group: Sequence[_Excursion]) -> Event:
    """Return the proposal that stands for excursions that touch; its note says the strongest one of each signal."""
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
