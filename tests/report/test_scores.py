"""Results of the evaluation: gathered by model, compared with the best baseline, the best one marked."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from wheelprint.report.scores import Score, read_scores
from wheelprint.report.tables import lookahead_table, motion_primitives_table
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.tables import LOOKAHEAD_COLUMNS, MOTION_PRIMITIVE_COLUMNS

LOOKAHEAD = """driver,model,components,regressors,fold,split,mean_error,mean_sd,samples
anna,velocity,12,3,0,test,0.5,3.0,100
anna,velocity,12,3,1,test,0.7,3.2,200
anna,velocity,12,3,0,train,0.4,2.0,900
anna,persistence,,,0,test,0.2,,100
anna,ridge,,,1,test,1.1,4.0,200
anna,ridge,,,0,test,0.9,4.0,100
anna,general,3,,0,test,1.4,4.0,100
anna,general,3,,1,test,,,0
"""
PRIMITIVES = """coverage_68,driver,model,path_types,past_steps,future_steps,components,fold,mean_error,mean_variance,coverage_95,crps,samples
0.66,anna,mixture,27,-1,50,3,0,1.9,7.0,0.93,1.4,40
0.70,anna,mixture,27,-1,50,3,1,2.7,9.0,0.97,1.8,60
,anna,persistence,1,-1,50,,0,2.0,,,,40
,anna,persistence,1,-1,50,,1,2.0,,,,60
"""  # noqa: E501  a table


@pytest.fixture
def lookahead(tmp_path: Path) -> list[Score]:
    path = tmp_path / "lookahead.csv"
    path.write_text(LOOKAHEAD, encoding="utf-8")
    return read_scores(path, LOOKAHEAD_COLUMNS)


@pytest.fixture
def primitives(tmp_path: Path) -> list[Score]:
    path = tmp_path / "motion_primitives.csv"
    path.write_text(PRIMITIVES, encoding="utf-8")
    return read_scores(path, MOTION_PRIMITIVE_COLUMNS)


def test_folds_of_one_model_are_one_score_and_baselines_come_first(lookahead: list[Score]) -> None:
    assert [(s.model, s.is_baseline, dict(s.parameters)) for s in lookahead] == [
        ("persistence", True, {}),
        ("ridge", True, {}),
        ("general", False, {"components": 3}),
        ("velocity", False, {"components": 12, "regressors": 3}),
    ]
    velocity = lookahead[-1]
    assert velocity.mean("mean_error") == pytest.approx(0.6)
    assert velocity.deviation("mean_error") == pytest.approx(math.sqrt(0.02))
    assert velocity.mean("train_mean_error") == 0.4
    assert math.isnan(velocity.deviation("train_mean_error")), "of one fold there is no deviation"
    assert lookahead[2].mean("mean_error") == 1.4, "a fold without a value does not count"


def test_the_lookahead_table_shows_mean_and_deviation_beside_the_best_baseline(lookahead: list[Score]) -> None:
    table = lookahead_table("anna", lookahead)
    assert [[cell.text for cell in row] for row in table.rows] == [
        ["persistence", "–", "–", "0.20", "–", "–", "–", "–", "–", "100"],
        ["ridge", "–", "–", "1.00 ± 0.14", "–", "–", "4.00 ± 0.00", "–", "–", "300"],
        ["general", "3", "–", "1.40", "+40", "0 of 1", "4.00", "–", "–", "100"],
        ["velocity", "12", "3", "0.60 ± 0.14", "−40", "2 of 2", "3.10 ± 0.14", "0.40", "2.00", "300"],
    ]
    assert [row[3].mark for row in table.rows] == ["", "", "", "best"], "persistence knows more than models may"
    assert [row[0].mark for row in table.rows] == ["baseline", "baseline", "", ""]
    assert table.rows[2][4].mark == "alert", "worse than a baseline is said aloud"


def test_the_table_of_motion_primitives_has_the_columns_of_the_paper(primitives: list[Score]) -> None:
    table = motion_primitives_table("anna", primitives)
    assert [(column.title, column.unit) for column in table.columns[4:9]] == [
        ("ave_err", "°"), ("against best baseline", "%"), ("better in", "folds"), ("var", "°²"),
        ("within 68 % band", "%"),
    ]  # fmt: skip
    assert [[cell.text for cell in row] for row in table.rows] == [
        ["persistence", "–", "−1", "–", "2.00 ± 0.00", "–", "–", "–", "–", "–", "100"],
        [
            "mixture", "27", "−1", "3", "2.30 ± 0.57", "+15", "1 of 2", "8.00 ± 1.41", "68.0 ± 2.8", "95.0 ± 2.8",
            "100",
        ],
    ]  # fmt: skip
    assert table.rows[0][4].mark == "best", "a baseline may be the best"
    assert [score.label for score in primitives] == ["persistence, n₂ = −1", "mixture, n₁ = 27, n₂ = −1, n₄ = 3"]


def test_without_any_baseline_nothing_is_compared(lookahead: list[Score]) -> None:
    table = lookahead_table("anna", lookahead[2:])
    assert [[cell.text for cell in row[4:6]] for row in table.rows] == [["–", "–"], ["–", "–"]]


def test_a_table_with_missing_columns_is_an_input_error(tmp_path: Path) -> None:
    path = tmp_path / "lookahead.csv"
    path.write_text("driver,model,fold,split,mean_error\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_scores(path, LOOKAHEAD_COLUMNS)
    assert str(caught.value) == (
        f"{path}: line 1: the columns components, regressors, mean_sd, samples are missing; "
        "remove it and run `wheelprint evaluate` again"
    )
