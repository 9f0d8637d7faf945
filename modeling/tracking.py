"""Every driver's laws of the lookahead distance driven in closed loop, on PP's test track and on recorded paths."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import __version__
from ..dataset.reference import find_references, read_reference
from ..schemas.config import Config
from ..schemas.errors import InputError
from ..schemas.project import Project, Recording, encode_name
from ..schemas.store import Manifest, describe_output, fingerprint, publish_json, publish_text, read_table
from ..schemas.tables import TRACK_COLUMNS
from ..schemas.tasks import Outcome, Task
from .bicycle import Bicycle
from .driver_limits import DriverLimits
from .drivers import one_thread, read_series
from .driving import CONTROLS, Drive, as_driven, drive_track, measure
from .lookahead_laws import LAWS, LookaheadLaw, fit_simple_laws, load_mixtures
from .track import SHORTEST, SPACING, Track, lay_track, recorded_tracks

TEST_TRACK = "test-track"
"""What PP's test track is called where a recording could be."""

SECTION = "tracks"
"""Of the manifest."""

DRAWN = (*((law, "pursuit") for law in LAWS), ("velocity", "bounded"), ("velocity", "combined"))
"""Law and control of the drives that a cell keeps, beside the driver's own."""

RECORDINGS = 3
"""Of each driver that are driven where none is named: a quarter of an hour takes all laws and controls some seconds."""

LENGTH = 500.0
"""m of each path that are kept, those where it bends most."""


def plan_tracking(
    project: Project,
    drivers: Sequence[str] = (),
    path: str | None = None,
    offset: float = 0.0,
    recordings: int = RECORDINGS,
) -> list[Task]:
    """Plan one task for each driver and path.

    Args:
        project: The project.
        drivers: Whose laws; none: everybody's who has trained models of the lookahead distance.
        path: `TEST_TRACK` or `driver/recording`; None: the test track, and recordings of each driver.
        offset: m to the left of where the driver began, where the car begins.
        recordings: Most recordings of each driver where none is named, evenly spread over theirs; 0: all.

    Raises:
        InputError: Nothing was trained yet, a driver has no models, or there is no such recording or none at all.
    """
    there = _what_there_is(project)
    if not there.trained:
        raise InputError(project.directory, "", "no model of the lookahead distance is there; run `wheelprint train`")
    if unknown := [driver for driver in drivers if driver not in there.trained]:
        reason = f"no model of the lookahead distance was trained; there are those of {', '.join(there.trained)}"
        raise InputError(project.directory, ", ".join(unknown), reason)
    if path not in (None, TEST_TRACK, *there.recordings):
        known = ", ".join([TEST_TRACK, *there.recordings])
        raise InputError(project.directory, str(path), f"no such recording, and no track; there are {known}")
    if path not in (None, TEST_TRACK, *there.built):
        reason = "the dataset holds nothing of this recording; run `wheelprint build`, or choose another one"
        raise InputError(project.directory, str(path), reason)
    tasks = []
    for driver in drivers or there.trained:
        own = [key for key in there.built if there.recordings[key].driver == driver]
        if 0 < recordings < len(own):
            own = [own[place] for place in np.linspace(0, len(own) - 1, recordings).astype(int).tolist()]
        paths = [TEST_TRACK, *own] if path is None else [path]
        tasks += [_task(project, there, driver, where, offset) for where in paths]
    return tasks


class _There(NamedTuple):
    """What the tasks are planned from: the manifest, drivers with models, recordings by key, those of the dataset."""

    manifest: Mapping[str, Any]
    trained: list[str]
    recordings: dict[str, Recording]
    built: list[str]


def _what_there_is(project: Project) -> _There:
    manifest = project.manifest
    recordings = {recording.key: recording for recording in project.recordings()}
    models = set(manifest.get("models", {}))
    trained = sorted(
        driver
        for kind, _, driver in (name.partition("/") for name in models)
        if kind == "lookahead_velocity" and f"lookahead_general/{driver}" in models
    )
    dataset = {
        f"{driver}/{output['recording']}"
        for driver, entry in manifest.get("dataset", {}).items()
        for output in entry["outputs"]
    }
    return _There(manifest, trained, recordings, [key for key in recordings if key in dataset])


