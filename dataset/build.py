"""The build stage: synced tables to `events.csv`, `situations.csv` and a task for the dataset of every driver."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from .. import __version__
from ..schemas.errors import InputError
from ..schemas.project import Project
from ..schemas.store import fingerprint, locked, read_table
from ..schemas.tasks import Task
from .detectors import propose_events
from .driver_dataset import build_driver
from .events import Event, merge_proposals, read_events, write_events
from .manoeuvres import propose_situations
from .path import Floats
from .provenance import parameters_of
from .reference import find_references
from .segments import PathClustering
from .situations import Situation, update_situations
from .steering import calibrate, steering_series
from .stretches import Stretch


def plan_build(project: Project, cluster: PathClustering) -> tuple[list[Task], list[InputError]]:
    """Calibrate the steering, bring `events.csv` and `situations.csv` up to date, and plan one task for each driver.

    Args:
        project: Whose synced tables are built upon.
        cluster: Clusters path segments; a function of a module's top level.

    Returns:
        The tasks, and which recordings, events and situations cannot be used.

    Raises:
        InputError: No recording is converted yet, `events.csv` or `situations.csv` is wrong, or the steering cannot be
            calibrated.
    """
    config = project.config
    synced, problems = _synced_files(project)
    existing, padding = read_events(project.events_file), round(config.events.padding * 1e9)
    proposals: list[Event] = []
    situations: list[Situation] = []
    steered: list[Floats] = []
    for driver, files in synced.items():
        tables, lost = _read_synced(project, files)
        problems += lost
        synced[driver] = {name: files[name] for name in tables}
        recordings = {f"{driver}/{name}": table for name, table in tables.items()}
        found = propose_events(recordings, config.events, config.sync.period, config.vehicle.wheelbase)
        left_out = [event for event in merge_proposals(existing, found, padding) if event.is_left_out]
        situations += propose_situations(recordings, left_out, config.situations, config.sync.period)
        proposals += found
        steered += [steering_series(table) for table in tables.values()]
    if not steered:
        reasons = "; ".join(map(str, problems))
        raise InputError(
            project.directory, "", f"no recording is converted; run `wheelprint convert` first ({reasons})"
        )
    with locked(project.directory):  # Decisions that were made meanwhile, in the browser, count.
        write_events(project.events_file, merge_proposals(read_events(project.events_file), proposals, padding))
        events = read_events(project.events_file)
        situations = update_situations(project.situations_file, situations, config.situations.names)
    problems += _strays(project, project.events_file, events) + _strays(project, project.situations_file, situations)
    steering, doubts = calibrate(project, synced, steered)
    problems += doubts

    tasks = []
    for driver, files in synced.items():
        own = [event for event in events if event.recording.startswith(f"{driver}/")]
        references, missing = find_references(project.directory, config.lookahead.reference, driver, files)
        problems += missing
        driven_in = [situation for situation in situations if situation.recording.startswith(f"{driver}/")]
        made_from = {
            "version": __version__,
            "parameters": parameters_of(config, steering),
            "cluster": [getattr(cluster, "__module__", ""), getattr(cluster, "__qualname__", "")],
            "synced": files,
            "references": references,
            "events": [(e.recording, e.start, e.stop, e.kind, e.decision) for e in own if e.is_left_out],
            "situations": [(s.recording, s.start, s.stop, s.situation, s.decision) for s in driven_in],
        }
        arguments = {
            "project": project.directory, "driver": driver, "synced": files, "events": own, "situations": driven_in,
            "steering": steering, "config": config, "cluster": cluster, "references": references,
        }  # fmt: skip
        tasks.append(Task("dataset", driver, build_driver, arguments, fingerprint(made_from)))
    return tasks, problems


def _synced_files(project: Project) -> tuple[dict[str, dict[str, tuple[str, str]]], list[InputError]]:
    """Return driver -> recording -> path and SHA-256 of the synced tables that the manifest confirms."""
    entries = project.manifest.get("recordings", {})
    files: dict[str, dict[str, tuple[str, str]]] = {}
    problems: list[InputError] = []
    for recording in project.recordings():
        path = project.synced_file(recording.driver, recording.name)
        relative = path.relative_to(project.directory).as_posix()
        outputs = entries.get(recording.key, {}).get("outputs", ())
        confirmed = next((output for output in outputs if output["path"] == relative), None)
        of_driver = files.setdefault(recording.driver, {})
        if confirmed is None:
            reason = "it has no synced table and is left out of the dataset; `wheelprint convert` says why"
            problems.append(InputError(recording.folder, "", reason))
        elif not path.is_file() or path.stat().st_size != confirmed["bytes"]:
            reason = "not the file that `wheelprint convert` wrote, and left out of the dataset; run it again"
            problems.append(InputError(path, "", reason))
        else:
            of_driver[recording.name] = (relative, confirmed["sha256"])
    return files, problems


def _read_synced(
    project: Project, files: Mapping[str, tuple[str, str]]
) -> tuple[dict[str, pa.Table], list[InputError]]:
    """Return the synced tables by recording, without those that are damaged or on another grid than is asked for."""
    sync = project.config.sync
    tables: dict[str, pa.Table] = {}
    problems: list[InputError] = []
    for name, (file, _) in files.items():
        try:
            table = read_table(project.directory / file)
        except InputError as error:
            problems.append(error)
            continue
        steps = np.unique(np.diff(table["time"].cast(pa.int64()).to_numpy()))
        if np.any(steps != sync.period):
            found = " or ".join(f"{step / 1e9:g}" for step in steps[:3])
            reason = (
                f"its rows are {found} s apart where sync.rate = {sync.rate:g} Hz asks for {sync.period / 1e9:g} s, "
                "and it is left out of the dataset; run `wheelprint convert` again"
            )
            problems.append(InputError(project.directory / file, "time", reason))
            continue
        tables[name] = table
    return tables, problems


def _strays(project: Project, path: Path, stretches: Sequence[Stretch]) -> list[InputError]:
    """Return a problem for every recording of a file of stretches that the project does not have."""
    known = [recording.key for recording in project.recordings()]
    problems = []
    for name in sorted({stretch.recording for stretch in stretches} - set(known)):
        near = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean {near[0]}?" if near else "correct or remove its lines"
        problems.append(InputError(path, name, f"the project has no such recording; {hint}"))
    return problems
