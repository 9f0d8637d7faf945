"""Training of personal models that are kept: population, adaptation, and learning that goes on drive by drive."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..schemas.config import Config
from ..schemas.errors import InputError
from ..schemas.project import Project
from ..schemas.store import describe_output, fingerprint
from ..schemas.tasks import Outcome, Task
from .drivers import modelled_drivers, one_thread, read_recording, read_series
from .estimator import FloatArray
from .motion_primitives import TOLERANCE
from .online import OnlineMixture
from .personal import QUANTITIES, Quantity, Samples, fit_own, personalise, samples_needed, take_samples
from .personal_models import PersonalModel, window_of
from .storage import CARD, FORMAT, Golden, load_model, save_model
from .train import golden_rows
from .windows import Series

POPULATION = "population"
"""What the driver of the population's models is called."""

UNITS = {
    "steering": ({"course_deviation": "deg per sample", "speed": "m/s", "steering_wheel_angle": "deg"}, "deg"),
    "lookahead": ({"course_deviation": "deg per sample", "speed": "m/s"}, "m"),
}
"""Units of the inputs by name, and of the output."""


def plan_population(project: Project) -> list[Task]:
    """Plan the population's models, one for each quantity.

    Returns:
        The tasks; none where `models.personal.train` says so or fewer than two drivers are modelled.

    Raises:
        InputError: See `drivers.modelled_drivers`.
    """
    drivers, _ = modelled_drivers(project)
    if not project.config.models.personal.train or len(drivers) < 2:
        return []
    arguments = {"project": project.directory, "drivers": drivers, "config": project.config}
    mark = _mark(project.config, drivers)
    return [
        Task(
            "models", f"population_{quantity}/{POPULATION}", train_population, {**arguments, "quantity": quantity}, mark
        )
        for quantity in QUANTITIES
    ]


def plan_adaptation(project: Project) -> list[Task]:
    """Plan the adaptation of the population's models to every driver; returns and raises as `plan_population`."""
    drivers, _ = modelled_drivers(project)
    if not project.config.models.personal.train or len(drivers) < 2:
        return []
    mark = _mark(project.config, drivers)
    return [
        Task(
            "models",
            f"adapted_{quantity}/{driver}",
            train_adapted,
            {"project": project.directory, "driver": driver, "files": files, "quantity": quantity,
             "config": project.config},
            mark,
        )
        for driver, files in drivers.items()
        for quantity in QUANTITIES
    ]  # fmt: skip


def plan_continuation(project: Project, *, anew: bool) -> tuple[list[Task], list[InputError]]:
    """Plan to go on learning, one task for each driver and quantity.

    Args:
        project: The project.
        anew: Forget what was learnt and begin with the first recording of the dataset.

    Returns:
        The tasks, and the drivers with too little data.

    Raises:
        InputError: See `drivers.modelled_drivers`.
    """
    drivers, problems = modelled_drivers(project)
    config = project.config
    entries = project.manifest["dataset"]
    tasks = []
    for driver, files in drivers.items():
        recordings = {output["recording"]: output["rows"] for output in entries[driver]["outputs"]}
        for quantity in QUANTITIES:
            arguments = {"project": project.directory, "driver": driver, "recordings": recordings,
                         "quantity": quantity, "config": config, "anew": anew}  # fmt: skip
            mark = _mark(config, {driver: files})
            tasks.append(Task("models", f"online_{quantity}/{driver}", continue_learning, arguments, mark))
    return tasks, problems


def train_population(
    project: Path, drivers: Mapping[str, Mapping[str, str]], quantity: Quantity, config: Config
) -> Outcome:
    """Fit and save the population's regression of a quantity.

    Args:
        project: Project folder.
        drivers: Those that make it up, each with the SHA-256 of its dataset files by path.
        quantity: What it predicts.
        config: The project file.

    Raises:
        InputError: There are too few samples, or a dataset cannot be read.
    """
    settings = config.models.personal
    series = [read_series(project, driver, config) for driver in drivers]
    samples = [_all_samples(own, quantity, config) for own in series]
    with one_thread():
        regression = fit_own(samples, quantity, settings, config.models.seed)
        if regression is None:
            found = sum(len(own.centres) for own in samples)
            raise _too_few(project, "all drivers together", found, samples_needed(quantity, settings))
        model = PersonalModel(regression, window_of(quantity, settings))
    facts = {"title": f"How drivers do it: {quantity} of {len(drivers)} drivers together", "drivers": list(drivers)}
    files = {path: digest for own in drivers.values() for path, digest in own.items()}
    inputs = np.concatenate([own.inputs for own in samples])
    hours = sum(len(own.time) for own in series) * config.sync.period / 3600e9
    return _publish(
        project,
        f"population_{quantity}",
        POPULATION,
        model,
        inputs,
        config,
        {**facts, "dataset": files, "hours": hours},
    )


