"""What makes a recording doubtful as a whole: sources that are absent or do not belong together, stamps, signs."""

from __future__ import annotations

from collections.abc import Mapping

import pyarrow as pa

from ..schemas.errors import InputError
from ..schemas.project import Recording
from ..schemas.signals import SIGNALS
from ..schemas.times import iso_utc
from ..schemas.units import factor as unit_factor
from .clock import ClockEstimate
from .mapping import MappedSignal
from .signs import reversed_signals
from .stored_signals import Signal, StoredSignal

DAY = 86_400_000_000_000


LONGEST_RECORDING = 7 * DAY


def absent_sources(
    recording: Recording,
    mapping: Mapping[str, MappedSignal],
    stored: Mapping[str, StoredSignal],
    navigation: Mapping[str, Signal],
) -> list[InputError]:
    """Return a problem for each of the two sources, CAN and navigation, that a recording lacks."""
    problems = []
    if "x" not in navigation:
        reason = "no navigation with a valid position; without it there is no path, and no dataset, from this recording"
        if {"speed", "yaw_rate"} <= stored.keys():
            reason += ". The bus has speed and yaw rate: nav.dead_reckoning = true makes a path of them, which drifts"
        problems.append(InputError(recording.folder, "", reason))
    if not stored and mapping:
        reason = "no CAN log with a mapped signal; without it there is no steering, and no dataset, from this recording"
        problems.append(InputError(recording.folder, "", reason))
    return problems


def unknown_clock(
    recording: Recording, can: Mapping[str, Signal], navigation: Mapping[str, Signal], clock: ClockEstimate
) -> list[InputError]:
    """Return a problem where the clocks of CAN and navigation ought to have been aligned and could not be."""
    if clock.applied or not can or not navigation:
        return []
    reason = f"the CAN clock's offset could not be told, and its stamps stand as they are: {clock.reason}"
    return [InputError(recording.folder, "sync.clock", reason)]


def wrong_signs(
    recording: Recording,
    synced: pa.Table,
    mapping: Mapping[str, MappedSignal],
    stored: Mapping[str, StoredSignal],
    rate: float,
) -> list[InputError]:
    """Return a problem for each mapped signal that goes against navigation, with the line that mends it."""
    names = [name for name in synced.column_names if name in stored or name in ("nav_speed", "nav_yaw_rate")]
    signals = {name: synced[name].cast(pa.float64()).to_numpy() for name in names}
    problems = []
    for name, (what, correlation) in reversed_signals(signals, rate).items():
        mapped = mapping[name]
        sign = "1" if mapped.factor < 0 else "-1"
        scale = abs(mapped.factor)
        of_unit = unit_factor(mapped.unit, SIGNALS[name].unit)
        scaled = "" if of_unit == scale else f", scale = {scale!r}"
        reason = (
            f"{name} goes against {what} (correlation {correlation:.2f}): its sign is wrong. Write "
            f'{name} = {{ signal = "{mapped.message}.{mapped.signal}", sign = {sign}{scaled} }}'
        )
        problems.append(InputError(recording.folder, f"can.signals.{name}", reason))
    return problems


def no_overlap(
    recording: Recording, can: Mapping[str, StoredSignal], nav: Mapping[str, Signal], clock: ClockEstimate
) -> InputError | None:
    """Return a problem where CAN, brought to UTC, and navigation have no time in common."""
    if not can or not nav:
        return None
    shift = round(clock.offset_s * 1e9)
    can_start = min(signal.start for signal in can.values()) - shift
    can_stop = max(signal.stop for signal in can.values()) - shift
    nav_start = min(signal.start for signal in nav.values())
    nav_stop = max(signal.stop for signal in nav.values())
    if can_start < nav_stop and nav_start < can_stop:
        return None
    reason = (
        f"the CAN log ({iso_utc(can_start)} to {iso_utc(can_stop)}) and navigation ({iso_utc(nav_start)} to "
        f"{iso_utc(nav_stop)}) have no time in common; the logs of two drives may have been mixed up, or the CAN "
        "logger's clock is off: then give sync.clock its offset in seconds"
    )
    return InputError(recording.folder, "", reason)


def too_long(recording: Recording, can: Mapping[str, StoredSignal], nav: Mapping[str, Signal]) -> InputError | None:
    """Refuse stamps that no drive has: one frame stamped 1970 would ask for a grid of decades."""
    sources: tuple[tuple[str, Mapping[str, Signal]], ...] = (("the CAN log", can), ("navigation", nav))
    for source, signals in sources:
        start = min((signal.start for signal in signals.values()), default=0)
        stop = max((signal.stop for signal in signals.values()), default=0)
        if stop - start > LONGEST_RECORDING:
            reason = (
                f"{source} goes from {iso_utc(start)} to {iso_utc(stop)}, longer than a recording can be "
                f"({LONGEST_RECORDING // DAY} days); some stamps are broken, or several recordings lie in one folder: "
                "remove those records, or give each recording its folder"
            )
            return InputError(recording.folder, "", reason)
    return None
