"""One recording's signals on one clock and one grid: the synced table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from ..schemas.signals import CAN_SIGNALS, NAV_SIGNALS, SIGNALS
from ..schemas.store import read_batches
from ..schemas.tables import SYNCED
from .clock import ClockEstimate, to_utc
from .mapping import MappedSignal
from .resample import grid, number_runs, resample, resample_pieces

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
    """

    time: Times
    values: Values


@dataclass(frozen=True, slots=True)
class StoredSignal:
    """A mapped signal in the signal files of its message; hours of all of them at once would fill the memory.

    Attributes:
        mapped: Where it comes from.
        files: One for each log.
        channel: The bus it is taken from.
        source: J1939 address of the sender; None where it is not J1939's.
        samples: How many frames carried it.
        out_of_range: Samples that lie outside the signal's range and are missing.
        start: First stamp, ns.
        stop: Last stamp, ns.
        in_order: Whether no piece of the files, as they are read, begins before the one before it ends.
    """

    mapped: MappedSignal
    files: tuple[Path, ...]
    channel: str
    source: int | None
    samples: int
    out_of_range: int
    start: int
    stop: int
    in_order: bool

    def pieces(self) -> Iterator[SampledSignal]:
        """Yield the samples in the order of the logs; values outside the signal's range are missing."""
        for channel, source, time, values in _pieces(self.files, self.mapped):
            if (channel, source) == (self.channel, self.source):
                yield SampledSignal(time, np.where(_outside(self.mapped.canonical, values), np.nan, values))

    def read(self) -> SampledSignal:
        """Read all samples in the order of the logs."""
        pieces = list(self.pieces())
        return SampledSignal(*(np.concatenate([getattr(p, name) for p in pieces]) for name in ("time", "values")))


@dataclass(slots=True)
class _Tally:
    samples: int
    out_of_range: int
    start: int
    stop: int
    in_order: bool


def survey(files: Sequence[Path], mapped: MappedSignal) -> StoredSignal | None:
    """Find a mapped signal in the signal files of its message, one for each log.

    Where several buses carry the message, or several senders in J1939, and the mapping names none, the one with most
    frames is taken.

    Returns:
        The signal; None where no such frame was recorded.
    """
    tallies: dict[tuple[str, int | None], _Tally] = {}
    for channel, source, time, values in _pieces(files, mapped):
        out_of_range = int(np.count_nonzero(_outside(mapped.canonical, values)))
        first, last = int(time.min()), int(time.max())
        tally = tallies.setdefault((channel, source), _Tally(0, 0, first, first, in_order=True))
        tally.samples += len(time)
        tally.out_of_range += out_of_range
        tally.in_order &= first >= tally.stop
        tally.start, tally.stop = min(tally.start, first), max(tally.stop, last)
    if not tallies:
        return None
    per_channel: Counter[str] = Counter()
    for (name, _), tally in tallies.items():
        per_channel[name] += tally.samples
    bus = min(per_channel, key=lambda name: (-per_channel[name], name))
    of_bus = {source: tally for (name, source), tally in tallies.items() if name == bus}
    sender = min(of_bus, key=lambda source: (-of_bus[source].samples, source or 0))
    chosen = of_bus[sender]
    return StoredSignal(
        mapped, tuple(files), bus, sender, chosen.samples, chosen.out_of_range, chosen.start, chosen.stop,
        chosen.in_order,
    )  # fmt: skip


def _pieces(files: Iterable[Path], mapped: MappedSignal) -> Iterator[tuple[str, int | None, Times, Values]]:
    """Yield channel, source, stamps and values of the frames that the mapping allows, a piece of a file at a time."""
    for file in files:
        names = set(pq.read_schema(file).names)
        wanted = [name for name in ("time", "channel", "source", mapped.column) if name in names]
        for batch in read_batches(file, wanted):
            time = batch["time"].cast(pa.int64()).to_numpy()
            values = batch[mapped.column].cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False) * mapped.factor
            for channel, source, rows in _senders(batch):
                if mapped.channel in (None, channel) and (mapped.source is None or mapped.source == source):
                    yield channel, source, time[rows], values[rows]


def _senders(batch: pa.RecordBatch) -> Iterator[tuple[str, int | None, slice | npt.NDArray[np.intp]]]:
    """Yield each channel and source of a batch of frames with its rows."""
    names = [name for name in ("channel", "source") if name in batch.schema.names]
    codes = np.zeros(len(batch), np.int64)
    values = []
    for name in names:
        column = batch[name]
        column = column if pa.types.is_dictionary(column.type) else column.dictionary_encode()
        values.append(column.dictionary.to_pylist())
        codes = codes * len(values[-1]) + column.indices.to_numpy(zero_copy_only=False)
    distinct = np.unique(codes)
    for code in distinct.tolist():
        rows = slice(None) if len(distinct) == 1 else np.flatnonzero(codes == code)
        if "source" in names:
            channel, source = divmod(code, len(values[-1]))
            yield values[0][channel], values[-1][source], rows
        else:
            yield values[0][code], None, rows


def _outside(canonical: str, values: Values) -> npt.NDArray[np.bool_]:
    return (values < SIGNALS[canonical].minimum) | (values > SIGNALS[canonical].maximum)


def read_navigation(navigation: pa.Table) -> dict[str, SampledSignal]:
    """Return every navigation signal that has at least one value."""
    time: Times = navigation["time"].cast(pa.int64()).to_numpy()
    signals = {}
    for name in NAV_SIGNALS:
        if navigation[name].null_count < len(navigation):
            values = navigation[name].cast(pa.float64(), safe=False).to_numpy()
            signals[name] = SampledSignal(time, np.where(_outside(name, values), np.nan, values))
    return signals


def synchronise(
    can: Mapping[str, StoredSignal],
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
    can_stamps = [stamp for signal in can.values() for stamp in (signal.start, signal.stop)]
    stamps = [to_utc(np.array(can_stamps, np.int64), clock), *(signal.time for signal in navigation.values())]
    stamps = [some for some in stamps if len(some)]
    grid_time = grid(min(int(some.min()) for some in stamps), max(int(some.max()) for some in stamps) + 1, period)
    on_grid: dict[str, Values] = {}
    for name, stored in can.items():
        pieces = stored.pieces() if stored.in_order else (stored.read(),)
        in_utc = ((to_utc(piece.time, clock), piece.values) for piece in pieces)
        on_grid[name] = resample_pieces(in_utc, grid_time, SIGNALS[name].resampling, max_gap, period)
    for name, signal in navigation.items():
        method = SIGNALS[name].resampling
        on_grid[name] = resample(signal.time, signal.values, grid_time, method, max_gap, period)
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
