"""Personal models on disk: population and adaptation, and learning that goes on drive by drive."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from wheelprint.modeling.drivers import read_recording, read_series
from wheelprint.modeling.export.exported_models import KINDS, export_models
from wheelprint.modeling.online import OnlineMixture
from wheelprint.modeling.personal import QUANTITIES, Samples, fit_own, personalise, take_samples
from wheelprint.modeling.personal_training import POPULATION, plan_adaptation, plan_continuation, plan_population
from wheelprint.modeling.storage import load_model
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import Project

DRIVER, OTHER = "王 小明", "b.~"
Perform = Callable[..., Any]
Replace = Callable[[Project, str, Sequence[dict[str, Any]]], None]
Recordings = Callable[[str], list[dict[str, np.ndarray]]]


def configured(project: Project, **settings: Any) -> Project:
    """The project with settings of its personal models."""
    path = project.directory / "wheelprint.toml"
    lines = {"future_steps": 3, "components": 2, "lookahead_components": 2, **settings}
    text = path.read_text(encoding="utf-8").split("[models.personal]")[0] + "[models.personal]\n"
    path.write_text(text + "".join(f"{name} = {json.dumps(value)}\n" for name, value in lines.items()), "utf-8")
    return Project(project.directory)


def samples_of(project: Project, driver: str, quantity: Any, recording: str | None = None) -> Samples:
    if recording is None:
        series = read_series(project.directory, driver, project.config)
    else:
        series = read_recording(project.directory, driver, recording, project.config)
    return take_samples(series, np.ones(len(series.time), dtype=bool), quantity, project.config.models.personal)


def test_population_and_adapted_models_are_those_of_the_evaluation(own_project: Project, perform: Perform) -> None:
    assert plan_population(own_project) == [] == plan_adaptation(own_project)
    project = configured(own_project, train=True)
    perform(project, plan_population(project))
    perform(project, plan_adaptation(project))
    settings = project.config.models.personal
    for quantity in QUANTITIES:
        every = [samples_of(project, driver, quantity) for driver in (OTHER, DRIVER)]
        expected = fit_own(every, quantity, settings)
        assert expected is not None
        found, card = load_model(project.model_folder(f"population_{quantity}", POPULATION), KINDS)
        asked = every[1].inputs[::50]
        np.testing.assert_allclose(found.predict(asked), expected.predict(asked, return_sd=True), rtol=1e-9)
        assert card["drivers"] == [OTHER, DRIVER]
        assert card["hours"] == pytest.approx(2000 / 36000)
        adapted, card = load_model(project.model_folder(f"adapted_{quantity}", DRIVER), KINDS)
        own = personalise(expected, every[1], quantity, settings)
        np.testing.assert_allclose(adapted.predict(asked), own.predict(asked, return_sd=True), rtol=1e-7)
        assert np.abs(adapted.predict(asked)[0] - found.predict(asked)[0]).max() > 1e-3
        assert len(card["dataset"]) == 2


def test_personal_models_are_exported(own_project: Project, perform: Perform, tmp_path: Any) -> None:
    project = configured(own_project, train=True)
    perform(project, plan_population(project) + plan_adaptation(project))
    written = [path.name for path in export_models(project, tmp_path, DRIVER, "c")]
    stems = [f"adapted_{quantity}.%E7%8E%8B%20%E5%B0%8F%E6%98%8E" for quantity in ("lookahead", "steering")]
    assert written == [f"{stem}.{end}" for stem in stems for end in ("h", "c.json")]
    card = json.loads((tmp_path / written[3]).read_text(encoding="utf-8"))
    assert [column["step"] for column in card["input_columns"]] == [*range(-1, 4), *range(-1, 4), -1, 0]


def test_learning_goes_on_with_new_recordings_alone(
    own_project: Project, perform: Perform, replace_dataset: Replace, recordings: Recordings
) -> None:
    """After two calls, the second without the first recording, it is what `OnlineMixture` makes of both."""
    project = configured(own_project)
    first, second = recordings(DRIVER)
    replace_dataset(project, DRIVER, [first, second])
    states = {}
    for quantity in QUANTITIES:
        tolerance = {"steering": 1.0, "lookahead": 1e-5}[quantity]
        begun = OnlineMixture.begin(samples_of(project, DRIVER, quantity, "drive 0").joint, 2, tolerance=tolerance)
        states[quantity] = begun.learn(samples_of(project, DRIVER, quantity, "drive 1").joint, 1)
    replace_dataset(project, DRIVER, [first])
    perform(project, plan_continuation(project, anew=False)[0])
    before = load_model(project.model_folder("online_steering", DRIVER), KINDS)[1]
    assert list(before["learnt"]) == ["drive 0"]
    replace_dataset(project, DRIVER, [first, second])
    project.dataset_file(DRIVER, "drive 0").unlink()
    tasks = [task for task in plan_continuation(project, anew=False)[0] if task.name.endswith(DRIVER)]
    outcomes = perform(project, tasks)
    assert [outcome.problems for outcome in outcomes] == [(), ()]
    for quantity in QUANTITIES:
        model, card = load_model(project.model_folder(f"online_{quantity}", DRIVER), KINDS)
        assert list(card["learnt"]) == ["drive 0", "drive 1"]
        assert card["samples"] == model.state.rows == states[quantity].rows
        for name, values in states[quantity].arrays().items():
            np.testing.assert_allclose(model.state.arrays()[name], values, rtol=1e-10, atol=1e-12, err_msg=name)
    # Once more: nothing is new, and nothing changes.
    saved = (project.model_folder("online_steering", DRIVER) / "arrays.npz").read_bytes()
    perform(project, tasks)
    assert (project.model_folder("online_steering", DRIVER) / "arrays.npz").read_bytes() == saved


def test_what_was_learnt_is_not_taken_back_and_settings_stay(
    own_project: Project, perform: Perform, replace_dataset: Replace, recordings: Recordings
) -> None:
    project = configured(own_project)

    def tasks(*, anew: bool = False) -> Any:
        return [task for task in plan_continuation(project, anew=anew)[0] if task.name == f"online_steering/{OTHER}"]

    perform(project, tasks())
    (changed,) = recordings(OTHER)
    replace_dataset(project, OTHER, [{name: values[:-7] for name, values in changed.items()}])
    ((problem,),) = [outcome.problems for outcome in perform(project, tasks())]
    card = project.model_folder("online_steering", OTHER) / "card.json"
    assert str(problem) == (
        f"{card}: learnt: recording 'drive 0' had 800 rows when it was learnt and has 793 now, and what was "
        "learnt cannot be taken back; to begin anew: `wheelprint train --continue --force`"
    )
    project = configured(own_project, components=1)
    with pytest.raises(InputError) as caught:
        perform(project, tasks())
    assert str(caught.value) == (
        f"{card}: parameters: learnt with components = 2, while the project file says components = 1; put that back, "
        "or begin anew: `wheelprint train --continue --force`"
    )
    ((),) = [outcome.problems for outcome in perform(project, tasks(anew=True))]
    assert load_model(card.parent, KINDS)[1]["parameters"]["components"] == 1
    project = configured(own_project, components=90)
    with pytest.raises(InputError) as caught:
        perform(project, tasks(anew=True))
    assert str(caught.value) == (
        f"{project.directory / 'wheelprint.toml'}: models.personal: driver 'b.~', longest recording: 783 samples, and "
        "1350 are needed; add recordings, decide about proposed events (`wheelprint review`), or ask for fewer "
        "components"
    )
