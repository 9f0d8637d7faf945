"""One recording's signals on one clock and one grid: the synced table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from ..schemas.signals import CAN_SIGNALS, NAV_SIGNALS, SIGNALS
from ..schemas.store import read_table
from ..schemas.tables import SYNCED
from .clock import ClockEstimate, to_utc
from .mapping import MappedSignal
from .resample import grid, number_runs, resample

Times = npt.NDArray[np.int64]
Values = npt.NDArray[np.float64]

CORE = ("steering_wheel_angle", "speed", "x", "y")
"""Without one of these that the recording has, a grid point lies in a gap; it is what every later stage needs."""


@dataclass(frozen=True, slots=True)
class SampledSignal:
    """One canonical signal at its own rate.

    Attributes:
        time: int64 (n,), ns.
        values: float64 (n,), in the stored unit; NaN where missing.
        channel: The bus it came from; empty for navigation.
        out_of_range: Samples set to missing because they lie outside the signal's range.
        source: J1939 address of the sender; None where it is not J1939's.
    """

    time: Times
    values: Values
    channel: str
    out_of_range: int
    source: int | None = None


def read_mapped(files: Sequence[Path], mapped: MappedSignal) -> SampledSignal | None:
    """Read a mapped signal from the signal files of its message, one for each log.

    Where several buses carry the message, or several senders in J1939, and the mapping names none, the one with most
    frames is taken.

    Returns:
        The signal; None where no such frame was recorded.
    """
    wanted = ("time", "channel", "source", mapped.column)
    columns = [name for name in wanted if name in pq.read_schema(files[0]).names]
    table = pa.concat_tables(read_table(file, columns).replace_schema_metadata() for file in files)
    table, channel = _from_one(table, "channel", mapped.channel)
    source = None
    if "source" in table.column_names:
        table, source = _from_one(table, "source", mapped.source)
    if len(table) == 0:
        return None
    values = table[mapped.column].cast(pa.float64(), safe=False).to_numpy() * mapped.factor
    return replace(_in_range(mapped.canonical, _nanoseconds(table), values, str(channel)), source=source)


def _from_one(table: pa.Table, column: str, wanted: Any) -> tuple[pa.Table, Any]:
    """Return the rows with one value in a column, without that column; the most frequent one where none is wanted."""
    counts = pc.value_counts(table[column]).to_pylist()
    if wanted is None and counts:
        wanted = min(counts, key=lambda c: (-c["counts"], c["values"]))["values"]
    if [count["values"] for count in counts] != [wanted]:
        table = table.filter(pc.equal(table[column], wanted))
    return table.drop_columns([column]), wanted


def read_navigation(navigation: pa.Table) -> dict[str, SampledSignal]:
    """Return every navigation signal that has at least one value."""
    time = _nanoseconds(navigation)
    return {
        name: _in_range(name, time, navigation[name].cast(pa.float64(), safe=False).to_numpy(), "")
        for name in NAV_SIGNALS
        if navigation[name].null_count < len(navigation)
    }


def synchronise(
    can: Mapping[str, SampledSignal],
    navigation: Mapping[str, SampledSignal],
    clock: ClockEstimate,
    period: int,
    max_gap: int,
) -> pa.Table:
    """Bring all signals to the grid.

    Args:
        can: Signals by canonical name, stamped by the CAN clock.
        navigation: Signals by canonical name, stamped in UTC.
        clock: What turns CAN stamps into UTC.
        period: Grid period, ns.
        max_gap: Longest time between two samples that is bridged, ns.

    Returns:
        A table in the schema `SYNCED` from the first sample of any source to the last; `run` numbers the stretches
        in which every core signal that the recording has (steering wheel angle, both speeds' sources, position) is
        there, and is null in between.
    """
    sources = {name: (to_utc(s.time, clock), s.values) for name, s in can.items()}
    sources |= {name: (s.time, s.values) for name, s in navigation.items()}
    grid_time = grid(
        min(int(time.min()) for time, _ in sources.values()),
        max(int(time.max()) for time, _ in sources.values()) + 1,
        period,
    )
    on_grid = {
        name: resample(time, values, grid_time, SIGNALS[name].resampling, max_gap, period)
        for name, (time, values) in sources.items()
    }
    complete = np.ones(len(grid_time), bool)
    for name in CORE:
        if name in on_grid:
            complete &= ~np.isnan(on_grid[name])
    runs = number_runs(complete)
    missing = np.full(len(grid_time), np.nan)
    columns = [pa.array(grid_time, SYNCED.field("time").type), pa.array(runs, pa.int32(), mask=runs < 0)]
    for name in (*CAN_SIGNALS, *NAV_SIGNALS):
        values = pa.array(on_grid.get(name, missing), pa.float64(), from_pandas=True)
        columns.append(values.cast(SYNCED.field(name).type, safe=False))
    return pa.Table.from_arrays(columns, schema=SYNCED)


def _nanoseconds(table: pa.Table) -> Times:
    time: Times = table["time"].cast(pa.int64()).to_numpy()
    return time


def _in_range(name: str, time: Times, values: Values, channel: str) -> SampledSignal:
    outside = (values < SIGNALS[name].minimum) | (values > SIGNALS[name].maximum)
    return SampledSignal(time, np.where(outside, np.nan, values), channel, int(np.count_nonzero(outside)))
