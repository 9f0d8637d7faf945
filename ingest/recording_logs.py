"""A recording's raw logs: every file read once, decoded into `signals/`, and accounted for."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, cast

import pyarrow as pa

from ..schemas.config import Nav
from ..schemas.errors import InputError
from ..schemas.project import Project, Recording
from ..schemas.store import describe_output, fingerprint, publish, publish_table, sha256
from ..schemas.times import iso_utc
from .account import Account
from .cameras import IMAGES, CameraIndex
from .can.database import Database
from .mapped_table import mapped_table
from .memory import give_memory_back, keep_memory, leave_out_scipy
from .navigation import navigation_writer
from .oxts.kitti import Kitti
from .readers import FrameReader, NavigationReader, Reader, formats_of, recognise
from .recording_cameras import Span, camera_facts, find_cameras, read_cameras, time_in_common
from .signal_files import as_facts, decode_log, signal_file
from .stamps import Stamps

BESIDE_LOGS = frozenset(
    ".arxml .avi .dbc .doc .docx .jpeg .jpg .json .kcd .md .mkv .mp4 .pdf .png .sym .toml .txt .xls .xlsx .xml".split()
)
"""Suffixes of what people keep beside logs; such a file that no reader claims is listed, but is not a problem."""


def recording_files(recording: Recording) -> dict[str, Path]:
    """Return a recording's files by their path within it, sorted; hidden ones are left out.

    A folder that is linked is followed, once, unless it is within the recording, whose files are there anyway, or
    holds the recording.
    """
    home = recording.folder.resolve()
    found: dict[str, Path] = {}
    seen: set[Path] = set()
    for place, folders, names in os.walk(recording.folder, followlinks=True):
        folder = Path(place)
        folders.sort()
        for name in tuple(folders):
            inner = folder / name
            target = inner.resolve()
            known = target in seen or target.is_relative_to(home) or home.is_relative_to(target)
            if inner.is_symlink() and known:
                folders.remove(name)
            seen.add(target)
        for path in (folder / name for name in names if not name.startswith(".")):
            if path.is_file() or path.is_symlink():
                found[path.relative_to(recording.folder).as_posix()] = path
    return {name: found[name] for name in sorted(found)}


@dataclass(slots=True)
class RawLogs:
    """What became of a recording's files; the attributes but the tables go into the manifest."""

    inputs: list[dict[str, Any]] = field(default_factory=list)
    ignored: list[str] = field(default_factory=list)
    outputs: list[dict[str, Any]] = field(default_factory=list)
    problems: list[InputError] = field(default_factory=list)
    message_files: dict[str, list[Path]] = field(default_factory=dict)
    navigation: list[Path] = field(default_factory=list)


def read_logs(project: Path, recording: Recording, database: Database, folder: Path, nav: Nav) -> RawLogs:
    """Decode every file of a recording into `folder`; what cannot be read becomes a problem of its own."""
    keep_memory()
    leave_out_scipy()
    logs = RawLogs()
    belonging: set[str] = set()
    spans: dict[str, list[Span]] = {}
    files = recording_files(recording)
    cameras, logs.ignored = find_cameras(files, recording.folder)
    for name, path in files.items():
        if path.suffix.lower() in IMAGES:
            continue
        also: list[str] = []
        try:
            if mapped := mapped_table(name, path, nav):
                readers: tuple[Reader, ...] = (mapped,)
                also = formats_of(path)
            else:
                readers = recognise(path)
        except InputError as error:
            if path.suffix.lower() in BESIDE_LOGS and path.exists() and name not in cameras:
                logs.ignored.append(name)
            elif name not in cameras:
                logs.problems.append(error.as_problem())
            continue
        for reader in readers:
            if reader.kind == "nav" and nav.format not in ("auto", reader.format):
                logs.ignored.append(name)
                continue
            if isinstance(reader, Kitti):
                belonging.update(part.relative_to(recording.folder).as_posix() for part in reader.parts())
            account, stamps = Account(), Stamps()
            try:
                if reader.kind == "can":
                    facts, stamps = _read_can(project, reader, account, database, folder, name, logs)
                else:
                    facts, stamps = _read_nav(project, reader, account, folder, name, logs)
            except InputError as error:
                logs.problems.append(error.as_problem())
                facts = {"failed": str(error)}
            give_memory_back()
            if len(readers) > 1 and not account.accepted and not account.rejected and "failed" not in facts:
                continue  # The format may hold this kind of record; this file does not.
            if stamps.start is not None and stamps.stop is not None:
                spans.setdefault(reader.kind, []).append((stamps.start, stamps.stop))
            if also:
                facts["looks_like"] = also  # The project file names it, and that counts.
            logs.inputs.append(_input_facts(name, path, reader, account, stamps) | facts)
            logs.problems += [*_account_problems(path, account), *stamps.problems(path)]
    _read_cameras(project, recording, cameras, files, spans, logs)
    logs.ignored = sorted(name for name in logs.ignored if name not in belonging)
    if all("failed" in entry for entry in logs.inputs):
        reasons = "; ".join(dict.fromkeys(str(problem) for problem in logs.problems))
        what = f"none of its files could be read: {reasons}" if reasons else "it holds no log"
        raise InputError(recording.folder, "", f"{what}. A recording is a folder with a CAN log and a navigation log")
    return logs


