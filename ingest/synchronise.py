"""One recording's signals on one clock and one grid: the synced table."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pyarrow as pa

from ..schemas.signals import CAN_SIGNALS, NAV_SIGNALS, SIGNALS
from ..schemas.tables import SYNCED
from .clock import ClockEstimate, to_utc
from .resample import Values, grid, number_runs, resample, resample_pieces
from .stored_signals import Signal, StoredSignal

CORE = ("steering_wheel_angle", "speed", "x", "y")
"""Without one of these that the recording has, a grid point lies in a gap; it is what every later stage needs."""


def synchronise(
    can: Mapping[str, StoredSignal],
    navigation: Mapping[str, Signal],
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
    can_stamps = [stamp for signal in can.values() for stamp in (signal.start, signal.stop)]
    stamps = to_utc(np.array(can_stamps, np.int64), clock).tolist()
    stamps += [stamp for signal in navigation.values() for stamp in (signal.start, signal.stop)]
    grid_time = grid(min(stamps), max(stamps) + 1, period)
    on_grid: dict[str, Values] = {}
    for name, stored in can.items():
        pieces = stored.pieces() if stored.in_order else (stored.read(),)
        in_utc = ((to_utc(piece.time, clock), piece.values) for piece in pieces)
        on_grid[name] = resample_pieces(in_utc, grid_time, SIGNALS[name].resampling, max_gap, period)
    for name, signal in navigation.items():
        samples, method = signal.read(), SIGNALS[name].resampling
        on_grid[name] = resample(samples.time, samples.values, grid_time, method, max_gap, period)
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
