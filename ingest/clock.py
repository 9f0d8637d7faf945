"""The CAN logger's clock against UTC, from what the car and the navigation unit both measure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from .alignment import MINIMUM_OVERLAP_S, SECOND, Fit, Peak, Signal, changes, refine, search
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
MAXIMUM_STANDARD_ERROR_S = 0.020
MAXIMUM_DRIFT_PPM = 300.0
LONGEST_DAYS = 7
ADVICE = "; if the offset is known, give it as sync.clock in seconds"

Series: TypeAlias = tuple[Times, Values]


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
    """

    offset_s: float
    drift_ppm: float
    residual_ms: float | None
    standard_error_ms: float | None
    correlation: float | None
    applied: bool
    reason: str
    reference: int

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
    max_offset_s: float = 10.0,
) -> ClockEstimate:
    """Estimate offset and drift of the CAN clock; where they cannot be told, say why and change nothing.

    Offsets within ±`max_offset_s` are tried first. If nothing fits there (a logger on local time, or one that counts
    from its own start), all those at which at least half of the shorter log overlaps are. The drift is 0 ± 60 ppm
    before anything is measured, and so stays near 0 in recordings too short to tell it.

    Args:
        can_time: (n_can,) stamps of the CAN speed, ns.
        can_speed: (n_can,) m/s, NaN where missing; scale, bias and sign do not matter.
        nav_time: (n_nav,) UTC stamps of the navigation's speed, ns.
        nav_speed: (n_nav,) m/s, NaN where missing.
        can_yaw_rate: Stamps in ns and values in deg/s; scale, bias and sign do not matter.
        nav_yaw_rate: UTC stamps in ns and values in deg/s. Yaw rates are used if both are given.
        max_offset_s: Largest offset that is tried first, s.

    Returns:
        The estimate. It is applied if the correlation reaches 0.9, no other offset explains the signals nearly as
        well, and the standard error stays within 20 ms throughout the recording.
    """
    driven = np.where(np.asarray(nav_speed, np.float64) >= STANDSTILL, nav_speed, np.nan)
    can, nav = {"speed": (can_time, np.abs(can_speed))}, {"speed": (nav_time, driven)}
    if can_yaw_rate is not None and nav_yaw_rate is not None:
        can["yaw rate"], nav["yaw rate"] = can_yaw_rate, nav_yaw_rate
    names = [name for name in can if min(np.isfinite(side[name][1]).sum() for side in (can, nav)) > 2]
    if not names:
        return ClockEstimate.trusted("CAN and navigation have no driving in common that both measured")
    sampling = max(ceil(np.median(np.diff(np.sort(side[name][0])))) for side in (can, nav) for name in names)
    period = max(round(PERIOD_S * SECOND), 2 * sampling)
    max_gap = max(round(BRIDGED_GAP_S * SECOND), 3 * sampling)

    can_span, nav_span = (_span([side[name][0] for name in names]) for side in (can, nav))
    for side, (start, stop) in (("CAN", can_span), ("navigation", nav_span)):
        days = (stop - start) / SECOND / 86400
        if days > LONGEST_DAYS:
            reason = f"the stamps of {side} span {days:.0f} days, its clock was set on the way"
            return ClockEstimate.trusted(reason)
    can_grid, nav_grid = grid(*can_span, period), grid(*nav_span, period)
    signals = [Signal(name, resample(*can[name], can_grid, "mean", max_gap, period), nav[name]) for name in names]
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
    apart = (
        f"no overlap: CAN and navigation have less than {MINIMUM_OVERLAP_S:.0f} s of driving in common within "
        f"±{max_offset_s:g} s, and do not agree elsewhere{ADVICE}"
    )
    if peak is None:
        return ClockEstimate.trusted(apart)
    enough = 0.5 * max(peak.correlations)
    telling = [signal for signal, r in zip(signals, peak.correlations, strict=True) if r > enough]
    if not telling:
        return ClockEstimate.trusted(f"too little excitation: neither speed nor yaw rate changes{ADVICE}")
    fit = _refine(telling, can_grid, peak.shift_s, period, max_gap)
    if fit is None:
        return ClockEstimate.trusted(apart)
    drift_ppm = 1e6 * fit.gain_s * SECOND / int(can_grid[-1] - can_grid[0])
    reason = _doubt(fit, peak, drift_ppm)
    applied = not reason
    if applied:
        single = [fit] if len(telling) == 1 else [_refine([s], can_grid, fit.shift_s, period, max_gap) for s in telling]
        said = [
            f"{signal.name} ({one.shift_s:.3f} ± {one.standard_error_s:.3f} s)"
            for signal, one in zip(telling, single, strict=True)
            if one is not None
        ]
        reason = f"estimated from {' and '.join(said)}"
    return ClockEstimate(
        offset_s=fit.shift_s if applied else 0.0,
        drift_ppm=drift_ppm if applied else 0.0,
        residual_ms=1e3 * fit.residual_s,
        standard_error_ms=1e3 * fit.standard_error_s,
        correlation=fit.correlation,
        applied=applied,
        reason=reason,
        reference=int(can_grid[0]),
    )


def _refine(signals: Sequence[Signal], can_grid: Times, shift_s: float, period: int, max_gap: int) -> Fit | None:
    """Return the fit with the window that tells more."""
    fits = [refine(signals, can_grid, shift_s, period, max_gap, window_s) for window_s in WINDOWS_S]
    return min((fit for fit in fits if fit is not None), key=lambda fit: fit.standard_error_s, default=None)


def _span(times: Sequence[Times]) -> tuple[int, int]:
    return min(int(time.min()) for time in times), max(int(time.max()) for time in times) + 1


def _doubt(fit: Fit, peak: Peak, drift_ppm: float) -> str:
    """Return why the fit cannot be relied on, empty where it can."""
    if fit.correlation < MINIMUM_CORRELATION:
        return (
            f"CAN and navigation do not agree: correlation {fit.correlation:.2f} at the best offset "
            f"{peak.shift_s:.1f} s, {MINIMUM_CORRELATION} is needed; another quantity, or too little driving{ADVICE}"
        )
    if peak.rival_s is not None:
        return f"ambiguous: offsets of {peak.shift_s:.1f} s and {peak.rival_s:.1f} s explain the signals alike{ADVICE}"
    if not fit.converged or abs(drift_ppm) > MAXIMUM_DRIFT_PPM:
        return (
            f"no offset near {peak.shift_s:.1f} s with a drift within ±{MAXIMUM_DRIFT_PPM:.0f} ppm fits throughout; "
            f"the CAN clock may have been set on the way{ADVICE}"
        )
    if fit.standard_error_s > MAXIMUM_STANDARD_ERROR_S:
        return (
            f"too little excitation: the offset {fit.shift_s:.3f} s has a standard error of "
            f"{1e3 * fit.standard_error_s:.0f} ms, more than {1e3 * MAXIMUM_STANDARD_ERROR_S:.0f} ms{ADVICE}"
        )
    return ""
