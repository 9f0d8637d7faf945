"""The section on closed loops: how each law of the lookahead distance drives, beside the driver."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..modeling.tracking import TEST_TRACK, current_cells
from ..schemas.project import Project
from .blocks import Block, Column, Figure, Gallery, Note, Table
from .figures import BLACK, BLUE, GREEN, ORANGE, PURPLE, VERMILLION, line_of, plain, style
from .tables import number, text

if TYPE_CHECKING:
    import plotly.graph_objects as go

Row = Mapping[str, Any]

STYLES = {
    ("driver", ""): ("driver", line_of(BLACK, 3)),
    ("general", "pursuit"): ("general", line_of(VERMILLION, 1.6, "dot")),
    ("velocity", "pursuit"): ("velocity-based", line_of(BLUE, 1.8)),
    ("constant", "pursuit"): ("constant", line_of(GREEN, 1.6, "dash")),
    ("linear", "pursuit"): ("linear in speed", line_of(PURPLE, 1.6, "dashdot")),
    ("velocity", "combined"): ("velocity-based, combined", line_of(ORANGE, 2)),
}
"""Law and control -> name and line."""

LISTED = (*STYLES, ("velocity", "bounded"))
"""Law and control of the rows of the table."""

QUADRATIC = ("tracking_rms", "steering_rate_rms", "steering_change_rms")
LINEAR = ("steering_error", "lookahead_error", "taken_over")


def closed_loop_blocks(project: Project) -> list[Block]:
    """Return the blocks of the section.

    Raises:
        InputError: The manifest or the project file is wrong.
    """
    cells = current_cells(project)
    if not cells:
        return [Note("Nothing was driven in closed loop with the models as they are now.", "wheelprint track")]
    shown: list[Figure] = []
    drawn: set[tuple[str, bool]] = set()
    for cell in cells.values():
        first = cell["rows"][0]
        kind = (first["driver"], first["path"] == TEST_TRACK)
        if kind not in drawn:
            drawn.add(kind)
            shown += _figures(cell)
    explained = Note(
        "Pure pursuit (PP eq. 1) with the lookahead distance of each law, a bicycle with the fitted steering ratio and "
        "understeer, and the path’s speed. Bounded: lookahead, steering wheel angle and its rate stay within what the "
        "driver has shown at that speed. Combined: that, and a controller that is stable at every speed takes over, by "
        "and by, off the path and where the path and speed are unlike what was learnt."
    )
    return [explained, _table(cells), Gallery(shown, wide=True)]


def _table(cells: Mapping[str, Mapping[str, Any]]) -> Table:
    groups: dict[tuple[str, str], dict[tuple[str, str], list[Row]]] = {}
    for cell in cells.values():
        for row in cell["rows"]:
            who, where, offset = row["driver"], row["path"], row["offset"]
            path = "test track" if where == TEST_TRACK else "own" if where.startswith(f"{who}/") else where
            path += f", from {offset:+g} m".replace("-", "−") if offset else ""
            groups.setdefault((who, path), {}).setdefault((row["law"], row["control"]), []).append(row)
    rows = []
    for (driver, path), by_law in groups.items():
        pooled = {law: _pool(by_law[law]) for law in LISTED if law in by_law}
        nearest = min(
            (row["steering_error"] for law, row in pooled.items() if law[1] == "pursuit" and row["steering_error"]),
            default=None,
        )
        for law, row in pooled.items():
            name = STYLES[law][0] if law in STYLES else "velocity-based, bounded"
            rows.append(
                [
                    text(driver),
                    text(path),
                    text(name, "baseline" if law[0] == "driver" else ""),
                    number(row["tracking_rms"], 2),
                    number(row["tracking_max"], 2),
                    number(row["steering_rate_rms"], 1),
                    number(row["steering_change_rms"], 0),
                    number(row["steering_error"], 2, "best" if row["steering_error"] == nearest else ""),
                    number(row["lookahead_error"], 2),
                    number(100 * row["taken_over"] if law[1] == "combined" else None, 1),
                ]
            )
    columns = [
        Column("Driver", numeric=False), Column("Path", numeric=False), Column("Law", numeric=False),
        Column("Off path, rms", "m"), Column("at most", "m"), Column("Wheel rate, rms", "°/s"),
        Column("Its change, rms", "°/s²"), Column("Angle, from the driver’s", "°"),
        Column("Lookahead, from the driver’s", "m"), Column("Controller steers", "% of time"),
    ]  # fmt: skip
    caption = (
        "Closed loop. From the driver’s: mean absolute difference to what the driver did at the same place of the "
        "path; of the laws alone the nearest one stands out. The driver’s signals are smoothed, the laws’ are not. "
        "Own: all of the driver’s recordings, along the reference path where there is one, else along what was driven."
    )
    return Table(caption, columns, rows)


def _pool(rows: Sequence[Row]) -> Row:
    """Return the measures over several drives together."""

    def mean(name: str, power: int) -> float | None:
        known = [row for row in rows if row[name] is not None]
        seconds = sum(row["seconds"] for row in known)
        if not seconds:
            return None
        return math.pow(sum(row["seconds"] * row[name] ** power for row in known) / seconds, 1 / power)

    largest = [row["tracking_max"] for row in rows if row["tracking_max"] is not None]
    return {
        **{name: mean(name, 2) for name in QUADRATIC},
        **{name: mean(name, 1) for name in LINEAR},
        "tracking_max": max(largest, default=None),
    }


def _figures(cell: Mapping[str, Any]) -> Iterator[Figure]:
    first = cell["rows"][0]
    where = "PP’s test track" if first["path"] == TEST_TRACK else first["path"]
    offset = f", from {first['offset']:+g} m to the left".replace("-", "−") if first["offset"] else ""
    yield Figure(f"{first['driver']}: {where}{offset}, the path and where each law drove.", path_driven(cell))
    yield Figure(f"{first['driver']}: {where}{offset}, along the path.", along_path(cell))


def path_driven(cell: Mapping[str, Any]) -> go.Figure:
    """Show a path and the drives along it on equal axes.

    Args:
        cell: As `modeling.tracking.drive_laws` writes it.
    """
    import plotly.graph_objects as go

    figure = go.Figure()
    style(figure, 440)
    track = cell["track"]
    figure.add_scatter(x=track["x"], y=track["y"], mode="lines", name="path", line=line_of("#C9D0D6", 9))
    for drive in cell["drives"]:
        if "x" in drive:
            name, line = STYLES[drive["law"], drive["control"]]
            figure.add_scatter(x=drive["x"], y=drive["y"], mode="lines", name=plain(name), line=line)
    figure.update_xaxes(title_text="x (east), m")
    figure.update_yaxes(title_text="y (north), m", scaleanchor="x", scaleratio=1)
    return figure


def along_path(cell: Mapping[str, Any]) -> go.Figure:
    """Show tracking error, steering and lookahead distance over the distance along a path.

    Args:
        cell: As `modeling.tracking.drive_laws` writes it.
    """
    from plotly.subplots import make_subplots

    panels = (
        ("deviation", "off path, m (left +)"), ("steering_wheel_angle", "wheel, ° (left +)"),
        ("lookahead", "lookahead, m"),
    )  # fmt: skip
    figure = make_subplots(rows=len(panels), cols=1, shared_xaxes=True, vertical_spacing=0.04)
    style(figure, 640)
    for row, (quantity, title) in enumerate(panels, start=1):
        for drive in cell["drives"]:
            name, line = STYLES[drive["law"], drive["control"]]
            figure.add_scatter(
                x=drive["distance"], y=drive[quantity], mode="lines", name=plain(name), legendgroup=name,
                showlegend=row == 1, line=line, row=row, col=1,
            )  # fmt: skip
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(title_text="distance along the path, m", row=len(panels), col=1)
    figure.update_layout(legend={"y": -0.1})
    return figure
