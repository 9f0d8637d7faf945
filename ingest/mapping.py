"""From the project file's `[can.signals]` to places in the database, with the factor to the stored unit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..schemas.config import Can
from ..schemas.errors import InputError
from ..schemas.signals import SIGNALS
from ..schemas.units import factor, known_units
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
    """

    canonical: str
    message: str
    signal: str
    column: str
    unit: str
    factor: float
    channel: str | None
    source: int | None = None


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
        key = f"can.signals.{canonical}"
        message, signal = source.signal.split(".", 1)
        try:
            layout, found = database.find(message, signal, source.channel)
        except LookupError as error:
            problems.append(InputError(config_file, key, str(error.args[0])))
            continue
        stored = SIGNALS[canonical].unit
        scale = source.scale if source.scale is not None else factor(found.unit, stored)
        if scale is None:
            reason = (
                f"the database gives {source.signal} the unit {found.unit!r}, which is not known as a unit of {stored} "
                f"({', '.join(known_units(stored))} are); say what to multiply it by: "
                f'{canonical} = {{ signal = "{source.signal}", scale = … }}'
            )
            problems.append(InputError(config_file, key, reason))
            continue
        mapped[canonical] = MappedSignal(
            canonical, layout.name, signal, found.column, found.unit, scale * source.sign, source.channel, source.source
        )
    return mapped, problems
