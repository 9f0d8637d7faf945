"""CAN databases as plain data: what a message carries, where in its payload, and in which unit."""

from __future__ import annotations

import difflib
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

from ...schemas import databases
from ...schemas.config import DatabaseFile
from ...schemas.errors import InputError
from .database_limits import refuse_monsters
from .layout_checks import complaints, tolerated
from .matching import identity
from .repair import Repair, decode_text, repair_dbc, tell_cut

SUFFIXES = (".dbc", ".kcd", ".sym", ".arxml")

FRAME_COLUMNS = frozenset({"time", "channel", "source", "destination"})
"""Columns of a decoded message that are its frames' own."""


@dataclass(frozen=True, slots=True)
class SignalLayout:
    """One signal of a message: physical value = raw value × `scale` + `offset`.

    Attributes:
        name: Name in the database.
        start: Bit number 8 × byte + bit within the byte (0 the least significant), as in a DBC: of the least
            significant bit of a little-endian signal, of the most significant bit of a big-endian one.
        length: Number of bits.
        big_endian: Motorola byte order, else Intel.
        signed: Two's complement.
        is_float: The raw value is an IEEE 754 number of 16, 32 or 64 bits.
        scale: An int only where scale, offset and raw value are integers and so is the physical value, or where the
            database writes one.
        offset: See `scale`.
        unit: As the database writes it, empty where it has none.
        description: The database's comment.
        choices: Raw values with their names, in the database's order.
        multiplexer: Signal of the same message that selects this one, None where it is always there.
        multiplexer_values: Raw values of the multiplexer, as unsigned numbers, that select this signal, ascending.
    """

    name: str
    start: int
    length: int
    big_endian: bool = False
    signed: bool = False
    is_float: bool = False
    scale: float = 1
    offset: float = 0
    unit: str = ""
    description: str = ""
    choices: tuple[tuple[int, str], ...] = ()
    multiplexer: str | None = None
    multiplexer_values: tuple[int, ...] = ()

    @property
    def first_bit(self) -> int:
        """Place in the payload's bits: counted from each byte's least (big-endian: most) significant one."""
        return self.start ^ 7 if self.big_endian else self.start

    @property
    def column(self) -> str:
        """Name of the signal's column; one that is taken by a frame's own gets an underscore."""
        return f"{self.name}_" if self.name in FRAME_COLUMNS else self.name


@dataclass(frozen=True, slots=True)
class MessageLayout:
    """One message.

    Attributes:
        name: Name in the database; where databases of several buses have it, with the bus: `STEER@can1`.
        id: Identifier.
        extended: The identifier has 29 bits.
        length: Payload bytes that the database states.
        description: The database's comment.
        signals: In the database's order.
        source: The database it is from, as the project names it.
        channel: The only bus whose frames it stands for; None: all.
        j1939: Frames are found by parameter group, whatever their priority and source address are.
    """

    name: str
    id: int
    extended: bool
    length: int
    description: str
    signals: tuple[SignalLayout, ...]
    source: str = ""
    channel: str | None = None
    j1939: bool = False

    @property
    def label(self) -> str:
        """Name and identifier as they are written to a user: `STEER (0x11F)`."""
        return f"{self.name} (0x{self.id:08X})" if self.extended else f"{self.name} (0x{self.id:03X})"


@dataclass(frozen=True)
class Database:
    """The messages of one or several databases.

    Attributes:
        messages: No two have the same name, nor, on one bus, the same identifier.
        repairs: What was put right in the files.
    """

    messages: tuple[MessageLayout, ...] = ()
    repairs: tuple[Repair, ...] = field(default=(), compare=False)

    @cached_property
    def by_name(self) -> dict[str, MessageLayout]:
        """Messages by their name."""
        return {message.name: message for message in self.messages}

    def find(self, message: str, signal: str, channel: str | None = None) -> tuple[MessageLayout, SignalLayout]:
        """Return a message and one of its signals.

        Args:
            message: Name of the message.
            signal: Name of the signal.
            channel: The bus, where databases of several have the message.

        Raises:
            LookupError: There is no such message or signal; the text names similar ones and where the signal is.
        """
        layout = self.by_name.get(f"{message}@{channel}", self.by_name.get(message))
        if layout is None and (buses := [str(m.channel) for m in self.messages if m.name == f"{message}@{m.channel}"]):
            known = f"message {message} is in the databases of channels {_enumerate(buses)}"
            raise LookupError(
                f"{known}, not of {channel}" if channel else f'{known}; say which: channel = "{buses[0]}"'
            )
        if layout is not None and channel is not None and layout.channel not in (None, channel):
            raise LookupError(
                f"message {layout.label} is in the database of channel {layout.channel}, not of {channel}"
            )
        having = [m.name for m in self.messages if signal.casefold() in {s.name.casefold() for s in m.signals}]
        if layout is None:
            fact, near = f"the database has no message {message}", _near(message, self.by_name)
            known = f"The messages are {_enumerate(self.by_name)}" if self.messages else "It has no messages at all"
        else:
            names = [s.name for s in layout.signals]
            if signal in names:
                return layout, layout.signals[names.index(signal)]
            fact, near = f"message {layout.label} has no signal {signal}", _near(signal, names)
            known = f"Its signals are {_enumerate(names)}" if names else "It has no signals at all"
        fact += f"; did you mean {near}?" if near else "."
        if others := [name for name in having if name != message]:
            known = f"A signal {signal} is in {_enumerate(others)}"
        elif near:
            raise LookupError(fact)
        raise LookupError(f"{fact} {known}")


