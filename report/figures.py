"""The figures of the report: plotly figures from arrays, units on every axis, colours safe for the colour-blind."""

from __future__ import annotations

import html
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from .scores import Score

Values = NDArray[np.float64]

BLUE, VERMILLION, GREEN, ORANGE, SKY, PURPLE, BLACK, GREY = (
    "#0072B2", "#D55E00", "#009E73", "#E69F00", "#56B4E9", "#CC79A7", "#222222", "#8C959F",
)  # fmt: skip
"""Okabe and Ito's palette, without its yellow, which is too light for lines on white."""
LINES = (BLUE, VERMILLION, GREEN, PURPLE, SKY, ORANGE)
DECISIONS = {"proposed": ORANGE, "emergency": VERMILLION, "normal": GREEN}
SHAPES = ("circle", "square", "diamond", "triangle-up", "cross", "x")
SYMBOLS = {"proposed": "diamond", "emergency": "x", "normal": "circle"}
WITHIN_68, WITHIN_95 = (NormalDist().inv_cdf((1 + share) / 2) for share in (0.68, 0.95))
"""Half widths of Gaussian bands that hold 68 % and 95 %, in standard deviations."""
FONT = 'system-ui, "Segoe UI", Roboto, "Noto Sans", "Noto Sans CJK SC", sans-serif'


def plain(name: str) -> str:
    """Return a name so that plotly, which reads a little HTML in texts, shows it as it is."""
    return html.escape(name, quote=False)


