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

Verdict = Literal["proposed", "confirmed", "rejected"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)


@dataclass(frozen=True, slots=True, order=True)
class Situation(Stretch):
    """A stretch of a recording, half-open, and the situation it is driven in.

    Attributes:
        recording: `driver/recording`.
        start: ns UTC.
        stop: ns UTC, after `start`.
        situation: What was driven, `lane change` for example.
        decision: `proposed` from the data, or decided by a person: `confirmed` or `rejected`.
        decided_by: Who decided; empty for a proposal.
        decided_at: When it was decided, ISO 8601 UTC; empty for a proposal and where it is not known.
        note: Free text; of a proposal, what was measured.
    """

    situation: str
    decision: Verdict
    decided_by: str
    decided_at: str
    note: str


def read_situations(path: Path, names: Sequence[str] | None = None) -> list[Situation]:
    """Read `situations.csv`, sorted; the columns may stand in any order, `decided_at` may be absent.

    No file, no situations.

    Args:
        path: The file.
        names: The project's situations, of which every confirmed one must be; None for any.

    Raises:
        InputError: The file cannot be read, or lines of it are wrong; one message lists all of them.
    """

    def complain(values: Mapping[str, str]) -> Iterator[str]:
        found = values["situation"]
        if values["decision"] not in VERDICTS:
            yield f"decision: expected {', '.join(VERDICTS[:-1])} or {VERDICTS[-1]}, found {values['decision']!r}"
        if not found:
            yield "situation: expected a name such as lane change, found nothing"
        elif names is not None and values["decision"] == "confirmed" and found not in names:
            near = difflib.get_close_matches(found, names, n=1)
            hint = f"did you mean {near[0]}?" if near else "add it to wheelprint.toml: [situations] names"
            yield f"situation: expected {' or '.join(names)}, found {found!r}; {hint}"

    def make(stretch: Stretch, values: Mapping[str, str]) -> Situation:
        decision = cast("Verdict", values["decision"])
        texts = (values[name] for name in ("decided_by", "decided_at", "note"))
        return Situation(stretch.recording, stretch.start, stretch.stop, values["situation"], decision, *texts)

    return read_stretches(path, SITUATION_COLUMNS, complain, make)


def write_situations(path: Path, situations: Iterable[Situation]) -> None:
    """Publish situations sorted (RFC 4180), as `write_events` does."""
    write_stretches(path, SITUATION_COLUMNS, situations)


def update_situations(path: Path, proposed: Iterable[Situation], names: Sequence[str]) -> list[Situation]:
    """Put new proposals in place of the old ones in `situations.csv`, decisions untouched, and return its content.

    Nothing is proposed where a person has confirmed or rejected something.

    Raises:
        InputError: See `read_situations`.
    """
    decided = [situation for situation in read_situations(path, names) if situation.decision != "proposed"]
    write_situations(path, merge(decided, proposed, lambda _: 0))
    return read_situations(path, names)


def situation_of(time: NDArray[np.int64], situations: Iterable[Situation]) -> NDArray[Any]:
    """Return the situation of every time (n_samples,), ascending ns UTC, None where nothing says.

    Where stretches overlap, confirmed ones come before proposals, and of either the one that begins last counts;
    rejected ones say nothing.

    Args:
        time: Of one recording.
        situations: Of the same recording.
    """
    names: NDArray[Any] = np.full(len(time), None, dtype=object)
    said = (one for one in situations if one.decision != "rejected")
    for one in sorted(said, key=lambda one: (one.decision == "confirmed", one.start)):
        names[np.searchsorted(time, one.start) : np.searchsorted(time, one.stop)] = one.situation
    return names
