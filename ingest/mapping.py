"""From the project file's `[can.signals]` and `[nav.can]` to places in the database, with the factor to the unit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from ..schemas.config import Can, CanSignal, Nav, NavSignal
from ..schemas.errors import InputError
from ..schemas.quantities import QUANTITIES
from ..schemas.signals import SIGNALS
from ..schemas.units import NANOSECONDS, factor, known_units
from .can.database import Database


@dataclass(frozen=True, slots=True)
class MappedSignal:
    """Where a canonical signal comes from.

    Attributes:
        canonical: Its canonical name.
        message: Name of the message in the merged database.
        signal: Name of the signal in the message.
        column: Its column in the signal file.
        unit: Unit as the database writes it.
        factor: What the decoded value is multiplied by: unit or scale, and sign.
        channel: The bus it is taken from; None: the one that carries most of it.
        source: J1939 address of the sender it is taken from; None: the one that sends most of it.
        valid: Column of the same message that is not 0 or, with a limit, below it where the signal counts.
    """

    canonical: str
    message: str
    signal: str
    column: str
    unit: str
    factor: float
    channel: str | None
    source: int | None = None
    valid: tuple[str, int | None] | None = None


_RECENT = "PositionAccuracyAge < 150"
OXTS_NAVIGATION = {
    "gps_time": NavSignal(signal="MilliTime.MilliTime"),
    "utc_offset": NavSignal(signal="MilliTime.UtcOffset"),
    "latitude": NavSignal(signal="LatitudeLongitude.PosLat"),
    "longitude": NavSignal(signal="LatitudeLongitude.PosLon"),
    "altitude": NavSignal(signal="Altitude.Altitude"),
    "velocity_north": NavSignal(signal="Velocity.VelNorth"),
    "velocity_east": NavSignal(signal="Velocity.VelEast"),
    "heading_clockwise": NavSignal(signal="HeadingPitchRoll.AngleHeading"),
    "nav_yaw_rate": NavSignal(signal="RateVehicle.AngRateZ", sign=-1),
    "nav_longitudinal_acceleration": NavSignal(signal="AccelLevel.AccelForward"),
    "nav_lateral_acceleration": NavSignal(signal="AccelLevel.AccelLateral", sign=-1),
    "position_accuracy_north": NavSignal(signal="StatusPositionAccuracy.AccuracyNorth", valid=_RECENT),
    "position_accuracy_east": NavSignal(signal="StatusPositionAccuracy.AccuracyEast", valid=_RECENT),
}
"""What `[nav.can]` is by default, as far as the database has it: the shipped `oxts`, or the DBC that NAVconfig exports,
which has the same names. Accelerations are those in level axes, free of gravity."""


def resolve(can: Can, database: Database, config_file: Path) -> tuple[dict[str, MappedSignal], list[InputError]]:
    """Look up every mapped signal.

    Args:
        can: The project file's `[can]`.
        database: All databases that loaded.
        config_file: Named in problems.

    Returns:
        The mapped signals by canonical name, and one problem for each that is not in the database or whose unit is
        unknown and has no `scale`; those are left out.
    """
    mapped: dict[str, MappedSignal] = {}
    problems: list[InputError] = []
    for canonical, source in can.signals.items():
        found = _look_up(canonical, source, database, SIGNALS[canonical].unit)
        if isinstance(found, str):
            problems.append(InputError(config_file, f"can.signals.{canonical}", found))
        else:
            mapped[canonical] = found
    return mapped, problems


def resolve_navigation(
    nav: Nav, database: Database, config_file: Path
) -> tuple[dict[str, MappedSignal], list[InputError]]:
    """Look up the signals that navigation is taken from: `[nav.can]`, or where it is empty those of an OxTS unit.

    Args:
        nav: The project file's `[nav]`.
        database: All databases that loaded.
        config_file: Named in problems.

    Returns:
        The mapped signals by quantity (`QUANTITIES`, `TIME_QUANTITIES`), the latter with a factor to s, and problems
        as of `resolve`.
    """
    mapped: dict[str, MappedSignal] = {}
    problems: list[InputError] = []
    sources = nav.can or OXTS_NAVIGATION
    for name, source in sources.items():
        stored = QUANTITIES[name].unit if name in QUANTITIES else "s"
        found = _look_up(name, source, database, stored)
        if not isinstance(found, str) and source.valid is not None:
            valid = f"{found.message}.{source.valid.split(' ')[0]}"
            there = _look_up(name, CanSignal(signal=valid, channel=source.channel), database, "")
            found = there if isinstance(there, str) else replace(found, valid=(there.column, _limit(source.valid)))
        if not isinstance(found, str):
            mapped[name] = found
        elif nav.can:
            problems.append(InputError(config_file, f"nav.can.{name}", found))
    return mapped, problems


def _limit(valid: str) -> int | None:
    _, _, limit = valid.partition(" < ")
    return int(limit) if limit else None


def _look_up(name: str, source: CanSignal, database: Database, stored: str) -> MappedSignal | str:
    """Return where a signal is, with the factor to the unit `stored`, or why there is none."""
    message, signal = source.signal.split(".", 1)
    try:
        layout, found = database.find(message, signal, source.channel)
    except LookupError as error:
        return str(error.args[0])
    unit = found.unit.strip().lower()
    of_unit = NANOSECONDS[unit] / 1e9 if stored == "s" and unit in NANOSECONDS else factor(found.unit, stored)
    scale = source.scale if source.scale is not None else of_unit
    if scale is None:
        known = NANOSECONDS if stored == "s" else known_units(stored)
        return (
            f"the database gives {source.signal} the unit {found.unit!r}, which is not known as a unit of {stored} "
            f"({', '.join(known)} are); say what to multiply it by: "
            f'{name} = {{ signal = "{source.signal}", scale = … }}'
        )
    return MappedSignal(
        name, layout.name, signal, found.column, found.unit, scale * source.sign, source.channel, source.source
    )
