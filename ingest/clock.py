"""The CAN logger's clock against UTC, from what the car and the navigation unit both measure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, hypot
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from ..schemas.times import iso_utc
from .alignment import BLOCK_S, MINIMUM_OVERLAP_S, SECOND, Fit, Peak, Signal, changes, find_step, refine, search
from .clock_jumps import count_repeated, jump_near, likely_clock, split_at_jumps
from .resample import Times, Values, grid, resample

PERIOD_S = 0.1
BRIDGED_GAP_S = 0.5
WINDOWS_S = (1.0, 2.0)
"""Windows of the changes: the short one tells more of abrupt changes of speed, the long one of smooth ones."""
STANDSTILL = 1.0
"""m/s; slower, a wheel speed sensor says zero or nothing."""
PROMISING_CORRELATION = 0.7
"""Enough to end the search: a drift still blurs the peak."""
MINIMUM_CORRELATION = 0.9
TOLERANCE_S = 0.010
"""What an applied offset is promised to be right to, throughout the recording."""
DRIFT_TOLERANCE_PPM = 5.0
"""What the drift of an applied estimate is promised to be right to, where the recording is long."""
LONG_S = 1800.0
SHORT_S = 120.0
"""Shorter recordings promise less: a few bends and stops do not tell 10 ms, and 60 ms are still within a sample."""
SHORT_TOLERANCE_S = 0.060
CONFIDENCE = 3.0
"""Standard errors that a promise must be wide."""
STEERING_SLOWEST = 3.0
"""m/s; slower, a curvature is a small yaw rate over a small speed."""
STEERING_LEAD_S = 0.1
"""The yaw rate follows the steering wheel by this order, more in a soft car, and no measurement tells it from the
clock's offset."""
ALIGNED_S = 0.050
"""Standard error with which a piece of a recording counts as aligned where the clock was set on the way."""
MAXIMUM_DRIFT_PPM = 300.0
LONGEST_DAYS = 7
ADVICE = "; if the offset is known, give it as sync.clock in seconds"

PART = "; nothing is applied: cut the log there, and give each part a recording of its own"

Series: TypeAlias = tuple[Times, Values]


@dataclass(frozen=True, slots=True)
class ClockStep:
    """Where the CAN clock was set: `time` is the last CAN stamp before it, ns, and `size_s` what its stamps gained."""

    time: int
    size_s: float

    def __str__(self) -> str:
        """Return place and size for people."""
        return f"by {self.size_s:+.3f} s after its stamp {iso_utc(self.time)}"


@dataclass(frozen=True, slots=True)
class ClockEstimate:
    """How CAN stamps become UTC: the stamp t is `offset_s + 1e-6·drift_ppm·(t - reference)` ahead of UTC.

    Attributes:
        offset_s: CAN stamp - UTC at the recording's start, s; 0 where nothing is applied.
        drift_ppm: What the offset gains, µs per s of the CAN clock; 0 where nothing is applied.
        residual_ms: Weighted rms of what the offset of single ten-second blocks differs from the line; None where
            nothing was estimated.
        standard_error_ms: The offset's largest standard error within the recording. It knows the sensors' noise and
            how that hangs together in time, not their latency.
        correlation: Between the changes of CAN and navigation signals once aligned, of the signal that agrees best.
        applied: Whether the stamps are changed.
        reason: What the offset comes from, or why there is none.
        reference: CAN stamp in ns that `offset_s` refers to, the recording's start.
        drift_standard_error_ppm: Of the drift, ppm.
        steps: Where the CAN clock was set on the way; nothing is applied then.
        repeated_stamps: Samples of CAN with the stamp of another one, which were not used.
    """

    offset_s: float
    drift_ppm: float
    residual_ms: float | None
    standard_error_ms: float | None
    correlation: float | None
    applied: bool
    reason: str
    reference: int
    drift_standard_error_ppm: float | None = None
    steps: tuple[ClockStep, ...] = ()
    repeated_stamps: int = 0

    @classmethod
    def trusted(cls, reason: str) -> ClockEstimate:
        """Return the estimate that leaves the stamps as they are."""
        return cls(0.0, 0.0, None, None, None, applied=False, reason=reason, reference=0)

    @classmethod
    def fixed(cls, offset_s: float, reason: str) -> ClockEstimate:
        """Return the estimate that takes away an offset known from elsewhere, the same throughout."""
        return cls(offset_s, 0.0, None, None, None, applied=True, reason=reason, reference=0)


