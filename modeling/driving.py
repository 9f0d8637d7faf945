"""Driving a track with a law of the lookahead distance: as the law says, within the driver's limits, or made stable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from .bicycle import LOCK, Bicycle
from .driver_limits import DriverLimits
from .lookahead_laws import LookaheadLaw
from .track import SPACING, STEP, FloatArray, Track

Control = Literal["pursuit", "bounded", "combined"]

CONTROLS: tuple[Control, ...] = ("pursuit", "bounded", "combined")
"""The law as it is; lookahead and steering within what the driver has shown; and that one with the controller."""

NEAREST = 1.0
"""m; a law that says less, where it extrapolates, is not followed."""

STRANGE, KNOWN = 1e-3, 1e-2
"""Share of the inputs learnt from that lie further out: below the second the controller begins to take over, below the
first it has."""

TOLERANCE = 1.0
"""m off the path, from which on the controller takes over, all of it at twice that: half a lane less half a car."""

HANDS = 500.0
"""deg/s at the steering wheel; the car of `combined` turns it no faster."""

FALL = 0.5
"""Share of the limit of the rate at which the limit of the angle falls at most: a car off the path may run ahead."""

Drive = Mapping[str, FloatArray]


def drive_track(
    track: Track,
    law: LookaheadLaw,
    bicycle: Bicycle,
    control: Control = "pursuit",
    limits: DriverLimits | None = None,
    domain: FloatArray | None = None,
    offset: float = 0.0,
    tolerance: float = TOLERANCE,
) -> Drive:
    """Steer a bicycle along a track by pure pursuit (PP eq. 1) with a law's lookahead distances.

    As in PP IV-D the law is given the course deviation and the speed of the path point at which the car is. The car
    has the track's speed, and begins where the driver was. See `path_following.follow` for what it does.

    Args:
        track: Where.
        law: How far ahead the driver looks.
        bicycle: The car.
        control: `pursuit`, `bounded` or `combined`; the latter two need `limits`, the last one `domain`.
        limits: What the driver has shown.
        domain: Share of the inputs learnt from that lie further out than the track's `inputs` (n,); see
            `MixtureRegression.domain_probability`.
        offset: m, how far to the left of there the car begins.
        tolerance: m off the path from which on the controller of `combined` takes over.

    Returns:
        Per `track.STEP` of driving, each (n_rows,): `time` (s), `distance` along the track, `x`, `y` (m), `deviation`
        (m, positive to the left of the track), `speed` (m/s), `steering_wheel_angle` (deg), `lookahead` and its
        `lookahead_sd` (m), `driver_share` (1 where the law steers alone, 0 where the controller does) and
        `driver_angle` (deg, steering wheel angle of the driver alone). It ends where the track does not reach as
        far ahead as the driver looks.

    Raises:
        ValueError: Limits or domain are needed and not given.
    """
    from .path_following import COLUMNS, Chassis, Way, follow
    from .pure_pursuit import Line

    if (control != "pursuit" and limits is None) or (control == "combined" and domain is None):
        raise ValueError(f"control {control!r} needs limits, and 'combined' a domain too")
    lookahead, sd = law.predict(track.inputs)
    lock = np.radians(LOCK)
    angle, rate = np.full(len(lookahead), lock), np.full(len(lookahead), np.inf)
    share = np.ones(len(lookahead))
    if limits is not None and control != "pursuit":
        shown = limits.at(track.speed)
        lookahead = np.clip(lookahead, shown.nearest, shown.farthest)
        rate = np.radians(shown.rate / bicycle.ratio)
        angle = _reachable(np.minimum(np.radians(shown.angle / bicycle.ratio), lock), rate, track.speed)
    if domain is not None and control == "combined":
        share = share_within(domain)
    hands = float(np.radians(HANDS / bicycle.ratio)) if control == "combined" else np.inf
    began = track.steering_wheel_angle[0]
    if not np.isfinite(began):
        began = float(bicycle.steering_wheel_angle(track.curvature[:1], track.speed[:1])[0])
    rows = follow(
        Line(track.x, track.y, SPACING),
        Way(track.course, track.curvature, track.speed, np.maximum(lookahead, NEAREST), share, angle, rate),
        Chassis(bicycle.wheelbase, bicycle.understeer, float(lock), hands),
        tolerance if control == "combined" else np.inf,
        track.start[0] + offset,
        track.start[1],
        float(np.radians(began / bicycle.ratio)),
    )
    driven = dict(zip(COLUMNS, np.ascontiguousarray(rows.T), strict=True))
    for name in ("steering_wheel_angle", "driver_angle"):
        driven[name] = np.degrees(driven[name]) * bicycle.ratio
    return {**driven, "lookahead_sd": np.interp(driven["distance"], track.distance, sd)}


def share_within(domain_probability: FloatArray) -> FloatArray:
    """Return the share of the driver's model in the steering (n,) by how common its inputs are where it learnt.

    With u = log(P / `STRANGE`) / log(`KNOWN` / `STRANGE`) within [0, 1] it is u² (3 − 2u).

    Args:
        domain_probability: P, share of the inputs learnt from that lie further out (n,).
    """
    scale = np.log(np.maximum(domain_probability, 1e-300) / STRANGE) / np.log(KNOWN / STRANGE)
    within = np.clip(scale, 0.0, 1.0)
    share: FloatArray = within * within * (3.0 - 2.0 * within)
    return share


def as_driven(track: Track) -> Drive:
    """Return what the driver did along a track in the form of a drive, NaN where nobody knows.

    From one point of the track to the next the time is Δt = 2 `SPACING` / (v_i + v_i+1).

    Returns:
        Per `track.STEP`, each (n_rows,): `time` (s), `distance`, `deviation` and `lookahead` (m),
        `steering_wheel_angle` (deg), with the signs of `drive_track`.
    """
    passed = np.concatenate([[0.0], np.cumsum(SPACING / ((track.speed[1:] + track.speed[:-1]) / 2))])
    time = np.arange(0.0, passed[-1], STEP)
    series = {
        "distance": track.distance,
        "deviation": track.deviation,
        "steering_wheel_angle": track.steering_wheel_angle,
        "lookahead": track.lookahead,
    }
    return {"time": time, **{name: np.interp(time, passed, values) for name, values in series.items()}}


def measure(driven: Sequence[tuple[Track, Drive]]) -> dict[str, Any]:
    """Measure drives along the stretches of one path together; every 0.1 s counts once.

    Args:
        driven: Each stretch and the drive along it, as `drive_track` returns it; one at least.

    Returns:
        `tracking_rms` (√ of the mean square), `tracking_95` (95 % are less), `tracking_max`: distance from the path, m;
        `steering_rate_rms` (deg/s) and `steering_change_rms`, that of its rate (deg/s²), at the steering wheel;
        `steering_error` (deg) and `lookahead_error` (m): mean absolute difference to the driver's at the same place of
        the path, None where the driver's is not known; `taken_over`: share of the time in which the controller had more
        than half of the steering; `distance` in m and `seconds`.
    """
    off, rates, changes, steering, lookahead, shares = (np.concatenate(parts) for parts in zip(
        *(_differences(track, drive) for track, drive in driven), strict=True,
    ))  # fmt: skip
    return {
        "tracking_rms": _rms(off),
        "tracking_95": float(np.quantile(np.abs(off), 0.95)) if np.isfinite(off).all() else None,
        "tracking_max": float(np.abs(off).max()) if np.isfinite(off).all() else None,
        "steering_rate_rms": _rms(rates),
        "steering_change_rms": _rms(changes),
        "steering_error": _mean_absolute(steering),
        "lookahead_error": _mean_absolute(lookahead),
        "taken_over": float(np.mean(shares < 0.5)),
        "distance": float(sum(np.ptp(drive["distance"]) for _, drive in driven)),
        "seconds": float(sum(len(drive["time"]) * STEP for _, drive in driven)),
    }


def _differences(track: Track, drive: Drive) -> tuple[FloatArray, ...]:
    rate = np.diff(drive["steering_wheel_angle"]) / STEP
    steered = np.interp(drive["distance"], track.distance, track.steering_wheel_angle)
    looked = np.interp(drive["distance"], track.distance, track.lookahead)
    return (
        drive["deviation"],
        rate,
        np.diff(rate) / STEP,
        drive["steering_wheel_angle"] - steered,
        drive["lookahead"] - looked,
        drive.get("driver_share", np.ones(len(drive["time"]))),
    )


def _reachable(angle: FloatArray, rate: FloatArray, speed: FloatArray) -> FloatArray:
    """Return the limit of the angle (n,), lower where else it would fall faster than the wheel may be turned.

    At a point it is the least of the neighbours, too: between two points it is not more than what holds there.
    """
    angle = np.minimum(angle, np.minimum(np.append(angle[1:], angle[-1]), np.append(angle[0], angle[:-1])))
    turned = np.concatenate([[0.0], np.cumsum(FALL * rate[:-1] * SPACING / np.maximum(speed[:-1], speed[1:]))])
    reachable: FloatArray = np.minimum.accumulate((angle + turned)[::-1])[::-1] - turned
    return np.minimum(reachable, angle)


def _rms(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(np.square(known)))) if len(known) else None


def _mean_absolute(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.abs(known).mean()) if len(known) else None
