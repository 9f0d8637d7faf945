"""The convert stage: a recording's raw logs to its `signals/` files and its synced table."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pyarrow as pa

from .. import __version__
from ..schemas.config import Config
from ..schemas.errors import InputError
from ..schemas.project import Project, Recording
from ..schemas.signals import SIGNALS
from ..schemas.store import describe_output, fingerprint, publish_table, sha256
from ..schemas.tasks import Outcome, Task
from ..schemas.times import iso_utc
from ..schemas.units import factor as unit_factor
from .account import Account
from .can.database import Database, load_databases
from .clock import ClockEstimate, estimate_clock
from .mapping import MappedSignal, resolve
from .navigation import merge_navigation
from .oxts.kitti import Kitti
from .readers import FrameReader, NavigationReader, Reader, recognise
from .signal_files import as_facts, decode_log, signal_file
from .signs import reversed_signals
from .synchronise import SampledSignal, read_mapped, read_navigation, synchronise

DAY = 86_400_000_000_000
LONGEST_RECORDING = 7 * DAY

BESIDE_LOGS = frozenset(
    ".arxml .avi .dbc .doc .docx .jpeg .jpg .json .kcd .md .mkv .mp4 .pdf .png .sym .toml .txt .xls .xlsx .xml".split()
)
"""Suffixes of what people keep beside logs; such a file that no reader claims is listed, but is not a problem."""


def plan_conversion(project: Project) -> tuple[list[Task], list[InputError]]:
    """Plan one task for each recording.

    Returns:
        The tasks, and what is wrong with the databases and the mapping: everything else is converted all the same.

    Raises:
        InputError: The project file is missing or wrong, or no recording is found.
    """
    config = project.config
    config_file = project.directory / "wheelprint.toml"
    database, problems = load_databases(config.can.database, project.directory)
    mapping, unmapped = resolve(config.can, database, config_file)
    problems += unmapped
    if not config.can.signals:
        reason = 'nothing is mapped; name at least steering_wheel_angle = "Message.Signal" and speed'
        problems.append(InputError(config_file, "can.signals", reason))
    parameters = {
        "version": __version__,
        "database": fingerprint(repr(database.messages)),
        "mapping": {name: asdict(mapped) for name, mapped in mapping.items()},
        "nav": config.nav.model_dump(),
        "sync": config.sync.model_dump(),
    }
    tasks = []
    for recording in project.recordings():
        files = recording_files(recording)
        states = [(name, path.stat().st_size, path.stat().st_mtime_ns) for name, path in files.items() if path.exists()]
        arguments = {
            "project": project.directory, "recording": recording, "config": config, "database": database,
            "mapping": mapping,
        }  # fmt: skip
        made_from = fingerprint({**parameters, "files": states})
        tasks.append(Task("recordings", recording.key, convert_recording, arguments, made_from))
    return tasks, problems


def recording_files(recording: Recording) -> dict[str, Path]:
    """Return a recording's files by their path within it, sorted; hidden ones are left out."""
    found = {
        path.relative_to(recording.folder).as_posix(): path
        for path in recording.folder.rglob("*")
        if (path.is_file() or path.is_symlink()) and not path.is_dir()
    }
    return {name: found[name] for name in sorted(found) if not Path(name).name.startswith(".")}


def convert_recording(
    project: Path, recording: Recording, config: Config, database: Database, mapping: Mapping[str, MappedSignal]
) -> Outcome:
    """Convert one recording and publish its files.

    Args:
        project: Project folder.
        recording: What to convert; its folder is only read.
        config: The project file.
        database: The messages to decode.
        mapping: The canonical signals that were found in the database.

    Returns:
        The manifest entry: inputs with their accounts, clock, origin, signals, outputs.

    Raises:
        InputError: The recording holds no log at all.
    """
    place = Project(project)
    folder = place.signals_folder(recording.driver, recording.name)
    logs = _read_logs(project, recording, database, folder, config.nav.format)
    problems = logs.problems
    sampled, signal_facts = _read_signals(logs.message_files, mapping, recording, problems)
    navigation = merge_navigation(logs.navigation) if logs.navigation else None
    nav_signals = read_navigation(navigation) if navigation is not None else {}
    problems += _absent_sources(recording, mapping, sampled, nav_signals)
    clock = _clock(config, sampled, nav_signals)
    entry: dict[str, Any] = {
        "driver": recording.driver,
        "inputs": logs.inputs,
        "ignored": logs.ignored,
        "database_repairs": [str(repair) for repair in database.repairs],
        "outputs": logs.outputs,
        "signals": signal_facts,
        "clock": _clock_facts(clock),
        "origin": _origin(navigation),
    }
    if mismatch := _no_overlap(recording, sampled, nav_signals, clock) or _too_long(recording, sampled, nav_signals):
        return Outcome(entry, (*problems, mismatch))
    if not sampled and not nav_signals:
        return Outcome(entry, tuple(problems))
    synced = synchronise(sampled, nav_signals, clock, config.sync.period, round(config.sync.max_gap * 1e9))
    problems += _wrong_signs(recording, synced, mapping, sampled, config.sync.rate)
    metadata = {
        "driver": recording.driver,
        "recording": recording.name,
        "wheelprint": __version__,
        "sync": config.sync.model_dump_json(),
        "clock": json.dumps(entry["clock"], sort_keys=True),
        "origin": json.dumps(entry["origin"], sort_keys=True),
        "signals": json.dumps(signal_facts, sort_keys=True),
        "inputs": json.dumps({file["path"]: file["sha256"] for file in logs.inputs}, sort_keys=True),
    }
    path = place.synced_file(recording.driver, recording.name)
    publish_table(path, synced.replace_schema_metadata(metadata))
    runs = synced["run"].drop_null()
    facts = {"rows": len(synced), "runs": len(runs.unique()), "rows_in_runs": len(runs)}
    entry["outputs"] = [describe_output(project, path, **facts), *logs.outputs]
    return Outcome(entry, tuple(problems))