def thin(length: int, at_most: int) -> slice:
    """Return a slice that keeps every n-th of `length` samples so that at most so many remain."""
    return slice(None, None, -(-length // at_most) or 1)


def alignment(
    seconds: Values, navigation: Values, before: Values | None, after: Values | None, shift: float
) -> go.Figure:
    """Show the car's speed against navigation's on the CAN clock and on UTC.

    Args:
        seconds: (n_samples,) time since the stretch began, s.
        navigation: (n_samples,) navigation's speed, m/s.
        before: (n_samples,) the car's speed at the same readings of its own clock, m/s; None where there is none.
        after: (n_samples,) the car's speed after alignment, m/s; None where the clock was not aligned.
        shift: CAN stamp − UTC in this stretch, s.
    """
    figure = figure_of("time, s", "speed, km/h", height=300)
    figure.add_scatter(x=_float32(seconds), y=_float32(3.6 * navigation), name="navigation", line=line_of(BLACK, 2.5))
    if before is not None:
        name = f"CAN as stamped ({shift:+.3f} s)" if after is not None else "CAN as stamped"
        line = line_of(ORANGE, 2, "dot")
        figure.add_scatter(x=_float32(seconds), y=_float32(3.6 * before), name=name.replace("-", "−"), line=line)
    if after is not None:
        figure.add_scatter(x=_float32(seconds), y=_float32(3.6 * after), name="CAN aligned", line=line_of(BLUE, 2))
    return figure


@dataclass(frozen=True, slots=True)
class Lane:
    """One recording in the timeline of events.

    Attributes:
        name: The recording.
        duration: Its length, min.
        events: Start and stop (min from the recording's start), kind and decision of each event.
    """

    name: str
    duration: float
    events: Sequence[tuple[float, float, str, str]]


def timeline(lanes: Sequence[Lane]) -> go.Figure:
    """Show when events happened, one lane for each recording: colours are decisions, symbols are kinds."""
    figure = figure_of("time since the recording's start, min", "", height=130 + 30 * len(lanes))
    bar = {"orientation": "h", "hoverinfo": "skip", "showlegend": False}
    places, durations = list(range(len(lanes))), [lane.duration for lane in lanes]
    figure.add_bar(y=places, x=durations, width=0.14, marker_color="#D5DBE1", **bar)
    events = [(place, *event) for place, lane in zip(places, lanes, strict=True) for event in lane.events]
    kinds = sorted({kind for _, _, _, kind, _ in events})
    for (decision, colour), (kind, symbol) in itertools.product(DECISIONS.items(), zip(kinds, itertools.cycle(SHAPES))):
        found = [event for event in events if event[3:] == (kind, decision)]
        if not found:
            continue
        y = [place for place, *_ in found]
        start = [begin for _, begin, *_ in found]
        length = [end - begin for _, begin, end, *_ in found]
        figure.add_bar(y=y, base=start, x=length, width=0.56, marker={"color": colour, "opacity": 0.55}, **bar)
        figure.add_scatter(
            x=[begin + minutes / 2 for begin, minutes in zip(start, length, strict=True)],
            y=y,
            mode="markers",
            marker={"color": colour, "symbol": symbol, "size": 9, "line": {"color": BLACK, "width": 1}},
            name=f"{plain(kind)}: {decision}",
            text=[f"{plain(kind)}, {60 * minutes:.1f} s" for minutes in length],
            hovertemplate="%{text} at %{x:.1f} min<extra></extra>",
        )
    figure.update_layout(barmode="overlay", legend={"y": 1.02, "yanchor": "bottom"})
    _name_lanes(figure, [lane.name for lane in lanes])
    return figure


def track(
    x: Values,
    y: Values,
    speed: Values,
    label: Values | None,
    events: Mapping[str, tuple[Values, Values]],
) -> go.Figure:
    """Draw a recording's path on equal axes, coloured by path label or, without one, by speed.

    Args:
        x: (n_samples,) east of the origin, m; NaN where the line breaks.
        y: (n_samples,) north of the origin, m.
        speed: (n_samples,) m/s.
        label: (n_samples,) path label from 1, NaN outside the dataset; None before there is a dataset.
        events: Positions (x and y, m) within events, by decision.
    """
    figure = figure_of("x (east), m", "y (north), m", height=420)
    east, north = _float32(x), _float32(y)
    if label is None:
        figure.add_scatter(x=east, y=north, mode="markers", showlegend=False, marker=_by_speed(speed))
    else:
        line = line_of("#AEB6BD", 1.5)
        figure.add_scatter(x=east, y=north, mode="lines", name="not in dataset", line=line, hoverinfo="skip")
        for value in np.unique(label[np.isfinite(label)]).astype(int).tolist():
            own = label == value
            figure.add_scatter(
                x=east[own], y=north[own], mode="markers", name=f"label {value}",
                marker={"size": 4, "color": LINES[(value - 1) % len(LINES)]},
            )  # fmt: skip
        figure.add_scatter(
            x=east, y=north, mode="markers", name="speed", visible=False, showlegend=False, marker=_by_speed(speed)
        )
        _choose(
            figure, {"path label": lambda name: name != "speed", "speed": lambda name: not name.startswith("label")}
        )
    for decision, (event_x, event_y) in events.items():
        figure.add_scatter(
            x=_float32(event_x), y=_float32(event_y), mode="markers", name=f"event: {decision}",
            marker={
                "size": 11, "symbol": f"{SYMBOLS[decision]}-open", "color": DECISIONS[decision], "line": {"width": 2.5},
            },
        )  # fmt: skip
    figure.update_yaxes(scaleanchor="x", scaleratio=1)
    return figure


def _by_speed(speed: Values) -> dict[str, Any]:
    bar = {"title": {"text": "km/h", "side": "top"}, "thickness": 12, "len": 0.8}
    return {"size": 4, "color": _float32(3.6 * speed), "colorscale": "Cividis", "colorbar": bar}


def _choose(figure: go.Figure, views: Mapping[str, Any]) -> None:
    """Add buttons, one for each view: which of the traces there are so far it shows; later traces stay as they are."""
    names = [trace.name for trace in figure.data]
    places = list(range(len(names)))
    buttons = [
        {"label": label, "method": "restyle", "args": [{"visible": [bool(shows(name)) for name in names]}, places]}
        for label, shows in views.items()
    ]
    figure.update_layout(
        margin_t=44,
        updatemenus=[
            {
                "type": "buttons", "direction": "right", "buttons": buttons, "showactive": True,
                "x": 0, "xanchor": "left", "y": 1.02, "yanchor": "bottom", "pad": {"t": 0, "b": 0, "l": 0, "r": 0},
            }
        ],
    )  # fmt: skip


def lookahead(
    speed: Values, distance: Values, spread: Values, narrow: float = 10.0, at_most: int = 2500, bin_width: float = 5.0
) -> go.Figure:
    """Scatter one driver's lookahead distance over speed, with median and quartiles of bins of speed.

    Samples whose steering tells the distance to within `narrow` are shown apart from those, on straight roads above
    all, that many distances explain.

    Args:
        speed: (n_samples,) m/s.
        distance: (n_samples,) m; NaN where undefined.
        spread: (n_samples,) m, range of the distances that explain the steering.
        narrow: m.
        at_most: Points that are drawn; the bins are computed from all of them.
        bin_width: km/h.
    """
    defined = np.isfinite(distance) & np.isfinite(speed)
    speed, distance, told = 3.6 * speed[defined], distance[defined], spread[defined] <= narrow
    figure = figure_of("speed, km/h", "lookahead distance h, m", height=400)
    few = thin(len(speed), at_most)
    bins = np.floor(speed / bin_width).astype(int)
    kinds = ((f"spread above {narrow:g} m", ~told, GREY, 0.35), (f"spread up to {narrow:g} m", told, BLUE, 0.5))
    for name, own, colour, opacity in kinds:
        x, y = speed[few][own[few]], distance[few][own[few]]
        marker = {"size": 3, "color": colour, "opacity": opacity}
        figure.add_scatter(x=_float32(x), y=_float32(y), mode="markers", name=name, hoverinfo="skip", marker=marker)
    for name, own, colour, _ in kinds:
        filled = [number for number in np.unique(bins[own]) if np.count_nonzero(bins[own] == number) >= 20]
        if not filled:
            continue
        quantiles = [np.quantile(distance[own & (bins == number)], (0.25, 0.5, 0.75)) for number in filled]
        low, middle, high = np.array(quantiles).T
        bars = {"array": _float32(high - middle), "arrayminus": _float32(middle - low)}
        figure.add_scatter(
            x=[(number + 0.5) * bin_width for number in filled],
            y=_float32(middle),
            mode="lines+markers",
            name=f"{name}: median, quartiles",
            error_y={"type": "data", "symmetric": False, **bars},
            line=line_of(colour, 2),
            marker={"size": 7},
        )
    figure.update_yaxes(rangemode="tozero")
    return figure


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
    _name_lanes(figure, [score.label for score in scores])
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
            y=_float32([np.mean(values) for values in errors]),
            error_y=None if across else {"type": "data", "array": _float32([np.std(values) for values in errors])},
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
        z=_float32(numbers), zmin=float(low), zmax=float(high), text=shown, texttemplate="%{text}", showscale=False,
        colorscale="Blues", reversescale=reverse, xgap=1, ygap=1,
        hovertemplate=f"{down} %{{y}}, {across} %{{x}}: %{{text}}<extra></extra>",
    )  # fmt: skip
    places = list(range(len(names)))
    _name_lanes(figure, names)
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
            x=_float32(around), y=_float32(edge), fill="toself", fillcolor=colour, mode="lines", line={"width": 0},
            name=name, hoverinfo="skip",
        )  # fmt: skip
    figure.add_scatter(
        x=_float32(np.hstack([time, apart]).ravel()), y=_float32(np.hstack([mean, apart]).ravel()), mode="lines",
        name="predicted", line=line_of(VERMILLION, 2.2, "dash"),
    )  # fmt: skip
    figure.add_scatter(x=_float32(driven_time), y=_float32(driven), mode="lines", name="driven", line=line_of(BLACK, 2))
    for start in starts.tolist():
        figure.add_vline(x=start, line={"color": GREY, "width": 1, "dash": "dot"})
    return figure


