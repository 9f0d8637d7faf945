"""Repair of DBC text that other tools accept and cantools refuses, and refusal of text that is cut off.

Repairs never move a line, so places in later complaints hold.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from pathlib import Path

from ...schemas.errors import InputError
from .dbc_statements import CLOSED, KEYWORDS, OPEN, UNKNOWN, Statement, statements_of, tokens_of

_EXTENDED = 1 << 31  # the flag of 29-bit identifiers in a DBC
_LARGEST_STANDARD, _LARGEST_EXTENDED = 0x7FF, 0x1FFF_FFFF
_NO_NODE = "Vector__XXX"
_UNASSIGNED = "VECTOR__INDEPENDENT_SIG_MSG"  # holds signals of no message, under an identifier of its own


@dataclass(frozen=True, slots=True)
class Repair:
    """Something in a database that was put right.

    Attributes:
        path: The file.
        where: `line 17`, or empty for the file as a whole.
        found: What is wrong there.
        done: What was done about it.
    """

    path: str
    where: str
    found: str
    done: str

    def __str__(self) -> str:
        return f"{self.path}: {self.where}: {self.found}; {self.done}".replace(": : ", ": ")


def decode_text(path: Path, content: bytes) -> tuple[str, list[Repair]]:
    """Return a database file as text whose lines end in line feeds.

    UTF-8, with or without a byte order mark, is what a database should be; UTF-16 shows by its mark; other text is
    taken as Windows-1252 and, where a byte has no meaning there, as Latin-1.
    """
    repairs = []
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = content.decode("utf-16", "replace")
        repairs.append(Repair(str(path), "", "UTF-16 text", "read as such"))
    else:
        if content.startswith(b"\xef\xbb\xbf"):
            repairs.append(Repair(str(path), "line 1", "a byte order mark", "skipped"))
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            line = content.count(b"\n", 0, error.start) + 1
            found = f"byte 0x{content[error.start]:02X}, which is not UTF-8"
            try:
                text, encoding = content.decode("cp1252"), "Windows-1252"
            except UnicodeDecodeError:
                text, encoding = content.decode("latin-1"), "Latin-1"
            repairs.append(Repair(str(path), f"line {line}", found, f"the file is read as {encoding}"))
    text = text.replace("\r\n", "\n")
    if "\r" in text:
        line = text.count("\n", 0, text.index("\r")) + 1
        found = f"{text.count(chr(13))} carriage returns without line feed, here the first"
        repairs.append(Repair(str(path), f"line {line}", found, "each ends a line"))
        text = text.replace("\r", "\n")
    return text, repairs


def tell_cut(path: Path, text: str, kind: str) -> list[Repair]:
    """Tell what looks as if a DBC or SYM file had been cut off behind a whole statement, where nothing else shows it.

    KCD and ARXML are XML, which is whole or none.
    """
    if kind not in {"dbc", "sym"}:
        return []
    signs = []
    if not text.endswith("\n"):
        signs.append("the last line has no line end")
    ends_within_message = (
        r"\n[ \t]*BO_\s[^\n]*\s*\Z" if kind == "dbc" else r"\n\[[^\]\n]*\]?(?:(?!\n(?:Sig|Mux)=)[^\[])*\Z"
    )
    if re.search(ends_within_message, text):
        signs.append("the last message has no signals")
    done = "what is there was taken; compare it with the file it was copied from"
    line = f"line {text.count(chr(10), 0, len(text.rstrip())) + 1}"
    return [Repair(str(path), line, f"{sign}, as where a file was cut off", done) for sign in signs]


def repair_dbc(path: Path, text: str) -> tuple[str, list[Repair]]:
    """Repair the text of a DBC.

    Args:
        path: Named in repairs and errors.
        text: The file, as `decode_text` returns it.

    Returns:
        Text with the same lines, and what was repaired in it, by line.

    Raises:
        InputError: The text ends within a statement.
    """
    editing = _Editing(path, text)
    statements = _statements(editing)
    _refuse_cut(editing, statements)
    _close_statements(editing, statements)
    messages = _repair_messages(editing, statements)
    tables = {s.text(1): text[s.tokens[2].start : s.tokens[-2].stop] for s in statements
              if s.keyword == "VAL_TABLE_" and s.closed and len(s.tokens) > 4}  # fmt: skip
    for statement in statements:
        _insert_table(editing, statement, tables)
        _repair_numbers(editing, statement)
        _repair_references(editing, statement, messages)
    return editing.result()


@dataclass(slots=True)
class _Editing:
    """A text and the changes to it."""

    path: Path
    text: str
    edits: dict[int, tuple[int, str]] = field(default_factory=dict)
    repairs: list[tuple[int, Repair]] = field(default_factory=list)

    def line(self, place: int) -> int:
        return self.text.count("\n", 0, place) + 1

    def replace(self, start: int, stop: int, new: str) -> None:
        """Put `new` in the place of what is there, whose line ends are kept."""
        self.edits[start] = (stop, new + "\n" * self.text.count("\n", start, stop))

    def report(self, place: int, found: str, done: str) -> None:
        line = self.line(place)
        self.repairs.append((line, Repair(str(self.path), f"line {line}", found, done)))

    def drop(self, statement: Statement, found: str) -> None:
        self.replace(statement.start, statement.stop, " ")
        self.report(statement.start, found, "left out")

    def result(self) -> tuple[str, list[Repair]]:
        parts, place = [], 0
        for start, (stop, new) in sorted(self.edits.items()):
            if start >= place:  # what lies within something left out is gone already
                parts += [self.text[place:start], new]
                place = stop
        self.repairs.sort(key=lambda repair: repair[0])
        return "".join([*parts, self.text[place:]]), [repair for _, repair in self.repairs]


def _statements(editing: _Editing) -> list[Statement]:
    """Return the statements; comments are taken out of the text."""
    tokens = []
    for token in tokens_of(editing.text):
        if token.kind == "comment":
            editing.replace(token.start, token.stop, " ")
            editing.report(token.start, f"a comment: {_shortened(token.text)}", "skipped")
        elif token.kind == "rest" and token.text in "\0\x1a":
            editing.replace(token.start, token.stop, " ")
            editing.report(token.start, f"the control character 0x{ord(token.text):02X}", "skipped")
        else:
            tokens.append(token)
    return statements_of(tokens, editing.text)


def _shortened(text: str, length: int = 40) -> str:
    line = " ".join(text.split())
    return line if len(line) <= length else f"{line[:length]}…"


def _refuse_cut(editing: _Editing, statements: Sequence[Statement]) -> None:
    """Refuse a text that ends within its last statement."""
    for statement in statements:
        quote = next((token for token in statement.tokens if token.text == '"'), None)
        if quote is not None:
            reason = (
                f"the text that begins here has no closing quotation mark: {_shortened(editing.text[quote.start :])} "
                "The file is cut off there, or the mark is missing; copy or export it again"
            )
            raise InputError(editing.path, f"line {editing.line(quote.start)}", reason)
    if not statements:
        return
    last, keyword = statements[-1], statements[-1].keyword
    if keyword in OPEN:
        is_cut = _lacks_its_end(last)
        if not is_cut and keyword in ("BO_", "SG_") and not editing.text.endswith(("\n", ";")):
            # A name may be cut as well; one that stands elsewhere too is whole.
            name = last.tokens[-1]
            elsewhere = {token.text for statement in statements for token in statement.tokens if token is not name}
            is_cut = name.text not in elsewhere | {_NO_NODE}
    elif keyword in KEYWORDS:
        is_cut = not last.closed
    else:
        is_cut = len(last.tokens) == 1 and any(known.startswith(keyword) for known in KEYWORDS)
    if is_cut:
        reason = (
            f"the file ends within the statement that begins here: "
            f"{_shortened(editing.text[last.start : last.stop])} It is cut off; copy or export it again"
        )
        raise InputError(editing.path, f"line {editing.line(last.start)}", reason)


def _lacks_its_end(statement: Statement) -> bool:
    """Tell whether a statement without a semicolon is right as far as it goes, and goes not far enough."""
    kinds: dict[str, list[tuple[str, ...]]] = {
        "VERSION": [("string",)],
        "NS_": [(":",)],
        "BS_": [(":",)],
        "BU_": [(":",)],
        "BO_": [("number", "word", ":", "number", "word")],
        "SG_": [
            (
                *("word", *multiplexing, ":", "number", "|", "number", "@", "number", sign),
                *("(", "number", ",", "number", ")", "[", "number", "|", "number", "]", "string", "word"),
            )
            for multiplexing in ((), ("word",))
            for sign in "+-"
        ],
    }
    present = len(statement.tokens) - 1
    return statement.tokens[-1].text == "," or any(
        present < len(kind) and statement.is_like(*kind[:present]) for kind in kinds[statement.keyword]
    )


def _close_statements(editing: _Editing, statements: Sequence[Statement]) -> None:
    """Put right how statements begin and end."""
    for statement in statements:
        keyword = statement.keyword
        if keyword in UNKNOWN:
            editing.drop(statement, f"a statement {keyword}, which does not matter for decoding")
        elif keyword in CLOSED and not statement.closed:
            editing.replace(statement.stop, statement.stop, ";")
            editing.report(statement.start, f"no semicolon after a statement {keyword}", "added")
        elif keyword == "BS_" and len(statement.tokens) > 2:
            editing.replace(statement.tokens[2].start, statement.stop, " ")
            editing.report(statement.start, "a bit timing", "left out")
        elif keyword in ("BO_", "SG_") and statement.closed:
            editing.replace(statement.stop - 1, statement.stop, " ")
            editing.report(statement.start, f"a semicolon after a statement {keyword}", "left out")


def _repair_messages(editing: _Editing, statements: Sequence[Statement]) -> dict[int, set[str]]:
    """Repair messages and signals.

    Returns:
        By identifier as the DBC should write it, the names of the message's signals.
    """
    messages: dict[int, set[str]] = {}
    contents: set[tuple[str, ...]] = set()
    blocks: list[list[Statement]] = []
    for keyword, group in groupby(statements, lambda s: s.keyword):
        if keyword == "BO_":
            blocks += [[statement] for statement in group]
        elif keyword == "SG_" and blocks:
            blocks[-1] += group
    for block in blocks:
        head, *signals = block
        identifier, name = _identifier(head.text(1)), head.text(2)
        if identifier is None or not head.is_like("number", "word", ":", "number"):
            continue
        content = tuple(token.text for statement in block for token in statement.tokens)
        if content in contents:
            for statement in block:
                editing.replace(statement.start, statement.stop, " ")
            editing.report(head.start, f"message {name} once more, the same", "left out")
            continue
        contents.add(content)
        proper = _proper(identifier)
        if name == _UNASSIGNED:
            continue
        if proper is None:
            for statement in block:
                editing.replace(statement.start, statement.stop, " ")
            editing.report(head.start, f"message {name} with the identifier {identifier}, which has more than 29 bits",
                           "left out")  # fmt: skip
            continue
        if proper != identifier:
            found = (
                f"message {name} with the identifier {identifier} (0x{identifier:X}) of more than 11 bits without the"
            )
            editing.report(head.start, f"{found} extended flag", f"taken as extended, {proper}")
        if len(head.tokens) == 5:
            editing.replace(head.stop, head.stop, f" {_NO_NODE}")
            editing.report(head.start, f"message {name} without a sender", f"{_NO_NODE} added")
        for signal in signals:
            _repair_receivers(editing, signal)
        messages.setdefault(proper, set()).update(signal.text(1) for signal in signals)
    return messages


def _identifier(text: str) -> int | None:
    return int(text) if text.isdecimal() and len(text) <= 10 else None


def _proper(identifier: int) -> int | None:
    """Return an identifier with the extended flag where it needs one; None where it has too many bits."""
    if identifier <= _LARGEST_STANDARD:
        return identifier
    bare = identifier & ~_EXTENDED
    return bare | _EXTENDED if bare <= _LARGEST_EXTENDED and identifier < 2 * _EXTENDED else None


def _repair_receivers(editing: _Editing, signal: Statement) -> None:
    """Write receivers with commas between them; there must be one."""
    end = next((place for place, token in enumerate(signal.tokens) if token.kind == "string"), None)
    if end is None:
        return
    receivers = [token for token in signal.tokens[end + 1 :] if token.text != ";"]
    names = [token.text for token in receivers if token.kind != "rest"]
    if "\n" in editing.text[signal.tokens[end].stop : signal.stop]:
        return  # what stands in the next line is something else
    if not names:
        editing.replace(signal.tokens[end].stop, signal.tokens[-1].stop, f" {_NO_NODE}")
        editing.report(signal.start, f"signal {signal.text(1)} without a receiver", f"{_NO_NODE} added")
    elif [token.text for token in receivers] != list(",".join(names).replace(",", "\0,\0").split("\0")):
        editing.replace(receivers[0].start, receivers[-1].stop, ",".join(names))
        editing.report(signal.start, f"receivers of signal {signal.text(1)} without commas between them", "put there")


def _repair_numbers(editing: _Editing, statement: Statement) -> None:
    """Write numbers with digits on both sides of the point, and raw values as integers."""
    if statement.keyword in ("VAL_", "VAL_TABLE_"):
        _repair_values(editing, statement)
        return
    for token in statement.tokens:
        if token.kind == "number" and re.search(r"(?<!\d)\.|\.(?!\d)", token.text):
            new = re.sub(r"\.(?!\d)", ".0", re.sub(r"(?<!\d)\.", "0.", token.text))
            editing.replace(token.start, token.stop, new)
            editing.report(token.start, f"the number {token.text}", f"read as {new}")


def _insert_table(editing: _Editing, statement: Statement, tables: Mapping[str, str]) -> None:
    """Write the values of a table where a signal's values are given by its name."""
    if statement.keyword == "VAL_" and statement.is_like("number", "word", "word"):
        name = statement.tokens[3]
        if name.text in tables:
            editing.replace(name.start, name.stop, " ".join(tables[name.text].split("\n")))
            editing.report(name.start, f"values given as the table {name.text}", "its values put there")
        else:
            editing.drop(statement, f"values given as the table {name.text}, which the file does not define")


