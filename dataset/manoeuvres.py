"""Proposals of driving situations: lane changes, turns at intersections, highway speed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..schemas.angles import wrap_degrees
from ..schemas.config import Situations
from .events import Event
from .excursions import excursions
from .path import Floats, begins_run, course_deviation
from .situations import Situation
from .stretches import covered, subtract

STILL_FAST = 0.9
"""Share of highway speed below which a highway is left."""
LEAVE = 0.5
"""Share of the curvature of a turn at which it is over."""
SLOWEST = 1.0
"""m/s; the course of a car that stands says nothing."""
CHANGING_SPEED = 8.0
"""m/s; slower, going round something is no lane change."""
STRAIGHTNESS = 1.5
"""deg between the courses before and after a lane change."""
COUNTERSTEER = 0.25
"""Share of the displacement by which a lane change may lead to the other side on its way."""
PADDING = 0.5
"""s on both sides of a lane change, whose first centimetres do not show."""


def propose_situations(
    recordings: Mapping[str, pa.Table], left_out: Iterable[Event], settings: Situations, period: int
) -> list[Situation]:
    """Propose situations in recordings, those that the project names, from nothing that is left out of the dataset.

    - `lane change`: the car is displaced to one side by `lane_width` within `lane_change_duration`, going in the
      direction that it came in.
    - `intersection`: it turns by more than `turn_angle` with a radius below `turn_radius`.
    - `highway`: it is faster than `highway_speed` for `highway_duration`, but for lane changes.

    Args:
        recordings: `driver/recording` -> synced table.
        left_out: Events that are left out.
        settings: What is proposed.
        period: Of the grid, ns.

    Returns:
        Situations with decision `proposed`, none of which overlaps another, sorted.
    """
    events: dict[str, list[Event]] = {name: [] for name in recordings}
    for event in left_out:
        if event.recording in events:
            events[event.recording].append(event)
    proposals: list[Situation] = []
    for name, table in recordings.items():
        if len(table):
            proposals += _propose(name, table, events[name], settings, period)
    return sorted(proposals)


def _propose(
    recording: str, table: pa.Table, left_out: list[Event], settings: Situations, period: int
) -> list[Situation]:
    time = table["time"].cast(pa.int64()).to_numpy()
    run = np.where(covered(time, left_out), -1, table["run"].fill_null(-1).to_numpy().astype(np.int64))
    columns = {name: table[name].to_numpy() for name in ("nav_speed", "speed", "course")}
    speed = np.where(np.isnan(columns["nav_speed"]), np.abs(columns["speed"]), columns["nav_speed"])
    speed = np.where(run < 0, np.nan, speed)
    deviation = course_deviation(columns["course"], run)
    highway = excursions(
        speed, run, settings.highway_speed, STILL_FAST * settings.highway_speed,
        round(settings.highway_duration * 1e9 / period),
    )  # fmt: skip
    faster = f"faster than {settings.highway_speed:g} m/s"

    def situations(name: str, found: Iterable[tuple[int, int, str]], padding: float = 0.0) -> list[Situation]:
        margin = round(padding * 1e9)
        return [
            Situation(
                recording,
                max(int(time[first]) - margin, int(time[0])),
                min(int(time[last]) + margin, int(time[-1])) + period,
                name,
                "proposed",
                "",
                "",
                note,
            )
            for first, last, note in found
            if name in settings.names
        ]

    turns = situations("intersection", _turns(deviation, speed, run, settings, period))
    changes = _apart(situations("lane change", _lane_changes(deviation, speed, run, settings, period), PADDING))
    changes = subtract(changes, turns)
    fast = situations("highway", ((rows.start, rows.stop - 1, faster) for rows in highway))
    return [*changes, *turns, *subtract(fast, changes + turns)]


def _apart(changes: list[Situation]) -> list[Situation]:
    """Return lane changes none of which begins before the one before it ends."""
    apart: list[Situation] = []
    for change in changes:
        apart += subtract([change], apart[-1:])
    return apart


def _turns(
    deviation: Floats, speed: Floats, run: NDArray[np.int64], settings: Situations, period: int
) -> Iterator[tuple[int, int, str]]:
    """Yield first and last row of every turn, and by how much it turns."""
    step = np.where(speed > SLOWEST, speed, np.nan) * period / 1e9
    curvature = np.radians(deviation) / step
    tight = 1 / settings.turn_radius
    for sign in (1, -1):
        for rows in excursions(sign * curvature, run, tight, LEAVE * tight, 1):
            angle = float(deviation[rows].sum())
            if abs(angle) > settings.turn_angle:
                yield rows.start, rows.stop - 1, f"turns by {angle:.0f} deg"


def _lane_changes(
    deviation: Floats, speed: Floats, run: NDArray[np.int64], settings: Situations, period: int
) -> list[tuple[int, int, str]]:
    """Return first and last row of every lane change, and its displacement, ascending.

    Of the windows in which the car is displaced by a lane's width and goes as it came, the shortest ones are taken,
    and of equally long ones the straightest.
    """
    seconds = period / 1e9
    most = round(settings.lane_change_duration / seconds)
    if len(run) <= most:
        return []
    least_width, most_width = settings.lane_width
    turned = np.cumsum(np.where(np.isnan(deviation), 0.0, deviation))
    stride = np.where(np.isnan(speed), 0.0, speed) * seconds
    # A row that cannot be judged, and every row on which a run begins, counts against all windows that hold it.
    broken = np.cumsum(np.isnan(deviation) & ~begins_run(run) | np.isnan(speed) | (speed < CHANGING_SPEED))
    number = np.cumsum(begins_run(run))
    displaced = travelled = np.zeros(len(run))
    left, right = np.zeros(len(run)), np.zeros(len(run))
    found: list[tuple[int, float, int, float]] = []
    for length in range(1, most + 1):
        kept = len(run) - length
        relative = wrap_degrees(turned[length:] - turned[:kept])
        displaced = displaced[:kept] + np.sin(np.radians(relative)) * stride[length:]
        travelled = travelled[:kept] + stride[length:]
        left, right = np.maximum(left[:kept], displaced), np.minimum(right[:kept], displaced)
        whole = (number[length:] == number[:kept]) & (broken[length:] == broken[:kept])
        # Against the course at the end as well as that at the start: one that is a degree off leads far astray.
        width = np.minimum(
            np.abs(displaced), np.sign(displaced) * (displaced - np.sin(np.radians(relative)) * travelled)
        )
        astray = np.where(displaced > 0, -right, left)
        fits = whole & (np.abs(relative) < STRAIGHTNESS) & (width > least_width) & (width < most_width)
        fits &= astray < COUNTERSTEER * width
        rows = np.flatnonzero(fits)
        found += [(length, abs(float(relative[row])), int(row), float(displaced[row])) for row in rows]
    taken = np.zeros(len(run), dtype=np.bool_)
    changes = []
    for length, _, row, side in sorted(found):
        if not taken[row : row + length + 1].any():
            taken[row : row + length + 1] = True
            changes.append(
                (row, row + length, f"displaced by {abs(side):.1f} m to the {'left' if side > 0 else 'right'}")
            )
    return sorted(changes)