def _read_can(
    project: Path, reader: Reader, account: Account, database: Database, folder: Path, name: str, logs: RawLogs
) -> tuple[dict[str, Any], Stamps]:
    decoded = decode_log(cast("FrameReader", reader), account, database, folder, name)
    for message, file in decoded.files.items():
        logs.message_files.setdefault(message, []).append(file)
        logs.outputs.append(describe_output(project, file, rows=decoded.rows[message]))
    return as_facts(decoded), decoded.stamps


def _read_nav(
    project: Path, reader: Reader, account: Account, folder: Path, name: str, logs: RawLogs
) -> tuple[dict[str, Any], Stamps]:
    batches, stamps = cast("NavigationReader", reader).batches(account), Stamps()
    begun = next(batches, None)
    if begun is None:
        return {"samples": 0}, stamps
    file = signal_file(folder, name, "navigation")
    samples = 0
    with publish(file) as draft, navigation_writer(draft, begun.schema) as writer:
        for batch in chain((begun,), batches):
            writer.write_batch(batch)
            samples += len(batch)
            stamps.add(batch["time"].cast(pa.int64()).to_numpy())
    logs.outputs.append(describe_output(project, file, rows=samples))
    logs.navigation.append(file)
    return {"samples": samples}, stamps


def _read_cameras(
    project: Path,
    recording: Recording,
    indexes: Mapping[str, CameraIndex],
    files: Mapping[str, Path],
    spans: Mapping[str, list[Span]],
    logs: RawLogs,
) -> None:
    """Publish one index of all frames, and account for each source."""
    sources, problems = read_cameras(indexes, recording, files)
    logs.problems += problems
    for name, source in sources.items():
        path, stamps = source.index.path, Stamps()
        stamps.add(source.frames["time"].cast(pa.int64()).to_numpy())
        facts = _input_facts(name, path, source.index, source.account, stamps)
        logs.problems += _account_problems(path, source.account)
        if source.failed:
            logs.problems.append(source.failed)
            facts["failed"] = str(source.failed)
        if len(source.frames):
            clock, mismatch = time_in_common(source.frames, spans)
            facts |= {"cameras": camera_facts(source.frames), "clock": clock}
            logs.problems += [InputError(path, "", mismatch)] if mismatch else []
        logs.inputs.append(facts)
    tables = [source.frames for source in sources.values() if len(source.frames)]
    if tables:
        frames = pa.concat_tables(tables)
        file = Project(project).cameras_file(recording.driver, recording.name)
        publish_table(file, frames.sort_by("time"))
        logs.outputs.append(describe_output(project, file, rows=len(frames)))


def _input_facts(
    name: str, path: Path, reader: Reader | CameraIndex, account: Account, stamps: Stamps
) -> dict[str, Any]:
    digest, size = _digest(path)
    return {
        "path": name,
        "sha256": digest,
        "bytes": size,
        **({"parts_sha256": _sha256_of_parts(reader)} if isinstance(reader, Kitti) else {}),
        "format": reader.format,
        "kind": reader.kind,
        "accepted": account.accepted,
        "rejected": account.rejected,
        "truncated": account.truncated,
        "rejections": [{"where": where, "reason": reason} for where, reason in account.rejections],
        "remarks": [{"where": where, "reason": reason} for where, reason in account.remarks],
        "start": None if stamps.start is None else iso_utc(stamps.start),
        "stop": None if stamps.stop is None else iso_utc(stamps.stop),
        "stamps": stamps.facts(),
    }


def _digest(path: Path) -> tuple[str, int]:
    """Return SHA-256 and size of a file; of a folder of images, which may be many gigabytes, those of its listing."""
    if not path.is_dir():
        return sha256(path), path.stat().st_size
    sizes = {image.name: image.stat().st_size for image in path.iterdir() if image.suffix.lower() in IMAGES}
    return fingerprint(sizes), sum(sizes.values())


def _sha256_of_parts(reader: Kitti) -> str:
    """Return one hash for all files of a recording that is a folder: of their names and hashes."""
    return fingerprint({part.name: sha256(part) for part in reader.parts()})


def _account_problems(path: Path, account: Account) -> list[InputError]:
    problems = [InputError(path, where, reason) for where, reason in account.remarks]
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
