"""The look of the report's figures: colours safe for the colour-blind, axes with units, names as they are."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import plotly.graph_objects as go

BLUE, VERMILLION, GREEN, ORANGE, SKY, PURPLE, BLACK, GREY = (
    "#0072B2", "#D55E00", "#009E73", "#E69F00", "#56B4E9", "#CC79A7", "#222222", "#8C959F",
)  # fmt: skip
"""Okabe and Ito's palette, without its yellow, which is too light for lines on white."""
LINES = (BLUE, VERMILLION, GREEN, PURPLE, SKY, ORANGE)
SHAPES = ("circle", "square", "diamond", "triangle-up", "cross", "x")
FONT = 'system-ui, "Segoe UI", Roboto, "Noto Sans", "Noto Sans CJK SC", sans-serif'

AXIS: dict[str, Any] = {
    "gridcolor": "#E6EAEE", "zerolinecolor": "#C9D0D6", "linecolor": GREY, "showline": True, "ticks": "outside",
    "title": {"standoff": 8, "font": {"size": 13}},
}  # fmt: skip


def plain(name: str) -> str:
    """Return a name so that plotly, which reads a little HTML in texts, shows it as it is."""
    return html.escape(name, quote=False)


def figure_of(x_title: str, y_title: str, height: int) -> go.Figure:
    """Return an empty figure with titled axes in the style of the report."""
    import plotly.graph_objects as go

    # All at once: of a figure that is there already plotly compares every part of its own style, 15 ms long.
    x_axis, y_axis = ({**AXIS, "title": {**AXIS["title"], "text": title}} for title in (x_title, y_title))
    return go.Figure(layout={**_layout(height), "xaxis": x_axis, "yaxis": y_axis})


def style(figure: go.Figure, height: int) -> None:
    """Give a figure, all of its axes included, the style of the report and a height in pixels."""
    figure.update_layout(_layout(height))
    figure.update_xaxes(AXIS)
    figure.update_yaxes(AXIS)


def _layout(height: int) -> dict[str, Any]:
    return {
        "template": "none", "height": height, "margin": {"l": 68, "r": 14, "t": 12, "b": 48}, "paper_bgcolor": "#fff",
        "plot_bgcolor": "#fff", "font": {"family": FONT, "size": 13, "color": "#1b1f24"}, "hovermode": "closest",
        "legend": {"orientation": "h", "x": 0, "xanchor": "left", "y": -0.2, "yanchor": "top"},
    }  # fmt: skip


def line_of(colour: str, width: float, dash: str = "solid") -> dict[str, Any]:
    """Return a line as plotly describes it; widths are in pixels."""
    return {"color": colour, "width": width, "dash": dash}


def name_lanes(figure: go.Figure, names: Sequence[str]) -> None:
    """Write names instead of 0, 1, 2, … on the vertical axis, from above."""
    shown = [name if len(name) <= 40 else f"{name[:39]}…" for name in names]
    figure.update_yaxes(
        tickvals=list(range(len(names))), ticktext=[plain(name) for name in shown], range=[len(names) - 0.4, -0.6],
        showgrid=False, zeroline=False,
    )  # fmt: skip
    # Plotly's own automargin cuts labels where the figure is narrow; Chinese characters are as wide as high.
    figure.update_layout(margin_l=20 + max(sum(13.0 if char > "\u2e80" else 7.6 for char in name) for name in shown))


def as_float32(values: Any) -> NDArray[np.float32]:
    """Return values as the report stores them: half the bytes, and more precise than any screen."""
    return np.asarray(values, np.float32)