def to_utc(can_time: Times, estimate: ClockEstimate) -> Times:
    """Return the UTC stamps of CAN stamps (n_samples,), both in ns; only the drift's share is rounded, to 1 ns."""
    gained: Times = np.rint((can_time - estimate.reference) * (1e-6 * estimate.drift_ppm)).astype(np.int64)
    return np.asarray(can_time - round(estimate.offset_s * SECOND) - gained, np.int64)


def estimate_clock(
    can_time: Times,
    can_speed: npt.ArrayLike,
    nav_time: Times,
    nav_speed: npt.ArrayLike,
    *,
    can_yaw_rate: Series | None = None,
    nav_yaw_rate: Series | None = None,
    can_steering: Series | None = None,
    max_offset_s: float = 10.0,
) -> ClockEstimate:
    """Estimate offset and drift of the CAN clock; where they cannot be told, say why and change nothing.

    Offsets within ±`max_offset_s` are tried first. If nothing fits there (a logger on local time, or one that counts
    from its own start), all those at which at least half of the shorter log overlaps are. The drift is 0 ± 60 ppm
    before anything is measured, and so stays near 0 in recordings too short to tell it.

    Stamps are taken in the order of the log: where they go back, or ahead by more than half a second, the pieces on
    both sides are aligned by themselves, and one line is laid across only if they agree.

    Args:
        can_time: (n_can,) stamps of the CAN speed, ns, in the order of the log.
        can_speed: (n_can,) m/s, NaN where missing; scale, bias and sign do not matter.
        nav_time: (n_nav,) UTC stamps of the navigation's speed, ns.
        nav_speed: (n_nav,) m/s, NaN where missing.
        can_yaw_rate: Stamps in ns and values in deg/s; scale, bias and sign do not matter.
        nav_yaw_rate: UTC stamps in ns and values in deg/s. Yaw rates are used if both are given.
        can_steering: Stamps in ns and steering wheel angles in deg. They are compared with the curvature of
            navigation's path if the bus has neither speed nor yaw rate.
        max_offset_s: Largest offset that is tried first, s.

    Returns:
        The estimate. It is applied if the correlation reaches 0.9, no other offset explains the signals nearly as
        well, three standard errors of the offset stay within 10 ms throughout the recording (60 ms where it is shorter
        than two minutes), and those of the drift
        within 5 ppm where it takes half an hour or more. From steering alone it is never applied: by how much steering
        leads the yaw rate, some 0.1 s, no measurement tells from the offset. The reason says what the offset is about.
    """
    driven = np.where(np.asarray(nav_speed, np.float64) >= STANDSTILL, nav_speed, np.nan)
    can, nav = {"speed": (can_time, np.abs(can_speed))}, {"speed": (nav_time, driven)}
    if nav_yaw_rate is not None:
        if can_yaw_rate is not None:
            can["yaw rate"], nav["yaw rate"] = can_yaw_rate, nav_yaw_rate
        if can_steering is not None and not any(np.isfinite(values).sum() > 2 for _, values in can.values()):
            can["steering"], nav["steering"] = (
                can_steering,
                (nav_yaw_rate[0], _curvature(nav_time, driven, nav_yaw_rate)),
            )
    names = [name for name in can if min(np.isfinite(side[name][1]).sum() for side in (can, nav)) > 2]
    if not names:
        return ClockEstimate.trusted("CAN and navigation have no driving in common that both measured")
    can, nav = ({name: side[name] for name in names} for side in (can, nav))
    repeated = max(count_repeated(time) for time, _ in can.values())
    found = (
        _from_steering(_estimate(can, nav, max_offset_s))
        if names == ["steering"]
        else _estimate(can, nav, max_offset_s)
    )
    if repeated:
        said = f"; {repeated} stamps of CAN are repeated, of each the last sample counts"
        found = replace(found, reason=found.reason + said, repeated_stamps=repeated)
    return found


