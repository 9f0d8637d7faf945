"""Figures of models: their errors and predictions; plotly figures from arrays, units on every axis."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .look import BLACK, BLUE, GREY, LINES, VERMILLION, as_float32, figure_of, line_of, name_lanes, plain, style

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from .scores import Score

Values = NDArray[np.float64]

WITHIN_68, WITHIN_95 = (NormalDist().inv_cdf((1 + share) / 2) for share in (0.68, 0.95))
"""Half widths of Gaussian bands that hold 68 % and 95 %, in standard deviations."""


def information_criterion(by_driver: Mapping[str, Sequence[Mapping[str, Any]]]) -> go.Figure:
    """Show the Bayesian information criterion over the number of path clusters."""
    figure = figure_of("number of clusters", "BIC", height=300)
    for number, (driver, fits) in enumerate(by_driver.items()):
        figure.add_scatter(
            x=[fit["clusters"] for fit in fits], y=[fit["bic"] for fit in fits], mode="lines+markers",
            name=plain(driver), line=line_of(LINES[number % len(LINES)], 2),
        )  # fmt: skip
    figure.update_xaxes(dtick=1)
    return figure


def errors_by_components(scores: Sequence[Score]) -> go.Figure:
    """Show errors and standard deviations of one driver's lookahead models over their components (PP, Fig. 5)."""
    from plotly.subplots import make_subplots

    panels = (("mean_error", "average error, m"), ("mean_sd", "average standard deviation, m"))
    splits = (("", "test", "solid", "circle"), ("train_", "training", "dot", "square"))
    figure = make_subplots(cols=2, horizontal_spacing=0.11)
    style(figure, 420)
    baselines = [score for score in scores if score.is_baseline]
    models = [score for score in scores if not score.is_baseline]
    components = [score.parameters["components"] for score in models] or [1]
    names = list(dict.fromkeys((score.model, score.parameters.get("regressors")) for score in models))
    apart = 0.012 * (max(components) - min(components))  # Bars of different models would cover each other.
    for column, (what, title) in enumerate(panels, start=1):
        where = {"row": 1, "col": column}
        figure.update_yaxes(title_text=title, rangemode="tozero", minallowed=0, **where)
        figure.update_xaxes(title_text="number of components N", **where)
        for place, ((model, regressors), colour) in enumerate(zip(names, itertools.cycle(LINES), strict=False)):
            own = [s for s in models if (s.model, s.parameters.get("regressors")) == (model, regressors)]
            name = model if regressors is None else f"{model}, n₂ = {regressors}"
            for number, (prefix, split, dash, symbol) in enumerate(splits):
                aside = apart * (2 * place + number - len(names) + 0.5)
                figure.add_scatter(
                    x=[score.parameters["components"] + aside for score in own],
                    y=[score.mean(prefix + what) for score in own],
                    error_y={"type": "data", "array": [score.deviation(prefix + what) for score in own], "width": 3},
                    mode="lines+markers",
                    name=f"{plain(name)}: {split}",
                    legendgroup=f"{plain(name)}: {split}",
                    showlegend=column == 1,
                    line=line_of(colour, 2, dash),
                    marker_symbol=symbol,
                    hovertemplate="%{y:.3g}<extra>%{fullData.name}</extra>",
                    **where,
                )
        for score, dash in zip(baselines, itertools.cycle(("dash", "dashdot", "longdash", "dot")), strict=False):
            figure.add_scatter(
                x=[min(components) - 0.5, max(components) + 0.5],
                y=[score.mean(what)] * 2,
                mode="lines",
                name=f"baseline {plain(score.model)}: test",
                legendgroup=f"baseline {plain(score.model)}",
                showlegend=column == 1,
                line=line_of(GREY, 1.8, dash),
                **where,
            )
    return figure


def errors_of_models(scores: Sequence[Score]) -> go.Figure:
    """Show the error of each of one driver's motion primitive models and baselines, and its spread over the folds."""
    figure = figure_of("average error of the steering wheel angle, °", "", height=110 + 28 * len(scores))
    for is_baseline, name, colour, symbol in ((True, "baseline", GREY, "square"), (False, "model", BLUE, "circle")):
        own = [score for score in scores if score.is_baseline == is_baseline]
        if own:
            figure.add_scatter(
                x=[score.mean("mean_error") for score in own],
                y=[scores.index(score) for score in own],
                error_x={"type": "data", "array": [score.deviation("mean_error") for score in own]},
                mode="markers",
                name=f"{name}, mean ± sd over folds",
                marker={"color": colour, "symbol": symbol, "size": 9},
            )
    name_lanes(figure, [score.label for score in scores])
    figure.update_xaxes(rangemode="tozero", minallowed=0)
    figure.update_layout(legend={"y": 1.02, "yanchor": "bottom"})
    return figure


