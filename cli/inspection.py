"""`wheelprint inspect`: what raw logs hold, as tables for people and as one structure for machines."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .output import Report, console
from .schemas.config import DatabaseFile, read_config
from .schemas.errors import InputError
from .schemas.times import iso_utc

if TYPE_CHECKING:
    from .ingest.cadence import Cadence
    from .ingest.can.database import Database
    from .ingest.inspection import Inspection, TopicCount

Table = tuple[str, Sequence[str], list[Sequence[Any]]]

SHOWN_REJECTIONS = 5
SHOWN_PERIODS = 16
FRAME_OF_TIMELINE = 38
"""Characters of a row of the timeline beside the name and the bar."""
BARS = (30, 60)
"""Characters of its bar, least and most."""
LONGEST_NAME = 30


def inspect_files(report: Report, paths: Sequence[Path], databases: Sequence[str]) -> None:
    """Fill the report with what the logs hold and how they lie in time to each other.

    Args:
        report: Filled.
        paths: Logs; a folder stands for all that is in it.
        databases: Name the messages; where there are none, those of the project file of this folder.
    """
    from .ingest.inspection import files_of, inspect_log, topics_of
    from .ingest.recording_logs import BESIDE_LOGS

    database, problems = _databases(databases)
    report.problems += problems
    files = list(dict.fromkeys(file for path in paths for file in files_of(path)))
    logs: list[Inspection] = []
    topics: dict[Path, list[TopicCount]] = {}
    with _progress(files) as advance:
        for path in files:
            advance(path, 0)
            try:
                logs += inspect_log(path, database, lambda done, path=path: advance(path, done))  # type: ignore[misc]
                topics[path] = topics_of(path)
            except InputError as error:
                if path in paths or path.suffix.lower() not in BESIDE_LOGS:
                    report.problems.append(error.as_problem())
            advance(path, None)
    report.failed = not logs
    for log in logs:
        report.problems += _problems(log)
    names = _names([log.path for log in logs])
    if report.as_json:
        report.facts |= _facts(database, logs, topics)
    else:
        report.tables += _tables(database, logs, topics, names)


def _databases(named: Sequence[str]) -> tuple[Database, list[InputError]]:
    from .ingest.can.database import load_databases

    if not named and Path("wheelprint.toml").exists():
        return load_databases(read_config(Path("wheelprint.toml")).can.database, Path())
    return load_databases([DatabaseFile(file=name) for name in named], Path())


@contextmanager
def _progress(files: Sequence[Path]) -> Iterator[Callable[[Path, int | None], None]]:
    """Show how many bytes of all files were read; where nobody looks, nothing."""
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    sizes = {path: path.stat().st_size if path.is_file() else 0 for path in files}
    read = dict.fromkeys(files, 0)
    where = console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeElapsedColumn())
    with Progress(*columns, TimeRemainingColumn(), console=where, disable=not where.is_terminal, transient=True) as bar:
        task = bar.add_task("", total=sum(sizes.values()))

        def advance(path: Path, done: int | None) -> None:
            read[path] = max(read[path], sizes[path] if done is None else min(done, sizes[path]))
            bar.update(task, description=path.name, completed=sum(read.values()))

        yield advance


def _problems(log: Inspection) -> list[InputError]:
    kept, rejected = log.account.rejections[:SHOWN_REJECTIONS], log.account.rejected
    problems = [InputError(log.path, where, reason) for where, reason in (*kept, *log.account.remarks)]
    if rejected > len(kept):
        listed = f"; --json lists {min(rejected, len(log.account.rejections))} of them"
        problems.append(InputError(log.path, "", f"{rejected - len(kept)} more records rejected{listed}"))
    if log.account.truncated:
        problems.append(InputError(log.path, "end", "the file ends within a record"))
    return [*problems, *log.stamps.problems(log.path)]


def _names(paths: Sequence[Path]) -> dict[Path, str]:
    """Return the shortest names by which files of several folders can be told apart."""
    if not paths:
        return {}
    base = os.path.commonpath([path.absolute().parent for path in paths])
    return {path: os.path.relpath(path.absolute(), base) for path in paths}


def _doubts(logs: Sequence[Inspection], names: dict[Path, str]) -> list[tuple[Inspection, str]]:
    from .ingest.overlap import doubt

    spans = [_span(log, names) for log in logs]
    known = [span for span in spans if span is not None]
    found = [(log, doubt(span, known)) for log, span in zip(logs, spans, strict=True) if span is not None]
    return [(log, reason) for log, reason in found if reason]


def _span(log: Inspection, names: dict[Path, str]) -> Any:
    from .ingest.overlap import LogSpan

    start, stop = log.stamps.start, log.stamps.stop
    return None if start is None or stop is None else LogSpan(names[log.path], log.kind, start, stop)


def _tables(
    database: Database, logs: Sequence[Inspection], topics: dict[Path, list[TopicCount]], names: dict[Path, str]
) -> Iterator[Table]:
    if database.repairs:
        rows: list[Sequence[Any]] = [
            (Path(repair.path).name, repair.where or None, repair.found, repair.done) for repair in database.repairs
        ]
        yield "Repairs of the databases", ("database", "where", "found", "done"), rows
    if not logs:
        return
    yield _logs_table(logs, names)
    seen: set[Path] = set()
    for log in logs:
        if topics.get(log.path) and log.path not in seen:
            yield _topics_table(names[log.path], topics[log.path])
        seen.add(log.path)
        if log.kind == "can":
            yield _messages_table(names[log.path], log, named=bool(database.messages))
        elif log.kind == "nav":
            yield _periods_table(names[log.path], log)
        else:
            yield _cameras_table(names[log.path], log)
    yield _stamps_table(logs, names)
    spans = [span for log in logs if (span := _span(log, names)) is not None]
    if len(spans) > 1:
        yield _timeline(spans)
    doubts: list[Sequence[Any]] = [(names[log.path], reason) for log, reason in _doubts(logs, names)]
    if doubts:
        yield "What does not fit", ("file", "why"), doubts


def _logs_table(logs: Sequence[Inspection], names: dict[Path, str]) -> Table:
    rows: list[Sequence[Any]] = []
    for log in logs:
        start, stop = log.stamps.start, log.stamps.stop
        told = (None, None) if start is None or stop is None else (_moment(start)[:-4], (stop - start) / 1e9)
        cut = "yes" if log.account.truncated else "no"
        rows.append((names[log.path], log.format, log.kind, *told, log.account.accepted, log.account.rejected, cut))
    heads = ("file", "format", "holds", "start, UTC", "length, s", "accepted", "rejected", "cut off")
    return "Logs", heads, rows


def _messages_table(name: str, log: Inspection, *, named: bool) -> Table:
    rows: list[Sequence[Any]] = []
    for (channel, identifier, extended), message in sorted(log.messages.items()):
        cadence, layout = message.cadence, message.layout
        shown = f"{identifier:08X}x" if extended else f"{identifier:03X}"
        size = f"{message.shortest}" if message.shortest == message.longest else f"{message.shortest}–{message.longest}"
        if layout is not None and (message.shortest, message.longest) != (layout.length, layout.length):
            size += f", database {layout.length}"
        called = () if not named else ("unknown" if layout is None else layout.name,)
        rows.append((channel, shown, *called, *_cadence(log, cadence), size))
    kinds = ", ".join(f"{count:,} {kind}" for kind, count in log.frame_kinds.items() if count)
    title = f"{name}: {kinds or 'no'} frames, {len(rows)} message{'' if len(rows) == 1 else 's'}"
    if named:
        known = sum(message.layout is not None for message in log.messages.values())
        title += f" of which the database knows {known}"
    if log.other_frames:
        title += f", and {log.other_frames:,} frames of more messages than any car has"
    heads = ("bus", "id", *(("message",) if named else ()), "frames", "Hz", "gaps", "longest, s", "after, s", "bytes")
    return title, heads, rows


def _cadence(log: Inspection, cadence: Cadence) -> Sequence[Any]:
    """Return count, rate, gaps, the longest interval and, where that is a gap, when it began after the log's start."""
    rate = "" if cadence.rate is None else round(cadence.rate, 2)
    longest = round(cadence.longest / 1e9, 3) if cadence.count > 1 else ""
    after = _after(log, cadence.longest_at) if cadence.gaps else None
    return cadence.count, rate, cadence.gaps, longest, "" if after is None else round(after, 1)


