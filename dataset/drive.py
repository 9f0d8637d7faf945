"""One recording on its way from the synced table to the dataset: which rows remain, and what is derived from them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..schemas.config import Config
from .events import Event, covered
from .lookahead import lookahead_distance
from .path import Floats, course_deviation, distance
from .segments import divide, features
from .smoothing import moving_average, moving_average_of_angles
from .steering import Steering


@dataclass(frozen=True, slots=True)
class Drive:
    """The ordinary driving of one recording, ready but for what only the driver's whole data can say.

    Attributes:
        time: ns UTC (n_samples,).
        run: Number of the run, from 0; no run has fewer than two samples.
        columns: The measured and derived columns of the dataset, each (n_samples,), NaN where missing.
        segment: Segment of every sample, from 0.
        side: 1 left, 0 neutral, -1 right.
        features: MP eq. 3 of every segment (n_segments, 4).
        distance: m driven.
        excluded: Rows of the synced table that are absent, by the reason.
        undecided: Those of them that are absent because of proposals that nobody decided about, by the kind.
    """

    time: NDArray[np.int64]
    run: NDArray[np.int32]
    columns: dict[str, Floats]
    segment: NDArray[np.int32]
    side: NDArray[np.int8]
    features: Floats
    distance: float
    excluded: dict[str, int]
    undecided: dict[str, int]


def core_columns(config: Config) -> tuple[str, ...]:
    """Return the columns of a synced table without which a row is no use."""
    return ("x", "y", "course", {"nav": "nav_speed", "can": "speed"}[config.dataset.speed], "steering_wheel_angle")


def select_rows(
    table: pa.Table, events: Iterable[Event], core: Sequence[str]
) -> tuple[NDArray[np.int64], NDArray[np.int32], dict[str, int], dict[str, int]]:
    """Return which rows of a synced table are ordinary driving.

    Args:
        table: Schema `SYNCED`.
        events: Of this recording; those a person has called normal stay in.
        core: Columns that must not be null.

    Returns:
        The rows that remain, ascending; their runs, numbered from 0: what is absent ends a run; how many rows are
        absent for which reason: `gap` (outside runs), an event's kind, `missing` (of a core column), or `single` (a
        run of one sample, which has no course deviation), a row counting for the first reason; and how many of these
        for which kind of proposed events.
    """
    time = table["time"].cast(pa.int64()).to_numpy()
    run = table["run"].fill_null(-1).to_numpy()
    excluded: Counter[str] = Counter()
    undecided: Counter[str] = Counter()
    keep = np.ones(len(table), dtype=np.bool_)

    def leave_out(reason: str, mask: NDArray[np.bool_], *, is_proposed: bool = False) -> None:
        if absent := int(np.count_nonzero(keep & mask)):
            excluded[reason] += absent
            if is_proposed:
                undecided[reason] += absent
            keep[mask] = False

    leave_out("gap", run < 0)
    for event in sorted(events):
        if event.is_left_out:
            leave_out(event.kind, covered(time, [event]), is_proposed=event.decision == "proposed")
    for name in core:
        leave_out("missing", np.isnan(table[name].to_numpy()))
    before = np.append(False, keep[:-1] & (run[1:] == run[:-1]))
    after = np.append(before[1:] & keep[1:], False)
    leave_out("single", keep & ~before & ~after)
    rows = np.flatnonzero(keep)
    numbers = np.cumsum(~before[rows]) - 1
    return rows, numbers.astype(np.int32), dict(excluded), dict(undecided)


def derive(table: pa.Table, events: Iterable[Event], steering: Steering, config: Config) -> Drive:
    """Return a recording's ordinary driving, smoothed within its runs, with the quantities of both papers.

    What events leave out is gone before anything is smoothed, so that nothing of an emergency gets into the dataset.

    Args:
        table: Synced table; no core column is entirely null.
        events: Of this recording.
        steering: Calibration of the car's steering.
        config: The project file.
    """
    core = core_columns(config)
    rows, run, excluded, undecided = select_rows(table, events, core)
    chosen = table.take(pa.array(rows))
    window = config.dataset.smoothing_window

    def values(name: str) -> Floats:
        column: Floats = chosen[name].to_numpy()
        return column

    x, y = (moving_average(values(name), run, window) for name in ("x", "y"))
    course, heading = (moving_average_of_angles(values(name), run, window) for name in ("course", "heading"))
    speed = moving_average(values(core[3]), run, window)
    wheel = moving_average(values("steering_wheel_angle") - steering.offset, run, window)
    road_wheel = wheel / steering.ratio
    deviation = course_deviation(course, run)
    pointing = np.where(np.isnan(heading), course, heading)
    lookahead, spread = lookahead_distance(x, y, pointing, road_wheel, run, config.vehicle.wheelbase, config.lookahead)
    period = config.sync.period
    segment, side = divide(deviation, run, config.segments.neutral * period / 1e8)
    return Drive(
        chosen["time"].cast(pa.int64()).to_numpy(),
        run,
        {
            "x": x,
            "y": y,
            "course": course,
            "heading": heading,
            "course_deviation": deviation,
            "speed": speed,
            "steering_wheel_angle": wheel,
            "road_wheel_angle": road_wheel,
            "lookahead": lookahead,
            "lookahead_spread": spread,
        },
        segment,
        side,
        features(deviation, speed, segment, period),
        distance(x, y, run),
        excluded,
        undecided,
    )
