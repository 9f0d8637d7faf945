"""Prediction as a stream: sample by sample, as a car does it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from ..schemas.project import Project
from .path_ahead import HISTORY, label_present
from .predict import SteeringModel, load_steering_model
from .windows import Floats


class Sample(NamedTuple):
    """What is known at one moment, as a row of the dataset has it.

    Attributes:
        time: ns UTC.
        course_deviation: deg per sample, positive to the left; NaN where nothing came before.
        speed: m/s.
        steering_wheel_angle: deg, positive to the left, without the sensor's offset.
    """

    time: int
    course_deviation: float
    speed: float
    steering_wheel_angle: float


class PathAhead(NamedTuple):
    """A planned path at the model's period.

    Attributes:
        course_deviation: deg per sample (n_steps,), positive to the left.
        speed: m/s (n_steps,).
    """

    course_deviation: npt.ArrayLike
    speed: npt.ArrayLike


@dataclass(frozen=True, slots=True)
class Prediction:
    """How the driver would steer over the next n₃ steps.

    Attributes:
        time: Of the sample, ns UTC.
        mean: Steering wheel angle at each step ahead (n₃,), deg, positive to the left.
        sd: Its standard deviation (n₃,), deg.
        domain_score: Log density of the inputs where the model learnt, nats.
        path_type: Previous, own and next label, as far as they are known by now.
        regression: The motion primitive that predicts.
    """

    time: int
    mean: Floats
    sd: Floats
    domain_score: float
    path_type: str
    regression: str


class Predictor:
    """Predicts a driver's steering sample by sample; the same numbers as `predict.predict_steering`.

    It keeps the last minute of samples, however long it drives. The path ahead comes with each step, or
    from a plan. Nothing reaches across a gap: a sample that does not follow one period after the last one begins anew,
    and so does one without a course deviation.

        predictor = Predictor.load("project", "driver01")
        predictor.plan(start, PathAhead(course_deviation, speed))
        for sample in samples:
            if prediction := predictor.step(sample):
                print(prediction.mean[0], prediction.sd[0])

    Args:
        model: The driver's.
    """

    def __init__(self, model: SteeringModel) -> None:
        self.model = model
        self._past: deque[Sample] = deque(maxlen=max(HISTORY // model.period, model.past_steps) + 1)
        self._plan: tuple[int, Floats] | None = None

    @classmethod
    def load(cls, project: str | Path, driver: str) -> Self:
        """Return the predictor of a trained model.

        Args:
            project: Folder with wheelprint.toml.
            driver: Whose model.

        Raises:
            InputError: See `predict.load_steering_model`.
        """
        return cls(load_steering_model(Project(Path(project)), driver))

    def reset(self) -> None:
        """Forget what was driven, as after a gap; a plan stays."""
        self._past.clear()

    def plan(self, start: int, path: PathAhead) -> None:
        """Take a planned path for the steps to come, in place of an earlier one.

        Args:
            start: When its first step is, ns UTC.
            path: Any number of steps, one period apart.

        Raises:
            ValueError: Its two parts differ in length.
        """
        self._plan = (start, self._two_rows(path))

    def step(self, sample: Sample, ahead: PathAhead | None = None) -> Prediction | None:
        """Take the next sample and predict; see `MotionPrimitives.predict` for the formulas, the sd = √variance.

        Args:
            sample: What is known now.
            ahead: The path of the following n₃ steps or more; None: as planned.

        Returns:
            The prediction; None where there are too few past samples, or the plan does not reach n₃ steps ahead.

        Raises:
            ValueError: The path ahead has fewer than n₃ steps or missing values.
        """
        model = self.model
        follows = bool(self._past) and sample.time == self._past[-1].time + model.period
        if not follows or not np.isfinite(sample.course_deviation):
            self.reset()
        self._past.append(sample)
        path = self._planned(sample.time) if ahead is None else self._two_rows(ahead)[:, : model.future_steps]
        if ahead is not None and (path.shape[1] < model.future_steps or not np.isfinite(path).all()):
            raise ValueError(f"the path ahead must have {model.future_steps} steps and no missing values")
        past = np.array(self._past)[:, 1:]
        window = past[-max(model.past_steps, 0) - 1 :]
        if path.shape[1] < model.future_steps or len(past) <= max(model.past_steps, 0) or not np.isfinite(window).all():
            return None
        deviation, speed = path
        seen = window[len(window) - 1 - model.past_steps :, 2]
        inputs = np.concatenate([window[:, 0], deviation, window[:, 1], speed, seen])
        path_type = label_present(
            np.append(past[:, 0], deviation),
            np.append(past[:, 1], speed),
            len(past) - 1,
            model.types,
            model.division,
            model.period,
        )
        mean, variance, score = model.primitives.predict_one(inputs, path_type)
        regression = model.primitives.model_of(path_type)
        return Prediction(sample.time, mean, np.sqrt(variance), score, path_type, regression)

    def _planned(self, time: int) -> Floats:
        """Return what is planned for the n₃ steps after `time` (2, n₃); nothing, (2, 0), where it does not reach."""
        if self._plan is None:
            return np.empty((2, 0))
        start, path = self._plan
        first, off_grid = divmod(time - start, self.model.period)
        ahead = path[:, first + 1 : first + 1 + self.model.future_steps]
        reaches = not off_grid and first >= -1 and np.isfinite(ahead).all()
        return ahead if reaches else np.empty((2, 0))

    @staticmethod
    def _two_rows(path: PathAhead) -> Floats:
        deviation, speed = (np.asarray(values, dtype=np.float64) for values in path)
        if deviation.ndim != 1 or deviation.shape != speed.shape:
            raise ValueError(
                f"course_deviation and speed of a path must have the same shape (n_steps,), found {deviation.shape} "
                f"and {speed.shape}"
            )
        return np.stack([deviation, speed])