def shipped_databases() -> tuple[str, ...]:
    """Return the names of the databases that come with Wheelprint."""
    return tuple(
        sorted(file.name[: -len(".dbc")] for file in resources.files(databases).iterdir() if file.name.endswith(".dbc"))
    )


def load_database(names: Sequence[str | DatabaseFile], base: Path) -> Database:
    """Load databases and merge them.

    Args:
        names: Shipped names (`byd_tang`) or paths of DBC, KCD, SYM or ARXML files, or what the project file says of
            them.
        base: The folder that relative paths start from.

    Raises:
        InputError: The first of what `load_databases` complains of.
    """
    database, problems = load_databases(names, base)
    if problems:
        raise problems[0]
    return database


def load_databases(names: Sequence[str | DatabaseFile], base: Path) -> tuple[Database, list[InputError]]:
    """Load and merge what can be; return it with a complaint about everything that cannot.

    Of messages with the same name or identifier on one bus the first is kept.

    Args:
        names: See `load_database`.
        base: See `load_database`.
    """
    problems: list[InputError] = []
    repairs: list[Repair] = []
    kept: list[MessageLayout] = []
    taken: dict[Any, list[MessageLayout]] = defaultdict(list)
    for file in dict.fromkeys(DatabaseFile(file=name) if isinstance(name, str) else name for name in names):
        collisions: dict[str, list[str]] = defaultdict(list)
        try:
            messages = _load(file, base, problems, repairs)
        except InputError as error:
            problems.append(error)
            continue
        for message in messages:
            keys = (message.name, identity(message))
            earlier = next((m for key in keys for m in taken[key] if _share_a_bus(m, message)), None)
            if earlier is None:
                kept.append(message)
                for key in keys:
                    taken[key].append(message)
            else:
                collisions[earlier.source].append(
                    message.label if earlier.label == message.label else f"{message.label} against {earlier.label}"
                )
        for source, labels in collisions.items():
            where = "twice in this database" if source == _source(file) else f"in this database and in {source}"
            reason = (
                f"same message name or identifier {where}: {', '.join(labels)}. Which one a frame is cannot be known; "
                "remove one of each pair"
            )
            problems.append(InputError(_place(file.file, base), "", reason))
    # Two of one name are of two buses; what is stored of them must not be mixed.
    merged = tuple(replace(m, name=f"{m.name}@{m.channel}") if len(taken[m.name]) > 1 else m for m in kept)
    return Database(merged, tuple(repairs)), problems


def _share_a_bus(one: MessageLayout, other: MessageLayout) -> bool:
    return one.channel is None or other.channel is None or one.channel == other.channel


def _source(file: DatabaseFile) -> str:
    return f"{file.file} on {file.channel}" if file.channel else file.file


def _place(name: str, base: Path) -> str:
    return name if name in shipped_databases() else str(base / name)


def _load(file: DatabaseFile, base: Path, problems: list[InputError], repairs: list[Repair]) -> list[MessageLayout]:
    """Return the messages of one database; what is wrong with single messages goes to `problems`."""
    name = file.file
    if name in shipped_databases():
        path, content = Path(name), (resources.files(databases) / f"{name}.dbc").read_bytes()
        kind = "dbc"
    else:
        path = base / name
        kind = path.suffix.lower().removeprefix(".")
        content = _read(path, name)
    text, repaired = decode_text(path, content)
    repaired += tell_cut(path, text, kind)
    if kind == "dbc":
        text, mended = repair_dbc(path, text)
        repaired += mended
    refuse_monsters(path, text, kind)
    repairs += repaired
    loaded = _parse(path, text, kind)
    lines = {
        int(match[1]): text.count("\n", 0, match.start(1)) + 1
        for match in re.finditer(r"^[ \t]*BO_\s+(\d{1,10})\s", text if kind == "dbc" else "", re.MULTILINE)
    }
    if not loaded.messages:
        reason = "holds no messages; it is empty, cut off, or not the file that was meant. Export it again"
        raise InputError(path, "", reason)
    layouts = []
    for message in loaded.messages:
        layout = replace(
            _message_layout(message, _source(file)),
            channel=file.channel,
            j1939=bool(message.is_extended_frame) and _is_j1939(message, loaded.dbc, file.j1939),
        )
        if wrong := complaints(layout):
            problems.append(InputError(path, f"message {layout.label}", f"{'; '.join(wrong)}. It is left out"))
        else:
            layouts.append(layout)
            repairs += tolerated(path, layout, lines)
    return layouts


