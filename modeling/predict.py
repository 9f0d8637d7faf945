"""Prediction: a trained model says how its driver would steer along a recording of the dataset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..dataset.segments import Division
from ..schemas.errors import InputError
from ..schemas.project import Project
from ..schemas.tables import TIME, field
from .drivers import read_series
from .mixture import GaussianMixture
from .motion_primitives import MotionPrimitives
from .path_ahead import label_windows
from .path_types import PathTypes
from .storage import load_model
from .windows import Floats, Rows, Series, cut_windows, window_centres

MODEL = "motion_primitives"


@dataclass(frozen=True, slots=True)
class SteeringModel:
    """All that is needed to predict a driver's steering along a path.

    Attributes:
        primitives: The fitted motion primitives.
        types: The types of path that they were fitted within.
        past_steps: n₂.
        future_steps: n₃.
        period: ns of a step.
        division: How a path is divided into segments.
    """

    primitives: MotionPrimitives
    types: PathTypes
    past_steps: int
    future_steps: int
    period: int
    division: Division

    @property
    def window(self) -> tuple[int, int]:
        """n₂ and n₃."""
        return self.past_steps, self.future_steps

    def predict(self, inputs: Floats, path_types: NDArray[Any]) -> tuple[Floats, Floats]:
        """Return means and standard deviations √var, deg, each (n_windows, n₃); see `MotionPrimitives.predict`."""
        mean, variance = self.primitives.predict(inputs, path_types)
        return mean, np.sqrt(variance)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what a file has to hold."""
        mixture = self.types.mixture
        return {
            **self.primitives.arrays(),
            "past_steps": np.array(self.past_steps),
            "future_steps": np.array(self.future_steps),
            "period": np.array(self.period),
            "division": np.array(self.division),
            "types/weights": mixture.weights_,
            "types/means": mixture.means_,
            "types/covariances": mixture.covariances_,
            "types/features": self.types.means,
            "types/logarithms": np.array(self.types.logarithms),
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """Return the model that `arrays` was taken from; raises as `MixtureRegression.from_arrays`."""
        mixture = GaussianMixture.from_parameters(*(arrays[f"types/{n}"] for n in ("weights", "means", "covariances")))
        types = PathTypes(mixture, arrays["types/features"], bool(arrays["types/logarithms"]), ())
        neutral, release, shortest = arrays["division"]
        return cls(
            MotionPrimitives.from_arrays(arrays),
            types,
            past_steps=int(arrays["past_steps"]),
            future_steps=int(arrays["future_steps"]),
            period=int(arrays["period"]),
            division=Division(float(neutral), float(release), int(shortest)),
        )


def load_steering_model(project: Project, driver: str) -> SteeringModel:
    """Load a driver's motion primitives.

    Raises:
        InputError: They were not trained, or their files are damaged.
    """
    folder = project.model_folder(MODEL, driver)
    if not folder.is_dir():
        trained = sorted(name.split("/")[1] for name in project.manifest.get("models", {}) if name.startswith(MODEL))
        there = f"trained are those of {', '.join(trained)}" if trained else "run `wheelprint train` first"
        raise InputError(folder, "", f"driver {driver!r} has no motion primitives; {there}")
    return load_model(folder, {MODEL: (SteeringModel.from_arrays, SteeringModel.predict)})[0]


def predict_steering(project: Project, model: SteeringModel, driver: str, recording: str) -> pa.Table:
    """Predict the steering along a recording of the dataset, from every sample with a whole window (MP eq. 1).

    The path up to n₃ steps ahead is taken from the recording, as a planner would give it; of the steering only what
    the driver had done by then. Types of path are what is known by then, too (`path_ahead`), so that `Predictor` gives
    the same numbers sample by sample. A recording that the model was trained on is predicted better than a new one
    would be: the evaluation says how well that is.

    Args:
        project: Its dataset holds the recording.
        model: Whose steering is predicted; need not be that of the recording's driver.
        driver: Who drove.
        recording: Name of the recording.

    Returns:
        A row for each window, see `predict_windows`. Empty where no window is whole.

    Raises:
        InputError: See `predictable`.
    """
    series, centres = predictable(project, model, driver, recording)
    return predict_windows(model, series, centres)


def predictable(project: Project, model: SteeringModel, driver: str, recording: str) -> tuple[Series, Rows]:
    """Return a driver's data and the rows t of a recording from which it can be predicted (n_windows,), from 0.

    Raises:
        InputError: The dataset cannot be read, lacks the recording, or has another sampling period than the model.
    """
    config = project.config
    if config.sync.period != model.period:
        reason = f"the model was trained on samples {model.period / 1e9:g} s apart, the dataset's are "
        reason += f"{config.sync.period / 1e9:g} s apart; train again"
        raise InputError(project.directory / "wheelprint.toml", "sync.rate", reason)
    series = read_series(project.directory, driver, config)
    allowed = series.recording == recording
    if not allowed.any():
        known = ", ".join(dict.fromkeys(series.recording.tolist()))
        reason = f"driver {driver!r} has no recording {recording!r} in the dataset; there are {known}"
        raise InputError(project.directory / "dataset", "", reason)
    rows = allowed & series.has_path_and_steering
    return series, window_centres(series.stretch, rows, max(model.past_steps, 0), model.future_steps)


def predict_windows(model: SteeringModel, series: Series, centres: Rows) -> pa.Table:
    """Predict the steering from some rows of a driver's data, see `predict_steering`.

    Args:
        model: Whose steering is predicted.
        series: The data.
        centres: Rows t (n_windows,), from 0, as `predictable` returns them or some of those.

    Returns:
        One row for each predicted window: `time` (t), `steering_wheel_angle` (deg, what the driver did at t),
        `path_type`, `regression` (the motion primitive that predicts, see `MotionPrimitives.model_of`), and as lists
        of n₃ values for t + 1 … t + n₃ `mean` and `sd`, deg; `domain_score` in nats, see
        `MotionPrimitives.domain_score`. Empty where no window is whole.
    """
    windows = cut_windows(series, centres, model.past_steps, model.future_steps)
    path_type = label_windows(series, centres, model.future_steps, model.types, model.division, model.period)
    mean, sd = model.predict(windows.inputs, path_type)
    score = model.primitives.domain_score(windows.inputs, path_type)
    names, which = np.unique(path_type, return_inverse=True)
    regression = np.array([model.primitives.model_of(name) for name in names.tolist()], dtype=np.str_)[which]
    lists = pa.list_(pa.float64(), model.future_steps)
    schema = pa.schema(
        [
            field("time", TIME, "", "when the prediction is made"),
            field("steering_wheel_angle", pa.float64(), "deg", "what the driver did then, positive left"),
            field("path_type", pa.string(), "", "previous, own and next label"),
            field("regression", pa.string(), "", "motion primitive that predicts"),
            field("mean", lists, "deg", "predicted steering wheel angle of each following step"),
            field("sd", lists, "deg", "standard deviation of each following step"),
            field("domain_score", pa.float64(), "nats", "log density of the inputs where the model learnt"),
        ]
    )
    columns = [
        pa.array(series.time[windows.centres]).cast(TIME),
        pa.array(windows.current),
        pa.array(path_type.tolist(), pa.string()),
        pa.array(regression.tolist(), pa.string()),
        *(pa.FixedSizeListArray.from_arrays(values.ravel(), type=lists) for values in (mean, sd)),
        pa.array(score),
    ]
    return pa.Table.from_arrays(columns, schema=schema)
