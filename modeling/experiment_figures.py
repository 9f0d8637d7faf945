"""The cells behind the papers' pictures: MP's Fig. 2, and PP's Figs. 6 and 7."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..schemas.config import Config
from ..schemas.tasks import Outcome
from .bicycle import Bicycle
from .drivers import one_thread, read_series
from .driving import drive_track
from .experiment_cells import publish_cell
from .experiment_models import FUTURE_STEPS, fit_structure, known_lookahead, split_windows
from .lookahead_models import GeneralLookahead, VelocityLookahead
from .motion_primitives import N1
from .track import lay_track
from .windows import Floats, Rows

METHODS: dict[str, tuple[N1, int, int]] = {"proposed": (27, 1, 3), "general": (1, -1, 9)}
"""MP's Fig. 2: n₁, n₂ and n₄ of the two methods it compares."""

QUANTILES = (1.0, 0.9, 0.7, 0.4)
"""The four situations: of this rank among the test windows by how far the steering wheel turns."""

TRACK_COMPONENTS, TRACK_REGRESSORS = 12, 3
"""Of the models on PP's track; PP does not say which n₂."""

SHOWN = ("time", "distance", "x", "y", "deviation", "lookahead", "lookahead_sd")
"""What is kept of a drive along the track, beside the angle of the road wheels."""


def draw_situations(project: Path, driver: str, fold: int, faithful: bool, config: Config) -> Outcome:
    """Predict four windows of a test fold by MP's proposed and its general method (Fig. 2).

    Args:
        project: Project folder.
        driver: Whose data.
        fold: The test fold, from 0.
        faithful: Formulas as printed.
        config: The project file.

    Returns:
        The cell: of each situation `time_s` (s), `course_deviation` (deg per sample), `speed` (m/s), what was `driven`
        (deg), and by method `mean` and `sd` = √variance (deg) of each step.

    Raises:
        InputError: There are too few windows to learn from, no segment lies entirely in the training folds, or the
            dataset cannot be read.
    """
    series = read_series(project, driver, config)
    situations: list[dict[str, Any]] = []
    with one_thread():
        for method, (n1, past_steps, components) in METHODS.items():
            split = split_windows(project, driver, series, fold, past_steps, config, faithful=faithful)
            if not situations:
                chosen = _situations(split.asked.outputs, split.asked.centres)
                for letter, window in zip("abcd", chosen.tolist(), strict=False):
                    around = np.arange(FUTURE_STEPS + 1) + split.asked.centres[window]
                    situations.append(
                        {
                            "driver": driver,
                            "fold": fold,
                            "situation": letter,
                            "time_s": (0.1 * np.arange(FUTURE_STEPS + 1)).tolist(),
                            "course_deviation": series.course_deviation[around].tolist(),
                            "speed": series.speed[around].tolist(),
                            "path_type": split.path_type[around].tolist(),
                            "driven": series.steering_wheel_angle[around].tolist(),
                            "methods": {},
                        }
                    )
            primitives = fit_structure(
                split.learnt.inputs, split.learnt.outputs, split.learnt_types, components, config.models.seed,
                past_steps, faithful=faithful,
            ).coarser(n1)  # fmt: skip
            mean, variance = primitives.predict(split.asked.inputs[chosen], split.asked_types[chosen])
            sd, error = np.sqrt(variance), np.abs(mean - split.asked.outputs[chosen])
            for place, situation in enumerate(situations):
                situation["methods"][method] = {
                    "mean": mean[place].tolist(),
                    "sd": sd[place].tolist(),
                    "mean_error": float(error[place].mean()),
                    "mean_sd": float(sd[place].mean()),
                }
    return publish_cell(project, "situations", driver, f"fold{fold}.json", situations, {}, faithful=faithful)


def follow_track(project: Path, driver: str, fold: int, faithful: bool, config: Config) -> Outcome:
    """Drive PP's test track with the lookahead distances of both models at N = 12 (Figs. 6 and 7).

    The car is a kinematic bicycle without delay, steered by PP's eq. 1 (see `driving.drive_track`).

    Args:
        project: Project folder.
        driver: Whose models, of the training folds.
        fold: The test fold.
        faithful: Predictions are the arg max (eq. 10) instead of the mean.
        config: The project file.

    Returns:
        The cell: of each model the drive in the units of `driving.drive_track`, and `road_wheel_angle` (deg).

    Raises:
        InputError: There are too few samples to learn from, or the dataset cannot be read.
    """
    series = read_series(project, driver, config)
    inputs, lookahead, training, _ = known_lookahead(project, driver, series, fold, config)
    estimate: Any = "mode" if faithful else "mean"
    seed = config.models.seed
    track = lay_track()
    rows = []
    with one_thread():
        for model in (
            GeneralLookahead(TRACK_COMPONENTS, starts=3, seed=seed, estimate=estimate),
            VelocityLookahead(TRACK_COMPONENTS, TRACK_REGRESSORS, starts=3, seed=seed, estimate=estimate),
        ):
            model.fit(inputs[training], lookahead[training])
            driven = drive_track(track, model, Bicycle(config.vehicle.wheelbase))
            rows.append(
                {
                    "driver": driver,
                    "model": "general" if isinstance(model, GeneralLookahead) else "velocity",
                    "components": TRACK_COMPONENTS,
                    "mean_deviation_m": float(np.abs(driven["deviation"]).mean()),
                    "largest_deviation_m": float(np.abs(driven["deviation"]).max()),
                    "mean_sd_m": float(driven["lookahead_sd"].mean()),
                    **{name: np.round(driven[name], 4).tolist() for name in SHOWN},
                    "road_wheel_angle": np.round(driven["steering_wheel_angle"], 4).tolist(),
                }
            )
    facts = {"track": {"x": np.round(track.x, 3).tolist(), "y": np.round(track.y, 3).tolist()}}
    return publish_cell(project, "track", driver, f"fold{fold}.json", rows, facts, faithful=faithful)


def _situations(outputs: Floats, centres: Rows) -> Rows:
    """Return the windows of `QUANTILES`; they do not overlap, and where the fold is too short there are fewer."""
    order = np.argsort(np.ptp(outputs, axis=1), kind="stable")
    chosen: list[int] = []
    for quantile in QUANTILES:
        nearest = np.argsort(np.abs(np.arange(len(order)) - quantile * (len(order) - 1)), kind="stable")
        free = (w for w in order[nearest].tolist() if all(abs(centres[w] - centres[o]) > FUTURE_STEPS for o in chosen))
        chosen += [window for window in (next(free, None),) if window is not None]
    return np.array(chosen, dtype=np.intp)
