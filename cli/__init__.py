"""Wheelprint: raw vehicle logs in, personalised driver models out.

What the package offers to Python, each loaded when it is first asked for:

    read_frames(path)         CAN frames of a log
    decode(frames, database)  their signals in physical values, by message
    read_nav(path)            navigation at its own rate
    Project(directory)        .synced(driver), .dataset(driver), .manifest
    Predictor                 .step(sample): a driver's steering, predicted sample by sample
    modeling                  GaussianMixture, MixtureRegression, Predictor, Sample, PathAhead
    InputError                what all of them raise for bad input
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import modeling
    from .ingest.can.decode import decode
    from .ingest.readers import read_frames, read_nav
    from .modeling.predictor import Predictor
    from .schemas.errors import InputError
    from .schemas.project import Project

__version__ = "0.1.0"

__all__ = ["InputError", "Predictor", "Project", "decode", "modeling", "read_frames", "read_nav"]

_PLACES = {
    "InputError": "schemas.errors",
    "Predictor": "modeling.predictor",
    "Project": "schemas.project",
    "decode": "ingest.can.decode",
    "read_frames": "ingest.readers",
    "read_nav": "ingest.readers",
}


def __getattr__(name: str) -> Any:
    if name == "modeling":
        return import_module(f"{__name__}.modeling")
    if name in _PLACES:
        return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
