"""`wheelprint inspect`: tables of what raw logs hold."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .output import Report
from .schemas.errors import InputError
from .schemas.times import iso_utc

if TYPE_CHECKING:
    from .ingest.inspection import Inspection

FILE_HEADS = ("file", "format", "start", "stop", "seconds", "accepted", "rejected", "truncated")
MESSAGE_HEADS = ("channel", "id", "message", "frames", "rate, Hz", "longest gap, s")


def inspect_files(report: Report, files: Sequence[Path], databases: Sequence[str]) -> None:
    """Fill the report with a table of files, of each CAN log's messages, and of each navigation log's states."""
    from .ingest.can.database import load_databases
    from .ingest.inspection import inspect_log

    database, problems = load_databases(databases, Path())
    report.problems += problems
    if database.repairs:
        report.tables.append(("Repairs of the databases", ("repair",), [(str(repair),) for repair in database.repairs]))
    logs: list[Inspection] = []
    for path in files:
        try:
            logs += inspect_log(path, database)
        except InputError as error:
            report.problems.append(error)
    report.failed = not logs
    report.tables.append(("Logs", FILE_HEADS, [_file_row(log) for log in logs]))
    for log in logs:
        account = log.account
        report.problems += [InputError(log.path, where, reason) for where, reason in account.rejections]
        if account.truncated:
            report.problems.append(InputError(log.path, "end", "the file ends within a record"))
        if log.kind == "can":
            kinds = ", ".join(f"{count} {kind}" for kind, count in log.frame_kinds.items() if count)
            report.tables.append((f"{log.path.name}: {kinds} frames", MESSAGE_HEADS, _message_rows(log)))
        else:
            states: list[Sequence[Any]] = [(status, count) for status, count in sorted(log.statuses.items())]
            title = f"{log.path.name}: {log.samples} samples by navigation status"
            report.tables.append((title, ("status", "samples"), states))
    report.tables += _overlap(logs)


def _file_row(log: Inspection) -> Sequence[Any]:
    start, stop = log.start, log.stop
    seconds = None if start is None or stop is None else (stop - start) / 1e9
    return (
        str(log.path), log.format, None if start is None else iso_utc(start), None if stop is None else iso_utc(stop),
        seconds, log.account.accepted, log.account.rejected, "yes" if log.account.truncated else "no",
    )  # fmt: skip


def _message_rows(log: Inspection) -> list[Sequence[Any]]:
    rows: list[Sequence[Any]] = []
    for (channel, identifier, extended), count in sorted(log.messages.items()):
        seconds = (count.last - count.first) / 1e9
        rate = (count.frames - 1) / seconds if seconds > 0 else None
        shown = f"0x{identifier:08X}x" if extended else f"0x{identifier:03X}"
        rows.append((channel, shown, count.name, count.frames, rate, count.longest_gap / 1e9))
    return rows


def _overlap(logs: Sequence[Inspection]) -> list[tuple[str, Sequence[str], list[Sequence[Any]]]]:
    rows: list[Sequence[Any]] = []
    for index, log in enumerate(logs):
        for other in logs[index + 1 :]:
            if None in (log.start, log.stop, other.start, other.stop):
                continue
            start, stop = max(log.start or 0, other.start or 0), min(log.stop or 0, other.stop or 0)
            rows.append((log.path.name, other.path.name, max(0, stop - start) / 1e9))
    return [("Overlap", ("file", "and file", "common time, s"), rows)] if rows else []
