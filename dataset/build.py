"""The build stage: synced tables to `events.csv` and the dataset of every driver."""

from __future__ import annotations

import difflib
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from .. import __version__
from ..schemas.config import Config
from ..schemas.errors import InputError
from ..schemas.project import Project
from ..schemas.signals import SIGNALS
from ..schemas.store import describe_output, fingerprint, publish_table, read_table
from ..schemas.tables import DATASET
from ..schemas.tasks import Outcome, Task
from .detectors import propose_events
from .drive import Drive, core_columns, derive
from .events import Event, merge_proposals, read_events, write_events
from .folds import deal_folds
from .manoeuvres import propose_situations
from .path import Floats
from .segments import SIDES, Integers, PathClustering, path_types
from .situations import Situation, situation_of, update_situations
from .steering import Steering, calibrate, steering_series
from .stretches import Stretch

SAMPLES_PER_FOLD = 60
"""With fewer there is nothing to test: one window of MP takes 51."""

SEGMENTS_PER_CLUSTER = 10
"""Fewer do not determine the covariance of four features."""


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
    write_events(project.events_file, merge_proposals(existing, proposals, padding))
    events = read_events(project.events_file)
    situations = update_situations(project.situations_file, situations, config.situations.names)
    problems += _strays(project, project.events_file, events) + _strays(project, project.situations_file, situations)
    steering, doubts = calibrate(project, synced, steered)
    problems += doubts

    tasks = []
    for driver, files in synced.items():
        own = [event for event in events if event.recording.startswith(f"{driver}/")]
        driven_in = [situation for situation in situations if situation.recording.startswith(f"{driver}/")]
        made_from = {
            "version": __version__,
            "parameters": _parameters(config, steering),
            "cluster": [getattr(cluster, "__module__", ""), getattr(cluster, "__qualname__", "")],
            "synced": files,
            "events": [(e.recording, e.start, e.stop, e.kind, e.decision) for e in own if e.is_left_out],
            "situations": [(s.recording, s.start, s.stop, s.situation, s.decision) for s in driven_in],
        }
        arguments = {
            "project": project.directory, "driver": driver, "synced": files, "events": own, "situations": driven_in,
            "steering": steering, "config": config, "cluster": cluster,
        }  # fmt: skip
        tasks.append(Task("dataset", driver, build_driver, arguments, fingerprint(made_from)))
    return tasks, problems


def build_driver(
    project: Path,
    driver: str,
    synced: Mapping[str, tuple[str, str]],
    events: Sequence[Event],
    situations: Sequence[Situation],
    steering: Steering,
    config: Config,
    cluster: PathClustering,
) -> Outcome:
    """Build the dataset of one driver and publish one file for each recording.

    Args:
        project: Project folder.
        driver: Whose dataset is built.
        synced: Recording -> path from the project folder and SHA-256 of its synced table.
        events: Of this driver's recordings.
        situations: Of this driver's recordings.
        steering: Calibration of the car's steering.
        config: The project file.
        cluster: Clusters the driver's path segments.

    Returns:
        The manifest entry: path types, what was driven, what was left out, outputs; and the recordings without use.

    Raises:
        InputError: Too little ordinary driving remains.
    """
    drives: dict[str, Drive] = {}
    origins: dict[str, str] = {}
    excluded: Counter[str] = Counter()
    undecided: Counter[str] = Counter()
    problems: list[InputError] = []
    for name, (file, _) in synced.items():
        table = read_table(project / file)
        if empty := [column for column in core_columns(config) if table[column].null_count == len(table)]:
            problems.append(InputError(project / file, ", ".join(empty), _how_to_fill(empty)))
            excluded["missing"] += len(table)
            continue
        drive = derive(table, [e for e in events if e.recording == f"{driver}/{name}"], steering, config)
        excluded.update(drive.excluded)
        undecided.update(drive.undecided)
        if len(drive.time):
            drives[name] = drive
            origins[name] = (table.schema.metadata or {}).get(b"origin", b"null").decode()
        else:
            reason = f"no row of it is ordinary driving: {_seconds(drive.excluded, config)}"
            problems.append(InputError(project / file, "", reason))
    drives = dict(sorted(drives.items(), key=lambda item: (int(item[1].time[0]), item[0])))
    samples = sum(len(drive.time) for drive in drives.values())
    if samples < (needed := config.dataset.folds * SAMPLES_PER_FOLD):
        raise InputError(project, f"driver {driver!r}", _too_little(samples, needed, excluded, problems, config))

    features = np.concatenate([drive.features for drive in drives.values()])
    labels, means, weights, bic = _path_clusters(features, config, cluster, problems, project, driver)
    fold = deal_folds(samples, config.dataset.folds, config.dataset.seed)
    outputs = []
    in_situation: Counter[str] = Counter()
    first_row = first_segment = 0
    for name, drive in drives.items():
        rows = slice(first_row, first_row := first_row + len(drive.time))
        segments = slice(first_segment, first_segment := first_segment + len(drive.features))
        file, digest = synced[name]
        metadata = {
            "driver": driver,
            "recording": name,
            "wheelprint": __version__,
            "parameters": json.dumps(_parameters(config, steering), sort_keys=True),
            "origin": origins[name],
            "inputs": json.dumps({file: digest}, sort_keys=True),
        }
        path = Project(project).dataset_file(driver, name)
        situation = situation_of(drive.time, [s for s in situations if s.recording == f"{driver}/{name}"])
        in_situation.update(one for one in situation if one is not None)
        publish_table(path, _table(drive, labels[segments], fold[rows], situation).replace_schema_metadata(metadata))
        outputs.append(describe_output(project, path, rows=len(drive.time), recording=name))
    second = 1e9 / config.sync.period
    entry = {
        "outputs": outputs,
        "clusters": [
            {
                "label": label,
                "share": float(weight),
                "duration_s": float(mean[0]),
                "average_course_deviation_deg": float(mean[1]),
                "maximum_course_deviation_deg": float(mean[2]),
                "average_speed_m_s": float(mean[3]),
            }
            for label, (mean, weight) in enumerate(zip(means, weights, strict=True), start=1)
        ],
        "segments": len(features),
        "bic": [{"clusters": int(count), "bic": float(value)} for count, value in bic],
        "samples": samples,
        "driven_s": samples / second,
        "distance_m": sum(drive.distance for drive in drives.values()),
        "excluded": {reason: count / second for reason, count in sorted(excluded.items())},
        "undecided": {kind: count / second for kind, count in sorted(undecided.items())},
        "situations": {situation: count / second for situation, count in sorted(in_situation.items())},
    }
    return Outcome(entry, tuple(problems))


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