Span = tuple[int | None, int | None]
"""First and last stamp, ns; None where there is none."""


@dataclass(slots=True)
class _RawLogs:
    """What became of a recording's files; the attributes but the tables go into the manifest."""

    inputs: list[dict[str, Any]] = field(default_factory=list)
    ignored: list[str] = field(default_factory=list)
    outputs: list[dict[str, Any]] = field(default_factory=list)
    problems: list[InputError] = field(default_factory=list)
    message_files: dict[str, list[Path]] = field(default_factory=dict)
    navigation: list[pa.Table] = field(default_factory=list)


def _read_logs(project: Path, recording: Recording, database: Database, folder: Path, nav_format: str) -> _RawLogs:
    """Decode every file of a recording into `folder`; what cannot be read becomes a problem of its own."""
    logs = _RawLogs()
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
    project: Path, reader: Reader, account: Account, database: Database, folder: Path, name: str, logs: _RawLogs
) -> tuple[dict[str, Any], Span]:
    decoded = decode_log(cast("FrameReader", reader), account, database, folder, name)
    for message, file in decoded.files.items():
        logs.message_files.setdefault(message, []).append(file)
        logs.outputs.append(describe_output(project, file, rows=decoded.rows[message]))
    return as_facts(decoded), (decoded.start, decoded.stop)


def _read_nav(
    project: Path, reader: Reader, account: Account, folder: Path, name: str, logs: _RawLogs
) -> tuple[dict[str, Any], Span]:
    batches = list(cast("NavigationReader", reader).batches(account))
    if not batches:
        return {"samples": 0}, (None, None)
    table = pa.Table.from_batches(batches)
    file = signal_file(folder, name, "navigation")
    publish_table(file, table)
    logs.outputs.append(describe_output(project, file, rows=len(table)))
    logs.navigation.append(table)
    time = table["time"].cast(pa.int64()).to_numpy()
    return {"samples": len(time)}, (int(time[0]), int(time[-1])) if len(time) else (None, None)


def _origin(navigation: pa.Table | None) -> dict[str, float] | None:
    origin = (navigation.schema.metadata or {}).get(b"origin") if navigation is not None else None
    found: dict[str, float] | None = json.loads(origin) if origin else None
    return found


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


def _read_signals(
    files: Mapping[str, list[Path]],
    mapping: Mapping[str, MappedSignal],
    recording: Recording,
    problems: list[InputError],
) -> tuple[dict[str, SampledSignal], dict[str, Any]]:
    sampled: dict[str, SampledSignal] = {}
    facts: dict[str, Any] = {}
    for canonical, mapped in mapping.items():
        signal = read_mapped(files[mapped.message], mapped) if mapped.message in files else None
        if signal is None:
            on = f" on channel {mapped.channel}" if mapped.channel else ""
            reason = f"the recording holds no frame of message {mapped.message}{on}, which {canonical} is mapped to"
            problems.append(InputError(recording.folder, f"can.signals.{canonical}", reason))
            continue
        if signal.out_of_range:
            reason = f"{signal.out_of_range} of {len(signal.time)} samples lie outside the signal's range and are null"
            problems.append(InputError(recording.folder, f"can.signals.{canonical}", reason))
        sampled[canonical] = signal
        facts[canonical] = asdict(replace(mapped, channel=signal.channel, source=signal.source)) | {
            "samples": len(signal.time),
            "out_of_range": signal.out_of_range,
        }
    return sampled, facts


