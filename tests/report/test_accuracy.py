"""The figures of the error over the horizon and of the calibration."""

from __future__ import annotations

from pathlib import Path

import pytest

from wheelprint.report.accuracy import errors_by_horizon, read_curves, reliability
from wheelprint.schemas.errors import InputError

HEAD = "driver,model,path_types,past_steps,future_steps,components,fold,horizon,mean_error\n"


def test_errors_are_averaged_over_the_folds(tmp_path: Path) -> None:
    path = tmp_path / "horizons.csv"
    rows = ["a,ridge,1,1,50,,0,0.1,1.0", "a,ridge,1,1,50,,1,0.1,3.0", "a,ridge,1,1,50,,0,5.0,7.0"]
    rows += ["a,mixture,3,1,50,6,0,0.1,1.5", "a,mixture,3,1,50,6,1,0.1,"]
    path.write_text(HEAD + "\n".join(rows) + "\n", encoding="utf-8")
    curves = read_curves(path, "horizon", "mean_error")
    assert curves == {"a": {"ridge, n₂ = 1": {0.1: 2.0, 5.0: 7.0}, "mixture, n₁ = 3, n₂ = 1, n₄ = 6": {0.1: 1.5}}}
    ridge, mixture = errors_by_horizon(curves["a"]).data
    assert (list(ridge.x), list(ridge.y), mixture.name) == ([0.1, 5.0], [2.0, 7.0], "mixture, n₁ = 3, n₂ = 1, n₄ = 6")


def test_bands_are_made_of_bins_on_both_sides_of_the_median() -> None:
    bins = {0.0: 0.1, 0.25: 0.3, 0.5: 0.4, 0.75: 0.2}
    line, model = reliability({"mixture": bins}).data
    assert list(line.y) == [0, 100]
    assert list(model.x) == [0.0, 50.0, 100.0]
    assert list(model.y) == pytest.approx([0.0, 70.0, 100.0])


def test_a_damaged_table_says_what_is_wrong(tmp_path: Path) -> None:
    path = tmp_path / "horizons.csv"
    path.write_text("driver,model\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_curves(path, "horizon", "mean_error")
    reason = "the columns horizon, mean_error, components are missing; remove it and run `wheelprint evaluate` again"
    assert str(caught.value) == f"{path}: line 1: {reason}"
    path.write_text(HEAD + "a,ridge,1,1,50,,0,0.1,much\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_curves(path, "horizon", "mean_error")
    reason = "horizon and mean_error must be numbers: could not convert string to float: 'much'"
    assert str(caught.value) == f"{path}: line 2: {reason}; run `wheelprint evaluate` again"
