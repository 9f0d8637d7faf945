"""The two lists of the review page, and what a page may ask to be changed in them."""

from __future__ import annotations

import getpass
import os
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from ...schemas.project import Project
from ...schemas.times import iso_utc
from ..events import DECISIONS, Event, read_events, write_events
from ..situations import VERDICTS, Situation, read_situations, write_situations
from .ledger import Change, Ledger, version_of

MS = 1_000_000
"""ns; the page and the files count in milliseconds."""
ADDED = "added"
"""Kind of an event that a person added; only such a one can be removed."""
LATEST = 9_000_000_000_000
"""ms UTC, in the year 2255."""

Row = TypeVar("Row", Event, Situation)


@dataclass(frozen=True, slots=True)
class Book(Generic[Row]):
    """One list of the page and the file that it stands in.

    Attributes:
        ledger: The file.
        label: Attribute that says what a row is: `kind` or `situation`.
        decisions: Undecided first, then that of a row that a person adds, then the other one.
    """

    ledger: Ledger[Row]
    label: str
    decisions: Sequence[str]


class Refusal(Exception):  # noqa: N818  the page shows it to the person who asked
    """What was asked for cannot be; the message says why."""


Milliseconds = Annotated[int, Field(ge=0, lt=LATEST)]
Text = Annotated[str, Field(max_length=2000)]


class Fields(BaseModel):
    """What a page may set of a row; what is None stays as it is."""

    model_config = ConfigDict(extra="forbid", strict=True)

    start: Milliseconds | None = None
    stop: Milliseconds | None = None
    decision: str | None = None
    note: Text | None = None


class Addition(BaseModel):
    """A row that a person adds; `recording` is the number under which the page knows it."""

    model_config = ConfigDict(extra="forbid", strict=True)

    recording: int
    start: Milliseconds
    stop: Milliseconds
    label: Text = ""


class Wish(BaseModel):
    """One change as a page asks for it: `add`, `set` or `remove` a row, or take the change `undo` back."""

    model_config = ConfigDict(extra="forbid", strict=True)

    key: Annotated[str, Field(min_length=8, max_length=64)]
    book: Literal["events", "situations"]
    by: Annotated[str, Field(min_length=1, max_length=200)]
    number: int | None = None
    version: str | None = None
    add: Addition | None = None
    set: Fields | None = None
    remove: bool = False
    undo: str | None = None


def books_of(project: Project) -> dict[str, Book[Any]]:
    """Return the lists by the names that the page calls them."""
    events = Ledger(
        project.events_file,
        lambda path: [
            # As it is written, so that a row has the same version before and after another one was changed.
            replace(e, start=e.start // MS * MS, stop=e.stop // MS * MS, severity=round(e.severity, 3))
            for e in read_events(path)
        ],
        write_events,
    )
    situations = Ledger(project.situations_file, read_situations, write_situations)
    return {
        "events": Book(events, "kind", DECISIONS),
        "situations": Book(situations, "situation", VERDICTS),
    }


def fulfil(wish: Wish, book: Book[Any], recordings: Sequence[str], labels: Sequence[str]) -> Change[Any]:
    """Make the change, publish the file, and return what it was.

    Args:
        wish: What is asked for.
        book: The list that it concerns.
        recordings: Names by number.
        labels: What a person may add to this list.

    Raises:
        Refusal: It is against the rules.
        Conflict: The row has been changed meanwhile.
        InputError: The file is wrong.
    """
    if wish.undo is not None:
        try:
            return book.ledger.reverse(wish.key, wish.undo)
        except KeyError:
            raise Refusal(
                "this change was made in an earlier run of `wheelprint review` and cannot be taken back"
            ) from None
    if wish.add is not None:
        row = _added(wish.add, wish.by, book, recordings, labels)
        return book.ledger.put(wish.key, None, None, lambda _: row)
    if wish.number is None or (wish.set is None) is not wish.remove:
        raise Refusal("expected one of: add, set or remove with a number, undo")
    return book.ledger.put(wish.key, wish.number, wish.version, lambda row: _edited(row, wish, book))


def _added(addition: Addition, by: str, book: Book[Any], recordings: Sequence[str], labels: Sequence[str]) -> Any:
    if not 0 <= addition.recording < len(recordings):
        raise Refusal(f"there is no recording of number {addition.recording}")
    if addition.label not in labels:
        raise Refusal(f"expected one of {', '.join(labels)}, found {addition.label!r}")
    _check(addition.start, addition.stop)
    where = (recordings[addition.recording], addition.start * MS, addition.stop * MS)
    now = iso_utc(time.time_ns())
    if book.label == "kind":
        return Event(*where, addition.label, 0.0, "emergency", by, "", now)
    return Situation(*where, addition.label, "confirmed", by, now, "")


def _edited(row: Any, wish: Wish, book: Book[Any]) -> Any:
    """Return the row as it is wished, with who and when, unless nobody has decided about it; None to remove it."""
    undecided = book.decisions[0]
    is_addition = book.label == "kind" and row.kind == ADDED
    if wish.set is None:
        if row.decided_by != wish.by or not (is_addition or (book.label != "kind" and row.decision == "confirmed")):
            raise Refusal("only what you added yourself can be removed; decide about it instead")
        return None
    asked = wish.set.model_dump(exclude_none=True)
    asked |= {edge: asked[edge] * MS for edge in ("start", "stop") if edge in asked}
    if asked.get("decision", undecided) not in book.decisions:
        raise Refusal(f"expected one of {', '.join(book.decisions)}, found {asked['decision']!r}")
    edited = replace(row, **asked)
    _check(edited.start, edited.stop)
    if edited.decision == undecided:
        if is_addition:
            raise Refusal("what a person added cannot be undecided: the next build would drop it; remove it instead")
        return replace(edited, decided_by="", decided_at="")
    return replace(edited, decided_by=wish.by, decided_at=iso_utc(time.time_ns()))


def _check(start: int, stop: int) -> None:
    if start >= stop:
        raise Refusal("the stop must come after the start")


def as_json(number: int, row: Any, book: Book[Any], recording: int) -> dict[str, Any]:
    """Return a row as the page knows it; times in ms UTC, the recording by its number."""
    return {
        "number": number,
        "version": version_of(row),
        "recording": recording,
        "start": row.start // MS,
        "stop": row.stop // MS,
        "label": getattr(row, book.label),
        "severity": getattr(row, "severity", None),
        "decision": row.decision,
        "by": row.decided_by,
        "at": row.decided_at,
        "note": row.note,
        "limits": limits_in(row.note),
    }


def limits_in(note: str) -> dict[str, float]:
    """Return the threshold that each signal of a proposal's note was compared with, on the side of the peak."""
    found = re.findall(r"(\w+) (-?)[\d.e+-]+ \S+ \(threshold ([\d.e+-]+)\)", note)
    return {signal: float(sign + threshold) for signal, sign, threshold in found}


def user_name() -> str:
    """Return the name that this machine knows the person by."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return f"user {os.getuid()}"
