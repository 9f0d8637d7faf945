"""The convert stage: a recording's raw logs to its `signals/` files and its synced table."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..schemas.config import Config
from ..schemas.errors import InputError
from ..schemas.project import Project, Recording
from ..schemas.store import describe_output, fingerprint, publish_table
from ..schemas.tables import SYNCED
from ..schemas.tasks import Outcome, Task
from .alignment import SECOND
from .bus_navigation import BusNavigation, read_bus_navigation
from .can.database import Database, load_databases
from .clock import BRIDGED_GAP_S, PERIOD_S, ClockEstimate, estimate_clock, to_utc
from .dead_reckoning import dead_reckon
from .mapping import MappedSignal, resolve, resolve_navigation
from .memory import give_memory_back, leave_out_asammdf, leave_out_pandas
from .plausibility import absent_sources, no_overlap, too_long, unknown_clock, wrong_signs
from .recording_logs import read_logs, recording_files
from .signal_files import signal_file
from .stored_signals import NavigationSignal, SampledSignal, Signal, StoredSignal, find_mapped, find_navigation
from .synchronise import synchronise


def plan_conversion(project: Project) -> tuple[list[Task], list[InputError]]:
    """Plan one task for each recording.

    Returns:
        The tasks, and what is wrong with the databases and the mapping: everything else is converted all the same.

    Raises:
        InputError: The project file is missing or wrong, or no recording is found.
    """
    config = project.config
    config_file = project.directory / "wheelprint.toml"
    leave_out_asammdf()
    leave_out_pandas()
    database, problems = load_databases(config.can.database, project.directory)
    mapping, unmapped = resolve(config.can, database, config_file)
    nav_mapping, not_found = resolve_navigation(config.nav, database, config_file)
    problems += [*unmapped, *not_found]
    if not config.can.signals:
        reason = 'nothing is mapped; name at least steering_wheel_angle = "Message.Signal" and speed'
        problems.append(InputError(config_file, "can.signals", reason))
    parameters = {
        "version": __version__,
        "database": fingerprint(repr(database.messages)),
        "mapping": {name: asdict(mapped) for name, mapped in mapping.items()},
        "nav": config.nav.model_dump(),
        "sync": config.sync.model_dump(),
        "columns": SYNCED.names,
    }
    tasks = []
    for recording in project.recordings():
        files = recording_files(recording)
        states = [(name, path.stat().st_size, path.stat().st_mtime_ns) for name, path in files.items() if path.exists()]
        arguments = {
            "project": project.directory, "recording": recording, "config": config, "database": database,
            "mapping": mapping, "nav_mapping": nav_mapping,
        }  # fmt: skip
        made_from = fingerprint({**parameters, "files": states})
        tasks.append(Task("recordings", recording.key, convert_recording, arguments, made_from))
    return tasks, problems


def convert_recording(
    project: Path,
    recording: Recording,
    config: Config,
    database: Database,
    mapping: Mapping[str, MappedSignal],
    nav_mapping: Mapping[str, MappedSignal],
) -> Outcome:
    """Convert one recording and publish its files.

    Args:
        project: Project folder.
        recording: What to convert; its folder is only read.
        config: The project file.
        database: The messages to decode.
        mapping: The canonical signals that were found in the database.
        nav_mapping: The quantities of navigation that were found there.

    Returns:
        The manifest entry: inputs with their accounts, clock, origin, signals, outputs.

    Raises:
        InputError: The recording holds no log at all.
    """
    place = Project(project)
    folder = place.signals_folder(recording.driver, recording.name)
    logs = read_logs(project, recording, database, folder, config.nav)
    problems = logs.problems
    stored, signal_facts = _find_signals(logs.message_files, mapping, recording, problems)
    max_gap = round(config.sync.max_gap * 1e9)
    bus = read_bus_navigation(logs.message_files, nav_mapping, max_gap)
    from_bus = not logs.navigation and bus is not None and bool(bus.signals) and config.nav.format in ("auto", "can")
    measured, origin = find_navigation(logs.navigation)
    clock = _clock(config, stored, measured, bus, from_bus=from_bus)
    give_memory_back()
    if bus is not None and from_bus:
        file = signal_file(folder, "can", "navigation")
        publish_table(file, navigation := bus.table(clock, round(config.nav.latency * 1e9)))
        logs.outputs.append(describe_output(project, file, rows=len(navigation)))
        measured, origin = find_navigation([file])
    nav_signals: dict[str, Signal] = dict(measured)
    path_from_bus = _path_from_bus(config, stored, nav_signals, clock)
    problems += absent_sources(recording, mapping, stored, nav_signals)
    entry: dict[str, Any] = {
        "driver": recording.driver,
        "inputs": logs.inputs,
        "ignored": logs.ignored,
        "database_repairs": [str(repair) for repair in database.repairs],
        "outputs": logs.outputs,
        "signals": signal_facts,
        "navigation": bus.sources if bus is not None and from_bus else {},
        "path_from_bus": path_from_bus,
        "clock": _clock_facts(clock),
        "origin": None if origin is None else asdict(origin),
    }
    if mismatch := no_overlap(recording, stored, nav_signals, clock) or too_long(recording, stored, nav_signals):
        return Outcome(entry, (*problems, mismatch))
    if not stored and not nav_signals:
        return Outcome(entry, tuple(problems))
    if config.sync.clock == "estimate" and path_from_bus is None:
        problems += unknown_clock(recording, stored, nav_signals, clock)
    synced = synchronise(stored, nav_signals, clock, config.sync.period, max_gap)
    problems += wrong_signs(recording, synced, mapping, stored, config.sync.rate)
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


def _find_signals(
    files: Mapping[str, list[Path]],
    mapping: Mapping[str, MappedSignal],
    recording: Recording,
    problems: list[InputError],
) -> tuple[dict[str, StoredSignal], dict[str, Any]]:
    stored: dict[str, StoredSignal] = {}
    facts: dict[str, Any] = {}
    for canonical, mapped in mapping.items():
        signal = find_mapped(files[mapped.message], mapped) if mapped.message in files else None
        if signal is None:
            on = f" on channel {mapped.channel}" if mapped.channel else ""
            reason = f"the recording holds no frame of message {mapped.message}{on}, which {canonical} is mapped to"
            problems.append(InputError(recording.folder, f"can.signals.{canonical}", reason))
            continue
        if signal.out_of_range:
            reason = f"{signal.out_of_range} of {signal.samples} samples lie outside the signal's range and are null"
            problems.append(InputError(recording.folder, f"can.signals.{canonical}", reason))
        stored[canonical] = signal
        facts[canonical] = asdict(replace(mapped, channel=signal.channel, source=signal.source)) | {
            "samples": signal.samples,
            "out_of_range": signal.out_of_range,
        }
    return stored, facts


def _clock(
    config: Config,
    can: Mapping[str, StoredSignal],
    nav: Mapping[str, NavigationSignal],
    bus: BusNavigation | None,
    *,
    from_bus: bool,
) -> ClockEstimate:
    """Return what the project file says; else what the unit's own time on the bus says; else what signals say."""
    if config.sync.clock == "trust":
        return ClockEstimate.trusted("the project file says that the CAN clock is UTC")
    if not isinstance(config.sync.clock, str):
        return ClockEstimate.fixed(config.sync.clock, "the project file gives the offset")
    if bus is not None and bus.clock is not None and bus.clock.applied:
        return bus.clock
    if from_bus and bus is not None:
        why = f": {bus.clock.reason}" if bus.clock is not None else ", which tells no time of its own"
        reason = f"navigation is on the clock of the CAN frames that it comes from{why}; UTC is the logger's"
        return ClockEstimate.fixed(0.0, reason)
    nothing = SampledSignal(np.array([], np.int64), np.array([]))
    if "nav_speed" not in nav and "nav_yaw_rate" not in nav:
        can = {}  # There is nothing to compare them with.
    speed = can["speed"].read() if "speed" in can else nothing
    yaw = can["yaw_rate"].read() if "yaw_rate" in can else None
    # Of hours at 100 Hz the means are enough, and shift nothing.
    period, max_gap = round(PERIOD_S * SECOND) // 2, round(BRIDGED_GAP_S * SECOND)
    nav_speed = nav["nav_speed"].means(period, max_gap) if "nav_speed" in nav else nothing
    nav_yaw = nav["nav_yaw_rate"].means(period, max_gap) if "nav_yaw_rate" in nav else None
    # Steering is the last resort, and not worth the memory where it is not taken.
    better = any(np.count_nonzero(np.isfinite(signal.values)) > 2 for signal in (speed, yaw) if signal)
    steering = can["steering_wheel_angle"].read() if "steering_wheel_angle" in can and not better else None
    return estimate_clock(
        speed.time,
        speed.values,
        nav_speed.time,
        nav_speed.values,
        can_yaw_rate=(yaw.time, yaw.values) if yaw else None,
        nav_yaw_rate=(nav_yaw.time, nav_yaw.values) if nav_yaw else None,
        can_steering=(steering.time, steering.values) if steering else None,
    )


def _path_from_bus(
    config: Config, can: Mapping[str, StoredSignal], navigation: dict[str, Signal], clock: ClockEstimate
) -> dict[str, Any] | None:
    """Where navigation has no position and the project file allows it, integrate one and add it to `navigation`."""
    if "x" in navigation or not config.nav.dead_reckoning:
        return None
    sampled = {name: can[name].read() for name in ("speed", "yaw_rate") if name in can}
    reckoned = dead_reckon(sampled, config.sync.period, round(config.sync.max_gap * 1e9))
    if reckoned is None:
        return None
    for name, signal in reckoned.signals.items():
        navigation.setdefault(name, SampledSignal(to_utc(signal.time, clock), signal.values))
    return reckoned.facts


def _clock_facts(clock: ClockEstimate) -> dict[str, Any]:
    facts = asdict(clock)
    return {
        name: None if isinstance(value, float) and not np.isfinite(value) else value for name, value in facts.items()
    }