def _periods_table(name: str, log: Inspection) -> Table:
    rows: list[Sequence[Any]] = [
        (_moment(period.start), _clock(period.stop), (period.stop - period.start) / 1e9, period.samples,
         period.status if period.status >= 0 else None, log.status_name(period.status))
        for period in log.periods
    ]  # fmt: skip
    more = max(len(rows) - SHOWN_PERIODS, 0)
    if more:
        half = SHOWN_PERIODS // 2
        between = (f"… {more + log.more_periods} more", "", None, sum(row[3] for row in rows[half:-half]), None, "")
        rows = [*rows[:half], between, *rows[-half:]]
    samples, accuracy = log.samples, log.accuracy
    title = f"{name}: {samples.count:,} samples" + (f" at {samples.rate:.4g} Hz" if samples.rate else "")
    if samples.gaps:
        after = _after(log, samples.longest_at)
        title += f", {samples.gaps} gaps, the longest {samples.longest / 1e9:.3g} s after {after:.1f} s"
    if accuracy.samples:
        best, worst = f"{accuracy.best:.2g}", f"{accuracy.worst:.2g}"
        title += (
            f"; accuracy {best} m" if best == worst else f"; accuracy {best} to {worst}, median {accuracy.median:.2g} m"
        )
    return title, ("from, UTC", "to", "s", "samples", "code", "navigation status"), rows


