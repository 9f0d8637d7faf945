"""The report's section about personal models: its figures' numbers, and what is said when there is nothing."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from wheelprint.report.blocks import Gallery, Note, Table
from wheelprint.report.personal import personal_blocks
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.project import Project
from wheelprint.schemas.tables import CROSS_DRIVER_COLUMNS


def galleries(project: Project) -> list[Gallery]:
    return [block for block in personal_blocks(project) if isinstance(block, Gallery)]


def test_learning_curves(project: Project) -> None:
    curves = galleries(project)[0].figures
    assert len(curves) == 2
    traces = {trace.name: trace for trace in curves[0].figure.data}
    assert list(traces) == ["population", "own", "adapted"]
    np.testing.assert_allclose(traces["own"].y, [3.15, 1.65, 0.75], rtol=1e-6)
    np.testing.assert_allclose(traces["adapted"].y, [1.05, 0.6, 0.33], rtol=1e-6)
    np.testing.assert_allclose(traces["population"].y, 3 * [1.15], rtol=1e-6)
    assert traces["population"].x == traces["own"].x == (1, 2, 5)
    np.testing.assert_allclose(traces["own"].error_y.array, 3 * [np.std([0.0, 0.1, 0.2, 0.3])], rtol=1e-6)


def test_matrices(project: Project) -> None:
    error, likelihood = (figure.figure.data[0] for figure in galleries(project)[1].figures)
    np.testing.assert_allclose(error.z, [[0.65, 1.65], [1.65, 0.65]], rtol=1e-6)
    np.testing.assert_allclose(likelihood.z, [[1.25, -3.5], [-3.5, 1.25]], rtol=1e-6)
    assert list(likelihood.text[0]) == ["1.25", "−3.50"]
    assert error.reversescale
    assert not likelihood.reversescale


def test_identification(project: Project) -> None:
    (table,) = (block for block in personal_blocks(project) if isinstance(block, Table))
    assert [[cell.text for cell in row] for row in table.rows] == [
        ["adapted", "conditional", "both", "20", "90.0", "69.9 to 97.2"]
    ]
    confusion = galleries(project)[2].figures[0].figure.data[0]
    np.testing.assert_array_equal(confusion.z, [[10, 0], [2, 8]])


def test_without_results(bare_project: Project) -> None:
    (block,) = personal_blocks(bare_project)
    assert isinstance(block, Note)
    assert block.command == "wheelprint evaluate"


def test_a_table_with_missing_columns_is_an_input_error(project: Project, tmp_path: Path) -> None:
    (tmp_path / "results").mkdir()
    for name in ("learning_curve.csv", "identification.json"):
        shutil.copy(project.results_folder / name, tmp_path / "results")
    path = tmp_path / "results" / "cross_driver.csv"
    with pytest.raises(InputError) as caught:
        personal_blocks(Project(tmp_path))
    assert str(caught.value) == f"{path}: no such file; run `wheelprint evaluate` again"
    path.write_text(",".join(CROSS_DRIVER_COLUMNS[:-1]) + "\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        personal_blocks(Project(tmp_path))
    assert str(caught.value) == (
        f"{path}: line 1: the columns samples are missing; remove it and run `wheelprint evaluate` again"
    )
