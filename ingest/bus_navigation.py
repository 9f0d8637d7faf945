"""Navigation from decoded CAN signals: `[nav.can]`, or an OxTS unit on the bus."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from ..schemas.quantities import QUANTITIES, TIME_QUANTITIES
from ..schemas.store import read_table
from .account import Account
from .clock import ClockEstimate, to_utc
from .gps_clock import clock_from_gps
from .mapping import MappedSignal
from .navigation import Samples, navigation_batches
from .oxts.leap_seconds import GPS_EPOCH, gps_to_utc
from .quantities import canonical_signals
from .resample import resample

Times = npt.NDArray[np.int64]
Values = npt.NDArray[np.float64]

SECOND = 1_000_000_000
TOGETHER = (
    ("latitude", "longitude", "altitude"),
    ("velocity_north", "velocity_east"),
    ("position_accuracy_north", "position_accuracy_east"),
)
"""What makes sense only together: where the first one comes without the others, these are interpolated."""
DIRECTLY = 600_000
"""ns; frames that follow one another so soon are of one cycle."""
LONGEST_CYCLE = 3_900_000
"""ns; shorter than the time between two measurements at 250 Hz."""
OXTS_DATE = ("TimeCentury", "TimeYear", "TimeMonth", "TimeDay", "TimeHour", "TimeMinute", "TimeSecond", "TimeHSecond")
"""Signals of OxTS's message `DateTime`: GPS time to the hundredth of a second."""
LEAP_SECONDS = range(10, 41)
"""Believable differences between GPS time and UTC; 18 since 2017."""


@dataclass(frozen=True, slots=True)
class BusNavigation:
    """The navigation of a recording's CAN frames, on the clock of the logger that stamped them.

    Attributes:
        time: int64 (n,), stamps in ns, increasing.
        signals: (n,) by canonical name, NaN where the frames of that cycle do not tell it.
        clock: What the unit's own time in the frames says of that clock; None where they have none.
        sources: What each quantity was taken from, for the manifest.
    """

    time: Times
    signals: Mapping[str, npt.NDArray[np.generic]]
    clock: ClockEstimate | None
    sources: Mapping[str, Mapping[str, Any]]

    def table(self, clock: ClockEstimate, latency: int = 0) -> pa.Table:
        """Return the samples in the schema `NAVIGATION`, their stamps brought to UTC and to when they were measured.

        Args:
            clock: Of the logger.
            latency: How late the frames come, ns.
        """
        time = to_utc(self.time, clock) - latency
        samples = Samples(np.arange(len(time)), time, np.ones(len(time), bool), self.signals, {})
        metadata = {"source": "can"}
        batches = navigation_batches(lambda _: [samples], Account(), metadata, unit="sample", record="sample")
        return pa.Table.from_batches(list(batches))


def read_bus_navigation(
    files: Mapping[str, Sequence[Path]], mapping: Mapping[str, MappedSignal], max_gap: int
) -> BusNavigation | None:
    """Read the navigation signals of a recording.

    There is a sample for every cycle of frames that tell something, see `_cycles`; nothing is interpolated but what
    goes together and comes apart, see `TOGETHER`.

    Args:
        files: Signal files by message.
        mapping: Mapped signals by quantity, of `resolve_navigation`.
        max_gap: Longest time between two samples that is bridged where messages are brought together, ns.

    Returns:
        What the frames tell; None where no frame of a mapped message was recorded.
    """
    told: dict[str, tuple[Times, Values]] = {}
    sources: dict[str, Mapping[str, Any]] = {}
    for name, mapped in mapping.items():
        found = _read(files[mapped.message], mapped) if mapped.message in files else None
        if found is None:
            continue
        time, column, channel = found
        sources[name] = {"message": mapped.message, "signal": mapped.signal, "channel": channel, "samples": len(time)}
        if name in QUANTITIES:
            told[name] = time, column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False) * mapped.factor
    clock = _clock(files, mapping)
    if not told:
        return None if clock is None else BusNavigation(np.array([], np.int64), {}, clock, sources)
    stamps, row = _cycles(np.unique(np.concatenate([time for time, _ in told.values()])))
    columns: dict[str, Values] = {}
    for name, (time, values) in told.items():
        columns[name] = np.full(len(stamps), np.nan)
        known = np.isfinite(values)
        columns[name][row(time[known])] = values[known]
    for first, *others in TOGETHER:
        for other in set(others) & columns.keys() if first in columns else ():
            alone = np.flatnonzero(np.isfinite(columns[first]) & np.isnan(columns[other]))
            method = QUANTITIES[other].resampling
            columns[other][alone] = resample(
                *told[other], stamps[alone], "angle" if method == "angle" else "linear", max_gap, 1
            )
    return BusNavigation(stamps, canonical_signals(columns), clock, sources)


