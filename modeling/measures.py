"""What a forecast is measured by on a test fold: error, coverage, ranked probability score, and how they are spread."""

from __future__ import annotations

from typing import Any

import numpy as np

from .calibration import Forecast
from .windows import Floats

HORIZONS = (0.1, 0.2, 0.3, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0)
"""Horizons, in s, of `results/horizons.csv`."""

PROBABILITY_BINS = 20
"""Bins of the probability integral transform in `results/calibration.csv`."""

Row = dict[str, Any]


def measure(forecast: Forecast, truth: Floats, step: float) -> tuple[Row, list[Row], list[Row]]:
    """Measure a forecast against what the driver did.

    Args:
        forecast: Of windows to test.
        truth: What happened, deg (n_windows, n_steps).
        step: s between two steps.

    Returns:
        Measures over all steps: `mean_error` (deg, absolute) and `mean_variance` (deg²), MP's ave_err and var;
        `coverage_68`, `coverage_95` (shares), `crps` (deg, `Calibration.crps`), `samples` (windows). The same by
        `horizon` (s), with `bias` (deg). By `probability`, the lower edge of a bin of the probability integral
        transform, the `share` of all steps that fell there: calibrated distributions fill every bin alike. Without
        windows the values are None.
    """
    errors = truth - forecast.mean
    calibration, sd = forecast.calibration, forecast.sd
    probability = calibration.probability(errors, sd)
    size = np.abs(errors)
    quantities = {
        "mean_error": size,
        "mean_variance": calibration.variance(sd),
        "coverage_68": size <= calibration.half_width(sd, 0.68),
        "coverage_95": size <= calibration.half_width(sd, 0.95),
        "crps": calibration.crps(errors, sd, probability),
    }
    overall: Row = {name: _mean(values) for name, values in quantities.items()}
    steps = [(horizon, round(horizon / step) - 1) for horizon in HORIZONS]
    horizons: list[Row] = [
        {
            "horizon": horizon,
            "bias": _mean(-errors[:, place]),
            **{name: _mean(values[:, place]) for name, values in quantities.items()},
            "samples": len(errors),
        }
        for horizon, place in steps
        if 0 <= place < errors.shape[1]
    ]
    counts, edges = np.histogram(probability, PROBABILITY_BINS, (0.0, 1.0))
    probabilities: list[Row] = [
        {"probability": round(float(edge), 6), "share": float(count / errors.size) if errors.size else None}
        for edge, count in zip(edges, counts, strict=False)
    ]
    return {**overall, "samples": len(errors)}, horizons, probabilities


def _mean(values: np.ndarray[Any, Any]) -> float | None:
    return float(values.mean()) if values.size else None
