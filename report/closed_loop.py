"""The section on closed loops: how each law of the lookahead distance drives, beside the driver."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..modeling.tracking import TEST_TRACK, current_cells, pool
from ..schemas.project import Project
from .blocks import Block, Cell, Column, Figure, Gallery, Note, Table
from .look import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILLION, as_float32, line_of, style
from .tables import number, text

if TYPE_CHECKING:
    import plotly.graph_objects as go

Row = Mapping[str, Any]

STYLES = {
    ("driver", ""): ("driver", line_of(BLACK, 3)),
    ("general", "pursuit"): ("general", line_of(VERMILLION, 1.6, "dot")),
    ("velocity", "pursuit"): ("velocity", line_of(BLUE, 1.8)),
    ("constant", "pursuit"): ("constant", line_of(GREEN, 1.6, "dash")),
    ("linear", "pursuit"): ("linear", line_of(PURPLE, 1.6, "dashdot")),
    ("velocity", "bounded"): ("velocity, bounded", line_of(SKY, 1.6, "dash")),
    ("velocity", "combined"): ("velocity, combined", line_of(ORANGE, 2)),
}
"""Law and control, as they are listed -> name and line."""


def closed_loop_blocks(project: Project) -> list[Block]:
    """Return the blocks of the section.

    Raises:
        InputError: The manifest or the project file is wrong.
    """
    # The test track first: it is the same for everybody.
    cells = sorted(current_cells(project).values(), key=lambda cell: cell["rows"][0]["path"] != TEST_TRACK)
    if not cells:
        return [Note("Nothing was driven in closed loop with the models as they are now.", "wheelprint track")]
    shown: list[Figure] = []
    drawn: set[tuple[str, bool]] = set()
    for cell in cells:
        first = cell["rows"][0]
        kind = (first["driver"], first["path"] == TEST_TRACK)
        if kind not in drawn:
            drawn.add(kind)
            shown.append(Figure(f"{first['driver']}: {_place(first)}.", drives(cell)))
    explained = Note(
        "Pure pursuit (PP eq. 1) with the lookahead distance of each law: general and velocity-based mixture, the "
        "driver’s median, and linear in speed. The car is a bicycle with the fitted steering ratio and understeer, at "
        "the path’s speed. Bounded: lookahead, steering wheel angle and its rate stay within what the driver has shown "
        "at that speed. Combined: that, and a controller that is stable at every speed takes over, by and by, off the "
        "path and where path and speed are unlike what was learnt."
    )
    return [explained, *_tables(cells), Gallery(shown, wide=True)]


def _place(row: Row) -> str:
    path = "test track" if row["path"] == TEST_TRACK else f"along {row['path']}"
    return path + (f", begun {row['offset']:+g} m to the left".replace("-", "−") if row["offset"] else "")


def _tables(cells: Sequence[Mapping[str, Any]]) -> Iterator[Table]:
    groups: dict[bool, dict[tuple[str, str], dict[tuple[str, str], list[Row]]]] = {}
    for cell in cells:
        for row in cell["rows"]:
            own = row["path"].startswith(f"{row['driver']}/") and not row["offset"]
            place = "own" if own else _place(row)
            group = groups.setdefault(row["path"] == TEST_TRACK, {})
            group.setdefault((row["driver"], place), {}).setdefault((row["law"], row["control"]), []).append(row)
    for on_test_track, group in groups.items():
        columns = [
            Column("Driver", numeric=False), Column("Path", numeric=False), Column("Law", numeric=False),
            Column("Off path, rms", "m"), Column("at most", "m"), Column("Wheel rate, rms", "°/s"),
            Column("Its change, rms", "°/s²"), Column("Controller steers", "% of time"),
        ]  # fmt: skip
        caption = "Closed loop on PP’s test track, 10 to 40 km/h, or one of its kind: PP gives no measures of it."
        if not on_test_track:
            columns += [Column("Angle, from the driver’s", "°"), Column("Lookahead, from the driver’s", "m")]
            caption = (
                "Closed loop along what was driven, or along the reference path where there is one; own: all of the "
                "driver’s recordings. From the driver’s: mean absolute difference to what the driver did at the same "
                "place; of the laws alone the nearest one stands out. The driver’s signals are smoothed, the laws’ are "
                "not."
            )
        rows = [row for key, by_law in group.items() for row in _rows(key, by_law, len(columns))]
        yield Table(caption, columns, rows)


def _rows(key: tuple[str, str], by_law: Mapping[tuple[str, str], Sequence[Row]], width: int) -> Iterator[list[Cell]]:
    """Return the lines of one driver and path, of each so many cells."""
    pooled = {law: pool(by_law[law]) for law in STYLES if law in by_law}
    errors = [row["steering_error"] for (_, control), row in pooled.items() if control == "pursuit"]
    nearest = min((error for error in errors if error is not None), default=math.nan)
    for law, row in pooled.items():
        yield [
            text(key[0]),
            text(key[1]),
            text(STYLES[law][0], "baseline" if law[0] == "driver" else ""),
            number(row["tracking_rms"], 2),
            number(row["tracking_max"], 2),
            number(row["steering_rate_rms"], 1),
            number(row["steering_change_rms"], 0),
            number(100 * (row["taken_over"] or 0.0) if law[1] == "combined" else None, 1),
            number(row["steering_error"], 2, "best" if row["steering_error"] == nearest else ""),
            number(row["lookahead_error"], 2),
        ][:width]


def drives(cell: Mapping[str, Any]) -> go.Figure:
    """Show a path and the drives along it on equal axes, and beside it tracking error, steering and lookahead distance.

    Args:
        cell: As `modeling.tracking.drive_laws` writes it.
    """
    from plotly.subplots import make_subplots

    panels = (
        ("deviation", "off path, m (left +)"), ("steering_wheel_angle", "wheel, ° (left +)"),
        ("lookahead", "lookahead, m"),
    )  # fmt: skip
    figure = make_subplots(
        rows=3, cols=2, column_widths=[0.4, 0.6], horizontal_spacing=0.09, vertical_spacing=0.05,
        specs=[[{"rowspan": 3}, {}], [None, {}], [None, {}]],
    )  # fmt: skip
    style(figure, 560)
    track = cell["track"]
    figure.add_scatter(
        x=as_float32(track["x"]),
        y=as_float32(track["y"]),
        mode="lines",
        name="path",
        line=line_of("#C9D0D6", 9),
        hoverinfo="skip",
        row=1,
        col=1,
    )
    for drive in cell["drives"]:
        name, line = STYLES[drive["law"], drive["control"]]
        own: dict[str, Any] = {"mode": "lines", "name": name, "legendgroup": name, "line": line, "col": 2}
        if "x" in drive:
            x, y = as_float32(drive["x"]), as_float32(drive["y"])
            figure.add_scatter(x=x, y=y, row=1, showlegend=False, **own | {"col": 1})
        distance = as_float32(drive["distance"])
        for row, (quantity, _) in enumerate(panels, start=1):
            figure.add_scatter(x=distance, y=as_float32(drive[quantity]), showlegend=row == 1, row=row, **own)
    figure.update_xaxes(title_text="x (east), m", row=1, col=1)
    figure.update_yaxes(title_text="y (north), m", scaleanchor="x", scaleratio=1, row=1, col=1)
    for row, (_, title) in enumerate(panels, start=1):
        figure.update_yaxes(title_text=title, row=row, col=2)
        figure.update_xaxes(matches=None if row == 3 else "x4", showticklabels=row == 3, row=row, col=2)
    figure.update_xaxes(title_text="distance along the path, m", row=3, col=2)
    figure.update_layout(legend={"y": -0.13})
    return figure