def _task(project: Project, there: _There, driver: str, path: str, offset: float) -> Task:
    config, recording = project.config, there.recordings.get(path)

    def made(section: str, name: str) -> dict[str, str]:
        return {output["path"]: output["sha256"] for output in there.manifest[section][name]["outputs"]}

    driven: dict[str, Any] = {}
    if recording is not None:
        references, _ = find_references(
            project.directory, config.lookahead.reference, recording.driver, [recording.name]
        )
        driven = {"dataset": made("dataset", recording.driver), "reference": references}
    mark = fingerprint(
        {
            "version": __version__,
            "models": [made("models", f"lookahead_{kind}/{driver}") for kind in ("general", "velocity")],
            "dataset": made("dataset", driver),
            "driven": driven,
            "calibration": there.manifest.get("calibration", {}).get("fingerprint"),
            "wheelbase": config.vehicle.wheelbase,
            "period": config.sync.period,
            "maximum_spread": config.lookahead.maximum_spread,
            "path": path,
            "offset": offset,
        }
    )
    name = f"{driver}/{path}" + (f"/{offset:+g} m" if offset else "")
    where = {"driver": driver, "path": path, "offset": offset}
    arguments = {"project": project.directory, **where, "recording": recording, "config": config}
    return Task(SECTION, name, drive_laws, arguments, mark)


def drive_laws(
    project: Path, driver: str, path: str, offset: float, recording: Recording | None, config: Config
) -> Outcome:
    """Drive a path with every law and control of one driver, measure the drives, and keep some of them to draw.

    The laws are the driver's trained mixtures, and those of `fit_simple_laws` on the data that these learnt from; the
    car is the project's, with its fitted ratio and understeer. Angles are without the sensor's offset.

    Args:
        project: Project folder.
        driver: Whose laws and limits.
        path: `TEST_TRACK`, or the recording's key.
        offset: m to the left of where the driver began, where the car begins.
        recording: What is driven, by whomever; None on the test track.
        config: The project file.

    Raises:
        InputError: No models were trained, the car was not calibrated, the dataset or the reference cannot be read, or
            the recording has no stretch to drive.
    """
    of = Project(project)
    series = read_series(project, driver, config)
    mixtures, bicycle = load_mixtures(of, driver), Bicycle.of_project(of)
    known = series.has_lookahead
    simple = fit_simple_laws(series.path_points[known], series.lookahead[known])
    laws: dict[str, LookaheadLaw] = {"general": mixtures[0], "velocity": mixtures[1], **simple}
    limits = DriverLimits.fit(series, config.sync.period / 1e9)
    tracks = [lay_track()] if recording is None else recorded_stretches(of, recording)
    if not tracks:
        reason = f"no stretch of {SHORTEST:g} m without a break, so nothing to drive; choose another recording"
        raise InputError(project, path, reason)
    shown, first, last = _most_bent(tracks)
    where = {"driver": driver, "path": path, "offset": offset}
    rows: list[dict[str, Any]] = []
    drawn: list[dict[str, Any]] = []
    if recording is not None:
        told = [as_driven(track) for track in tracks]
        measures = measure(list(zip(tracks, told, strict=True)))
        of_driver = {"law": "driver", "control": ""}
        rows.append({**where, **of_driver, **measures, "steering_error": None, "lookahead_error": None})
        drawn.append({**of_driver, **_between(told[shown], first, last)})
    with one_thread():
        domains = [mixtures[0].regression.domain_probability(track.inputs) for track in tracks]
        for name, law in laws.items():
            for control in CONTROLS:
                drives = [
                    drive_track(track, law, bicycle, control, limits, domain, offset)
                    for track, domain in zip(tracks, domains, strict=True)
                ]
                measures = measure(list(zip(tracks, drives, strict=True)))
                rows.append({**where, "law": name, "control": control, **measures})
                if (name, control) in DRAWN:
                    drawn.append({"law": name, "control": control, **_between(drives[shown], first, last)})
    track = tracks[shown]
    path_points = {"distance": track.distance, "x": track.x, "y": track.y}
    content = {"rows": rows, "drives": drawn, "track": _between(path_points, first, last)}
    file = f"{encode_name(path)}{f'.{offset:+g}m' if offset else ''}.json"
    cell = of.results_folder / "cells" / "track" / encode_name(driver) / file
    publish_json(cell, content)
    return Outcome({"outputs": [describe_output(project, cell)], **where})


def recorded_stretches(project: Project, recording: Recording) -> list[Track]:
    """Return the stretches of a recording of the dataset as tracks, along its `[lookahead] reference` where it has one.

    Raises:
        InputError: The dataset or the reference cannot be read.
    """
    config = project.config
    table = read_table(project.dataset_file(recording.driver, recording.name))
    references, problems = find_references(
        project.directory, config.lookahead.reference, recording.driver, [recording.name]
    )
    if problems:
        raise problems[0]
    reference = None
    if references:
        origin = json.loads((table.schema.metadata or {}).get(b"origin", b"null"))
        reference = read_reference(project.directory / references[recording.name][0], origin, config)
    return recorded_tracks(table, config.sync.period, reference)


