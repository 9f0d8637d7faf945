"""No training window shares a raw sample with a test window: shown by changing every raw sample and looking."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray

from wheelprint.dataset.drive import derive
from wheelprint.dataset.driver_lookahead import driver_lookahead
from wheelprint.dataset.folds import deal_folds, training_mask
from wheelprint.dataset.steering import Steering
from wheelprint.modeling.windows import Series, cut_windows, window_centres
from wheelprint.schemas.config import Config
from wheelprint.schemas.tables import SYNCED

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

SAMPLES, FOLDS, PERIOD = 110, 3, 100_000_000
PAST, FUTURE = 2, 9


def configured(smoothing: str, window: int, definition: str, points: int) -> Config:
    """Windows short enough for all of them to be tried; with so much noise every candidate counts for the spread."""
    return Config.model_validate(
        {
            "vehicle": {"wheelbase": 2.8},
            "dataset": {"smoothing": smoothing, "smoothing_window": window, "folds": FOLDS},
            "lookahead": {
                "definition": definition, "points": points, "minimum": 0.5, "steering_noise": 80.0,
                "steering_lag": 0.3,
            },
            "models": {"motion_primitives": {"past_steps": [PAST], "future_steps": FUTURE}},
        }
    )  # fmt: skip


def raw_drive() -> dict[str, Floats]:
    rng = np.random.default_rng(4)
    bend = 3 * np.sin(0.2 * np.arange(SAMPLES)) + rng.normal(0, 0.2, SAMPLES)
    speed = 12 + rng.normal(0, 0.3, SAMPLES)
    course = np.cumsum(bend)
    return {
        "x": np.cumsum(speed * np.cos(np.radians(course))) / 10,
        "y": np.cumsum(speed * np.sin(np.radians(course))) / 10,
        "course": course,
        "heading": course + rng.normal(0, 0.1, SAMPLES),
        "nav_speed": speed,
        "steering_wheel_angle": 15 * bend,
    }


def series_of(raw: dict[str, Floats], config: Config) -> tuple[Series, Floats]:
    """Return what models are given of a drive, and the spread of its lookahead distances."""
    values: dict[str, Any] = {**raw, "time": np.arange(SAMPLES) * PERIOD, "run": np.zeros(SAMPLES, np.int32)}
    columns = [
        pa.array(values[f.name], pa.int64() if f.name == "time" else f.type).cast(f.type)
        if f.name in values
        else pa.nulls(SAMPLES, f.type)
        for f in SYNCED
    ]
    drive = derive(pa.table(columns, SYNCED), [], Steering(15.0, 0.0), config)
    found, _, _ = driver_lookahead(Path(), "d", {"r": drive}, {"r": "null"}, {}, config)
    lookahead, spread = found["r"]
    return Series(
        recording=np.full(SAMPLES, "r"),
        time=drive.time,
        stretch=drive.run.astype(np.intp),
        course_deviation=drive.columns["course_deviation"],
        speed=drive.columns["speed"],
        steering_wheel_angle=drive.columns["steering_wheel_angle"],
        lookahead=lookahead,
        segment=np.zeros(SAMPLES, np.intp),
        fold=deal_folds(SAMPLES, FOLDS, 0).astype(np.int64),
    ), spread


def windows_of(series: Series, spread: Floats, lookahead_counts: bool) -> dict[str, Floats]:
    """Return every window (n_samples, …) around every row: what goes into a model and what it is to predict."""
    whole = series.has_path_and_steering
    centres = window_centres(series.stretch, whole, PAST, FUTURE)
    cut = cut_windows(series, centres, PAST, FUTURE)
    primitives = np.full((SAMPLES, cut.inputs.shape[1] + FUTURE), np.nan)
    primitives[centres] = np.concatenate([cut.inputs, cut.outputs], axis=1)
    distance = series.lookahead if lookahead_counts else np.zeros(SAMPLES)
    return {
        "motion primitives": primitives,
        "lookahead": np.column_stack([series.course_deviation, series.speed, distance, spread]),
    }


@pytest.mark.parametrize("definition", ["paper", "refined"])
@pytest.mark.parametrize(("smoothing", "window"), [("moving average", 5), ("zero-phase", 7), ("causal", 4)])
@pytest.mark.parametrize(("points", "longest_model"), [(14, "lookahead"), (6, "motion primitives")])
def test_no_raw_sample_is_in_a_training_and_in_a_test_window(
    smoothing: str, window: int, definition: str, points: int, longest_model: str
) -> None:
    """Of `refined` only what is measured: its dynamic programming ties a run's distances together at any distance."""
    config = configured(smoothing, window, definition, points)
    raw = raw_drive()
    series, spread = series_of(raw, config)
    is_paper = definition == "paper"
    before = windows_of(series, spread, is_paper)
    depends = {model: np.zeros((SAMPLES, SAMPLES), np.bool_) for model in before}  # window around a row × raw sample
    for sample in range(SAMPLES):
        for size in (0.05, -0.3):
            changed = {name: values + size * (np.arange(SAMPLES) == sample) for name, values in raw.items()}
            after = windows_of(*series_of(changed, config), is_paper)
            for model, rows in depends.items():
                same = (after[model] == before[model]) | (np.isnan(after[model]) & np.isnan(before[model]))
                rows[:, sample] |= ~same.all(axis=1)

    def shared(steps: int) -> dict[str, int]:
        """Return how many raw samples are on both sides in any fold, with an embargo of so many steps."""
        counts = dict.fromkeys(depends, 0)
        for test_fold in range(FOLDS):
            training = training_mask(series.fold, series.recording, series.time, test_fold, steps * PERIOD)
            assert training.sum() > 20
            for model, rows in depends.items():
                learnt, asked = rows[training].any(axis=0), rows[series.fold == test_fold].any(axis=0)
                counts[model] += int(np.count_nonzero(learnt & asked))
        return counts

    assert shared(config.longest_window) == {"motion primitives": 0, "lookahead": 0}
    if is_paper:  # refined distances stand on a grid, which hides the least influences
        assert shared(config.longest_window - 1)[longest_model] > 0  # so it is not longer than it has to be


def test_the_default_embargo_is_long_enough_for_the_defaults() -> None:
    config = Config.model_validate({"vehicle": {"wheelbase": 2.8}})
    assert config.longest_window == 1 + 1 + 50 + 4
    assert config.dataset.embargo * 10 == 60
