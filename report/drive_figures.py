"""Figures of drives: clocks, events, paths, lookahead distances; plotly figures from arrays, units on every axis."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .look import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LINES,
    ORANGE,
    SHAPES,
    VERMILLION,
    as_float32,
    figure_of,
    line_of,
    name_lanes,
    plain,
)

if TYPE_CHECKING:
    import plotly.graph_objects as go

Values = NDArray[np.float64]

DECISIONS = {"proposed": ORANGE, "emergency": VERMILLION, "normal": GREEN}
SYMBOLS = {"proposed": "diamond", "emergency": "x", "normal": "circle"}


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
    figure.add_scatter(
        x=as_float32(seconds), y=as_float32(3.6 * navigation), name="navigation", line=line_of(BLACK, 2.5)
    )
    if before is not None:
        name = f"CAN as stamped ({shift:+.3f} s)" if after is not None else "CAN as stamped"
        line = line_of(ORANGE, 2, "dot")
        figure.add_scatter(x=as_float32(seconds), y=as_float32(3.6 * before), name=name.replace("-", "−"), line=line)
    if after is not None:
        figure.add_scatter(x=as_float32(seconds), y=as_float32(3.6 * after), name="CAN aligned", line=line_of(BLUE, 2))
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
    name_lanes(figure, [lane.name for lane in lanes])
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
    east, north = as_float32(x), as_float32(y)
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
            x=as_float32(event_x), y=as_float32(event_y), mode="markers", name=f"event: {decision}",
            marker={
                "size": 11, "symbol": f"{SYMBOLS[decision]}-open", "color": DECISIONS[decision], "line": {"width": 2.5},
            },
        )  # fmt: skip
    figure.update_yaxes(scaleanchor="x", scaleratio=1)
    return figure


def _by_speed(speed: Values) -> dict[str, Any]:
    bar = {"title": {"text": "km/h", "side": "top"}, "thickness": 12, "len": 0.8}
    return {"size": 4, "color": as_float32(3.6 * speed), "colorscale": "Cividis", "colorbar": bar}


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
        figure.add_scatter(x=as_float32(x), y=as_float32(y), mode="markers", name=name, hoverinfo="skip", marker=marker)
    for name, own, colour, _ in kinds:
        filled = [number for number in np.unique(bins[own]) if np.count_nonzero(bins[own] == number) >= 20]
        if not filled:
            continue
        quantiles = [np.quantile(distance[own & (bins == number)], (0.25, 0.5, 0.75)) for number in filled]
        low, middle, high = np.array(quantiles).T
        bars = {"array": as_float32(high - middle), "arrayminus": as_float32(middle - low)}
        figure.add_scatter(
            x=[(number + 0.5) * bin_width for number in filled],
            y=as_float32(middle),
            mode="lines+markers",
            name=f"{name}: median, quartiles",
            error_y={"type": "data", "symmetric": False, **bars},
            line=line_of(colour, 2),
            marker={"size": 7},
        )
    figure.update_yaxes(rangemode="tozero")
    return figure
