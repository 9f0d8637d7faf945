"""Figures from arrays: what is drawn where."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from wheelprint.report import drive_figures, look, model_figures
from wheelprint.report.scores import Score


@pytest.mark.parametrize(
    ("length", "at_most", "kept"), [(0, 10, 0), (5, 10, 5), (10, 10, 10), (11, 10, 6), (1000, 7, 7)]
)
def test_thinning_keeps_no_more_than_asked_for(length: int, at_most: int, kept: int) -> None:
    values = np.arange(length)[drive_figures.thin(length, at_most)]
    assert len(values) == kept
    assert len(values) <= at_most


def test_names_stay_text_for_plotly() -> None:
    assert look.plain('<a href="//x">&amp;') == '&lt;a href="//x"&gt;&amp;amp;'


def test_the_bins_of_the_lookahead_figure_are_medians_and_quartiles() -> None:
    rng = np.random.default_rng(0)
    speed = rng.uniform(0, 30, 5000)
    distance = np.where(rng.random(5000) < 0.2, np.nan, 3 + speed + rng.gamma(2.0, size=5000))
    spread = rng.uniform(0, 20, 5000)
    figure = drive_figures.lookahead(speed, distance, spread, narrow=8.0, at_most=100)
    wide, narrow, _, bins = figure.data
    assert len(wide.x) + len(narrow.x) <= 100
    assert narrow.name == "spread up to 8 m"
    assert bins.name == "spread up to 8 m: median, quartiles"

    frame = pd.DataFrame({"bin": 3.6 * speed // 5, "h": distance})[spread <= 8].dropna()
    groups = frame.groupby("bin").filter(lambda group: len(group) >= 20).groupby("bin")["h"]
    low, middle, high = (groups.quantile(q) for q in (0.25, 0.5, 0.75))
    np.testing.assert_allclose(bins.x, middle.index.to_numpy() * 5 + 2.5)
    np.testing.assert_allclose(bins.y, middle, rtol=1e-6)
    np.testing.assert_allclose(bins.error_y.array, high - middle, rtol=1e-4)
    np.testing.assert_allclose(bins.error_y.arrayminus, middle - low, rtol=1e-4)


def test_without_lookahead_distances_the_figure_is_empty_and_still_has_its_axes() -> None:
    figure = drive_figures.lookahead(np.array([1.0, 2.0]), *np.full((2, 2), np.nan))
    assert [len(trace.x) for trace in figure.data] == [0, 0]
    assert figure.layout.xaxis.title.text == "speed, km/h"


def test_every_event_is_in_its_lane_with_its_kind_and_decision() -> None:
    lanes = [
        drive_figures.Lane("anna/1", 10.0, [(1.0, 1.5, "swerve", "proposed"), (4.0, 4.2, "hard_braking", "normal")]),
        drive_figures.Lane("anna/2", 8.0, [(2.0, 2.5, "swerve", "proposed")]),
    ]
    figure = drive_figures.timeline(lanes)
    marks = {trace.name: (list(trace.x), list(trace.y)) for trace in figure.data if trace.type == "scatter"}
    assert marks == {
        "swerve: proposed": ([1.25, 2.25], [0, 1]),
        "hard_braking: normal": ([pytest.approx(4.1)], [0]),
    }
    assert list(figure.layout.yaxis.ticktext) == ["anna/1", "anna/2"]
    symbols = {trace.name: trace.marker.symbol for trace in figure.data if trace.type == "scatter"}
    assert len(set(symbols.values())) == 2, "kinds differ by symbol, not by colour alone"


def score(model: str, error: float, **parameters: int) -> Score:
    values: dict[str, list[float]] = {
        "fold": [0, 1],
        "mean_error": [error, error + 0.2],
        "mean_sd": [2.0, 2.0],
        "train_mean_error": [error - 0.1],
    }
    return Score("anna", model, parameters, values)


def test_errors_over_components_stand_beside_every_baseline() -> None:
    scores = [
        score("ridge", 3.0), score("general", 2.0, components=3), score("general", 1.5, components=6),
        score("velocity", 1.0, components=6, regressors=3),
    ]  # fmt: skip
    figure = model_figures.errors_by_components(scores)
    errors = {trace.name: trace for trace in figure.data if trace.yaxis == "y"}
    assert list(errors) == [
        "general: test", "general: training", "velocity, n₂ = 3: test", "velocity, n₂ = 3: training",
        "baseline ridge: test",
    ]  # fmt: skip
    assert list(errors["general: test"].y) == pytest.approx([2.1, 1.6])
    assert np.rint(errors["general: test"].x).tolist() == [3, 6]
    assert list(errors["general: training"].y) == pytest.approx([1.9, 1.4])
    assert list(errors["baseline ridge: test"].y) == pytest.approx([3.1, 3.1])
    assert {trace.name for trace in figure.data if trace.yaxis == "y2"} == set(errors)


def test_errors_of_models_are_listed_in_the_order_of_the_table() -> None:
    scores = [score("ridge", 3.0), score("mixture", 2.0, path_types=27, past_steps=1, components=3)]
    figure = model_figures.errors_of_models(scores)
    assert list(figure.layout.yaxis.ticktext) == ["ridge", "mixture, n₁ = 27, n₂ = 1, n₄ = 3"]
    baseline, model = figure.data
    assert (*baseline.y, *model.y) == (0, 1)
    assert [*baseline.x, *model.x] == pytest.approx([3.1, 2.1])
    assert baseline.marker.symbol != model.marker.symbol
