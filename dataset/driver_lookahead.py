"""The lookahead distances of all of a driver's recordings, as `[lookahead]` defines them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ..schemas.config import Config, Lookahead
from ..schemas.errors import InputError
from .drive import Drive
from .lookahead import TYPICAL_NOISE, among_points, points_ahead
from .path import Floats
from .reference import FARTHEST, Reference, read_reference
from .refined_lookahead import refined_lookahead
from .steering_lag import Manner, Sight, estimate_manner

_DETOUR = 1.5
"""Length of path that may lead to a point, over its straight-line distance."""


def driver_lookahead(
    project: Path,
    driver: str,
    drives: Mapping[str, Drive],
    origins: Mapping[str, str],
    files: Mapping[str, tuple[str, str]],
    config: Config,
) -> tuple[dict[str, tuple[Floats, Floats]], dict[str, Any], list[InputError]]:
    """Return lookahead distance and spread in m of every recording, and how the driver was found to steer.

    Along the driven path smoothed positions are compared with a smoothed path, which shifts both alike. A reference is
    as it is, and so is the car that is compared with it.

    Args:
        project: Project folder.
        driver: Whose recordings.
        drives: The recordings.
        origins: Of each recording: latitude, longitude, altitude as JSON, or "null".
        files: Reference file of each recording that has one, from the project folder, and its SHA-256.
        config: The project file.

    Returns:
        The distances by recording, NaN where there are none; what the manifest says of the driver: definition,
        reference, lag and noise, each with what it rests on; and what the references are no use for.
    """
    settings, wheelbase, period = config.lookahead, config.vehicle.wheelbase, config.sync.period
    on_reference = settings.reference != "driven"
    references: dict[str, Reference] = {}
    problems: list[InputError] = []
    for name in sorted(drives.keys() & files.keys()):
        try:
            references[name] = read_reference(project / files[name][0], json.loads(origins[name]), config)
        except InputError as error:
            problems.append(error)
    sights = {
        name: _along_reference(drive, references[name], settings) if name in references else _as_driven(drive, settings)
        for name, drive in drives.items()
        if name in references or not on_reference
    }
    problems += [
        InputError(references[name].file, "", _astray(f"{driver}/{name}"))
        for name, sight in sights.items()
        if sight.place is not None and np.isnan(sight.place).all()
    ]
    manner = _given_manner(settings)
    if on_reference and settings.definition == "refined":
        estimated = estimate_manner(list(sights.values()), wheelbase, settings, period, TYPICAL_NOISE)
        if estimated.reason:
            asked = [key for key in ("steering_lag", "steering_noise") if getattr(settings, key) == "estimate"]
            reason = (
                f"driver {driver!r}: nothing can be estimated, and a lag of {estimated.lag:g} s and a noise of "
                f"{estimated.noise:g} deg are assumed: {estimated.reason}. Write numbers, or check the reference"
            )
            where = ", ".join(f"lookahead.{key}" for key in asked)
            problems += [InputError(project / "wheelprint.toml", where, reason)] if asked else []
        noise = estimated.noise if settings.steering_noise == "estimate" else settings.steering_noise
        manner = Manner(**(asdict(estimated) | {"noise": noise}))
    found = {}
    for name, drive in drives.items():
        if (sight := sights.get(name)) is None:
            found[name] = (np.full(len(drive.time), np.nan), np.full(len(drive.time), np.nan))
        elif settings.definition == "refined":
            found[name] = refined_lookahead(sight, wheelbase, settings, period, manner.lag, manner.noise)
        else:
            found[name] = among_points(
                sight.x, sight.y, sight.heading, sight.road_wheel_angle, sight.path_x, sight.path_y,
                sight.first + 1, sight.stop, wheelbase, settings, manner.noise,
            )  # fmt: skip
    facts = {
        "definition": settings.definition,
        "reference": settings.reference,
        "steering_lag_s": manner.lag if settings.definition == "refined" else None,
        "steering_lag_standard_error_s": manner.lag_standard_error,
        "steering_noise_deg": manner.noise,
        "law_base_m": manner.base,
        "law_time_s": manner.time,
        "samples": manner.samples,
        "reason": manner.reason,
    }
    return found, facts, problems


def _astray(recording: str) -> str:
    return (
        f"{recording} is nowhere within {FARTHEST:g} m of this path in its direction, and has no lookahead distance; "
        "is it the right road, in the direction of travel, and in the right coordinates?"
    )


def _given_manner(settings: Lookahead) -> Manner:
    lag = 0.0 if settings.steering_lag == "estimate" else settings.steering_lag
    noise = TYPICAL_NOISE if settings.steering_noise == "estimate" else settings.steering_noise
    return Manner(lag, None, noise, None, None, 0)


def _as_driven(drive: Drive, settings: Lookahead) -> Sight:
    columns = drive.columns
    following, stop = points_ahead(drive.run, settings.points)
    x, y = columns["x"], columns["y"]
    heading = np.where(np.isnan(columns["heading"]), columns["course"], columns["heading"])
    return Sight(
        x, y, heading, columns["speed"], columns["road_wheel_angle"], drive.run, x, y, following - 1, stop
    )  # fmt: skip


def _along_reference(drive: Drive, reference: Reference, settings: Lookahead) -> Sight:
    measured = drive.measured
    x, y = measured["x"], measured["y"]
    heading = np.where(np.isnan(measured["heading"]), measured["course"], measured["heading"])
    place = reference.locate(x, y, measured["course"], drive.run)
    path_x, path_y, first, stop = reference.ahead(place, _DETOUR * settings.maximum)
    return Sight(
        x, y, heading, measured["speed"], measured["road_wheel_angle"], drive.run, path_x, path_y, first, stop,
        reference, place,
    )  # fmt: skip
