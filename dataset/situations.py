"""`situations.csv`: what kind of driving a stretch of a recording is, as detectors propose it and a person says."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from ..schemas.tables import SITUATION_COLUMNS
from .stretches import Stretch, merge, read_stretches, write_stretches

Tagging = Literal["proposed", "decided"]
TAGGINGS: tuple[Tagging, ...] = get_args(Tagging)


@dataclass(frozen=True, slots=True, order=True)
class Situation(Stretch):
    """A stretch of a recording, half-open, and the situation it is driven in.

    Attributes:
        recording: `driver/recording`.
        start: ns UTC.
        stop: ns UTC, after `start`.
        situation: One of the project's; empty where a person decided that it is none of them.
        decision: `proposed` by a detector, or `decided` by a person.
        decided_by: Who decided; empty for a proposal.
        note: Free text; of a proposal, what was measured.
    """

    situation: str
    decision: Tagging
    decided_by: str
    note: str


def read_situations(path: Path, names: Sequence[str]) -> list[Situation]:
    """Read `situations.csv`, sorted; the columns may stand in any order. No file, no situations.

    Args:
        path: The file.
        names: The project's situations; what was once proposed may be another.

    Raises:
        InputError: The file cannot be read, or lines of it are wrong; one message lists all of them.
    """

    def complain(values: Mapping[str, str]) -> Iterator[str]:
        found = values["situation"]
        if values["decision"] not in TAGGINGS:
            yield f"decision: expected {' or '.join(TAGGINGS)}, found {values['decision']!r}"
        elif values["decision"] == "decided" and found not in ("", *names):
            near = difflib.get_close_matches(found, names, n=1)
            hint = f"did you mean {near[0]}?" if near else "add it to wheelprint.toml: [situations] names"
            yield f"situation: expected {', '.join(names)} or nothing, found {found!r}; {hint}"

    def make(stretch: Stretch, values: Mapping[str, str]) -> Situation:
        decision = cast("Tagging", values["decision"])
        return Situation(
            stretch.recording, stretch.start, stretch.stop, values["situation"], decision, values["decided_by"],
            values["note"],
        )  # fmt: skip

    return read_stretches(path, SITUATION_COLUMNS, complain, make)


def write_situations(path: Path, situations: Iterable[Situation]) -> None:
    """Publish situations sorted (RFC 4180), as `write_events` does."""
    write_stretches(path, SITUATION_COLUMNS, situations)


def update_situations(path: Path, proposed: Iterable[Situation], names: Sequence[str]) -> list[Situation]:
    """Put new proposals in place of the old ones in `situations.csv`, decisions untouched, and return its content.

    Raises:
        InputError: See `read_situations`.
    """
    decided = [situation for situation in read_situations(path, names) if situation.decision == "decided"]
    write_situations(path, merge(decided, proposed, lambda _: 0))
    return read_situations(path, names)


def situation_of(time: NDArray[np.int64], situations: Iterable[Situation]) -> NDArray[Any]:
    """Return the situation of every time (n_samples,), ascending ns UTC, None where nothing says.

    Where stretches overlap, decisions come before proposals, and of either the one that begins last counts.

    Args:
        time: Of one recording.
        situations: Of the same recording.
    """
    names: NDArray[Any] = np.full(len(time), None, dtype=object)
    for one in sorted(situations, key=lambda one: (one.decision == "decided", one.start)):
        names[np.searchsorted(time, one.start) : np.searchsorted(time, one.stop)] = one.situation or None
    return names