def _curvature(nav_time: Times, driven: Values, nav_yaw_rate: Series) -> Values:
    """Return navigation's yaw rate over its speed at the stamps of the yaw rate, deg/m, NaN where it is slow."""
    time, yaw_rate = nav_yaw_rate
    fast = np.where(driven >= STEERING_SLOWEST, driven, np.nan)
    speed = fast if np.array_equal(time, nav_time) else np.interp(time, nav_time, fast)
    return np.asarray(yaw_rate / speed, np.float64)


def _estimate(can: Mapping[str, Series], nav: Mapping[str, Series], max_offset_s: float) -> ClockEstimate:
    for name in can:
        if set_on_the_way := _steps_between_pieces(name, can[name], nav[name], max_offset_s):
            return set_on_the_way
    for side, series in (("CAN", can), ("navigation", nav)):
        start, stop = _span([time for time, _ in series.values()])
        days = (stop - start) / SECOND / 86400
        if days > LONGEST_DAYS:
            reason = f"the stamps of {side} span {days:.0f} days, its clock was set on the way"
            return ClockEstimate.trusted(reason)
    found = _align(can, nav, max_offset_s)
    if isinstance(found, str):
        return ClockEstimate.trusted(found)
    fit, drift_ppm, time = found.fit, found.drift_ppm, next(iter(can.values()))[0]
    drift_error_ppm = 1e6 * fit.gain_standard_error_s / found.span_s
    reason = _doubt(found, drift_error_ppm)
    steps: tuple[ClockStep, ...] = ()
    if fit.correlation >= MINIMUM_CORRELATION and (step := find_step(fit.pull, fit.grip)) is not None:
        place = found.reference + round(step.block * BLOCK_S * SECOND)
        exact = jump_near(time, place, step.size_s, 2 * BLOCK_S)
        steps = (ClockStep(place if exact is None else exact, step.size_s),)
        about = "" if exact is not None else f", give or take {BLOCK_S:.0f} s"
        reason = f"the CAN clock was set on the way, {steps[0]}{about}{PART}"
    applied = not reason
    if applied:
        reason = _said(found)
        if cause := likely_clock(fit.shift_s, found.reference - round(fit.shift_s * SECOND)):
            reason += f"; {cause}"
    return ClockEstimate(
        offset_s=fit.shift_s if applied else 0.0,
        drift_ppm=drift_ppm if applied else 0.0,
        residual_ms=1e3 * fit.residual_s,
        standard_error_ms=1e3 * fit.standard_error_s,
        correlation=fit.correlation,
        applied=applied,
        reason=reason,
        reference=found.reference,
        drift_standard_error_ppm=drift_error_ppm,
        steps=steps,
    )


class _Alignment(NamedTuple):
    """How CAN and navigation lie to one another.

    Attributes:
        fit: With the window that tells more.
        peak: The best offset before it was refined.
        single: What single signals say, by name, with the same window.
        reference: CAN stamp of the grid's first sample, ns.
        span_s: From there to its last one, s.
    """

    fit: Fit
    peak: Peak
    single: dict[str, Fit | None]
    reference: int
    span_s: float

    @property
    def drift_ppm(self) -> float:
        return 1e6 * self.fit.gain_s / self.span_s