def _parameters(config: Config, steering: Steering) -> dict[str, Any]:
    return {
        "sync": {"rate": config.sync.rate},
        "vehicle": {"wheelbase": config.vehicle.wheelbase},
        "steering": asdict(steering),
        "dataset": config.dataset.model_dump(),
        "lookahead": config.lookahead.model_dump(),
        "segments": config.segments.model_dump(),
    }


def _path_clusters(
    features: Floats, config: Config, cluster: PathClustering, problems: list[InputError], project: Path, driver: str
) -> tuple[Integers, Floats, Floats, list[tuple[int, float]]]:
    """Cluster a driver's segments, into fewer clusters than asked for where the segments do not determine so many."""
    settings = config.segments
    most = len(features) // SEGMENTS_PER_CLUSTER
    labels: Integers = np.ones(len(features), np.int64)
    means, weights = features.mean(axis=0, keepdims=True), np.ones(1)
    bic: list[tuple[int, float]] = []
    if most > 0:
        asked = settings.clusters if settings.clusters == "bic" else min(settings.clusters, most)
        maximum = min(settings.maximum_clusters, most)
        labels, means, weights, bic = cluster(features, asked, maximum, config.dataset.seed)
    found = len(weights)
    if settings.clusters != "bic" and found < settings.clusters:
        reason = (
            f"driver {driver!r}: {settings.clusters} clusters were asked for, and {len(features)} segments give "
            f'{found}; ask for fewer, write "bic", or add recordings'
        )
        problems.append(InputError(project / "wheelprint.toml", "segments.clusters", reason))
    return labels, means, weights, bic


def _table(drive: Drive, labels: Integers, fold: NDArray[np.int16], situation: NDArray[Any]) -> pa.Table:
    begins = np.flatnonzero(np.diff(drive.segment, prepend=-1))
    types = np.array(path_types(labels, drive.run[begins]))
    sides = np.array([SIDES[side] for side in sorted(SIDES)])
    columns: dict[str, NDArray[Any]] = {
        "time": drive.time,
        "run": drive.run,
        **drive.columns,
        "segment": drive.segment,
        "path_side": sides[drive.side + 1],
        "path_label": labels[drive.segment].astype(np.int16),
        "path_type": types[drive.segment],
        "situation": situation,
        "fold": fold,
    }
    return pa.table([pa.array(columns[f.name], f.type, from_pandas=True) for f in DATASET], schema=DATASET)


def _how_to_fill(empty: Sequence[str]) -> str:
    """Say where the columns come from that a recording lacks entirely."""
    of_car = [name for name in empty if SIGNALS[name].source == "can"]
    of_navigation = [name for name in empty if SIGNALS[name].source == "nav"]
    steps = []
    if of_car:
        mapping = ", ".join(f'{name} = "Message.Signal"' for name in of_car)
        steps.append(f"map the car's signals in wheelprint.toml: [can.signals] {mapping}")
    if of_navigation:
        steps.append(f"{', '.join(of_navigation)} must come from a navigation log in the recording's folder")
    return (
        "nothing but nulls in this recording, which is left out of the dataset; "
        f"{'; '.join(steps)}. `wheelprint inspect FILE` shows what a log holds"
    )


def _too_little(
    samples: int, needed: int, excluded: Mapping[str, int], problems: Sequence[InputError], config: Config
) -> str:
    """Say what there is of a driver, what is needed and what can be done."""
    absent = f" Left out: {_seconds(excluded, config)}." if excluded else ""
    lost = f" Recordings without use: {'; '.join(map(str, problems))}." if problems else ""
    return (
        f"{samples} samples of ordinary driving, and {needed} are needed ({SAMPLES_PER_FOLD} for each of "
        f"{config.dataset.folds} folds).{absent}{lost} Add recordings, decide about proposed events "
        "(`wheelprint review`), or lower dataset.folds"
    )


def _seconds(excluded: Mapping[str, int], config: Config) -> str:
    period = config.sync.period / 1e9
    return ", ".join(f"{reason} {count * period:.1f} s" for reason, count in sorted(excluded.items()))