def _cameras_table(name: str, log: Inspection) -> Table:
    rows: list[Sequence[Any]] = [(camera, *_cadence(log, cadence)) for camera, cadence in log.cameras.items()]
    return f"{name}: cameras", ("camera", "frames", "Hz", "gaps", "longest, s", "after, s"), rows


def _topics_table(name: str, topics: Sequence[TopicCount]) -> Table:
    rows: list[Sequence[Any]] = []
    for found in topics:
        topic, rate = found.topic, found.cadence.rate
        told = "" if rate is None else round(rate, 2)
        purpose = found.purpose or "not read"
        rows.append((topic.name, topic.schema, topic.encoding, found.cadence.count, told, purpose))
    return f"{name}: topics", ("topic", "schema", "encoding", "messages", "Hz", "read as"), rows


def _stamps_table(logs: Sequence[Inspection], names: dict[Path, str]) -> Table:
    rows: list[Sequence[Any]] = []
    for log in logs:
        stamps = log.stamps
        for what, finding, worst in (
            ("earlier than the one before", stamps.backwards, f"{stamps.backwards.worst / 1e9:.3g} s earlier"),
            ("same as the one before", stamps.repeated, f"{stamps.repeated.worst} in a row"),
            ("more than 1 s after it", stamps.gaps, f"{stamps.gaps.worst / 1e9:.4g} s"),
        ):
            if finding.count and finding.at is not None:
                rows.append((names[log.path], what, finding.count, worst, _moment(finding.at)))
    if not rows:
        rows.append(("every log", "none earlier, same or more than 1 s after the one before", 0, None, None))
    return "Stamps, each against the record before", ("file", "stamp", "times", "worst", "at, UTC"), rows


def _timeline(spans: Sequence[Any]) -> Table:
    """Draw every group of logs that lie near each other on a scale of its own."""
    from .ingest.overlap import duration, near_each_other, of_every_kind

    beside = min(max(len(span.name) for span in spans), LONGEST_NAME) + FRAME_OF_TIMELINE
    width = min(max(console().width - beside, BARS[0]), BARS[1])
    rows: list[Sequence[Any]] = []
    before: int | None = None
    for group in near_each_other(spans):
        start, stop = min(log.start for log in group), max(log.stop for log in group)
        if before is not None:
            rows.append(("", "", f"— {duration(start - before)} later —", "", ""))
        before = stop
        scale = f"{_moment(start)[:-4]}{_clock(stop)[:-4].rjust(width - 19)}"
        rows.append(("", "", scale, "", ""))
        ends: dict[str, int] = {}
        for log in group:
            gap = log.start - ends.get(log.kind, log.start)
            bar = _bar([(log.start, log.stop)], start, stop, width)
            short = log.name if len(log.name) <= LONGEST_NAME else f"…{log.name[1 - LONGEST_NAME :]}"
            rows.append((short, log.kind, bar, (log.stop - log.start) / 1e9, round(gap / 1e9, 3) if gap > 0 else ""))
            ends[log.kind] = max(log.stop, ends.get(log.kind, log.stop))
        if len(ends) > 1:
            common = of_every_kind(group)
            shared = sum(end - begin for begin, end in common) / 1e9
            rows.append(("in common", "all", _bar(common, start, stop, width), shared, ""))
    return (
        "When, by the logs' own stamps, and the gap to the log of that kind before",
        ("file", "holds", "UTC", "length, s", "gap, s"),
        rows,
    )


