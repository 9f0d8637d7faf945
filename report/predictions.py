"""A stretch of a recording as a driver's model predicts it, against what the driver did."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..modeling.drivers import one_thread
from ..modeling.predict import load_steering_model, predict_windows, predictable
from ..schemas.project import Project
from . import model_figures
from .blocks import Figure
from .drives import readable

PREDICTIONS = 6
"""Predictions shown one after the other, where a recording has so many in a row."""


def predicted_stretch(project: Project, driver: str, recordings: Sequence[str]) -> Figure | None:
    """Predict the stretch of a driver's first recording in which the steering moves most.

    Args:
        project: The project.
        driver: Whose motion primitives predict.
        recordings: Names of the driver's recordings in the dataset.

    Returns:
        The figure; None where no recording has a whole window.

    Raises:
        InputError: The model or a table is damaged.
    """
    with one_thread():
        model = load_steering_model(project, driver)
    for recording in recordings:
        series, centres = predictable(project, model, driver, recording)
        if len(centres) == 0:
            continue
        own = series.recording == recording
        time, driven = series.time[own], series.steering_wheel_angle[own]
        made = series.time[centres]
        horizon = model.future_steps * model.period
        first, number = _liveliest(made, time, driven, horizon)
        shown = centres[np.searchsorted(made, first + horizon * np.arange(number))]
        with one_thread():  # The same bytes whatever the machine.
            table = predict_windows(model, series, shown)
        mean, sd = (np.array(table[name].to_pylist()) for name in ("mean", "sd"))
        same_stretch = series.stretch[own] == series.stretch[shown[0]]
        around = same_stretch & (time >= first - horizon // 5) & (time <= first + number * horizon)
        true = series.steering_wheel_angle[shown[:, None] + np.arange(1, model.future_steps + 1)]
        figure = model_figures.prediction(
            (time[around] - first) / 1e9,
            driven[around],
            (series.time[shown] - first) / 1e9,
            np.arange(1.0, model.future_steps + 1) * (model.period / 1e9),
            mean,
            sd,
        )
        error = np.abs(true - mean)
        caption = (
            f"{driver}/{recording} from {readable(first)}: {number} predictions of {horizon / 1e9:g} s, one after the "
            f"other, where the steering moves most. Mean error here {error.mean():.1f}°, "
            f"{100 * np.mean(error <= model_figures.WITHIN_68 * sd):.0f} % within the 68 % band."
        )
        return Figure(caption, figure)
    return None


def _liveliest(
    made: NDArray[np.int64], time: NDArray[np.int64], driven: NDArray[np.float64], horizon: int
) -> tuple[int, int]:
    """Return when the stretch begins whose steering varies most, and how many predictions follow each other in it."""
    for number in range(PREDICTIONS, 0, -1):
        begins = made[np.isin(made + (number - 1) * horizon, made)]
        for k in range(1, number - 1):
            begins = begins[np.isin(begins + k * horizon, made)]
        if len(begins):
            start, stop = np.searchsorted(time, [begins, begins + number * horizon])
            # Variances of all of them from sums over everything before, of angles about their mean. Where one is
            # missing nothing is predicted, so that it counts for nothing.
            centred = np.nan_to_num(driven - np.nanmean(driven))
            first, second = (np.append(0.0, np.cumsum(centred**power)) for power in (1, 2))
            mean, square = ((sums[stop] - sums[start]) / (stop - start) for sums in (first, second))
            return int(begins[int(np.argmax(square - mean**2))]), number
    raise ValueError("there is no prediction at all")
