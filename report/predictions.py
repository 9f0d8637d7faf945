"""A stretch of a recording as a driver's model predicts it, against what the driver did."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..modeling.drivers import one_thread
from ..modeling.predict import load_steering_model, predict_steering
from ..schemas.project import Project
from ..schemas.store import read_table
from . import model_figures
from .blocks import Figure
from .drives import column, nanoseconds, readable

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
        with one_thread():  # The same bytes whatever the machine.
            table = predict_steering(project, model, driver, recording)
        if len(table) == 0:
            continue
        dataset = read_table(project.dataset_file(driver, recording))
        time, driven = nanoseconds(dataset), column(dataset, "steering_wheel_angle")
        made, horizon = nanoseconds(table), model.future_steps * model.period
        first, number = _liveliest(made, time, driven, horizon)
        shown = [int(np.searchsorted(made, first + k * horizon)) for k in range(number)]
        mean, sd = (np.array([table[name][row].as_py() for row in shown]) for name in ("mean", "sd"))
        run = column(dataset, "run")
        same_run = run == run[np.searchsorted(time, first)]
        around = same_run & (time >= first - horizon // 5) & (time <= first + number * horizon)
        true = np.array([driven[np.searchsorted(time, made[row]) + 1 :][: model.future_steps] for row in shown])
        figure = model_figures.prediction(
            (time[around] - first) / 1e9,
            driven[around],
            (made[shown] - first) / 1e9,
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
            edges = np.searchsorted(time, [begins, begins + number * horizon])
            spread = [float(np.std(driven[start:stop])) for start, stop in edges.T]
            return int(begins[int(np.argmax(spread))]), number
    raise ValueError("there is no prediction at all")