def train_adapted(project: Path, driver: str, files: Mapping[str, str], quantity: Quantity, config: Config) -> Outcome:
    """Adapt the population's regression to a driver's data and save it (see `adaptation.adapt`).

    Args:
        project: Project folder; the population's model is there.
        driver: Whose model.
        files: SHA-256 of the driver's dataset files by path.
        quantity: What it predicts.
        config: The project file.

    Raises:
        InputError: There is no model of the population, it is damaged, or the dataset cannot be read.
    """
    settings = config.models.personal
    kind = f"population_{quantity}"
    population, _ = load_model(
        Project(project).model_folder(kind, POPULATION), {kind: (PersonalModel.from_arrays, PersonalModel.predict)}
    )
    series = read_series(project, driver, config)
    samples = _all_samples(series, quantity, config)
    with one_thread():
        regression = personalise(population.regression, samples, quantity, settings)
        model = PersonalModel(regression, window_of(quantity, settings))
    facts = {
        "title": f"How {driver} does it: {quantity}, adapted from the population's model",
        "relevance": settings.relevance,
        "samples": len(samples.centres),
        "dataset": dict(files),
        "hours": len(series.time) * config.sync.period / 3600e9,
    }
    inputs = samples.inputs if len(samples.inputs) else regression.mixture_.means_[:, : regression.n_features_in_]
    return _publish(project, f"adapted_{quantity}", driver, model, inputs, config, facts)


def continue_learning(
    project: Path,
    driver: str,
    recordings: Mapping[str, int],
    quantity: Quantity,
    config: Config,
    *,
    anew: bool,
) -> Outcome:
    """Learn from the recordings that were not learnt from yet, one after the other, and save the model (see `online`).

    In memory is one recording at a time. The first one that has enough samples is fitted in batch; the statistics of
    all of them go on as in `online`. A recording that has left the dataset stays learnt.

    Args:
        project: Project folder.
        driver: Whose model.
        recordings: Rows of the dataset by recording, in the order in which they are learnt.
        quantity: What it predicts.
        config: The project file.
        anew: Forget what was learnt.

    Returns:
        The outcome. Its problems are the recordings that have another number of rows than when they were learnt, as
        after a decision about an event: what was learnt cannot be taken back. Their files differ after every build,
        with the folds and labels in them.

    Raises:
        InputError: No recording has enough samples to begin with, the settings are not those of the saved model, or
            the saved model or a recording's dataset is damaged.
    """
    settings, kind = config.models.personal, f"online_{quantity}"
    folder = Project(project).model_folder(kind, driver)
    state: OnlineMixture | None = None
    learnt: dict[str, int] = {}
    if not anew and (folder / CARD).exists():
        model, card = load_model(folder, {kind: (PersonalModel.from_arrays, PersonalModel.predict)})
        state, learnt = model.state, dict(card["learnt"])
        if other := {name: now for name, now in _parameters(config).items() if card["parameters"].get(name) != now}:
            then = {name: card["parameters"].get(name) for name in other}
            reason = (
                f"learnt with {_listed(then)}, while the project file says {_listed(other)}; put that back, or begin "
                "anew: `wheelprint train --continue --force`"
            )
            raise InputError(folder / CARD, "parameters", reason)
    changed = [name for name, rows in recordings.items() if learnt.get(name, rows) != rows]
    waiting = [name for name in recordings if name not in learnt]
    inputs: FloatArray | None = None
    most = 0
    with one_thread():
        # What comes before the first recording that is long enough to begin with is learnt after it.
        for name in waiting if state is None else ():
            samples = _recorded(project, driver, name, quantity, config)
            most = max(most, len(samples.centres))
            if len(samples.centres) >= samples_needed(quantity, settings):
                state, learnt[name] = _begin(samples, quantity, config), recordings[name]
                inputs = samples.inputs
                break
        if state is None:
            raise _too_few(project, f"driver {driver!r}, longest recording", most, samples_needed(quantity, settings))
        for name in (name for name in waiting if name not in learnt):
            samples = _recorded(project, driver, name, quantity, config)
            if len(samples.centres):
                state = state.learn(samples.joint, config.models.seed + len(learnt))
                inputs = samples.inputs
            learnt[name] = recordings[name]
        model = PersonalModel.of_state(state, quantity, settings)
    if inputs is None:
        inputs = state.means[:, : model.regression.n_features_in_]
    facts = {
        "title": f"How {driver} does it: {quantity}, learnt drive by drive",
        "learnt": learnt,
        "samples": state.rows,
    }
    outcome = _publish(project, kind, driver, model, inputs, config, facts)
    return Outcome(outcome.entry, tuple(_unlearnable(folder, name, learnt[name], recordings[name]) for name in changed))


