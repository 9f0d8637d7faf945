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

from .. import __version__
from ..schemas.config import Config
from ..schemas.errors import InputError
from ..schemas.project import Project
from ..schemas.store import Manifest, describe_output, fingerprint, publish_table, read_table
from ..schemas.tables import DATASET
from ..schemas.tasks import Outcome, Task
from ..schemas.times import iso_utc
from .calibration import calibrate
from .detectors import propose_events
from .drive import Drive, Steering, core_columns, derive
from .events import Event, merge_proposals, read_events, write_events
from .folds import deal_folds
from .segments import SIDES, PathClustering, path_types

SAMPLES_PER_FOLD = 60
"""With fewer there is nothing to test: one window of MP takes 51."""

SEGMENTS_PER_CLUSTER = 10
"""Fewer do not determine the covariance of four features."""


def plan_build(project: Project, cluster: PathClustering) -> tuple[list[Task], list[InputError]]:
    """Calibrate the steering, bring `events.csv` up to date, and plan one task for each driver.

    Args:
        project: Whose synced tables are built upon.
        cluster: Clusters path segments; a function of a module's top level.

    Returns:
        The tasks, and which recordings and events cannot be used.

    Raises:
        InputError: No recording is converted yet, `events.csv` is wrong, or the steering cannot be calibrated.
    """
    config = project.config
    synced, problems = _synced_files(project)
    steering = _calibrated(project, synced)
    proposals: list[Event] = []
    for driver, files in synced.items():
        tables = {f"{driver}/{name}": read_table(project.directory / file) for name, (file, _) in files.items()}
        proposals += propose_events(tables, config.events, config.sync.period)
    write_events(project.events_file, merge_proposals(read_events(project.events_file), proposals))
    events = read_events(project.events_file)
    problems += _stray_events(project, events)

    parameters = _parameters(config, steering)
    tasks = []
    for driver, files in synced.items():
        own = [event for event in events if event.recording in {f"{driver}/{name}" for name in files}]
        made_from = {
            "version": __version__,
            "parameters": parameters,
            "cluster": f"{cluster.__module__}.{cluster.__qualname__}",
            "synced": files,
            "events": [(e.recording, e.start, e.stop, e.kind) for e in own if e.is_left_out],
        }
        arguments = {
            "project": project.directory, "driver": driver, "synced": files, "events": own, "steering": steering,
            "config": config, "cluster": cluster,
        }  # fmt: skip
        tasks.append(Task("dataset", driver, build_driver, arguments, fingerprint(made_from)))
    return tasks, problems


def build_driver(
    project: Path,
    driver: str,
    synced: Mapping[str, tuple[str, str]],
    events: Sequence[Event],
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
        steering: Calibration of the car's steering.
        config: The project file.
        cluster: Clusters the driver's path segments.

    Returns:
        The manifest entry: path types, what was driven, what was left out, outputs; and the recordings without use.

    Raises:
        InputError: Too little ordinary driving remains.
    """
    place = Project(project)
    drives: dict[str, Drive] = {}
    origins: dict[str, str] = {}
    excluded: Counter[str] = Counter()
    problems: list[InputError] = []
    for name, (file, _) in synced.items():
        table = read_table(project / file)
        if reason := _unusable(table, config):
            problems.append(InputError(project / file, ", ".join(reason), " ".join(reason.values())))
            continue
        own = [event for event in events if event.recording == f"{driver}/{name}"]
        drive = derive(table, own, steering, config)
        excluded.update(drive.excluded)
        if len(drive.time) == 0:
            problems.append(InputError(project / file, "", f"no row remains: {_account(drive.excluded, config)}"))
            continue
        drives[name] = drive
        origins[name] = (table.schema.metadata or {}).get(b"origin", b"null").decode()
    samples = sum(len(drive.time) for drive in drives.values())
    if samples < (needed := config.dataset.folds * SAMPLES_PER_FOLD):
        ...