def error_over_minutes(lines: Mapping[str, Mapping[int, Sequence[float]]], title: str) -> go.Figure:
    """Show errors over the minutes of training data on a logarithmic axis, mean and standard deviation over the folds.

    Args:
        lines: By model: errors of the folds by minutes; a model of 0 minutes is drawn across.
        title: Of the errors, with their unit.
    """
    figure = figure_of("training data, min", title, height=340)
    learnt = sorted({minutes for points in lines.values() for minutes in points if minutes})
    for (model, points), colour in zip(lines.items(), itertools.cycle(LINES), strict=False):
        across = set(points) == {0}
        minutes = learnt or [1] if across else sorted(points)
        errors = [points[0 if across else number] for number in minutes]
        figure.add_scatter(
            x=minutes,
            y=as_float32([np.mean(values) for values in errors]),
            error_y=None if across else {"type": "data", "array": as_float32([np.std(values) for values in errors])},
            mode="lines" if across else "lines+markers",
            name=plain(model),
            line=line_of(GREY if across else colour, 2, "dash" if across else "solid"),
        )
    figure.update_xaxes(type="log", tickvals=learnt, ticktext=[str(number) for number in learnt])
    figure.update_yaxes(rangemode="tozero")
    return figure


def matrix(
    names: Sequence[str],
    values: Sequence[Sequence[float | None]],
    across: str,
    down: str,
    digits: int,
    *,
    reverse: bool = False,
) -> go.Figure:
    """Show a matrix of drivers as a heat map with its numbers; dark is much.

    Args:
        names: Drivers, of the columns and of the rows.
        values: Row by row; None where there is none.
        across: What the columns are.
        down: What the rows are.
        digits: Decimals of the numbers.
        reverse: Dark is little.
    """
    figure = figure_of(across, "", height=150 + 38 * len(names))
    numbers = np.array([[np.nan if value is None else value for value in row] for row in values], np.float64)
    shown = [["" if value is None else f"{value:.{digits}f}".replace("-", "−") for value in row] for row in values]
    # One bad pair must not wash out the others.
    low, high = np.nanpercentile(numbers, (0, 75) if reverse else (25, 100)) if np.isfinite(numbers).any() else (0, 1)
    figure.add_heatmap(
        z=as_float32(numbers), zmin=float(low), zmax=float(high), text=shown, texttemplate="%{text}", showscale=False,
        colorscale="Blues", reversescale=reverse, xgap=1, ygap=1,
        hovertemplate=f"{down} %{{y}}, {across} %{{x}}: %{{text}}<extra></extra>",
    )  # fmt: skip
    places = list(range(len(names)))
    name_lanes(figure, names)
    figure.update_yaxes(title_text=down, range=[len(names) - 0.5, -0.5])
    figure.update_layout(margin_l=figure.layout.margin.l + 30)
    figure.update_xaxes(tickvals=places, ticktext=[plain(name[:40]) for name in names], showgrid=False, zeroline=False)
    return figure


def prediction(
    driven_time: Values, driven: Values, starts: Values, steps: Values, mean: Values, sd: Values
) -> go.Figure:
    """Show predictions that follow each other, with their bands, against what the driver did.

    Args:
        driven_time: (n_samples,) s from the first prediction.
        driven: (n_samples,) steering wheel angle, deg.
        starts: (n_predictions,) when each prediction is made, s from the first one.
        steps: (n_steps,) s from its prediction, the same for all.
        mean: (n_predictions, n_steps) predicted steering wheel angle, deg.
        sd: (n_predictions, n_steps) standard deviation of the prediction, deg.
    """
    figure = figure_of(
        "time, s; a prediction begins at each dotted line", "steering wheel angle, ° (left +)", height=360
    )
    time = starts[:, None] + steps
    apart = np.full((len(starts), 1), np.nan)
    around = np.hstack([time, time[:, ::-1], apart]).ravel()
    for factor, name, colour in (
        (WITHIN_95, "95 % band", "rgba(0,114,178,0.16)"),
        (WITHIN_68, "68 % band", "rgba(0,114,178,0.30)"),
    ):
        edge = np.hstack([mean + factor * sd, (mean - factor * sd)[:, ::-1], apart]).ravel()
        figure.add_scatter(
            x=as_float32(around), y=as_float32(edge), fill="toself", fillcolor=colour, mode="lines", line={"width": 0},
            name=name, hoverinfo="skip",
        )  # fmt: skip
    figure.add_scatter(
        x=as_float32(np.hstack([time, apart]).ravel()), y=as_float32(np.hstack([mean, apart]).ravel()), mode="lines",
        name="predicted", line=line_of(VERMILLION, 2.2, "dash"),
    )  # fmt: skip
    figure.add_scatter(
        x=as_float32(driven_time), y=as_float32(driven), mode="lines", name="driven", line=line_of(BLACK, 2)
    )
    for start in starts.tolist():
        figure.add_vline(x=start, line={"color": GREY, "width": 1, "dash": "dot"})
    return figure
