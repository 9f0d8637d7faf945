"""How the errors of the steering models are spread: over the horizon, and against the bands that they state."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..schemas.errors import InputError
from .look import GREY, LINES, SHAPES, figure_of

if TYPE_CHECKING:
    import plotly.graph_objects as go

Curves = Mapping[str, Mapping[str, Mapping[float, float]]]
"""Driver -> model -> horizon or probability -> mean over the folds."""


def read_curves(path: Path, over: str, value: str) -> Curves:
    """Read `results/horizons.csv` or `results/calibration.csv`, means over the folds.

    Args:
        path: The file.
        over: Column of the horizontal axis.
        value: Column to average.

    Raises:
        InputError: A column is missing, or something is no number.
    """
    found: dict[str, dict[str, dict[float, list[float]]]] = {}
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        if missing := [name for name in (over, value, "components") if name not in (reader.fieldnames or ())]:
            reason = f"the columns {', '.join(missing)} are missing; remove it and run `wheelprint evaluate` again"
            raise InputError(path, "line 1", reason)
        for row in reader:
            model = row["model"]
            if row["components"]:
                model += f", n₁ = {row['path_types']}, n₂ = {row['past_steps']}, n₄ = {row['components']}"
            elif row["past_steps"]:
                model += f", n₂ = {row['past_steps']}"
            try:
                if row[value]:
                    curve = found.setdefault(row["driver"], {}).setdefault(model, {})
                    curve.setdefault(float(row[over]), []).append(float(row[value]))
            except ValueError as error:
                reason = f"{over} and {value} must be numbers: {error}; run `wheelprint evaluate` again"
                raise InputError(path, f"line {reader.line_num}", reason) from None
    return {
        driver: {
            model: {place: float(np.mean(values)) for place, values in sorted(curve.items())}
            for model, curve in models.items()
        }
        for driver, models in found.items()
    }


def errors_by_horizon(models: Mapping[str, Mapping[float, float]]) -> go.Figure:
    """Show one driver's mean absolute error over the horizon, a line for each model."""
    figure = figure_of("horizon, s", "average error of the steering wheel angle, °", height=420)
    for place, (model, curve) in enumerate(models.items()):
        _add(figure, place, model, [*curve], [*curve.values()])
    figure.update_yaxes(rangemode="tozero", minallowed=0)
    return figure


def reliability(models: Mapping[str, Mapping[float, float]]) -> go.Figure:
    """Show the share of errors within each central band over the share that the band states.

    Args:
        models: For each model the share of probability integral transforms in the equal bins that begin at the keys.
    """
    figure = figure_of("share that the band states, %", "share that it holds, %", height=420)
    figure.add_scatter(x=[0, 100], y=[0, 100], mode="lines", name="calibrated", line={"color": GREY, "dash": "dot"})
    for place, (model, curve) in enumerate(models.items()):
        shares = np.array([share for _, share in sorted(curve.items())])
        half = len(shares) // 2
        # A central band is made of as many bins above the median as below it.
        held = np.cumsum(shares[half:] + shares[:half][::-1])
        stated = np.arange(half + 1) / half
        _add(figure, place, model, (100 * stated).tolist(), [0.0, *(100 * held).tolist()])
    return figure


def _add(figure: go.Figure, place: int, name: str, x: Sequence[float], y: Sequence[float]) -> None:
    figure.add_scatter(
        x=[*x],
        y=[*y],
        mode="lines+markers",
        name=name,
        line={"color": LINES[place % len(LINES)], "width": 1.8},
        marker={"symbol": SHAPES[place % len(SHAPES)], "size": 7},
    )