def _begin(samples: Samples, quantity: Quantity, config: Config) -> OnlineMixture:
    settings = config.models.personal
    components, tolerance = settings.lookahead_components, 1e-5
    if quantity == "steering":
        components, tolerance = settings.components, TOLERANCE
    return OnlineMixture.begin(
        samples.joint,
        components,
        exponent=settings.online_exponent,
        tolerance=tolerance,
        random_state=config.models.seed,
    )


def _recorded(project: Path, driver: str, recording: str, quantity: Quantity, config: Config) -> Samples:
    return _all_samples(read_recording(project, driver, recording, config), quantity, config)


def _all_samples(series: Series, quantity: Quantity, config: Config) -> Samples:
    return take_samples(series, np.ones(len(series.time), dtype=np.bool_), quantity, config.models.personal)


def _publish(
    project: Path,
    kind: str,
    driver: str,
    model: PersonalModel,
    inputs: FloatArray,
    config: Config,
    facts: Mapping[str, Any],
) -> Outcome:
    """Publish a model with its card; `inputs` (n_samples, n_inputs) are those that golden vectors are taken from."""
    golden = inputs[golden_rows(len(inputs))]
    quantity: Quantity = "steering" if model.window is not None else "lookahead"
    units, unit = UNITS[quantity]
    card = {
        "driver": driver,
        "inputs": {name: {"unit": of_name} for name, of_name in units.items()},
        "outputs": {"steering_wheel_angle" if quantity == "steering" else "lookahead": {"unit": unit}},
        "parameters": _parameters(config),
        "limits": ["Beyond the angles, speeds and curvatures it was trained on it extrapolates linearly."],
        "wheelprint": __version__,
        **facts,
    }
    written = save_model(
        Project(project).model_folder(kind, driver),
        kind,
        model.arrays(),
        card,
        Golden((golden,), model.predict(golden)),
    )
    return Outcome({"outputs": [describe_output(project, path) for path in written], "parameters": card["parameters"]})


def _parameters(config: Config) -> dict[str, Any]:
    chosen = config.models.personal.model_dump(exclude={"evaluate", "train"})
    return {**chosen, "seed": config.models.seed, "period": config.sync.period}


def _listed(parameters: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in parameters.items())


def _mark(config: Config, drivers: Mapping[str, Mapping[str, str]]) -> str:
    return fingerprint(
        {
            "version": __version__,
            "format": FORMAT,
            "parameters": _parameters(config),
            "maximum_spread": config.lookahead.maximum_spread,
            "dataset": {driver: dict(files) for driver, files in drivers.items()},
        }
    )


def _unlearnable(folder: Path, recording: str, then: int, now: int) -> InputError:
    reason = (
        f"recording {recording!r} had {then} rows when it was learnt and has {now} now, and what was learnt cannot be "
        "taken back; to begin anew: `wheelprint train --continue --force`"
    )
    return InputError(folder / CARD, "learnt", reason)


def _too_few(project: Path, whose: str, found: int, needed: int) -> InputError:
    reason = (
        f"{whose}: {found} samples, and {needed} are needed; add recordings, decide about proposed events "
        "(`wheelprint review`), or ask for fewer components"
    )
    return InputError(project / "wheelprint.toml", "models.personal", reason)
