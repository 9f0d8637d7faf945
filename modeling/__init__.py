"""Mixtures, the drivers' models and their evaluation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .mixture import GaussianMixture
    from .regression import MixtureRegression

__all__ = ["GaussianMixture", "MixtureRegression"]


def __getattr__(name: str) -> Any:
    if name == "GaussianMixture":
        from .mixture import GaussianMixture

        return GaussianMixture
    if name == "MixtureRegression":
        from .regression import MixtureRegression

        return MixtureRegression
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
