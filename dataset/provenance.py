"""What a dataset file was made from and with, so that equal provenance means equal bytes on one machine."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

from .. import __version__
from ..schemas.config import Config
from ..schemas.store import fingerprint
from ..schemas.times import iso_utc
from .events import Event
from .situations import Situation
from .steering import Steering

LIBRARIES = ("numba", "numpy", "pyarrow", "scipy")
"""Whose versions may change the last digits or the bytes."""

Files = Mapping[str, tuple[str, str]]
"""Recording -> path from the project folder and SHA-256."""


def parameters_of(config: Config, steering: Steering) -> dict[str, Any]:
    """Return everything in the project file, and of the calibration, that decides what is in a dataset.

    The embargo and the largest spread only matter to those who take rows from it.
    """
    return {
        "sync": {"rate": config.sync.rate},
        "vehicle": {"wheelbase": config.vehicle.wheelbase},
        "steering": asdict(steering),
        "dataset": config.dataset.model_dump(exclude={"embargo"}),
        "lookahead": config.lookahead.model_dump(exclude={"maximum_spread"}),
        "segments": config.segments.model_dump(),
    }


def provenance(
    synced: Files,
    references: Files,
    events: Iterable[Event],
    situations: Iterable[Situation],
    steering: Steering,
    config: Config,
) -> dict[str, Any]:
    """Return what a driver's dataset was made from, ready for JSON; every file of the driver carries it.

    It is that of all the driver's recordings, because types of path and folds are: a recording more may change the
    labels in every file. Of `events.csv` and `situations.csv` it takes what they say of this driver and what decides
    about rows: no decision about another driver, and neither who decided nor whether, changes it.

    Args:
        synced: The driver's synced tables.
        references: Their reference paths.
        events: Of the driver.
        situations: Of the driver.
        steering: Calibration of the car's steering.
        config: The project file.
    """
    left_out = [(e.recording, iso_utc(e.start), iso_utc(e.stop), e.kind) for e in events if e.is_left_out]
    tagged = [
        (s.recording, iso_utc(s.start), iso_utc(s.stop), s.situation, s.decision)
        for s in situations
        if s.decision != "rejected"
    ]
    return {
        "versions": {"wheelprint": __version__, **{name: version(name) for name in LIBRARIES}},
        "parameters": parameters_of(config, steering),
        "inputs": dict(sorted([*synced.values(), *references.values()])),
        "events": {"left_out": len(left_out), "sha256": fingerprint(left_out)},
        "situations": {"tagged": len(tagged), "sha256": fingerprint(tagged)},
    }
