"""Canonical signals of one recording at their own rates, in its signal files, read when they are needed."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from ..schemas.signals import NAV_SIGNALS, SIGNALS
from ..schemas.store import read_batches, read_table
from .mapping import MappedSignal
from .navigation import Origin, merge_navigation
from .resample import grid, resample_pieces

Times = npt.NDArray[np.int64]
Values = npt.NDArray[np.float64]


class Signal(Protocol):
    """A canonical signal, in memory or not."""

    @property
    def start(self) -> int:
        """First stamp, ns."""
        ...

    @property
    def stop(self) -> int:
        """Last stamp, ns."""
        ...

    def read(self) -> SampledSignal:
        """Return all samples; they need not be in the order of time."""
        ...


@dataclass(frozen=True, slots=True)
class SampledSignal:
    """One canonical signal at its own rate.

    Attributes:
        time: int64 (n,), ns.
        values: float64 (n,), in the stored unit; NaN where missing.
    """

    time: Times
    values: Values

    @property
    def start(self) -> int:
        """First stamp, ns."""
        return int(self.time.min())

    @property
    def stop(self) -> int:
        """Last stamp, ns."""
        return int(self.time.max())

    def read(self) -> SampledSignal:
        """Return itself: nothing has to be read."""
        return self


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
        return _joined(self.pieces(), self.samples)


@dataclass(slots=True)
class _Tally:
    samples: int
    out_of_range: int
    start: int
    stop: int
    in_order: bool


def find_mapped(files: Sequence[Path], mapped: MappedSignal) -> StoredSignal | None:
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
    distinct = np.flatnonzero(np.bincount(codes))
    for code in distinct.tolist():
        rows = slice(None) if len(distinct) == 1 else np.flatnonzero(codes == code)
        if "source" in names:
            channel, source = divmod(code, len(values[-1]))
            yield values[0][channel], values[-1][source], rows
        else:
            yield values[0][code], None, rows


@dataclass(frozen=True, slots=True)
class NavigationSignal:
    """A signal of a recording's navigation logs.

    Attributes:
        files: One for each log, in the schema `NAVIGATION`.
        name: Canonical name.
        samples: Of all logs, missing ones too.
        start: First stamp of the logs, ns.
        stop: Last one, ns.
    """

    files: tuple[Path, ...]
    name: str
    samples: int
    start: int
    stop: int

    def read(self) -> SampledSignal:
        """Read the samples by increasing time, joined as `merge_navigation` says; null becomes NaN."""
        if len(self.files) == 1:
            return _joined(self._pieces(), self.samples)
        place = ("latitude", "longitude", "altitude", "x", "y") if self.name in ("x", "y") else (self.name,)
        joined = merge_navigation([read_table(file, ["time", *place]) for file in self.files])
        values = joined[self.name].cast(pa.float64(), safe=False).to_numpy()
        time: Times = joined["time"].cast(pa.int64()).to_numpy()
        return SampledSignal(time, np.where(_outside(self.name, values), np.nan, values))

    def means(self, period: int, max_gap: int) -> SampledSignal:
        """Return the means over periods, NaN within gaps, all in ns; every sample where a period has fewer than two."""
        if len(self.files) > 1 or self.samples * period < 2 * (self.stop - self.start):
            return self.read()
        time = grid(self.start, self.stop + 1, period)
        pieces = ((piece.time, piece.values) for piece in self._pieces())
        return SampledSignal(time, resample_pieces(pieces, time, "mean", max_gap, period))

    def _pieces(self) -> Iterator[SampledSignal]:
        for batch in read_batches(self.files[0], ["time", self.name]):
            values = batch[self.name].cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
            time = batch["time"].cast(pa.int64()).to_numpy()
            yield SampledSignal(time, np.where(_outside(self.name, values), np.nan, values))


def _joined(pieces: Iterable[SampledSignal], count: int) -> SampledSignal:
    """Return `count` samples as one signal; never are they in memory twice."""
    joined, first = SampledSignal(np.empty(count, np.int64), np.empty(count)), 0
    for piece in pieces:
        part = slice(first, first := first + len(piece.time))
        joined.time[part], joined.values[part] = piece.time, piece.values
    return joined


def find_navigation(files: Sequence[Path]) -> tuple[dict[str, NavigationSignal], Origin | None]:
    """Find every navigation signal that has at least one value, and the place where x and y are zero.

    Args:
        files: Navigation as it is published, each in the order of time; may be none.
    """
    stamps: list[int] = []
    samples = 0
    known: set[str] = set()
    origins: dict[int, Origin] = {}
    for file in files:
        content = pq.read_metadata(file)
        schema = content.schema.to_arrow_schema()
        if content.num_rows == 0:
            continue
        samples += content.num_rows
        time = read_table(file, ["time"])["time"]
        first, last = time[0].value, time[-1].value
        stamps += [first, last]
        for name in NAV_SIGNALS:
            if any(batch[name].null_count < len(batch) for batch in read_batches(file, [name])):
                known.add(name)
        if origin := json.loads((schema.metadata or {}).get(b"origin", b"null")):
            origins[first] = Origin(**origin)
    signals = {
        name: NavigationSignal(tuple(files), name, samples, min(stamps), max(stamps))
        for name in NAV_SIGNALS
        if name in known
    }
    return signals, origins[min(origins)] if origins else None


def _outside(canonical: str, values: Values) -> npt.NDArray[np.bool_]:
    return (values < SIGNALS[canonical].minimum) | (values > SIGNALS[canonical].maximum)
