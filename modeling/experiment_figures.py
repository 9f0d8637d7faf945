"""The cells behind the papers' pictures: MP's Fig. 2, and PP's Figs. 6 and 7."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ..schemas.config import Config
from ..schemas.tasks import Outcome
from .drivers import one_thread, read_series
from .experiment_cells import FUTURE_STEPS, fit_structure, known_lookahead, publish_cell, split_windows
from .lookahead_models import GeneralLookahead, VelocityLookahead
from .motion_primitives import N1
from .windows import Floats, Rows

METHODS: dict[str, tuple[N1, int, int]] = {"proposed": (27, 1, 3), "general": (1, -1, 9)}
"""MP's Fig. 2: n₁, n₂ and n₄ of the two methods it compares."""

QUANTILES = (1.0, 0.9, 0.7, 0.4)
"""The four situations: of this rank among the test windows by how far the steering wheel turns."""

TRACK_COMPONENTS, TRACK_REGRESSORS = 12, 3
"""Of the models on PP's track; PP does not say which n₂."""

SLOWEST, FASTEST = 10 / 3.6, 40 / 3.6
"""m/s, PP section IV-D."""

LATERAL_ACCELERATION = 2.0
"""m/s², by which the track's speed follows from its curvature within those limits."""

STEP = 0.1
"""s."""

SPACING = 0.25
"""m between the points of the track."""

TRACK = ((40, 0), (31, 20), (25, 0), (25, -12), (20, -30), (19, 12), (30, 0), (75, 40), (12, -8), (60, 0))
"""Length (m) and signed radius (m, 0: straight) of its pieces; PP gives none."""


def draw_situations(project: Path, driver: str, fold: int, faithful: bool, config: Config) -> Outcome:
    """Predict four windows of a test fold by MP's proposed and its general method (Fig. 2).

    Args:
        project: Project folder.
        driver: Whose data.
        fold: The test fold.
        faithful: Formulas as printed.
        config: The project file.

    Raises:
        InputError: There are too few windows to learn from.
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

    The car is a kinematic bicycle without delay, steered by PP's eq. 1; the path point's course deviation is that of
    the track at the car's speed.

    Args:
        project: Project folder.
        driver: Whose models, of the training folds.
        fold: The test fold.
        faithful: Predictions are the arg max (eq. 10) instead of the mean.
        config: The project file.

    Raises:
        InputError: There are too few samples to learn from.
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
            driven = drive_track(model, track, config.vehicle.wheelbase)
            rows.append(
                {
                    "driver": driver,
                    "model": "general" if isinstance(model, GeneralLookahead) else "velocity",
                    "components": TRACK_COMPONENTS,
                    "mean_deviation_m": float(np.abs(driven["deviation"]).mean()),
                    "largest_deviation_m": float(np.abs(driven["deviation"]).max()),
                    "mean_sd_m": float(driven["lookahead_sd"].mean()),
                    **{name: np.round(values, 4).tolist() for name, values in driven.items()},
                }
            )
    facts = {"track": {name: np.round(track[name], 3).tolist() for name in ("x", "y")}}
    return publish_cell(project, "track", driver, f"fold{fold}.json", rows, facts, faithful=faithful)


def lay_track() -> dict[str, Floats]:
    """Return the track's points every `SPACING` metres.

    They have `x`, `y` (m), `heading` (rad), `curvature` (1/m, positive left) and `speed` (m/s), each (n_points,). The
    speed keeps to `LATERAL_ACCELERATION` between `SLOWEST` and `FASTEST` and is averaged over 20 m.
    """
    curvature = np.concatenate([np.full(round(length / SPACING), 1 / r if r else 0.0) for length, r in TRACK])
    heading = np.cumsum(curvature) * SPACING
    fastest = np.sqrt(LATERAL_ACCELERATION / np.maximum(np.abs(curvature), 1e-6))
    around = round(10 / SPACING)
    padded = np.pad(np.clip(fastest, SLOWEST, FASTEST), around, mode="edge")
    speed = np.convolve(padded, np.full(2 * around + 1, 1 / (2 * around + 1)), mode="valid")
    return {
        "x": np.cumsum(np.cos(heading)) * SPACING,
        "y": np.cumsum(np.sin(heading)) * SPACING,
        "heading": heading,
        "curvature": curvature,
        "speed": speed,
    }


def drive_track(
    model: GeneralLookahead | VelocityLookahead, track: dict[str, Floats], wheelbase: float
) -> dict[str, Floats]:
    """Steer a kinematic bicycle along a track by pure pursuit (PP eq. 1) with a model's lookahead distances.

    Args:
        model: A fitted model.
        track: See `lay_track`.
        wheelbase: L, m.

    Returns:
        Per step of 0.1 s (n_steps,): `time` (s), `distance` along the track (m), `x`, `y` (m), `deviation` from the
        track (m, positive left), `road_wheel_angle` (deg), `lookahead` and `lookahead_sd` (m).
    """
    x, y, heading = float(track["x"][0]), float(track["y"][0]), float(track["heading"][0])
    last, near, time = len(track["x"]) - 1, 0, 0.0
    states: list[tuple[float, ...]] = []
    while near < last and time < 300.0:
        ahead = slice(near, near + round(10 / SPACING))
        near += int(np.argmin(np.hypot(track["x"][ahead] - x, track["y"][ahead] - y)))
        course, speed = float(track["heading"][near]), float(track["speed"][near])
        deviation = math.cos(course) * (y - track["y"][near]) - math.sin(course) * (x - track["x"][near])
        turned = math.degrees(track["curvature"][near] * speed * STEP)
        mean, sd = model.predict(np.array([[turned, speed]]))
        h = max(float(mean[0]), speed * STEP)
        far = np.hypot(track["x"][near:] - x, track["y"][near:] - y) >= h
        if not far.any():
            break
        goal = near + int(np.argmax(far))
        alpha = math.atan2(track["y"][goal] - y, track["x"][goal] - x) - heading
        angle = math.atan(2 * math.sin(alpha) * wheelbase / h)
        states.append((time, near * SPACING, x, y, deviation, math.degrees(angle), h, float(sd[0])))
        turn = speed * STEP * math.tan(angle) / wheelbase
        x += speed * STEP * math.cos(heading + turn / 2)
        y += speed * STEP * math.sin(heading + turn / 2)
        heading += turn
        time += STEP
    names = ("time", "distance", "x", "y", "deviation", "road_wheel_angle", "lookahead", "lookahead_sd")
    return dict(zip(names, np.array(states).T, strict=True))


def _situations(outputs: Floats, centres: Rows) -> Rows:
    """Return the windows of `QUANTILES`; they do not overlap, and where the fold is too short there are fewer."""
    order = np.argsort(np.ptp(outputs, axis=1), kind="stable")
    chosen: list[int] = []
    for quantile in QUANTILES:
        nearest = np.argsort(np.abs(np.arange(len(order)) - quantile * (len(order) - 1)), kind="stable")
        free = (w for w in order[nearest].tolist() if all(abs(centres[w] - centres[o]) > FUTURE_STEPS for o in chosen))
        chosen += [window for window in (next(free, None),) if window is not None]
    return np.array(chosen, dtype=np.intp)
