"""A path from the bus alone, where a recording has no navigation: speed and yaw rate, integrated.

The path begins at (0, 0) towards the east, anew in every stretch of samples; heading and course are the same, for a
point of the car that does not slip sideways (the middle of the rear axle). What it is worth is said with it: the yaw
rate's bias turns it, and its noise lets it wander.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..schemas.angles import wrap_degrees
from .resample import Times, Values, grid, number_runs, resample
from .stored_signals import SampledSignal

SECOND = 1_000_000_000
STANDSTILL = 0.1
"""m/s; slower, a car stands: wheel speed sensors say zero from somewhat higher speeds downwards."""
SETTLING_S = 0.5
"""Left out at both ends of a standstill, where the car still rolls or nods."""
SHORTEST_STANDSTILL_S = 1.0
BIAS_INSTABILITY = 0.02
"""deg/s; what a car's yaw rate sensor is taken to wander by where fewer than three standstills tell it."""
UNKNOWN_BIAS = 0.3
"""deg/s; where the car never stands, how far the bias of a car's sensor may be from 0."""


class Standstill(NamedTuple):
    """What a yaw rate sensor says while the car stands.

    Attributes:
        bias: deg/s, 0 where the car never stands.
        bias_error: deg/s, standard error of the bias at any time: from the noise, and from how much more the
            standstills differ than noise explains (0.02 deg/s where there are fewer than three); 0.3 deg/s where the
            car never stands.
        noise: deg/s/√Hz. Where the car never stands, from second differences, which know something of the car's motion.
        seconds: For how long it stood.
    """

    bias: float
    bias_error: float
    noise: float
    seconds: float


class DeadReckoning(NamedTuple):
    """A path from the bus.

    Attributes:
        signals: `x`, `y` (m), `course`, `heading` (deg, anticlockwise from where the stretch began), `nav_speed` (m/s)
            and `nav_yaw_rate` (deg/s, the bias taken away) on the grid and the clock of CAN, NaN in gaps.
        facts: What the manifest says of it.
    """

    signals: dict[str, SampledSignal]
    facts: dict[str, Any]


def dead_reckon(can: Mapping[str, SampledSignal], period: int, max_gap: int) -> DeadReckoning | None:
    """Integrate speed and yaw rate to a path.

    ``heading' = yaw rate - bias``, ``(x, y)' = speed·(cos heading, sin heading)``, by the trapezoidal rule from sample
    to sample, where heading and position are 0 at the beginning of each run. The bias is the mean yaw rate of all
    standstills, from half a second after the car stopped until half a second before it moves.

    The drift that the facts state is one standard deviation, in m, a kilometre of straight driving at the mean speed
    after a run's beginning: a bias of b turns the path by b·t, which is b·s²/(2·v) across it; white noise of spectral
    density N² makes the heading a random walk, which is N·(s/v)^1.5·v/√3 across it. What the scales of both signals are
    wrong by (worn tyres) comes on top; the bus alone cannot tell it.

    Args:
        can: Canonical signals by name; `speed` and `yaw_rate` are used.
        period: Of the grid, ns, at least that of both signals to be exact.
        max_gap: Longest gap that is bridged, ns; a longer one ends a run.

    Returns:
        The path; None where the bus has not both signals, or never both at once for two samples.
    """
    if "speed" not in can or "yaw_rate" not in can:
        return None
    sources = can["speed"], can["yaw_rate"]
    if not all(len(source.time) for source in sources):
        return None
    start = max(int(source.time.min()) for source in sources)
    stop = min(int(source.time.max()) for source in sources)
    time = grid(start, stop + 1, period)
    speed = resample(can["speed"].time, can["speed"].values, time, "linear", max_gap, period)
    measured = resample(can["yaw_rate"].time, can["yaw_rate"].values, time, "mean", max_gap, period)
    run = number_runs(np.isfinite(speed + measured)).astype(np.int64)
    if np.count_nonzero(np.diff(run[run >= 0]) == 0) == 0:
        return None
    standstill = at_standstill(speed, measured, period)
    yaw_rate = measured - standstill.bias
    heading, x, y = integrate_path(speed, yaw_rate, run, period / SECOND)
    course = wrap_degrees(heading)
    values = {"x": x, "y": y, "course": course, "heading": course, "nav_speed": np.abs(speed), "nav_yaw_rate": yaw_rate}
    signals = {name: SampledSignal(time, signal) for name, signal in values.items()}
    return DeadReckoning(signals, _facts(run, speed, standstill, period))