def _absent_sources(
    recording: Recording,
    mapping: Mapping[str, MappedSignal],
    sampled: Mapping[str, SampledSignal],
    navigation: Mapping[str, SampledSignal],
) -> list[InputError]:
    problems = []
    if "x" not in navigation:
        reason = "no navigation with a valid position; without it there is no path, and no dataset, from this recording"
        problems.append(InputError(recording.folder, "", reason))
    if not sampled and mapping:
        reason = "no CAN log with a mapped signal; without it there is no steering, and no dataset, from this recording"
        problems.append(InputError(recording.folder, "", reason))
    return problems


def _wrong_signs(
    recording: Recording,
    synced: pa.Table,
    mapping: Mapping[str, MappedSignal],
    sampled: Mapping[str, SampledSignal],
    rate: float,
) -> list[InputError]:
    names = [name for name in synced.column_names if name in sampled or name in ("nav_speed", "nav_yaw_rate")]
    signals = {name: synced[name].cast(pa.float64()).to_numpy() for name in names}
    problems = []
    for name, (what, correlation) in reversed_signals(signals, rate).items():
        mapped = mapping[name]
        sign = "1" if mapped.factor < 0 else "-1"
        scale = abs(mapped.factor)
        of_unit = unit_factor(mapped.unit, SIGNALS[name].unit)
        scaled = "" if of_unit == scale else f", scale = {scale!r}"
        reason = (
            f"{name} goes against {what} (correlation {correlation:.2f}): its sign is wrong. Write "
            f'{name} = {{ signal = "{mapped.message}.{mapped.signal}", sign = {sign}{scaled} }}'
        )
        problems.append(InputError(recording.folder, f"can.signals.{name}", reason))
    return problems


def _clock(config: Config, can: Mapping[str, SampledSignal], nav: Mapping[str, SampledSignal]) -> ClockEstimate:
    if config.sync.clock == "trust":
        return ClockEstimate.trusted("the project file says that the CAN clock is UTC")
    if not isinstance(config.sync.clock, str):
        return ClockEstimate.fixed(config.sync.clock, "the project file gives the offset")
    nothing = SampledSignal(np.array([], np.int64), np.array([]), "", 0)
    speed, nav_speed = can.get("speed", nothing), nav.get("nav_speed", nothing)
    yaw, nav_yaw = can.get("yaw_rate"), nav.get("nav_yaw_rate")
    return estimate_clock(
        speed.time,
        speed.values,
        nav_speed.time,
        nav_speed.values,
        can_yaw_rate=(yaw.time, yaw.values) if yaw else None,
        nav_yaw_rate=(nav_yaw.time, nav_yaw.values) if nav_yaw else None,
    )


def _clock_facts(clock: ClockEstimate) -> dict[str, Any]:
    facts = asdict(clock)
    return {
        name: None if isinstance(value, float) and not np.isfinite(value) else value for name, value in facts.items()
    }


def _no_overlap(
    recording: Recording, can: Mapping[str, SampledSignal], nav: Mapping[str, SampledSignal], clock: ClockEstimate
) -> InputError | None:
    if not can or not nav:
        return None
    shift = round(clock.offset_s * 1e9)
    can_start = min(int(signal.time.min()) for signal in can.values()) - shift
    can_stop = max(int(signal.time.max()) for signal in can.values()) - shift
    nav_start = min(int(signal.time.min()) for signal in nav.values())
    nav_stop = max(int(signal.time.max()) for signal in nav.values())
    if can_start < nav_stop and nav_start < can_stop:
        return None
    reason = (
        f"the CAN log ({iso_utc(can_start)} to {iso_utc(can_stop)}) and navigation ({iso_utc(nav_start)} to "
        f"{iso_utc(nav_stop)}) have no time in common; the logs of two drives may have been mixed up, or the CAN "
        "logger's clock is off: then give sync.clock its offset in seconds"
    )
    return InputError(recording.folder, "", reason)


def _too_long(
    recording: Recording, can: Mapping[str, SampledSignal], nav: Mapping[str, SampledSignal]
) -> InputError | None:
    """Refuse stamps that no drive has: one frame stamped 1970 would ask for a grid of decades."""
    for source, signals in (("the CAN log", can), ("navigation", nav)):
        start = min((int(signal.time.min()) for signal in signals.values()), default=0)
        stop = max((int(signal.time.max()) for signal in signals.values()), default=0)
        if stop - start > LONGEST_RECORDING:
            reason = (
                f"{source} goes from {iso_utc(start)} to {iso_utc(stop)}, longer than a recording can be "
                f"({LONGEST_RECORDING // DAY} days); some stamps are broken, or several recordings lie in one folder: "
                "remove those records, or give each recording its folder"
            )
            return InputError(recording.folder, "", reason)
    return None
