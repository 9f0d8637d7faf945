"""Whether mapped signals have the sign that the path says they should have."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.float64]

SLOWEST = 3.0
"""m/s; slower, steering says little about turning."""
SHORTEST_S = 20.0
REVERSED = -0.5
"""Correlation with its witness below which a signal has the wrong sign: sensors of one car never disagree so far."""
EXCITATION = {"deg/m": 0.05, "deg/s": 1.0, "m/s": 1.0, "m/s²": 0.2, "deg/s of steering": 2.0}
"""Standard deviation of a witness below which it says nothing."""


def reversed_signals(signals: Mapping[str, Values], rate: float) -> dict[str, tuple[str, float]]:
    """Find signals of the car whose sign contradicts navigation.

    Each signal has a witness that does not depend on its mapping: the steering wheel angle the curvature of the path,
    the yaw rate navigation's, the accelerations those that navigation's speed and yaw rate imply, the speed
    navigation's; and the steering wheel speed what the steering wheel angle does.

    Args:
        signals: Canonical signals on the grid, (n_samples,) each, NaN where missing.
        rate: Of the grid, Hz.

    Returns:
        For each signal with the wrong sign, what it was compared with and the correlation, in [-1, -0.5).
    """
    if "nav_speed" not in signals:
        return {}
    speed = signals["nav_speed"]
    missing = np.full(len(speed), np.nan)
    yaw_rate = signals.get("nav_yaw_rate", missing)
    steering = signals.get("steering_wheel_angle", missing)
    witnesses = {
        "steering_wheel_angle": ("the path's curvature", yaw_rate / np.maximum(speed, SLOWEST), "deg/m"),
        "steering_wheel_speed": (
            "the change of the steering wheel angle",
            _change(steering, rate),
            "deg/s of steering",
        ),
        "speed": ("navigation's speed", speed, "m/s"),
        "yaw_rate": ("navigation's yaw rate", yaw_rate, "deg/s"),
        "longitudinal_acceleration": ("the change of navigation's speed", _change(speed, rate), "m/s²"),
        "lateral_acceleration": ("navigation's speed times yaw rate", speed * np.radians(yaw_rate), "m/s²"),
    }
    found = {}
    for name, (what, witness, unit) in witnesses.items():
        if name not in signals:
            continue
        both = (speed > SLOWEST) & np.isfinite(signals[name]) & np.isfinite(witness)
        if np.count_nonzero(both) < SHORTEST_S * rate:
            continue
        values, expected = signals[name][both], witness[both]
        if np.std(expected) < EXCITATION[unit] or np.std(values) == 0:
            continue
        correlation = float(np.corrcoef(values, expected)[0, 1])
        if correlation < REVERSED:
            found[name] = (what, correlation)
    return found


def _change(values: Values, rate: float) -> Values:
    """Return the rate of change over two samples, NaN at both ends."""
    change = np.full(len(values), np.nan)
    if len(values) > 2:
        change[1:-1] = (values[2:] - values[:-2]) * (rate / 2)
    return change