def integrate_path(speed: Values, yaw_rate: Values, run: Times, period_s: float) -> tuple[Values, Values, Values]:
    """Integrate by the trapezoidal rule, anew in every run.

    Args:
        speed: (n,) m/s.
        yaw_rate: (n,) deg/s, positive to the left.
        run: (n,) number of the stretch of samples, -1 where there is none.
        period_s: From sample to sample, s.

    Returns:
        Heading, deg anticlockwise from where the run began, not wrapped, x along that direction and y to its left, m;
        (n,) each, NaN outside of runs.
    """
    inside = run >= 0
    joined = np.concatenate(([False], (run[1:] == run[:-1]) & inside[1:]))

    def integral(rate: Values) -> Values:
        rate = np.where(inside, rate, 0.0)
        area = np.where(joined, 0.5 * period_s * (rate + np.concatenate(([0.0], rate[:-1]))), 0.0)
        total = np.cumsum(area)
        first = np.maximum.accumulate(np.where(joined, 0, np.arange(len(total))))
        return np.where(inside, total - total[first], np.nan)

    heading = integral(yaw_rate)
    angle = np.radians(heading)
    return heading, integral(speed * np.cos(angle)), integral(speed * np.sin(angle))


def at_standstill(speed: Values, yaw_rate: Values, period: int) -> Standstill:
    """Return what a yaw rate sensor reads when the car stands.

    Args:
        speed: (n,) m/s on a grid, NaN where missing.
        yaw_rate: (n,) deg/s.
        period: Of the grid, ns.
    """
    stands = number_runs((np.abs(speed) < STANDSTILL) & np.isfinite(yaw_rate))
    margin, needed = (round(seconds * SECOND / period) for seconds in (SETTLING_S, SHORTEST_STANDSTILL_S))
    stood = []
    index = np.flatnonzero(stands >= 0)
    for part in np.split(index, np.flatnonzero(np.diff(stands[index])) + 1):
        # A log that begins or ends with the car at rest needs no margin there.
        first = 0 if not len(part) or part[0] == 0 else margin
        last = len(part) - (0 if not len(part) or part[-1] == len(speed) - 1 else margin)
        if last - first >= needed:
            stood.append(yaw_rate[part[first:last]])
    per_root_hz = float(np.sqrt(period / SECOND))
    if not stood:
        second = yaw_rate[2:] - 2 * yaw_rate[1:-1] + yaw_rate[:-2]
        second = second[np.isfinite(second + speed[1:-1])]
        deviation = 1.4826 * float(np.median(np.abs(second))) / np.sqrt(6) if len(second) else 0.0
        return Standstill(0.0, UNKNOWN_BIAS, deviation * per_root_hz, 0.0)
    together = np.concatenate(stood)
    deviation = float(np.sqrt(sum(np.sum((part - part.mean()) ** 2) for part in stood) / len(together)))
    wander = BIAS_INSTABILITY
    if len(stood) >= 3:
        explained = np.mean([deviation**2 / len(part) for part in stood])
        wander = float(np.sqrt(max(np.var([part.mean() for part in stood], ddof=1) - explained, 0.0)))
    # The median withstands a car that is turned on a ferry or a turntable; its error is 1.25 that of the mean.
    error = float(np.hypot(1.25 * deviation / np.sqrt(len(together)), wander))
    return Standstill(float(np.median(together)), error, deviation * per_root_hz, len(together) * period / SECOND)


def _facts(run: Times, speed: Values, standstill: Standstill, period: int) -> dict[str, Any]:
    inside = run >= 0
    moving = inside & (np.abs(speed) > STANDSTILL)
    mean_speed = float(np.mean(np.abs(speed[moving]))) if moving.any() else 0.0
    seconds = 1000.0 / mean_speed if mean_speed else 0.0
    turned = np.radians(standstill.bias_error) * 500.0 * seconds
    wandered = np.radians(standstill.noise) * seconds**1.5 * mean_speed / np.sqrt(3.0)
    return {
        "source": "bus: speed and yaw rate integrated",
        "runs": int(run.max()) + 1,
        "distance_m": float(np.nansum(np.abs(speed[inside])) * period / SECOND),
        "standstill_s": standstill.seconds,
        "yaw_rate_bias_deg_s": standstill.bias,
        "yaw_rate_bias_standard_error_deg_s": standstill.bias_error,
        "yaw_rate_noise_deg_s_sqrt_hz": standstill.noise,
        "drift_m_per_km": float(np.hypot(turned, wandered)),
        "heading_drift_deg_per_minute": float(np.hypot(60.0 * standstill.bias_error, standstill.noise * np.sqrt(60.0))),
    }
