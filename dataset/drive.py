"""One recording on its way from the synced table to the dataset: which rows remain, and what is derived from them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..schemas.config import Config
from .events import Event, covered
from .path import Floats, Runs, course_deviation, distance
from .segments import Division, divide, features
from .smoothing import smooth, smooth_angles
from .steering import Steering


@dataclass(frozen=True, slots=True)
class Drive:
    """The ordinary driving of one recording, ready but for what only the driver's whole data can say.

    Attributes:
        time: ns UTC (n_samples,).
        run: Number of the run, from 0; no run has fewer than two samples.
        columns: The measured and derived columns of the dataset but for the lookahead distance, each (n_samples,), NaN
            where missing.
        measured: Position, directions, speed and road wheel angle before they were smoothed, by column.
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
    measured: dict[str, Floats]
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


def segments_of(course_deviation: Floats, run: Runs, config: Config) -> tuple[NDArray[np.int32], NDArray[np.int8]]:
    """Return segments and sides as `divide`, by the thresholds of `[segments]` at the project's rate."""
    return divide(course_deviation, run, *division_of(config))


def division_of(config: Config) -> Division:
    """Return the thresholds of `[segments]` at the project's rate."""
    settings, period = config.segments, config.sync.period
    release = settings.neutral if settings.release is None else settings.release
    shortest = math.ceil(settings.minimum_duration * 1e9 / period)
    return Division(settings.neutral * period / 1e8, release * period / 1e8, shortest)


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
    how = (run, config.dataset.smoothing_window, config.dataset.smoothing)

    def values(name: str) -> Floats:
        column: Floats = chosen[name].to_numpy()
        return column

    measured = {name: values(name) for name in ("x", "y", "course", "heading")}
    measured |= {"speed": values(core[3]), "steering_wheel_angle": values("steering_wheel_angle") - steering.offset}
    by_kind = {"course": smooth_angles, "heading": smooth_angles}
    columns = {name: by_kind.get(name, smooth)(series, *how) for name, series in measured.items()}
    for of in (measured, columns):
        of["road_wheel_angle"] = of["steering_wheel_angle"] / steering.ratio
    deviation = columns["course_deviation"] = course_deviation(columns["course"], run)
    period = config.sync.period
    segment, side = segments_of(deviation, run, config)
    return Drive(
        chosen["time"].cast(pa.int64()).to_numpy(),
        run,
        columns,
        measured,
        segment,
        side,
        features(deviation, columns["speed"], segment, period),
        distance(columns["x"], columns["y"], run),
        excluded,
        undecided,
    )