def figure_of(x_title: str, y_title: str, height: int) -> go.Figure:
    """Return an empty figure with titled axes in the style of the report."""
    import plotly.graph_objects as go

    figure = go.Figure()
    style(figure, height)
    figure.update_xaxes(title_text=x_title)
    figure.update_yaxes(title_text=y_title)
    return figure


def style(figure: go.Figure, height: int) -> None:
    """Give a figure, all of its axes included, the style of the report and a height in pixels."""
    axis = {
        "gridcolor": "#E6EAEE", "zerolinecolor": "#C9D0D6", "linecolor": GREY, "showline": True, "ticks": "outside",
        "title": {"standoff": 8, "font": {"size": 13}},
    }  # fmt: skip
    figure.update_layout(
        template="none", height=height, margin={"l": 68, "r": 14, "t": 12, "b": 48}, paper_bgcolor="#fff",
        plot_bgcolor="#fff", font={"family": FONT, "size": 13, "color": "#1b1f24"}, hovermode="closest",
        legend={"orientation": "h", "x": 0, "xanchor": "left", "y": -0.2, "yanchor": "top"},
    )  # fmt: skip
    figure.update_xaxes(axis)
    figure.update_yaxes(axis)


def line_of(colour: str, width: float, dash: str = "solid") -> dict[str, Any]:
    """Return a line as plotly describes it; widths are in pixels."""
    return {"color": colour, "width": width, "dash": dash}


def _name_lanes(figure: go.Figure, names: Sequence[str]) -> None:
    """Write names instead of 0, 1, 2, … on the vertical axis, from above."""
    shown = [name if len(name) <= 40 else f"{name[:39]}…" for name in names]
    figure.update_yaxes(
        tickvals=list(range(len(names))), ticktext=[plain(name) for name in shown], range=[len(names) - 0.4, -0.6],
        showgrid=False, zeroline=False,
    )  # fmt: skip
    # Plotly's own automargin cuts labels where the figure is narrow; Chinese characters are as wide as high.
    figure.update_layout(margin_l=20 + max(sum(13.0 if char > "\u2e80" else 7.6 for char in name) for name in shown))


def _float32(values: Any) -> NDArray[np.float32]:
    """Return values as the report stores them: half the bytes, and more precise than any screen."""
    return np.asarray(values, np.float32)