def _parse(path: Path, text: str, kind: str) -> Any:
    import cantools

    try:
        return cantools.database.load_string(text, kind, strict=False, sort_signals=None)
    except cantools.database.UnsupportedDatabaseFormatError as error:
        said = re.sub(r'^[A-Z]+: "(.*)"$', r"\1", str(error), flags=re.DOTALL)
        line = re.search(r"line (\d+)", said)
        reason = f"cantools cannot read this {kind.upper()} file: {said}. Correct the file there, or export it again"
        raise InputError(path, f"line {line[1]}" if line else "", reason) from None


def _is_j1939(message: Any, dbc: Any, said: bool | None) -> bool:
    """Tell whether the project or, where it is silent, the DBC says that a message of 29 bits is J1939's.

    `VFrameFormat` says so of a message, `ProtocolType` of all those whose format the DBC does not write.
    """
    if said is not None:
        return said
    if message.protocol == "j1939":
        return True
    if dbc is None or (message.dbc is not None and "VFrameFormat" in message.dbc.attributes):
        return False
    definition, attribute = dbc.attribute_definitions.get("ProtocolType"), dbc.attributes.get("ProtocolType")
    protocol = attribute.value if attribute is not None else definition.default_value if definition is not None else ""
    if isinstance(protocol, int) and definition is not None and protocol < len(definition.choices or ()):
        protocol = definition.choices[protocol]
    return "J1939" in str(protocol).upper()


def _read(path: Path, name: str) -> bytes:
    shipped = shipped_databases()
    if path.suffix.lower() not in SUFFIXES:
        near = _near(name, shipped)
        reason = (
            f"neither a shipped database ({', '.join(shipped)}) nor a path that ends in {', '.join(SUFFIXES)}"
            f"{f'; did you mean {near}?' if near else ''}"
        )
        raise InputError(path, "", reason)
    try:
        return path.read_bytes()
    except FileNotFoundError:
        beside = [file.name for file in path.parent.glob("*") if file.suffix.lower() in SUFFIXES]
        near = _near(path.name, [*beside, *shipped])
        reason = (
            f"no such file{f'; did you mean {near}?' if near else '.'} "
            f"A database is a shipped name ({', '.join(shipped)}) or the path of a file"
        )
        raise InputError(path, "", reason) from None
    except OSError as error:
        raise InputError(path, "", f"cannot be read: {error.strerror}") from None


def _message_layout(message: Any, source: str) -> MessageLayout:
    return MessageLayout(
        name=message.name,
        id=message.frame_id,
        extended=message.is_extended_frame,
        length=message.length,
        description=message.comment or "",
        signals=tuple(_signal_layout(signal) for signal in message.signals),
        source=source,
    )


def _signal_layout(signal: Any) -> SignalLayout:
    conversion = signal.conversion
    scale, offset = conversion.scale, conversion.offset
    if not conversion.is_float and all(isinstance(number, int) or number.is_integer() for number in (scale, offset)):
        scale, offset = int(scale), int(offset)
    return SignalLayout(
        name=signal.name,
        start=signal.start,
        length=signal.length,
        big_endian=signal.byte_order == "big_endian",
        signed=signal.is_signed,
        is_float=conversion.is_float,
        scale=scale,
        offset=offset,
        unit=signal.unit or "",
        description=signal.comment or "",
        choices=tuple((int(value), str(text)) for value, text in (conversion.choices or {}).items()),
        multiplexer=signal.multiplexer_signal if signal.multiplexer_ids is not None else None,
        multiplexer_values=tuple(sorted(signal.multiplexer_ids or ())),
    )


def _near(name: str, known: Iterable[str]) -> str:
    """Return what may have been meant, empty where nothing is like it."""
    folded = {candidate.casefold(): candidate for candidate in known}
    near = difflib.get_close_matches(name.casefold(), folded, n=3)
    return _enumerate((folded[key] for key in near), "or") if near else ""


def _enumerate(names: Iterable[str], last: str = "and") -> str:
    *head, tail = names
    return f"{', '.join(head)} {last} {tail}" if head else tail
