"""Which drivers are modelled, and types of path that are learnt from some rows only."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wheelprint.dataset.folds import training_mask
from wheelprint.dataset.segments import features
from wheelprint.modeling.drivers import fit_path_types, label_rows, modelled_drivers, part, read_series
from wheelprint.modeling.path_types import PathTypes
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import Project


def test_drivers_with_too_little_are_named(project: Project) -> None:
    drivers, problems = modelled_drivers(project)
    assert list(drivers) == ["b.~", "王 小明"]
    assert [len(files) for files in drivers.values()] == [1, 2]
    (problem,) = problems
    assert str(problem) == (
        f"{project.directory}/wheelprint.toml: models.minimum_minutes: driver 'little' is not modelled: 0.2 minutes of "
        "ordinary driving were found, and 1 are needed; add recordings, decide about proposed events "
        "(`wheelprint review`), or lower models.minimum_minutes"
    )


def test_nothing_was_built_yet(tmp_path: Path) -> None:
    (tmp_path / "wheelprint.toml").write_text("[vehicle]\nwheelbase = 2.8\n", encoding="utf-8")
    (tmp_path / "raw" / "a" / "one").mkdir(parents=True)
    with pytest.raises(InputError) as caught:
        modelled_drivers(Project(tmp_path))
    assert str(caught.value) == f"{tmp_path}: no driver has a dataset yet; run `wheelprint build` first"


def test_path_types_learn_from_whole_segments_of_the_given_rows(project: Project) -> None:
    config = project.config
    series = read_series(project.directory, "王 小明", config)
    rows = np.arange(len(series.time)) < 645
    whole = [
        segment
        for segment in range(series.segment.max() + 1)
        if all(rows[row] for row in np.flatnonzero(series.segment == segment))
    ]
    assert 0 < len(whole) < series.segment[644] + 1
    of_all = features(series.course_deviation, series.speed, series.segment, TICK)
    expected = PathTypes.fit(of_all[whole], 2, 6, config.dataset.seed)
    found = fit_path_types(series, rows, config)
    np.testing.assert_array_equal(found.means, expected.means)
    labels = expected.label(of_all)
    own = [int(path_type.split("-")[1]) for path_type in label_rows(series, found, config).tolist()]
    assert own == labels[series.segment].tolist()


TICK = 100_000_000


def test_types_of_training_rows_know_nothing_of_test_rows(project: Project) -> None:
    config = project.config.model_copy(
        update={"segments": project.config.segments.model_copy(update={"minimum_duration": 0.3, "neutral": 0.2})}
    )
    series = read_series(project.directory, "王 小明", config)
    embargo = round(config.dataset.embargo * 1e9)
    rng = np.random.default_rng(0)
    different = 0
    for test_fold in range(config.dataset.folds):
        test = series.fold == test_fold
        training = training_mask(series.fold, series.recording, series.time, test_fold, embargo)
        found = []
        for another_drive in (False, True):
            there = ~training & another_drive
            first = np.isnan(series.course_deviation)
            deviation = np.where(there & ~first, rng.normal(0, 0.3, len(test)), series.course_deviation)
            driven = replace(
                series, course_deviation=deviation, speed=np.where(there, rng.uniform(3, 30, len(test)), series.speed)
            )
            sides = part(driven, training + 2 * test, config)
            types = fit_path_types(sides, training, config)
            found.append((types.means, types.mixture.covariances_, label_rows(sides, types, config)))
        np.testing.assert_array_equal(found[0][0], found[1][0])
        np.testing.assert_array_equal(found[0][1], found[1][1])
        inner = training & ~np.isnan(series.course_deviation)
        np.testing.assert_array_equal(found[0][2][inner], found[1][2][inner])
        different += int(np.count_nonzero(found[0][2] != found[1][2]))
    assert different > 0


def test_parts_end_where_the_group_changes_and_nothing_else_changes(project: Project) -> None:
    config = project.config
    series = read_series(project.directory, "b.~", config)
    group = series.time // TICK % 100 < 30
    parted = part(series, group, config)
    for segment in range(parted.segment.max() + 1):
        own = parted.segment == segment
        assert len({*parted.stretch[own].tolist()}) == 1
        assert len({*group[own & np.isfinite(series.course_deviation)].tolist()}) == 1
    begins = np.flatnonzero(np.diff(parted.stretch)) + 1
    changes = (group[begins] != group[begins - 1]) | (series.stretch[begins] != series.stretch[begins - 1])
    assert changes.all()
    whole = part(series, np.zeros(len(group)), config)
    np.testing.assert_array_equal(whole.stretch, series.stretch)


def test_path_types_need_a_segment(project: Project) -> None:
    series = read_series(project.directory, "little", project.config)
    with pytest.raises(InputError) as caught:
        fit_path_types(series, np.zeros(100, dtype=bool), project.config)
    assert str(caught.value) == "dataset: segment: no path segment is left to learn types of path from; add recordings"
