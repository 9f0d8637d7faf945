"""The dataset of one driver: what is ordinary driving, with everything that only the driver's whole data can say."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..schemas.config import Config
from ..schemas.errors import InputError
from ..schemas.project import Project
from ..schemas.signals import SIGNALS
from ..schemas.store import describe_output, publish_json, publish_table, read_table
from ..schemas.tables import DATASET
from ..schemas.tasks import Outcome
from .card import data_card
from .drive import Drive, core_columns, derive
from .driver_lookahead import driver_lookahead
from .events import Event
from .folds import deal_folds, deal_recordings
from .path import Floats
from .provenance import Files, provenance
from .segments import SEGMENTS_PER_CLUSTER, SIDES, Integers, PathClustering, describe_clusters, path_types
from .situations import Situation, situation_of
from .steering import Steering

SAMPLES_PER_FOLD = 60
"""With fewer there is nothing to test: one window of MP takes 51."""


@dataclass(slots=True)
class OrdinaryDriving:
    """What is left of a driver's recordings, and what is not.

    Attributes:
        drives: By recording, in the order of time.
        origins: Of each of them: latitude, longitude, altitude as JSON, or "null".
        excluded: Rows of all the driver's synced tables that are absent, by the reason.
        undecided: Those of them that are absent because of proposals that nobody decided about, by the kind.
        problems: Recordings without use.
    """

    drives: dict[str, Drive]
    origins: dict[str, str]
    excluded: Counter[str]
    undecided: Counter[str]
    problems: list[InputError]

    @property
    def samples(self) -> int:
        """Of all drives."""
        return sum(len(drive.time) for drive in self.drives.values())


def build_driver(
    project: Path,
    driver: str,
    synced: Files,
    events: Sequence[Event],
    situations: Sequence[Situation],
    steering: Steering,
    config: Config,
    cluster: PathClustering,
    references: Files,
) -> Outcome:
    """Build the dataset of one driver: publish one file for each recording, and the driver's data card.

    Args:
        project: Project folder.
        driver: Whose dataset is built.
        synced: Recording -> path from the project folder and SHA-256 of its synced table.
        events: Of this driver's recordings.
        situations: Of this driver's recordings.
        steering: Calibration of the car's steering.
        config: The project file.
        cluster: Clusters the driver's path segments.
        references: Recording -> path from the project folder and SHA-256 of its reference path, where it has one.

    Returns:
        The manifest entry: path types, what was driven, what was left out, outputs; and the recordings without use.

    Raises:
        InputError: Too little ordinary driving remains, or too few recordings to be dealt to the folds.
    """
    left = _ordinary_driving(project, driver, synced, events, steering, config)
    if left.samples < (needed := config.dataset.folds * SAMPLES_PER_FOLD):
        raise InputError(project, f"driver {driver!r}", _too_little(left, needed, config))
    fold = _folds(project, driver, left.drives, config)
    lookahead, manner, doubts = driver_lookahead(project, driver, left.drives, left.origins, references, config)
    features = np.concatenate([drive.features for drive in left.drives.values()])
    labels, clusters, criterion, too_few = _path_clusters(features, config, cluster, project, driver)

    ends = np.cumsum([len(drive.features) for drive in left.drives.values()])[:-1]
    tables = {}
    for (name, drive), own in zip(left.drives.items(), np.split(labels, ends), strict=True):
        situation = situation_of(drive.time, [s for s in situations if s.recording == f"{driver}/{name}"])
        tables[name] = _table(drive, lookahead[name], own, fold[name], situation)

    made_from = provenance(synced, references, events, situations, steering, config)
    common = {key: json.dumps(value, sort_keys=True) for key, value in made_from.items()}
    outputs = []
    for name, table in tables.items():
        path = Project(project).dataset_file(driver, name)
        own_metadata = {"driver": driver, "recording": name, "origin": left.origins[name]}
        publish_table(path, table.replace_schema_metadata({**own_metadata, **common}))
        outputs.append(describe_output(project, path, rows=len(table), recording=name))
    distances = {name: drive.distance for name, drive in left.drives.items()}
    card = Project(project).data_card_file(driver)
    publish_json(card, data_card(driver, tables, distances, left.excluded, left.undecided, clusters, made_from, config))
    in_situation = Counter(one for table in tables.values() for one in table["situation"].to_pylist() if one)
    second = 1e9 / config.sync.period
    entry = {
        "outputs": outputs,
        "documents": [describe_output(project, card)],
        "clusters": clusters,
        "segments": len(features),
        "lookahead": manner,
        "bic": criterion,
        "samples": left.samples,
        "driven_s": left.samples / second,
        "distance_m": sum(distances.values()),
        "excluded": {reason: count / second for reason, count in sorted(left.excluded.items())},
        "undecided": {kind: count / second for kind, count in sorted(left.undecided.items())},
        "situations": {situation: count / second for situation, count in sorted(in_situation.items())},
    }
    return Outcome(entry, (*left.problems, *doubts, *too_few))


def _ordinary_driving(
    project: Path, driver: str, synced: Files, events: Sequence[Event], steering: Steering, config: Config
) -> OrdinaryDriving:
    left = OrdinaryDriving({}, {}, Counter(), Counter(), [])
    for name, (file, _) in synced.items():
        table = read_table(project / file)
        if empty := [column for column in core_columns(config) if table[column].null_count == len(table)]:
            left.problems.append(InputError(project / file, ", ".join(empty), _how_to_fill(empty)))
            left.excluded["missing"] += len(table)
            continue
        drive = derive(table, [e for e in events if e.recording == f"{driver}/{name}"], steering, config)
        left.excluded.update(drive.excluded)
        left.undecided.update(drive.undecided)
        if len(drive.time):
            left.drives[name] = drive
            left.origins[name] = (table.schema.metadata or {}).get(b"origin", b"null").decode()
        else:
            reason = f"no row of it is ordinary driving: {_seconds(drive.excluded, config)}"
            left.problems.append(InputError(project / file, "", reason))
    left.drives = dict(sorted(left.drives.items(), key=lambda item: (int(item[1].time[0]), item[0])))
    return left


def _folds(project: Path, driver: str, drives: Mapping[str, Drive], config: Config) -> dict[str, NDArray[np.int16]]:
    """Return the fold of every sample, by recording."""
    settings = config.dataset
    samples = [len(drive.time) for drive in drives.values()]
    if settings.by == "block":
        fold = deal_folds(sum(samples), settings.folds, settings.seed)
        return dict(zip(drives, np.split(fold, np.cumsum(samples)[:-1]), strict=True))
    if len(samples) < settings.folds:
        reason = (
            f'driver {driver!r}: dataset.by = "recording" deals whole recordings to {settings.folds} folds, and there '
            f'are {len(samples)} with ordinary driving; write folds = {max(len(samples), 2)} or less, by = "block", or '
            "add recordings"
        )
        raise InputError(project / "wheelprint.toml", "dataset.folds", reason)
    dealt = deal_recordings(samples, settings.folds, settings.seed)
    return {name: np.full(count, fold) for name, count, fold in zip(drives, samples, dealt, strict=True)}


def _path_clusters(
    features: Floats, config: Config, cluster: PathClustering, project: Path, driver: str
) -> tuple[Integers, list[dict[str, Any]], list[dict[str, Any]], list[InputError]]:
    """Cluster a driver's segments, into fewer clusters than asked for where the segments do not determine so many.

    Returns:
        The label of every segment; clusters and criterion as the manifest has them; and a problem where fewer clusters
        were found than asked for.
    """
    settings = config.segments
    most = len(features) // SEGMENTS_PER_CLUSTER
    labels: Integers = np.ones(len(features), np.int64)
    means, weights = features.mean(axis=0, keepdims=True), np.ones(1)
    criterion: list[tuple[int, float]] = []
    if most > 0:
        asked = settings.clusters if settings.clusters == "bic" else min(settings.clusters, most)
        maximum = min(settings.maximum_clusters, most)
        labels, means, weights, criterion = cluster(features, asked, maximum, config.dataset.seed)
    problems = []
    if settings.clusters != "bic" and len(weights) < settings.clusters:
        reason = (
            f"driver {driver!r}: {settings.clusters} clusters were asked for, and {len(features)} segments give "
            f'{len(weights)}; ask for fewer, write "bic", or add recordings'
        )
        problems.append(InputError(project / "wheelprint.toml", "segments.clusters", reason))
    compared = [{"clusters": int(count), "bic": float(value)} for count, value in criterion]
    return labels, describe_clusters(means, weights), compared, problems


def _table(
    drive: Drive,
    lookahead: tuple[Floats, Floats],
    labels: Integers,
    fold: NDArray[np.int16],
    situation: NDArray[Any],
) -> pa.Table:
    begins = np.flatnonzero(np.diff(drive.segment, prepend=-1))
    types = np.array(path_types(labels, drive.run[begins]))
    sides = np.array([SIDES[side] for side in sorted(SIDES)])
    columns: dict[str, NDArray[Any]] = {
        "time": drive.time,
        "run": drive.run,
        **drive.columns,
        "lookahead": lookahead[0],
        "lookahead_spread": lookahead[1],
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


def _too_little(left: OrdinaryDriving, needed: int, config: Config) -> str:
    """Say what there is of a driver, what is needed and what can be done."""
    absent = f" Left out: {_seconds(left.excluded, config)}." if left.excluded else ""
    lost = f" Recordings without use: {'; '.join(map(str, left.problems))}." if left.problems else ""
    return (
        f"{left.samples} samples of ordinary driving, and {needed} are needed ({SAMPLES_PER_FOLD} for each of "
        f"{config.dataset.folds} folds).{absent}{lost} Add recordings, decide about proposed events "
        "(`wheelprint review`), or lower dataset.folds"
    )


def _seconds(excluded: Mapping[str, int], config: Config) -> str:
    period = config.sync.period / 1e9
    return ", ".join(f"{reason} {count * period:.1f} s" for reason, count in sorted(excluded.items()))
