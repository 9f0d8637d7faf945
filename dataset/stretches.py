"""Stretches of recordings that detectors propose and people decide about, as CSV files that both write."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..schemas.errors import InputError
from ..schemas.store import publish_text
from ..schemas.times import iso_utc

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_EXAMPLE = "2026-11-23T08:00:00.100Z"


@dataclass(frozen=True, slots=True, order=True)
class Stretch:
    """A stretch of a recording, half-open: its rows have `start <= time < stop`.

    Attributes:
        recording: `driver/recording`.
        start: ns UTC.
        stop: ns UTC, after `start`.
    """

    recording: str
    start: int
    stop: int


S = TypeVar("S", bound=Stretch)


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


def read_stretches(
    path: Path,
    columns: Sequence[str],
    complain: Callable[[Mapping[str, str]], Iterable[str]],
    make: Callable[[Stretch, Mapping[str, str]], S],
) -> list[S]:
    """Read a CSV file of stretches, sorted; the columns may stand in any order, `decided_at` may be absent.

    No file, no stretches.

    Args:
        path: The file.
        columns: Its columns, the attributes of `Stretch` and `decided_at` among them.
        complain: Tells what is wrong with the other columns of a line.
        make: Makes the stretch of a line that is right.

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
    if isinstance(header, str) or sorted([*header, *{"decided_at"}.difference(header)]) != sorted(columns):
        found = header if isinstance(header, str) else ", ".join(header) or "nothing"
        reason = (
            f"expected the columns {', '.join(columns)}, separated by commas, found {found}; "
            "a spreadsheet may have saved other separators or columns. Repair this line, or remove "
            "the file to begin again with the detectors' proposals"
        )
        raise InputError(path, f"line {first}", reason)
    stretches: list[S] = []
    wrong: dict[int, str] = {}
    for line, row in rows:
        if isinstance(row, str):
            wrong[line] = row
        elif len(row) != len(header):
            wrong[line] = f"expected {len(header)} fields, found {len(row)}"
        else:
            values = {"decided_at": "", **dict(zip(header, row, strict=True))}
            if complaints := [*_complaints(values), *complain(values), *_complaints_of_moment(values)]:
                wrong[line] = ", ".join(complaints)
            else:
                stretch = Stretch(values["recording"], parse_stamp(values["start"]), parse_stamp(values["stop"]))
                stretches.append(make(stretch, values))
    if wrong:
        where = f"line{'s' if len(wrong) > 1 else ''} {', '.join(map(str, wrong))}"
        raise InputError(path, where, "; ".join(f"line {line}: {reason}" for line, reason in wrong.items()))
    return sorted(stretches)


def write_stretches(path: Path, columns: Sequence[str], stretches: Iterable[Stretch]) -> None:
    """Publish stretches sorted (RFC 4180), with stamps cut to milliseconds and numbers rounded to three decimals.

    On a grid of 1 kHz or slower, cutting both ends keeps exactly the same rows within [start, stop). A file that
    already says so is left alone.

    Args:
        path: The file.
        columns: Names of its columns and of the attributes that fill them.
        stretches: All of one kind.
    """
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(columns)
    for stretch in sorted(stretches):
        values = {name: getattr(stretch, name) for name in columns}
        values |= {name: round(value, 3) for name, value in values.items() if isinstance(value, float)}
        writer.writerow((values | {"start": iso_utc(stretch.start), "stop": iso_utc(stretch.stop)}).values())
    if not path.is_file() or path.read_bytes() != text.getvalue().encode():
        publish_text(path, text.getvalue())


def subtract(stretches: Iterable[S], cuts: Iterable[Stretch]) -> list[S]:
    """Return what the cuts, where they concern the same recording, leave of stretches: none, one or more pieces."""
    pieces = list(stretches)
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


def merge(decided: Iterable[S], proposed: Iterable[S], padding: Callable[[S], int]) -> list[S]:
    """Return what a person decided, untouched, and the proposals where nothing is decided, sorted.

    A decision holds for its stretch of time and nothing beyond: of a proposal that overlaps decided stretches the rest
    remains, so that nothing that nobody looked at enters the dataset because something beside it was called normal.
    Only what remains at an end of a proposal and is no longer than its padding is dropped: all it shows is that
    something was near, and that was decided; else every change of a threshold would leave crumbs to be reviewed.

    Args:
        decided: By a person.
        proposed: By detectors.
        padding: Tells the ns that a proposal has on both sides of what was found.
    """
    merged = list(decided)
    decided_in: dict[str, list[S]] = {}
    for stretch in merged:
        decided_in.setdefault(stretch.recording, []).append(stretch)
    for proposal in proposed:
        crumb = padding(proposal)
        for piece in subtract([proposal], decided_in.get(proposal.recording, ())):
            is_inner = proposal.start < piece.start and piece.stop < proposal.stop
            if piece == proposal or is_inner or piece.stop - piece.start > crumb:
                merged.append(piece)
    return sorted(merged)


def covered(time: NDArray[np.int64], stretches: Iterable[Stretch]) -> NDArray[np.bool_]:
    """Return for every time (n_samples,), ascending ns UTC, whether it lies within one of the stretches."""
    mask = np.zeros(len(time), dtype=np.bool_)
    for stretch in stretches:
        mask[np.searchsorted(time, stretch.start) : np.searchsorted(time, stretch.stop)] = True
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


def _complaints_of_moment(values: Mapping[str, str]) -> Iterator[str]:
    if values["decided_at"]:
        try:
            parse_stamp(values["decided_at"])
        except ValueError as error:
            yield f"decided_at: {error}"