def current_cells(project: Project) -> dict[str, Mapping[str, Any]]:
    """Return the content of the cells that are made from the models and data as they are now, by name.

    Raises:
        InputError: There is no recording at all, or the manifest cannot be read.
    """
    manifest, found = Manifest(project.directory), {}
    entries = sorted(manifest.content.get(SECTION, {}).items())
    if not entries:
        return {}
    there = _what_there_is(project)
    for name, entry in entries:
        # Without its driver or recording there is no reason to show it.
        if entry["driver"] not in there.trained or entry["path"] not in (TEST_TRACK, *there.built):
            continue
        task = _task(project, there, entry["driver"], entry["path"], entry["offset"])
        if manifest.is_current(SECTION, name, task.fingerprint):
            path = project.directory / entry["outputs"][0]["path"]
            found[name] = json.loads(path.read_text(encoding="utf-8"))
    return found


def gather_tracks(project: Project, tasks: Sequence[Task]) -> list[tuple[str, tuple[str, ...], list[tuple[Any, ...]]]]:
    """Gather the current cells into `results/track.csv`, and return what to print of those that were asked for.

    Args:
        project: The project.
        tasks: As `plan_tracking` planned them.

    Returns:
        Title, heads and rows: m, deg/s and deg.

    Raises:
        InputError: There is no recording at all.
    """
    cells = current_cells(project)
    text = io.StringIO()
    table = csv.DictWriter(text, TRACK_COLUMNS, lineterminator="\n")
    table.writeheader()
    table.writerows(row for cell in cells.values() for row in cell["rows"])
    publish_text(project.results_folder / "track.csv", text.getvalue())
    asked: dict[tuple[str, ...], list[Mapping[str, Any]]] = {}
    for task in tasks:
        for row in cells.get(task.name, {"rows": ()})["rows"]:
            if (row["law"], row["control"]) in (("driver", ""), *DRAWN):
                path = TEST_TRACK if row["path"] == TEST_TRACK else "recordings"
                asked.setdefault((row["driver"], path, row["law"], row["control"]), []).append(row)
    measures = ("tracking_rms", "tracking_max", "steering_rate_rms", "steering_error")
    heads = ("driver", "path", "law", "control", *measures)
    printed = [(*key, *(pool(rows)[name] for name in measures)) for key, rows in asked.items()]
    return [("Closed loop: m, deg/s and deg to what the driver did at the same place", heads, printed)]


def pool(rows: Sequence[Mapping[str, Any]]) -> dict[str, float | None]:
    """Return the measures of several paths together, in the units of `driving.measure`.

    Over times T_i they are means Σ T_i m_i / Σ T_i, of rms √(Σ T_i m_i² / Σ T_i), and the largest distance.

    Args:
        rows: Those of `drive_laws`; None where a measure is not known.
    """

    def mean(name: str, power: int) -> float | None:
        known = [row for row in rows if row[name] is not None]
        seconds = sum(row["seconds"] for row in known)
        if not seconds:
            return None
        return math.pow(sum(row["seconds"] * row[name] ** power for row in known) / seconds, 1 / power)

    largest = [row["tracking_max"] for row in rows if row["tracking_max"] is not None]
    return {
        **{name: mean(name, 2) for name in ("tracking_rms", "steering_rate_rms", "steering_change_rms")},
        **{name: mean(name, 1) for name in ("steering_error", "lookahead_error", "taken_over")},
        "tracking_max": max(largest, default=None),
    }


def _most_bent(tracks: Sequence[Track]) -> tuple[int, float, float]:
    """Return which track, and from where to where along it (m), the `LENGTH` lie that have the largest curvature."""
    found = []
    for number, track in enumerate(tracks):
        bent = np.concatenate([[0.0], np.cumsum(np.abs(track.curvature))])
        points = min(round(LENGTH / SPACING), len(track.x))
        within = bent[points:] - bent[:-points]
        begin = int(np.argmax(within))
        found.append((float(within[begin]), number, begin * SPACING, (begin + points) * SPACING))
    return max(found)[1:]


def _between(drive: Drive, first: float, last: float) -> dict[str, list[float | None]]:
    """Return what is drawn of a drive, to the millimetre or thousandth of a degree; None where nobody knows."""
    names = ("distance", "x", "y", "deviation", "steering_wheel_angle", "lookahead", "driver_share")
    rows = (drive["distance"] >= first) & (drive["distance"] <= last)
    return {
        name: [value if np.isfinite(value) else None for value in np.round(drive[name][rows], 3).tolist()]
        for name in names
        if name in drive
    }
