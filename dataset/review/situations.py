"""`situations.csv`: stretches of a recording and the driving situation that they are."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Literal, cast, get_args

from ...schemas.errors import InputError
from ...schemas.store import publish_text
from ...schemas.times import iso_utc
from ..events import parse_stamp

Verdict = Literal["proposed", "confirmed", "rejected"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)

NAMES = ("lane keeping", "lane change", "overtaking", "intersection", "ring road", "highway")
"""What a stretch can be tagged with."""


@dataclass(frozen=True, slots=True, order=True)
class Situation:
    """A stretch of a recording, half-open: its rows have `start <= time < stop`.

    Attributes:
        recording: `driver/recording`.
        start: ns UTC.
        stop: ns UTC, after `start`.
        situation: What was driven, `lane change` for example.
        decision: `proposed` from the data, or decided by a person: `confirmed` or `rejected`.
        decided_by: Who decided; empty for a proposal.
        decided_at: When it was decided, ISO 8601 UTC; empty for a proposal and where it is not known.
        note: Free text.
    """

    recording: str
    start: int
    stop: int
    situation: str
    decision: Verdict
    decided_by: str
    decided_at: str
    note: str


COLUMNS = tuple(field.name for field in fields(Situation))


def read_situations(path: Path) -> list[Situation]:
    """Read `situations.csv`, sorted. No file, no situations.

    Raises:
        InputError: The file cannot be read, or lines of it are wrong; one message lists all of them.
    """
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, "", f"cannot be read as UTF-8 text: {error}") from None
    rows = csv.reader(io.StringIO(text, newline=""))
    header = next(rows, [])
    if sorted(header) != sorted(COLUMNS):
        expected = f"expected the columns {', '.join(COLUMNS)}, separated by commas, found {', '.join(header)}"
        raise InputError(path, "line 1", f"{expected}; repair this line, or remove the file to begin again")
    situations: list[Situation] = []
    wrong: list[str] = []
    for row in filter(None, rows):
        values = dict(zip(header, row, strict=False))
        try:
            situations.append(_situation(values))
        except (KeyError, ValueError) as error:
            wrong.append(f"line {rows.line_num}: {error}")
    if wrong:
        raise InputError(path, "", "; ".join(wrong))
    return sorted(situations)


def _situation(values: dict[str, str]) -> Situation:
    start, stop = parse_stamp(values["start"]), parse_stamp(values["stop"])
    if start >= stop:
        raise ValueError(f"expected a stop after the start, found {values['stop']} after {values['start']}")
    if values["decision"] not in ("proposed", "confirmed", "rejected"):
        raise ValueError(f"expected one of {', '.join(VERDICTS)} as decision, found {values['decision']!r}")
    texts = (values[name] for name in ("decided_by", "decided_at", "note"))
    return Situation(values["recording"], start, stop, values["situation"], cast("Verdict", values["decision"]), *texts)


def write_situations(path: Path, situations: Iterable[Situation]) -> None:
    """Publish situations sorted (RFC 4180), with stamps cut to milliseconds."""
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(COLUMNS)
    for one in sorted(situations):
        recording, start, stop, *rest = astuple(one)
        writer.writerow([recording, iso_utc(start), iso_utc(stop), *rest])
    publish_text(path, text.getvalue())