def _cycles(stamps: Times) -> tuple[Times, Callable[[Times], npt.NDArray[np.intp]]]:
    """Return the stamps of cycles, and what tells the number of the cycle that a frame's stamp belongs to.

    Units measure once and send what they measured in several messages, one directly after the other: those are one
    sample, with the stamp of the first.

    Args:
        stamps: (n,) of all frames, ns, increasing.
    """
    begins = np.concatenate(([True], np.diff(stamps) > DIRECTLY))
    since = stamps - stamps[begins][np.cumsum(begins) - 1]
    begins |= np.concatenate(([False], np.diff(since // LONGEST_CYCLE) != 0))
    first = stamps[begins]
    return first, lambda time: np.searchsorted(first, time, "right") - 1


def _read(files: Sequence[Path], mapped: MappedSignal) -> tuple[Times, pa.Array, str] | None:
    """Return stamps, decoded values that are valid, and the channel of a mapped signal."""
    valid = [mapped.valid[0]] if mapped.valid else []
    wanted = dict.fromkeys(("time", "channel", "source", mapped.column, *valid))
    columns = [name for name in wanted if name in pq.read_schema(files[0]).names]
    table = pa.concat_tables(read_table(file, columns).replace_schema_metadata() for file in files)
    table, channel = _from_one(table, "channel", mapped.channel)
    if "source" in table.column_names:
        table, _ = _from_one(table, "source", mapped.source)
    if mapped.valid:
        column, limit = mapped.valid
        told = table[column]
        table = table.filter(pc.not_equal(told, 0) if limit is None else pc.less(told, limit))
    table = table.filter(table[mapped.column].is_valid())
    if len(table) == 0:
        return None
    return table["time"].cast(pa.int64()).to_numpy(), table[mapped.column].combine_chunks(), str(channel)


def _from_one(table: pa.Table, column: str, wanted: Any) -> tuple[pa.Table, Any]:
    """Return the rows with one value in a column; the most frequent one where none is wanted."""
    values = table[column]
    if pa.types.is_dictionary(values.type):
        values = values.cast(values.type.value_type)
    counts = pc.value_counts(values).to_pylist()
    if wanted is None and counts:
        wanted = min(counts, key=lambda c: (-c["counts"], c["values"]))["values"]
    return table.filter(pc.equal(values, wanted)), wanted


def _clock(files: Mapping[str, Sequence[Path]], mapping: Mapping[str, MappedSignal]) -> ClockEstimate | None:
    """Return what the unit's own time says of the logger's clock; None where no frame tells it."""
    found = {name: (mapping[name], _read(files[mapping[name].message], mapping[name]))
             for name in TIME_QUANTITIES if name in mapping and mapping[name].message in files}  # fmt: skip
    told = {name: (mapped, read) for name, (mapped, read) in found.items() if read is not None}
    for name in ("unix_time", "gps_time"):
        if name in told:
            mapped, (stamps, column, _) = told[name]
            time = _nanoseconds(column, mapped.factor)
            offset = told["utc_offset"][1][1] if "utc_offset" in told else None
            utc = time if name == "unix_time" else _utc(time, offset)
            return clock_from_gps(stamps, utc, f"{mapped.message}.{mapped.signal}")
    if "DateTime" in files and set(OXTS_DATE) <= set(pq.read_schema(files["DateTime"][0]).names):
        stamps, gps = _oxts_date(files["DateTime"])
        return clock_from_gps(stamps, _utc(gps, None), "DateTime")
    return None


def _nanoseconds(column: pa.Array, seconds: float) -> Times:
    """Return ns for times in units of so many seconds; integers stay exact."""
    if pa.types.is_integer(column.type):
        return np.asarray(column.to_numpy(zero_copy_only=False).astype(np.int64) * round(seconds * SECOND), np.int64)
    time = column.to_numpy(zero_copy_only=False) * seconds
    whole = np.floor(time)
    return np.asarray(whole.astype(np.int64) * SECOND + np.rint((time - whole) * SECOND).astype(np.int64), np.int64)


def _utc(gps: Times, offset: pa.Array | None) -> Times:
    """Return ns since 1970 for ns since 1980 of GPS time, by the offset that frames tell or by the table."""
    if offset is not None:
        # Units differ in its sign; GPS time has been ahead of UTC since 1981.
        seconds = abs(float(np.median(offset.to_numpy(zero_copy_only=False))))
        if round(seconds) in LEAP_SECONDS:
            return np.asarray(gps + GPS_EPOCH - round(seconds) * SECOND, np.int64)
    return np.asarray(gps_to_utc(gps), np.int64)


def _oxts_date(files: Sequence[Path]) -> tuple[Times, Times]:
    """Return stamps and GPS time, ns since it began, of OxTS's message `DateTime`; impossible dates are left out."""
    table = pa.concat_tables(
        read_table(file, ["time", "channel", *OXTS_DATE]).replace_schema_metadata() for file in files
    )
    table, _ = _from_one(table, "channel", None)
    century, year, month, day, hour, minute, second, fraction = (
        table[name].cast(pa.float64()).to_numpy() for name in OXTS_DATE
    )
    possible = (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31) & (century >= 1900) & (century <= 2100)
    months = ((century + year - 1970) * 12 + month - 1)[possible].astype(np.int64).astype("datetime64[M]")
    days = months.astype("datetime64[D]").astype(np.int64) + day[possible].astype(np.int64) - 1
    clock = (hour * 3600 + minute * 60 + second)[possible].astype(np.int64)
    hundredths = np.rint(100 * fraction[possible]).astype(np.int64)
    since_1970 = (days * 86_400 + clock) * SECOND + hundredths * (SECOND // 100)
    return table["time"].cast(pa.int64()).to_numpy()[possible], np.asarray(since_1970 - GPS_EPOCH, np.int64)
