"""A recording's raw logs: every file read once, decoded into `signals/`, and accounted for."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, cast

from ..schemas.errors import InputError
from ..schemas.project import Recording
from ..schemas.store import describe_output, fingerprint, parquet_writer, publish, sha256
from ..schemas.times import iso_utc
from .account import Account
from .can.database import Database
from .oxts.kitti import Kitti
from .readers import FrameReader, NavigationReader, Reader, recognise
from .signal_files import as_facts, decode_log, signal_file

BESIDE_LOGS = frozenset(
    ".arxml .avi .dbc .doc .docx .jpeg .jpg .json .kcd .md .mkv .mp4 .pdf .png .sym .toml .txt .xls .xlsx .xml".split()
)
"""Suffixes of what people keep beside logs; such a file that no reader claims is listed, but is not a problem."""


def recording_files(recording: Recording) -> dict[str, Path]:
    """Return a recording's files by their path within it, sorted; hidden ones are left out."""
    found = {
        path.relative_to(recording.folder).as_posix(): path
        for path in recording.folder.rglob("*")
        if (path.is_file() or path.is_symlink()) and not path.is_dir()
    }
    return {name: found[name] for name in sorted(found) if not Path(name).name.startswith(".")}


Span = tuple[int | None, int | None]
"""First and last stamp, ns; None where there is none."""


@dataclass(slots=True)
class RawLogs:
    """What became of a recording's files; the attributes but the tables go into the manifest."""

    inputs: list[dict[str, Any]] = field(default_factory=list)
    ignored: list[str] = field(default_factory=list)
    outputs: list[dict[str, Any]] = field(default_factory=list)
    problems: list[InputError] = field(default_factory=list)
    message_files: dict[str, list[Path]] = field(default_factory=dict)
    navigation: list[Path] = field(default_factory=list)


def read_logs(project: Path, recording: Recording, database: Database, folder: Path, nav_format: str) -> RawLogs:
    """Decode every file of a recording into `folder`; what cannot be read becomes a problem of its own."""
    logs = RawLogs()
    belonging: set[str] = set()
    for name, path in recording_files(recording).items():
        try:
            readers = recognise(path)
        except InputError as error:
            if path.suffix.lower() in BESIDE_LOGS and path.exists():
                logs.ignored.append(name)
            else:
                logs.problems.append(error)
            continue
        for reader in readers:
            if reader.kind == "nav" and nav_format not in ("auto", reader.format):
                logs.ignored.append(name)
                continue
            if isinstance(reader, Kitti):
                belonging.update(part.relative_to(recording.folder).as_posix() for part in reader.parts())
            account = Account()
            try:
                if reader.kind == "can":
                    facts, span = _read_can(project, reader, account, database, folder, name, logs)
                else:
                    facts, span = _read_nav(project, reader, account, folder, name, logs)
            except InputError as error:
                logs.problems.append(error)
                facts, span = {"failed": str(error)}, (None, None)
            if len(readers) > 1 and not account.accepted and not account.rejected and "failed" not in facts:
                continue  # The format may hold this kind of record; this file does not.
            logs.inputs.append(_input_facts(recording, path, reader, account, span) | facts)
            logs.problems += _account_problems(path, account)
    logs.ignored = [name for name in logs.ignored if name not in belonging]
    if all("failed" in entry for entry in logs.inputs):
        reasons = "; ".join(dict.fromkeys(str(problem) for problem in logs.problems))
        what = f"none of its files could be read: {reasons}" if reasons else "it holds no log"
        raise InputError(recording.folder, "", f"{what}. A recording is a folder with a CAN log and a navigation log")
    return logs


def _read_can(
    project: Path, reader: Reader, account: Account, database: Database, folder: Path, name: str, logs: RawLogs
) -> tuple[dict[str, Any], Span]:
    decoded = decode_log(cast("FrameReader", reader), account, database, folder, name)
    for message, file in decoded.files.items():
        logs.message_files.setdefault(message, []).append(file)
        logs.outputs.append(describe_output(project, file, rows=decoded.rows[message]))
    return as_facts(decoded), (decoded.start, decoded.stop)


def _read_nav(
    project: Path, reader: Reader, account: Account, folder: Path, name: str, logs: RawLogs
) -> tuple[dict[str, Any], Span]:
    batches = cast("NavigationReader", reader).batches(account)
    begun = next(batches, None)
    if begun is None:
        return {"samples": 0}, (None, None)
    file = signal_file(folder, name, "navigation")
    samples, start, stop = 0, None, None
    with publish(file) as draft, parquet_writer(draft, begun.schema) as writer:
        for batch in chain((begun,), batches):
            writer.write_batch(batch)
            if len(batch):
                samples += len(batch)
                start = batch["time"][0].value if start is None else start
                stop = batch["time"][-1].value
    logs.outputs.append(describe_output(project, file, rows=samples))
    logs.navigation.append(file)
    return {"samples": samples}, (start, stop)


def _input_facts(recording: Recording, path: Path, reader: Reader, account: Account, span: Span) -> dict[str, Any]:
    return {
        "path": path.relative_to(recording.folder).as_posix(),
        "sha256": sha256(path),
        "bytes": path.stat().st_size,
        **({"parts_sha256": _sha256_of_parts(reader)} if isinstance(reader, Kitti) else {}),
        "format": reader.format,
        "kind": reader.kind,
        "accepted": account.accepted,
        "rejected": account.rejected,
        "truncated": account.truncated,
        "rejections": [{"where": where, "reason": reason} for where, reason in account.rejections],
        "start": None if span[0] is None else iso_utc(span[0]),
        "stop": None if span[1] is None else iso_utc(span[1]),
    }


def _sha256_of_parts(reader: Kitti) -> str:
    """Return one hash for all files of a recording that is a folder: of their names and hashes."""
    return fingerprint({part.name: sha256(part) for part in reader.parts()})


def _account_problems(path: Path, account: Account) -> list[InputError]:
    problems = []
    if account.rejected:
        where, reason = account.rejections[0]
        more = f"; {account.rejected - 1} more are in manifest.json" if account.rejected > 1 else ""
        total = account.accepted + account.rejected
        problems.append(InputError(path, where, f"{account.rejected} of {total} records rejected: {reason}{more}"))
    if account.truncated:
        reason = (
            "the file ends within a record, which is lost; the logger may have been cut off or the copy is not whole"
        )
        problems.append(InputError(path, "end", reason))
    return problems
