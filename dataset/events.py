"""`events.csv`: stretches of a recording that are no ordinary driving, and what a person decided about them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast, get_args

from ..schemas.tables import EVENT_COLUMNS
from .stretches import Stretch, covered, merge, parse_stamp, read_stretches, subtract, write_stretches

__all__ = [
    "DECISIONS", "STATES", "Decision", "Event", "covered", "merge_proposals", "parse_stamp", "read_events", "subtract",
    "write_events",
]  # fmt: skip

Decision = Literal["proposed", "emergency", "normal"]
DECISIONS: tuple[Decision, ...] = get_args(Decision)
STATES = ("standstill", "reversing", "navigation")
"""Kinds that are no emergencies, but no driving to learn from either; nothing is padded to them."""


@dataclass(frozen=True, slots=True, order=True)
class Event(Stretch):
    """A stretch of a recording, half-open: its rows have `start <= time < stop`.

    Attributes:
        recording: `driver/recording`.
        start: ns UTC.
        stop: ns UTC, after `start`.
        kind: What was detected (`hard_braking`, `swerve`, `standstill`) or what a person calls it.
        severity: Peak over threshold of the detector, so above 1 in an emergency; 2 for a flag of the car's; 0 for
            `STATES`, and where a person added the event.
        decision: `proposed` by a detector, or decided by a person: `emergency` or `normal`.
        decided_by: Who decided; empty for a proposal.
        note: Free text; of a proposal, what each detector measured.
        decided_at: When it was decided, ISO 8601 UTC; empty for a proposal and where it is not known.
    """

    kind: str
    severity: float
    decision: Decision
    decided_by: str
    note: str
    decided_at: str = ""

    @property
    def is_left_out(self) -> bool:
        """Whether its rows are absent from the dataset: everything a person has not called normal."""
        return self.decision != "normal"


def read_events(path: Path) -> list[Event]:
    """Read `events.csv`, sorted; the columns may stand in any order, `decided_at` may be absent. No file, no events.

    Raises:
        InputError: The file cannot be read, or lines of it are wrong; one message lists all of them.
    """
    return read_stretches(path, EVENT_COLUMNS, _complaints, _event)


def write_events(path: Path, events: Iterable[Event]) -> None:
    """Publish events sorted (RFC 4180), with stamps cut to milliseconds and severities rounded to three decimals.

    On a grid of 1 kHz or slower, cutting both ends keeps exactly the same rows within [start, stop). A file that
    already says so is left alone.
    """
    write_stretches(path, EVENT_COLUMNS, events)


def merge_proposals(existing: Iterable[Event], proposed: Iterable[Event], padding: int = 0) -> list[Event]:
    """Return what a person decided, untouched, and the new proposals in place of the old ones, sorted: see `merge`.

    Args:
        existing: Decided events and old proposals.
        proposed: New proposals.
        padding: ns that detectors add on both sides of what they find; they add nothing to `STATES`.
    """
    decided = [event for event in existing if event.decision != "proposed"]
    return merge(decided, proposed, lambda event: 0 if event.kind in STATES else padding)


def _complaints(values: Mapping[str, str]) -> Iterator[str]:
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


def _event(stretch: Stretch, values: Mapping[str, str]) -> Event:
    return Event(
        stretch.recording,
        stretch.start,
        stretch.stop,
        values["kind"],
        float(values["severity"] or 0),
        cast("Decision", values["decision"]),
        values["decided_by"],
        values["note"],
        values["decided_at"],
    )
