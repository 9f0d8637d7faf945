"""Windows of a driver's data: what a motion primitive is given and what it predicts (MP section II and eqs. 11 to 14).

Around a row t, with n₂ past and n₃ future steps of 0.1 s, a window has these channels, each block in the order of time:

    inputs   Δθ  at t − p … t + n₃     deg per sample, the path's course deviation
             v   at t − p … t + n₃     m/s, the path's speed
             δ   at t − n₂ … t         deg, the steering wheel angle that was seen
    outputs  δ   at t + 1 … t + n₃     deg, the steering wheel angle that follows

with p = max(n₂, 0). For n₂ = −1 no steering is seen, not even the current one, and the path from t on remains. The
path ahead is an input because it is the reference to be tracked.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .estimator import RowSource

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rows = NDArray[np.intp]

SERIES = ("time", "run", "course_deviation", "speed", "steering_wheel_angle", "lookahead", "segment", "fold")
"""Columns of the dataset that a `Series` is made of, `recording` aside."""


@dataclass(frozen=True, slots=True)
class Series:
    """A driver's dataset as arrays (n_rows,), recordings one after another, each in the order of time.

    Attributes:
        recording: Name of the recording.
        time: ns UTC.
        stretch: Number of the uninterrupted stretch of rows, one period apart; never falls.
        course_deviation: deg per sample, positive to the left; NaN in the first row of a stretch.
        speed: m/s.
        steering_wheel_angle: deg, positive to the left, without the sensor's offset.
        lookahead: m; NaN where undefined.
        segment: Number of the path segment among all of the driver's, rising by one from 0.
        fold: Cross-validation group.
    """

    recording: NDArray[Any]
    time: NDArray[np.int64]
    stretch: NDArray[np.intp]
    course_deviation: Floats
    speed: Floats
    steering_wheel_angle: Floats
    lookahead: Floats
    segment: NDArray[np.intp]
    fold: NDArray[np.int64]

    @classmethod
    def from_table(cls, table: pa.Table, period: int) -> Series:
        """Take the arrays from a driver's dataset.

        Args:
            table: Columns `recording` and `SERIES`, as `Project.dataset(driver)` returns them.
            period: ns between two rows of a run.

        Raises:
            KeyError: A column is missing.
        """
        time: NDArray[np.int64] = table["time"].cast(pa.int64()).to_numpy()
        names = table["recording"].combine_chunks().dictionary_encode()
        recording = np.array(names.dictionary.to_pylist(), dtype=str)[names.indices.to_numpy()]
        new_recording = _changes(recording)
        new_stretch = new_recording | _changes(table["run"].to_numpy())
        new_stretch[1:] |= np.diff(time) != period
        return cls(
            recording=recording,
            time=time,
            stretch=np.cumsum(new_stretch) - 1,
            course_deviation=table["course_deviation"].to_numpy(),
            speed=table["speed"].to_numpy(),
            steering_wheel_angle=table["steering_wheel_angle"].to_numpy(),
            lookahead=table["lookahead"].to_numpy(),
            segment=np.cumsum(new_recording | _changes(table["segment"].to_numpy())) - 1,
            fold=table["fold"].to_numpy().astype(np.int64),
        )

    @property
    def has_path_and_steering(self) -> Mask:
        """Rows with everything a motion primitive needs (n_rows,)."""
        return np.isfinite(self.course_deviation) & np.isfinite(self.speed) & np.isfinite(self.steering_wheel_angle)

    @property
    def path_points(self) -> Floats:
        """O = [Δθ, v] (n_rows, 2), deg per sample and m/s: what lookahead models are given (PP section II-B)."""
        return np.column_stack([self.course_deviation, self.speed])

    @property
    def has_lookahead(self) -> Mask:
        """Rows with everything that a lookahead model needs (n_rows,)."""
        return np.isfinite(self.course_deviation) & np.isfinite(self.speed) & np.isfinite(self.lookahead)


@dataclass(frozen=True, slots=True)
class Windows:
    """Windows around rows of a series.

    Attributes:
        centres: Row t of each window (n_windows,).
        inputs: Shape (n_windows, 2 (max(n₂, 0) + 1 + n₃) + n₂ + 1), laid out as the module says, in its units.
        outputs: Shape (n_windows, n₃), deg.
        current: Steering wheel angle at t (n_windows,), deg; for n₂ = −1 it is not among the inputs.
    """

    centres: Rows
    inputs: Floats
    outputs: Floats
    current: Floats


def window_centres(stretch: NDArray[np.integer[Any]], allowed: Mask, past: int, future: int) -> Rows:
    """Return the rows t whose window t − past … t + future is whole: one stretch, and every row allowed.

    Args:
        stretch: Number of the uninterrupted stretch of every row (n_rows,), never falling.
        allowed: Rows that a window may touch (n_rows,): those of training or of one test fold, with all values there.
        past: Steps before t, at least 0.
        future: Steps after t, at least 0.

    Returns:
        Rising, shape (n_windows,).
    """
    length = past + 1 + future
    if len(stretch) < length:
        return np.empty(0, dtype=np.intp)
    allowed_before = np.concatenate([[0], np.cumsum(allowed)])
    all_allowed = allowed_before[length:] - allowed_before[:-length] == length
    one_stretch = stretch[length - 1 :] == stretch[: len(stretch) - length + 1]
    return np.flatnonzero(all_allowed & one_stretch) + past


def spread_out(centres: Rows, most: int) -> Rows:
    """Return the rows t to learn from (n_windows,): all of them, or `most` evenly spread ones.

    Windows 0.1 s apart share all but one sample; `docs/method.md` says what is lost by it.
    """
    if len(centres) <= most:
        return centres
    return centres[np.linspace(0, len(centres) - 1, most).round().astype(np.intp)]


def cut_windows(series: Series, centres: Rows, past_steps: int, future_steps: int) -> Windows:
    """Cut the windows around the given rows (MP eqs. 11 to 14).

    Args:
        series: The driver's data.
        centres: Rows t, as `window_centres` returns them for at least max(`past_steps`, 0) past and `future_steps`
            future steps.
        past_steps: n₂ of MP, at least −1.
        future_steps: n₃ of MP.

    Returns:
        Shapes and units are those of `Windows` and the module.
    """
    path = centres[:, None] + np.arange(-max(past_steps, 0), future_steps + 1)
    seen = centres[:, None] + np.arange(-past_steps, 1)
    ahead = centres[:, None] + np.arange(1, future_steps + 1)
    steering = series.steering_wheel_angle
    inputs = np.concatenate([series.course_deviation[path], series.speed[path], steering[seen]], axis=1)
    return Windows(centres, inputs, steering[ahead], steering[centres])


class WindowRows(RowSource):
    """Inputs and outputs of windows side by side, cut from the series whenever rows are asked for.

    81 h of driving have 2.9 million windows of 153 channels: 3.5 GB as an array, 70 MB as series.
    """

    def __init__(self, series: Series, centres: Rows, past_steps: int, future_steps: int) -> None:
        """Take what `cut_windows` takes; the rows are its inputs and outputs in one."""
        past = max(past_steps, 0)
        path, steering = past + 1 + future_steps, past_steps + 1 + future_steps
        self.shape = (len(centres), 2 * path + steering)
        self._centres = centres
        # Steering that is seen and steering that follows are one window: the outputs continue the inputs.
        self._parts = [
            (np.array(values, dtype=np.float64), length)
            for values, length in (
                (series.course_deviation, path),
                (series.speed, path),
                (series.steering_wheel_angle, steering),
            )
        ]
        self._future = future_steps

    def __getitem__(self, index: slice | Rows) -> Floats:
        """Return the windows around some of the centres, (n, n_inputs + n_outputs), in the units of the module."""
        from .window_rows import cut

        centres = self._centres[index]
        rows = np.empty((len(centres), self.shape[1]))
        column = 0
        for values, length in self._parts:
            cut(values, centres + (self._future + 1 - length), column, length, rows)
            column += length
        return rows


def _changes(values: NDArray[Any]) -> Mask:
    """Return which values (n,) differ from the one before; the first one does."""
    changed = np.ones(len(values), dtype=np.bool_)
    changed[1:] = values[1:] != values[:-1]
    return changed
