"""From quantities as navigation units tell them to the canonical navigation signals."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from ..schemas.signals import NAV_SIGNALS
from .navigation import SLOWEST_COURSE, anticlockwise_from_east, horizontal_motion, is_on_earth

Values = npt.NDArray[np.float64]


def canonical_signals(told: Mapping[str, Values]) -> dict[str, npt.NDArray[np.generic]]:
    """Return the navigation signals that quantities amount to.

    What is canonical stays as it is and comes before what could be made of other quantities. A course is missing where
    a speed is told with it that is below `SLOWEST_COURSE`. Where there is no position yet, units send zeros: latitude
    and longitude that are both exactly 0, or that are nowhere on earth, are missing.

    Args:
        told: (n,) values by name of `QUANTITIES`, in its units; NaN where missing.

    Returns:
        (n,) values by canonical name, NaN where missing; `latitude`, `longitude` and `altitude` always.
    """
    missing = np.full(len(next(iter(told.values()))), np.nan)
    signals = {"latitude": missing, "longitude": missing, "altitude": missing}
    if "velocity_north" in told and "velocity_east" in told:
        signals["nav_speed"], signals["course"] = horizontal_motion(told["velocity_north"], told["velocity_east"])
    if "position_accuracy_north" in told and "position_accuracy_east" in told:
        signals["position_accuracy"] = np.hypot(told["position_accuracy_north"], told["position_accuracy_east"])
    for name in ("course", "heading"):
        if f"{name}_clockwise" in told:
            signals[name] = anticlockwise_from_east(told[f"{name}_clockwise"])
    signals |= {name: told[name] for name in NAV_SIGNALS if name in told}
    with np.errstate(invalid="ignore"):
        if "course" in signals and "nav_speed" in signals:
            signals["course"] = np.where(signals["nav_speed"] < SLOWEST_COURSE, np.nan, signals["course"])
        latitude, longitude = signals["latitude"], signals["longitude"]
        nowhere = ((latitude == 0) & (longitude == 0)) | ~is_on_earth(latitude, longitude, np.zeros_like(latitude))
    for name in ("latitude", "longitude"):
        signals[name] = np.where(nowhere, np.nan, signals[name])
    return {name: np.asarray(values) for name, values in signals.items()}