_REFERENCES = {
    "VAL_": (1, 2), "SIG_VALTYPE_": (1, 2), "SG_MUL_VAL_": (1, 2), "SIG_GROUP_": (1, None), "BO_TX_BU_": (1, None),
}  # fmt: skip
"""Places of the message's identifier and the signal's name."""


def _repair_references(editing: _Editing, statement: Statement, messages: Mapping[int, set[str]]) -> None:
    """Give identifiers their flag, and leave out what is said about messages and signals that are not there."""
    keyword = statement.keyword
    place, signal = _REFERENCES.get(keyword, (0, None))
    if keyword == "BO_":
        place = 1
    elif keyword in ("CM_", "BA_", "BA_REL_"):
        place = 1 + next((k for k, token in enumerate(statement.tokens) if token.text in ("BO_", "SG_")), -1)
        if keyword == "BA_REL_" and statement.text(2) == "BU_BO_REL_":
            place = 4
    identifier = _identifier(statement.text(place))
    proper = None if identifier is None else _proper(identifier)
    if place == 0 or identifier is None:
        return
    token = statement.tokens[place]
    if keyword in ("VAL_", "SIG_VALTYPE_", "SG_MUL_VAL_") and signal is not None:
        name = statement.text(signal)
        if proper is None or name not in messages.get(proper, ()):
            what = f"signal {name}" if proper in messages else f"a message {token.text}"
            editing.drop(statement, f"a statement {keyword} about {what}, which the file does not define")
            return
        if keyword == "SIG_VALTYPE_" and statement.text(3) != ":":
            editing.replace(statement.tokens[2].stop, statement.tokens[2].stop, " :")
            editing.report(statement.start, "a statement SIG_VALTYPE_ without a colon", "added")
    if proper not in (None, identifier):
        editing.replace(token.start, token.stop, str(proper))


def _repair_values(editing: _Editing, statement: Statement) -> None:
    for token, text in pairwise(statement.tokens[2:]):
        if token.kind != "number" or text.kind != "string" or re.fullmatch(r"[-+]?\d+", token.text):
            continue
        value = float(token.text)
        if value.is_integer():
            editing.replace(token.start, token.stop, str(int(value)))
            editing.report(token.start, f"the value {token.text}, which is not written as an integer",
                           f"read as {int(value)}")  # fmt: skip
        else:
            editing.replace(token.start, text.stop, " ")
            editing.report(token.start, f"the value {token.text}, which no raw value is", "left out")
