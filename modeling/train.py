"""Training: each driver's models, fitted to all of the driver's data, and their model cards."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..dataset.drive import division_of
from ..schemas.config import Config
from ..schemas.errors import InputError
from ..schemas.project import Project
from ..schemas.store import describe_output, fingerprint
from ..schemas.tasks import Outcome, Task
from .baselines import Ridge
from .cells import FEWEST_SAMPLES, fit_mixture
from .drivers import describe_path_types, fit_path_types, label_rows, modelled_drivers, one_thread, read_series
from .lookahead_models import GeneralLookahead, VelocityLookahead
from .motion_primitives import windows_needed
from .predict import MODEL, SteeringModel
from .storage import FORMAT, Arrays, Golden, save_model
from .windows import Series, cut_windows, spread_out, window_centres

GOLDEN_ROWS = 20
"""Predictions that a loaded model must reproduce."""


def plan_training(project: Project) -> tuple[list[Task], list[InputError]]:
    """Plan one task for each driver and model.

    Of each grid in `[models]` the last value is trained: grids are written from the smallest to the one preferred.

    Returns:
        The tasks, and the drivers with too little data.

    Raises:
        InputError: See `drivers.modelled_drivers`.
    """
    config = project.config
    drivers, problems = modelled_drivers(project)
    made_from = {
        "version": __version__,
        "format": FORMAT,
        "period": config.sync.period,
        "models": config.models.model_dump(),
        "segments": config.segments.model_dump(),
        "smoothing": [config.dataset.smoothing, config.dataset.smoothing_window],
        "maximum_spread": config.lookahead.maximum_spread,
        "clustering_seed": config.dataset.seed,
    }
    tasks = []
    for driver, files in drivers.items():
        arguments = {"project": project.directory, "driver": driver, "files": files, "config": config}
        mark = fingerprint({**made_from, "dataset": files})
        tasks += [
            Task("models", f"{MODEL}/{driver}", train_motion_primitives, arguments, mark),
            Task("models", f"lookahead_general/{driver}", train_general_lookahead, arguments, mark),
            Task("models", f"lookahead_velocity/{driver}", train_velocity_lookahead, arguments, mark),
        ]
    return tasks, problems


def train_motion_primitives(project: Path, driver: str, files: Mapping[str, str], config: Config) -> Outcome:
    """Fit and save a driver's motion primitives, the types of path within them; see `cells.fit_mixture`.

    Args:
        project: Project folder.
        driver: Whose model.
        files: SHA-256 of the driver's dataset files by path.
        config: The project file.

    Raises:
        InputError: There are too few windows, or the dataset cannot be read.
    """
    settings = config.models.motion_primitives
    series = read_series(project, driver, config)
    past_steps, components = settings.past_steps[-1], settings.components[-1]
    past, future = max(past_steps, 0), settings.future_steps
    whole = window_centres(series.stretch, series.has_path_and_steering, past, future)
    centres = spread_out(whole, settings.max_windows)
    windows = cut_windows(series, centres, past_steps, future)
    needed = max(windows_needed(windows.inputs.shape[1] + future, components), FEWEST_SAMPLES)
    if len(centres) < needed:
        raise _too_few(project, driver, f"{len(centres)} windows", needed)
    with one_thread():
        types = fit_path_types(series, np.ones(len(series.time), dtype=np.bool_), config)
        path_type = label_rows(series, types, config)[centres]
        penalty = Ridge.fit(windows.inputs, windows.outputs, gap=past + future).penalty
        inputs, n1 = settings.inputs[-1], settings.path_types[-1]
        primitives, facts = fit_mixture(inputs, windows, path_type, [n1], past_steps, components, penalty, config)
        model = SteeringModel(primitives, types, past_steps, future, config.sync.period, division_of(config))
        chosen = golden_rows(len(centres))
        golden = (windows.inputs[chosen], path_type[chosen])
        predicted = model.predict(*golden)
    card = {
        "title": f"How {driver} steers: motion primitives by Gaussian mixture regression",
        "paper": "Wang et al., Learning and Generalizing Motion Primitives from Driving Data (MP)",
        "inputs": {
            "course_deviation": {"unit": "deg per sample", "steps": [-past, future]},
            "speed": {"unit": "m/s", "steps": [-past, future]},
            "steering_wheel_angle": {"unit": "deg", "steps": [-past_steps, 0] if past_steps >= 0 else []},
        },
        "outputs": {"steering_wheel_angle": {"unit": "deg", "steps": [1, future]}},
        "parameters": {
            "inputs": inputs,
            "path_types": n1,
            "past_steps": past_steps,
            "future_steps": future,
            "components": components,
            "starts": settings.starts,
            "seed": config.models.seed,
            **facts,
        },
        "windows": dict(primitives.samples),
        "fallbacks": primitives.fallbacks(),
        "clusters": describe_path_types(types),
        "limits": [
            "It needs the path and the speed of the following steps, as a planner knows them.",
            f"Its signals were smoothed over {config.dataset.smoothing_window} samples, {_which(config)}.",
            "Beyond the angles, speeds and curvatures it was trained on it extrapolates linearly.",
            "Emergencies were left out of what it learnt.",
        ],
    }
    return _save(project, MODEL, driver, files, config, series, model.arrays(), card, Golden(golden, predicted))


def _which(config: Config) -> str:
    return "none of them later ones" if config.dataset.smoothing == "causal" else "half of them later ones"


def train_general_lookahead(project: Path, driver: str, files: Mapping[str, str], config: Config) -> Outcome:
    """Fit and save the general regression of a driver's lookahead distance (PP eq. 13).

    Arguments and errors are as for `train_motion_primitives`, samples instead of windows.
    """
    settings = config.models.lookahead
    model = GeneralLookahead(settings.components[-1], settings.starts, config.models.seed)
    return _train_lookahead(project, "lookahead_general", model, driver, files, config, {})


def train_velocity_lookahead(project: Path, driver: str, files: Mapping[str, str], config: Config) -> Outcome:
    """Fit and save the velocity-based regression of a driver's lookahead distance (PP eqs. 18 to 21).

    Arguments and errors are as for `train_motion_primitives`, samples instead of windows.
    """
    settings = config.models.lookahead
    regressors = settings.regressors[-1]
    model = VelocityLookahead(settings.components[-1], regressors, settings.starts, config.models.seed)
    return _train_lookahead(project, "lookahead_velocity", model, driver, files, config, {"regressors": regressors})


def _train_lookahead(
    project: Path,
    kind: str,
    model: GeneralLookahead | VelocityLookahead,
    driver: str,
    files: Mapping[str, str],
    config: Config,
    parameters: Mapping[str, Any],
) -> Outcome:
    series = read_series(project, driver, config)
    learnt = spread_out(np.flatnonzero(series.has_lookahead), config.models.lookahead.max_samples)
    inputs, lookahead = series.path_points[learnt], series.lookahead[learnt]
    if len(inputs) < FEWEST_SAMPLES:
        raise _too_few(project, driver, f"{len(inputs)} samples with a lookahead distance", FEWEST_SAMPLES)
    with one_thread():
        model.fit(inputs, lookahead)
        golden = inputs[golden_rows(len(inputs))]
        predicted = model.predict(golden)
    card = {
        "title": f"How far ahead {driver} looks: lookahead distance by Gaussian mixture regression",
        "paper": "Li et al., Two Learning-Based Personalized Driver Models for Pure Pursuit (PP)",
        "inputs": {"course_deviation": {"unit": "deg per sample"}, "speed": {"unit": "m/s"}},
        "outputs": {"lookahead": {"unit": "m"}},
        "parameters": {
            "components": model.components,
            **parameters,
            "starts": model.starts,
            "seed": model.seed,
        },
        "samples": len(inputs),
        "fallbacks": list(model.fallbacks),
        "limits": [
            "Straight driving taught it nothing: a lookahead distance is defined only where the path bends.",
            "Beyond the speeds and curvatures it was trained on it extrapolates linearly.",
        ],
    }
    return _save(project, kind, driver, files, config, series, model.arrays(), card, Golden((golden,), predicted))


def _save(
    project: Path,
    kind: str,
    driver: str,
    files: Mapping[str, str],
    config: Config,
    series: Series,
    arrays: Arrays,
    card: Mapping[str, Any],
    golden: Golden,
) -> Outcome:
    """Publish a model; its card also says what data it learnt from and between which values they lay."""
    columns = {
        "course_deviation": (series.course_deviation, "deg per sample"),
        "speed": (series.speed, "m/s"),
        "steering_wheel_angle": (series.steering_wheel_angle, "deg"),
    }
    data = {
        "driver": driver,
        "recordings": len(np.unique(series.recording)),
        "hours": len(series.time) * config.sync.period / 3600e9,
        "ranges": {
            name: {"minimum": float(np.nanmin(values)), "maximum": float(np.nanmax(values)), "unit": unit}
            for name, (values, unit) in columns.items()
        },
        "dataset": dict(files),
        "wheelprint": __version__,
    }
    written = save_model(Project(project).model_folder(kind, driver), kind, arrays, {**card, **data}, golden)
    return Outcome({"outputs": [describe_output(project, path) for path in written], "parameters": card["parameters"]})


def golden_rows(samples: int) -> NDArray[np.intp]:
    """Return `GOLDEN_ROWS` of the samples or fewer, from the first to the last (n_chosen,)."""
    return np.unique(np.linspace(0, samples - 1, GOLDEN_ROWS).astype(np.intp))


def _too_few(project: Path, driver: str, found: str, needed: int) -> InputError:
    reason = (
        f"driver {driver!r}: {found}, and {needed} are needed; add recordings, decide about proposed events "
        "(`wheelprint review`), or ask for fewer components"
    )
    return InputError(project / "wheelprint.toml", "models", reason)
