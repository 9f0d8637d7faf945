"""The figures of the papers' experiments: MP's Fig. 2, PP's Figs. 5, 6 and 7."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .look import BLACK, BLUE, GREY, VERMILLION, line_of, style

if TYPE_CHECKING:
    import plotly.graph_objects as go

METHODS = {"proposed": (BLUE, "rgba(0,114,178,0.22)"), "general": (VERMILLION, "rgba(213,94,0,0.18)")}
MODELS = {"general": VERMILLION, "velocity": BLUE}


def situations(shown: Sequence[Mapping[str, Any]]) -> go.Figure:
    """Show MP's Fig. 2: for each situation the path ahead, its type, and the steering driven and predicted twice.

    Args:
        shown: Situations as `modeling.experiment_figures.draw_situations` describes them.
    """
    from plotly.subplots import make_subplots

    figure = make_subplots(
        rows=2, cols=len(shown), row_heights=[0.3, 0.7], vertical_spacing=0.08, horizontal_spacing=0.05,
        subplot_titles=[situation["situation"] for situation in shown],
    )  # fmt: skip
    style(figure, 460)
    for column, situation in enumerate(shown, start=1):
        first = {"showlegend": column == 1}
        figure.add_scatter(
            x=situation["time_s"], y=situation["course_deviation"], text=situation["path_type"],
            name="course deviation", legendgroup="path", line=line_of(GREY, 2),
            hovertemplate="%{y:.2f}°, type %{text}<extra></extra>", row=1, col=column, **first,
        )  # fmt: skip
        ahead = situation["time_s"][1:]
        for method, (colour, band) in METHODS.items():
            mean, sd = (np.array(situation["methods"][method][name]) for name in ("mean", "sd"))
            figure.add_scatter(
                x=[*ahead, *ahead[::-1]], y=[*(mean + sd), *(mean - sd)[::-1]], fill="toself", fillcolor=band,
                mode="lines", line={"width": 0}, name=f"{method}: ± sd", legendgroup=f"{method} sd", hoverinfo="skip",
                row=2, col=column, **first,
            )  # fmt: skip
            figure.add_scatter(
                x=ahead, y=mean, mode="lines", name=method, legendgroup=method, line=line_of(colour, 2.2, "dash"),
                row=2, col=column, **first,
            )  # fmt: skip
        figure.add_scatter(
            x=situation["time_s"], y=situation["driven"], mode="lines", name="driven", legendgroup="driven",
            line=line_of(BLACK, 2), row=2, col=column, **first,
        )  # fmt: skip
        figure.update_xaxes(title_text="time, s", row=2, col=column)
    figure.update_yaxes(title_text="Δθ, ° per 0.1 s", row=1, col=1)
    figure.update_yaxes(title_text="steering wheel angle, °", row=2, col=1)
    figure.update_layout(margin_t=30)
    return figure


def add_printed(figure: go.Figure, points: Sequence[Mapping[str, Any]]) -> None:
    """Add what PP's text says of its Fig. 5 to the errors over components: errors left, deviations right."""
    for column, measure in enumerate(("mean_error", "mean_sd"), start=1):
        figure.add_scatter(
            x=[point["components"] for point in points],
            y=[point[measure] for point in points],
            mode="markers",
            name="paper, velocity-based: test",
            legendgroup="paper",
            showlegend=column == 1,
            marker={"symbol": "star", "size": 12, "color": BLACK},
            row=1,
            col=column,
        )


def track(driven: Sequence[Mapping[str, Any]], points: Mapping[str, Any]) -> go.Figure:
    """Show PP's Fig. 6: the test track and where each model drove, on equal axes.

    Args:
        driven: Drives as `modeling.experiment_figures.follow_track` describes them.
        points: `x` and `y` of the track, m.
    """
    import plotly.graph_objects as go

    figure = go.Figure()
    style(figure, 420)
    figure.add_scatter(x=points["x"], y=points["y"], mode="lines", name="track", line=line_of(BLACK, 4))
    for drive in driven:
        line = line_of(MODELS[drive["model"]], 2, "dash")
        figure.add_scatter(x=drive["x"], y=drive["y"], mode="lines", name=drive["model"], line=line)
    figure.update_xaxes(title_text="x, m")
    figure.update_yaxes(title_text="y, m", scaleanchor="x", scaleratio=1)
    return figure


def along_track(driven: Sequence[Mapping[str, Any]]) -> go.Figure:
    """Show PP's Fig. 7: steering angle, lookahead distance and its standard deviation over the distance driven."""
    from plotly.subplots import make_subplots

    panels = (
        ("road_wheel_angle", "road wheels, °"), ("lookahead", "lookahead, m"), ("lookahead_sd", "its sd, m"),
        ("deviation", "off track, m"),
    )  # fmt: skip
    figure = make_subplots(rows=len(panels), cols=1, shared_xaxes=True, vertical_spacing=0.04)
    style(figure, 620)
    for row, (name, title) in enumerate(panels, start=1):
        for drive in driven:
            figure.add_scatter(
                x=drive["distance"], y=drive[name], mode="lines", name=drive["model"], legendgroup=drive["model"],
                showlegend=row == 1, line=line_of(MODELS[drive["model"]], 2), row=row, col=1,
            )  # fmt: skip
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(title_text="distance along the track, m", row=len(panels), col=1)
    figure.update_layout(legend={"y": -0.1})
    return figure
