"""The car's steering: as the project file says, or estimated from all recordings and kept in the manifest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from .. import __version__
from ..schemas.errors import InputError
from ..schemas.project import Project
from ..schemas.store import Manifest, fingerprint
from .calibration import MINIMUM_S, estimate_steering
from .path import Floats

SERIES = {
    "steering_wheel_angle": ("steering_wheel_angle",),
    "yaw rate": ("nav_yaw_rate", "yaw_rate"),
    "speed": ("nav_speed", "speed"),
}
"""What the calibration looks at -> the columns of a synced table that say it, the preferred one first."""


@dataclass(frozen=True, slots=True)
class Steering:
    """What turns the measured steering wheel angle into the angle of the road wheels.

    Attributes:
        ratio: Steering wheel angle over road wheel angle.
        offset: deg, what the steering wheel angle reads when the car goes straight.
    """

    ratio: float
    offset: float


def steering_series(table: pa.Table) -> Floats:
    """Return `SERIES` of a synced table (3, n_samples + 1), NaN in gaps and at the end, where the next one joins."""
    series = np.full((len(SERIES), len(table) + 1), np.nan)
    in_run = table["run"].is_valid().to_numpy()
    for values, columns in zip(series[:, :-1], SERIES.values(), strict=True):
        for column in columns:
            missing = in_run & np.isnan(values)
            values[missing] = table[column].to_numpy()[missing]
    return series


def calibrate(project: Project, made_from: Any, recordings: Sequence[Floats]) -> tuple[Steering, list[InputError]]:
    """Return the steering of the project's vehicle, and tell the manifest what it is and how well it is known.

    Args:
        project: Whose `[vehicle]` says a number or "estimate".
        made_from: What identifies the recordings, in any form that JSON can hold; while it, the vehicle and the rate
            stay the same, nothing is estimated anew.
        recordings: `steering_series` of every recording.

    Returns:
        The steering, and what speaks against the given numbers.

    Raises:
        InputError: What is to be estimated cannot be told from these recordings.
    """
    vehicle, rate = project.config.vehicle, project.config.sync.rate
    ratio = None if vehicle.steering_ratio == "estimate" else vehicle.steering_ratio
    offset = None if vehicle.steering_offset == "estimate" else vehicle.steering_offset
    manifest = Manifest(project.directory)
    mark = fingerprint([__version__, made_from, rate, vehicle.wheelbase, ratio, offset])
    known = manifest.content.get("calibration", {})
    if known.get("fingerprint") != mark:
        wheel, yaw_rate, speed = series = np.concatenate(recordings, axis=1)
        found = estimate_steering(wheel, yaw_rate, speed, vehicle.wheelbase, ratio=ratio, offset=offset, rate=rate)
        absent = [name for name, values in zip(SERIES, series, strict=True) if np.isnan(values).all()]
        known = {
            "fingerprint": mark,
            "steering_ratio": found.ratio,
            "steering_ratio_standard_error": found.ratio_standard_error,
            "steering_offset_deg": found.offset,
            "steering_offset_deg_standard_error": found.offset_standard_error,
            "understeer_deg_per_m_s2": found.understeer,
            "samples": found.samples,
            "estimated": [
                name for name, given in (("steering_ratio", ratio), ("steering_offset", offset)) if given is None
            ],
            "reason": f"no recording has any {' or '.join(absent)}" if absent else found.reason,
        }
        manifest.put("calibration", known)
    told = {"steering_ratio": known["steering_ratio"], "steering_offset": known["steering_offset_deg"]}
    untold = [f"vehicle.{key}" for key, value in told.items() if value is None]
    path = project.directory / "wheelprint.toml"
    if untold:
        reason = f"no number is given, and none can be estimated: {known['reason']}"
        raise InputError(path, ", ".join(untold), reason)
    doubts = []
    # With too little driving there is nothing to estimate, but nothing against the given numbers either.
    if known["reason"] and known["samples"] >= MINIMUM_S * rate:
        reason = f"taken as given, although {known['reason']}"
        doubts.append(InputError(path, "vehicle.steering_ratio, vehicle.steering_offset", reason))
    return Steering(known["steering_ratio"], known["steering_offset_deg"]), doubts
