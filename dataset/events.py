"""`events.csv`: stretches of a recording that are no ordinary driving, and what a person decided about them."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from ..schemas.errors import InputError
from ..schemas.store import publish_text
from ..schemas.tables import EVENT_COLUMNS
from ..schemas.times import iso_utc

Decision = Literal["proposed", "emergency", "normal"]
DECISIONS: tuple[Decision, ...] = get_args(Decision)

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_EXAMPLE = "2026-11-23T08:00:00.100Z"


@dataclass(frozen=True, slots=True, order=True)
class Event:
    """A stretch of a recording, half-open: its rows have `start <= time < stop`.

    Attributes:
        recording: `driver/recording`.
        start: ns UTC.
        stop: ns UTC, after `start`.
        kind: What was detected (`hard_braking`, `swerve`, `standstill`) or what a person calls it.
        severity: Peak over threshold of the detector; 0 where a person added the event.
        decision: `proposed` by a detector, or decided by a person: `emergency` or `normal`.
        decided_by: Who decided; empty for a proposal.
        note: Free text; of a proposal, what each detector measured.
    """

    recording: str
    start: int
    stop: int
    kind: str
    severity: float
    decision: Decision
    decided_by: str
    note: str

    @property
    def is_left_out(self) -> bool:
        """Whether its rows are absent from the dataset: everything a person has not called normal."""
        return self.decision != "normal"


def parse_stamp(text: str) -> int:
    """Return an ISO 8601 time with a UTC offset as ns UTC; digits beyond microseconds are ignored.

    Raises:
        ValueError: It is no such time, has no offset, or does not fit into 64 bits; the message says what was found.
    """
    try:
        moment = datetime.fromisoformat(text.strip())
    except ValueError:
        raise ValueError(f"expected ISO 8601 UTC such as {_EXAMPLE}, found {text!r}") from None
    if moment.tzinfo is None:
        raise ValueError(f"expected ISO 8601 UTC such as {_EXAMPLE}, found {text!r} without Z")
    time = (moment - _EPOCH) // timedelta(microseconds=1) * 1000
    if not -(2**63) <= time < 2**63:
        raise ValueError(f"expected a year from 1678 to 2261, found {text!r}")
    return time


def read_events(path: Path) -> list[Event]:
    """Read `events.csv`, sorted; the columns may stand in any order. No file, no events.

    Raises:
        InputError: The file cannot be read, or lines of it are wrong; one message lists all of them.
    """
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        return []
    except OSError as error:
        raise InputError(path, "", f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise InputError(path, f"byte {error.start}", "not UTF-8; save the file as UTF-8 text") from None
    rows = _rows(text)
    first, header = next(rows, (1, []))
    if isinstance(header, str) or sorted(header) != sorted(EVENT_COLUMNS):
        found = header if isinstance(header, str) else ", ".join(header) or "nothing"
        reason = (
            f"expected the columns {', '.join(EVENT_COLUMNS)}, separated by commas, found {found}; "
            "a spreadsheet may have saved other separators or columns. Repair this line, or remove "
            "the file to begin again with the detectors' proposals"
        )
        raise InputError(path, f"line {first}", reason)
    events: list[Event] = []
    wrong: dict[int, str] = {}
    for line, row in rows:
        if isinstance(row, str):
            wrong[line] = row
        elif len(row) != len(header):
            wrong[line] = f"expected {len(header)} fields, found {len(row)}"
        else:
            values = dict(zip(header, row, strict=True))
            if complaints := list(_complaints(values)):
                wrong[line] = ", ".join(complaints)
            else:
                events.append(_event(values))
    if wrong:
        where = f"line{'s' if len(wrong) > 1 else ''} {', '.join(map(str, wrong))}"
        raise InputError(path, where, "; ".join(f"line {line}: {reason}" for line, reason in wrong.items()))
    return sorted(events)


def write_events(path: Path, events: Iterable[Event]) -> None:
    """Publish events sorted (RFC 4180), with stamps cut to milliseconds and severities rounded to three decimals.

    On a grid of 1 kHz or slower, cutting both ends keeps exactly the same rows within [start, stop). A file that
    already says so is left alone.
    """
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(EVENT_COLUMNS)
    for event in sorted(events):
        writer.writerow(
            [
                event.recording,
                iso_utc(event.start),
                iso_utc(event.stop),
                event.kind,
                round(event.severity, 3),
                event.decision,
                event.decided_by,
                event.note,
            ]
        )
    if not path.is_file() or path.read_bytes() != text.getvalue().encode():
        publish_text(path, text.getvalue())


def subtract(events: Iterable[Event], cuts: Iterable[Event]) -> list[Event]:
    """Return what the cuts, where they concern the same recording, leave of the events: none, one or more pieces."""
    pieces = list(events)
    for cut in cuts:
        pieces = [
            replace(piece, start=start, stop=stop)
            for piece in pieces
            for start, stop in (
                ((piece.start, min(piece.stop, cut.start)), (max(piece.start, cut.stop), piece.stop))
                if piece.recording == cut.recording and piece.start < cut.stop and cut.start < piece.stop
                else ((piece.start, piece.stop),)
            )
            if start < stop
        ]
    return pieces


def merge_proposals(existing: Iterable[Event], proposed: Iterable[Event], padding: int = 0) -> list[Event]:
    """Return what a person decided, untouched, and the new proposals in place of the old ones, sorted.

    A decision holds for its stretch of time and nothing beyond: of a proposal that overlaps decided events the rest
    remains, so that nothing that nobody looked at enters the dataset because something beside it was called normal.
    Only what remains at an end of a proposal and is no longer than its padding is dropped: all it shows is that
    something was near, and that was decided; else every change of a threshold would leave crumbs to be reviewed.

    Args:
        existing: Decided events and old proposals.
        proposed: New proposals.
        padding: ns that detectors add on both sides of what they find; they add nothing to standstill.
    """
    decided = [event for event in existing if event.decision != "proposed"]
    decided_in: dict[str, list[Event]] = {}
    for event in decided:
        decided_in.setdefault(event.recording, []).append(event)
    merged = list(decided)
    for proposal in proposed:
        crumb = 0 if proposal.kind == "standstill" else padding
        for piece in subtract([proposal], decided_in.get(proposal.recording, ())):
            is_inner = proposal.start < piece.start and piece.stop < proposal.stop
            if piece == proposal or is_inner or piece.stop - piece.start > crumb:
                merged.append(piece)
    return sorted(merged)


def covered(time: NDArray[np.int64], events: Iterable[Event]) -> NDArray[np.bool_]:
    """Return for every time (n_samples,), ascending ns UTC, whether it lies within one of the events' stretches."""
    mask = np.zeros(len(time), dtype=np.bool_)
    for event in events:
        mask[np.searchsorted(time, event.start) : np.searchsorted(time, event.stop)] = True
    return mask