def _bar(stretches: Sequence[tuple[int, int]], start: int, stop: int, width: int) -> str:
    cells = ["·"] * width
    for begin, end in stretches:
        first = min((begin - start) * width // max(stop - start, 1), width - 1)
        last = min(-(-(end - start) * width // max(stop - start, 1)), width)
        cells[first : max(last, first + 1)] = "━" * (max(last, first + 1) - first)
    return "".join(cells)


def _moment(time: int) -> str:
    return iso_utc(time).replace("T", " ").removesuffix("Z")


def _clock(time: int) -> str:
    return iso_utc(time)[11:-1]


def _after(log: Inspection, time: int | None) -> float | None:
    return None if time is None or log.stamps.start is None else (time - log.stamps.start) / 1e9


def _facts(database: Database, logs: Sequence[Inspection], topics: dict[Path, list[TopicCount]]) -> dict[str, Any]:
    """Return everything that was found, for machines."""
    from .ingest.overlap import time_zone

    names = {log.path: str(log.path) for log in logs}
    spans = [span for log in logs if (span := _span(log, names)) is not None]
    doubts = {id(log): reason for log, reason in _doubts(logs, names)}
    return {
        "repairs": [
            {"path": repair.path, "where": repair.where, "found": repair.found, "done": repair.done}
            for repair in database.repairs
        ],
        "logs": [_log_facts(log, doubts.get(id(log), "")) for log in logs],
        "topics": {
            str(path): [
                {"topic": found.topic.name, "schema": found.topic.schema, "encoding": found.topic.encoding,
                 "read_as": found.purpose or None, **found.cadence.facts()}
                for found in listed
            ]
            for path, listed in topics.items() if listed
        },
        "overlap": [
            {"file": log.name, "holds": log.kind, "and_file": other.name, "and_holds": other.kind,
             "common_s": max(log.in_common(other), 0) / 1e9, "between_s": max(-log.in_common(other), 0) / 1e9,
             "time_zone_s": zone / 1e9 if log.in_common(other) < 0 and (zone := time_zone(log, other)) else None}
            for number, log in enumerate(spans)
            for other in spans[number + 1 :]
        ],
    }  # fmt: skip


def _log_facts(log: Inspection, doubt: str) -> dict[str, Any]:
    account, stamps = log.account, log.stamps
    facts: dict[str, Any] = {
        "path": str(log.path),
        "format": log.format,
        "holds": log.kind,
        "start": None if stamps.start is None else iso_utc(stamps.start),
        "stop": None if stamps.stop is None else iso_utc(stamps.stop),
        "accepted": account.accepted,
        "rejected": account.rejected,
        "truncated": account.truncated,
        "rejections": [{"where": where, "reason": reason} for where, reason in account.rejections],
        "remarks": [{"where": where, "reason": reason} for where, reason in account.remarks],
        "stamps": stamps.facts(),
        "doubt": doubt or None,
    }
    if log.kind == "can":
        facts["frames"] = dict(log.frame_kinds)
        facts["frames_of_further_messages"] = log.other_frames
        facts["messages"] = [
            {
                "channel": channel, "id": identifier, "extended": extended,
                "name": message.layout.name if message.layout else None,
                "bytes": [message.shortest, message.longest],
                "database_bytes": message.layout.length if message.layout else None,
                **message.cadence.facts(),
            }
            for (channel, identifier, extended), message in sorted(log.messages.items())
        ]  # fmt: skip
    elif log.kind == "nav":
        accuracy = log.accuracy
        known = accuracy.samples > 0
        facts["samples"] = log.samples.facts()
        facts["accuracy_m"] = {
            "best": accuracy.best if known else None, "median": accuracy.median if known else None,
            "worst": accuracy.worst if known else None, "samples": accuracy.samples,
        }  # fmt: skip
        facts["status"] = [
            {"from": iso_utc(period.start), "to": iso_utc(period.stop), "samples": period.samples,
             "code": period.status if period.status >= 0 else None, "name": log.status_name(period.status)}
            for period in log.periods
        ]  # fmt: skip
        facts["further_status_changes"] = log.more_periods
    else:
        facts["cameras"] = {camera: cadence.facts() for camera, cadence in log.cameras.items()}
    return facts