def _align(
    can: Mapping[str, Series],
    nav: Mapping[str, Series],
    max_offset_s: float,
    windows_s: Sequence[float] = WINDOWS_S,
) -> _Alignment | str:
    """Align signals by name on both clocks, or return why they cannot be."""
    sampling, of_nav = (
        max(ceil(np.median(np.diff(np.sort(time)))) for side in sides for time, _ in side.values())
        for sides in ((can, nav), (nav,))
    )
    period = max(round(PERIOD_S * SECOND), 2 * sampling)
    max_gap = max(round(BRIDGED_GAP_S * SECOND), 3 * sampling)
    can_grid, nav_grid = (grid(*_span([time for time, _ in side.values()]), period) for side in (can, nav))
    apart = (
        f"no overlap: CAN and navigation have less than {MINIMUM_OVERLAP_S:.0f} s of driving in common within "
        f"±{max_offset_s:g} s, and do not agree elsewhere{ADVICE}"
    )
    if min(len(can_grid), len(nav_grid)) * period < MINIMUM_OVERLAP_S * SECOND:
        return apart
    if 4 * of_nav <= period:
        # A centred mean shifts nothing, and what is finer than the grid costs time only.
        fine = grid(int(nav_grid[0]), int(nav_grid[-1]) + 1, period // 2)
        nav = {name: (fine, resample(*nav[name], fine, "mean", max_gap, period // 2)) for name in nav}
    signals = [Signal(name, resample(*can[name], can_grid, "mean", max_gap, period), nav[name]) for name in can]
    compared = [
        (
            changes(signal.values, period),
            changes(resample(*signal.reference, nav_grid, "mean", max_gap, period), period),
        )
        for signal in signals
    ]
    start_s = int(can_grid[0] - nav_grid[0]) / SECOND
    peak = search(compared, period / SECOND, start_s, max_offset_s)
    if peak is None or max(peak.correlations) < PROMISING_CORRELATION:
        anywhere = search(compared, period / SECOND, start_s, None)
        if anywhere is not None and max(anywhere.correlations) >= PROMISING_CORRELATION:
            peak = anywhere
    if peak is None:
        return apart
    enough = 0.5 * max(peak.correlations)
    telling = [signal for signal, r in zip(signals, peak.correlations, strict=True) if r > enough]
    if not telling:
        return f"too little excitation: neither speed nor yaw rate changes{ADVICE}"
    fits = {w: refine(telling, can_grid, peak.shift_s, period, max_gap, w) for w in windows_s}
    told = {w: fit for w, fit in fits.items() if fit is not None}
    if not told:
        return apart
    window_s, fit = min(told.items(), key=lambda one: one[1].standard_error_s)
    single = {
        signal.name: fit if len(telling) == 1 else refine([signal], can_grid, fit.shift_s, period, max_gap, window_s)
        for signal in telling
    }
    return _Alignment(fit, peak, single, int(can_grid[0]), int(can_grid[-1] - can_grid[0]) / SECOND)


def _span(times: Sequence[Times]) -> tuple[int, int]:
    return min(int(time.min()) for time in times), max(int(time.max()) for time in times) + 1


def _steps_between_pieces(name: str, can: Series, nav: Series, max_offset_s: float) -> ClockEstimate | None:
    """Return the refusal where a signal's stamps jump and the pieces on both sides do not lie on one line."""
    time, values = can
    pieces, overlap = split_at_jumps(time)
    if len(pieces) == 1:
        return None
    aligned = []
    for piece in pieces:
        part = time[piece.start : piece.stop], np.asarray(values)[piece.start : piece.stop]
        found = _align({name: part}, {name: nav}, max_offset_s, WINDOWS_S[:1]) if np.isfinite(part[1]).sum() > 2 else ""
        if isinstance(found, str) or not found.fit.converged or found.fit.standard_error_s >= ALIGNED_S:
            continue
        if found.fit.correlation >= MINIMUM_CORRELATION and found.peak.rival_s is None:
            aligned.append((piece, found))
    steps = []
    for (earlier, one), (later, other) in pairwise(sorted(aligned, key=lambda pair: pair[0].start)):
        size = other.fit.shift_s - one.fit.shift_s - one.fit.gain_s
        if abs(size) > TOLERANCE_S + 5 * hypot(one.fit.standard_error_s, other.fit.standard_error_s):
            before = np.arange(earlier.stop - 1, later.start)
            jumps = np.abs(np.diff(time[earlier.stop - 1 : later.start + 1]) / SECOND - size)
            steps.append(ClockStep(int(time[before[np.argmin(jumps)]]), size))
    if steps:
        reason = f"the CAN clock was set on the way, {' and '.join(str(step) for step in steps)}{PART}"
        return replace(ClockEstimate.trusted(reason), steps=tuple(steps))
    if overlap and len(aligned) < len(pieces):
        back = int(np.argmin(np.diff(time)))
        step = ClockStep(int(time[back]), int(time[back + 1] - time[back]) / SECOND)
        reason = (
            f"the stamps of CAN go back {step}: its clock was set, or the logger began anew, and one of the sides is "
            f"too short to tell the offset from{PART}"
        )
        return replace(ClockEstimate.trusted(reason), steps=(step,))
    return None


def _said(found: _Alignment) -> str:
    """Return what the offset comes from."""
    said = [
        f"{name} ({one.shift_s:.3f} ± {one.standard_error_s:.3f} s)"
        for name, one in found.single.items()
        if one is not None
    ]
    return f"estimated from {' and '.join(said)}"


def _from_steering(found: ClockEstimate) -> ClockEstimate:
    """Return what steering alone says, unapplied: nobody knows by how much it leads the yaw rate."""
    if not found.applied or found.standard_error_ms is None:
        return found
    near = (
        "steering agrees with an offset of 0" if abs(found.offset_s) < 2 * STEERING_LEAD_S else "steering tells no more"
    )
    reason = (
        f"{near}: {found.offset_s:.3f} s, give or take the {STEERING_LEAD_S:g} s or so by which the yaw rate follows "
        f"it; map speed or yaw rate{ADVICE}"
    )
    error = 1e3 * hypot(found.standard_error_ms / 1e3, STEERING_LEAD_S)
    return replace(found, offset_s=0.0, drift_ppm=0.0, standard_error_ms=error, applied=False, reason=reason)


def _doubt(found: _Alignment, drift_error_ppm: float) -> str:
    """Return why the fit cannot be relied on, empty where it can."""
    fit, peak = found.fit, found.peak
    if fit.correlation < MINIMUM_CORRELATION:
        return (
            f"CAN and navigation do not agree: correlation {fit.correlation:.2f} at the best offset "
            f"{peak.shift_s:.1f} s, {MINIMUM_CORRELATION} is needed; another quantity, or too little driving{ADVICE}"
        )
    if peak.rival_s is not None:
        return f"ambiguous: offsets of {peak.shift_s:.1f} s and {peak.rival_s:.1f} s explain the signals alike{ADVICE}"
    if not fit.converged or abs(found.drift_ppm) > MAXIMUM_DRIFT_PPM:
        return (
            f"no offset near {peak.shift_s:.1f} s with a drift within ±{MAXIMUM_DRIFT_PPM:.0f} ppm fits throughout; "
            f"the CAN clock may have been set on the way{ADVICE}"
        )
    from_steering = "steering" in found.single
    tolerance_s = TOLERANCE_S if found.span_s >= SHORT_S else SHORT_TOLERANCE_S
    if from_steering:
        tolerance_s = STEERING_LEAD_S
    if CONFIDENCE * fit.standard_error_s > tolerance_s:
        return (
            f"too little excitation: the offset {fit.shift_s:.3f} s has a standard error of "
            f"{1e3 * fit.standard_error_s:.0f} ms, and three of them are more than {1e3 * tolerance_s:.0f} ms{ADVICE}"
        )
    if not from_steering and found.span_s >= LONG_S and CONFIDENCE * drift_error_ppm > DRIFT_TOLERANCE_PPM:
        return (
            f"too little excitation: the drift {found.drift_ppm:.1f} ppm has a standard error of {drift_error_ppm:.1f} "
            f"ppm, and three of them are more than {DRIFT_TOLERANCE_PPM:g} ppm{ADVICE}"
        )
    return ""
