"""Mixtures, the drivers' models and their evaluation."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .mixture import GaussianMixture
    from .predictor import PathAhead, Predictor, Sample
    from .regression import MixtureRegression
    from .selection import select_components

__all__ = ["GaussianMixture", "MixtureRegression", "PathAhead", "Predictor", "Sample", "select_components"]

_PLACES = {
    "GaussianMixture": "mixture",
    "MixtureRegression": "regression",
    "PathAhead": "predictor",
    "Predictor": "predictor",
    "Sample": "predictor",
    "select_components": "selection",
}


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