def _rows(text: str) -> Iterator[tuple[int, list[str] | str]]:
    """Yield the line that each record begins in with its fields, or with what makes it no record."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    while True:
        line = reader.line_num + 1
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            yield line, f"not CSV ({error})"
            continue
        if row:
            yield line, row


def _complaints(values: Mapping[str, str]) -> Iterator[str]:
    if "/" not in values["recording"].strip("/"):
        yield f"recording: expected driver/recording, found {values['recording']!r}"
    times = []
    for name in ("start", "stop"):
        try:
            times.append(parse_stamp(values[name]))
        except ValueError as error:
            yield f"{name}: {error}"
    if len(times) == 2 and times[0] >= times[1]:
        yield f"stop: expected a time after start, found {values['stop']} after {values['start']}"
    if not values["kind"]:
        yield "kind: expected a word such as hard_braking, found nothing"
    try:
        is_severity = 0 <= float(values["severity"] or 0) < math.inf
    except ValueError:
        is_severity = False
    if not is_severity:
        yield f"severity: expected a number from 0 or nothing, found {values['severity']!r}"
    if values["decision"] not in DECISIONS:
        yield f"decision: expected {', '.join(DECISIONS[:-1])} or {DECISIONS[-1]}, found {values['decision']!r}"


def _event(values: Mapping[str, str]) -> Event:
    return Event(
        values["recording"],
        parse_stamp(values["start"]),
        parse_stamp(values["stop"]),
        values["kind"],
        float(values["severity"] or 0),
        cast("Decision", values["decision"]),
        values["decided_by"],
        values["note"],
    )
