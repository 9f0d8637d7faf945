"""The drivers of a project that can be modelled, and their data as the models take it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..dataset.drive import segments_of
from ..dataset.folds import training_mask
from ..dataset.segments import SEGMENTS_PER_CLUSTER, describe_clusters, features, path_types
from ..schemas.config import Config
from ..schemas.errors import InputError
from ..schemas.project import Project
from ..schemas.store import read_table
from .path_types import PathTypes
from .windows import SERIES, Floats, Mask, Series

COLUMNS = (*SERIES, "lookahead_spread")
"""Of the dataset, what models are made of."""


def modelled_drivers(project: Project) -> tuple[dict[str, dict[str, str]], list[InputError]]:
    """Return the drivers with enough data, each with the SHA-256 of its dataset files by path.

    Returns:
        The drivers, sorted, and a problem for each driver with less than `models.minimum_minutes`.

    Raises:
        InputError: No dataset was built yet, there is no recording, or the project file or manifest cannot be read.
    """
    config = project.config
    entries = project.manifest.get("dataset", {})
    present = {recording.driver for recording in project.recordings()}
    drivers: dict[str, dict[str, str]] = {}
    problems = []
    for driver, entry in sorted(entries.items()):
        minutes = sum(output["rows"] for output in entry["outputs"]) * config.sync.period / 60e9
        if driver not in present:
            continue
        if minutes < config.models.minimum_minutes:
            reason = (
                f"driver {driver!r} is not modelled: {minutes:.1f} minutes of ordinary driving were found, and "
                f"{config.models.minimum_minutes:g} are needed; add recordings, decide about proposed events "
                "(`wheelprint review`), or lower models.minimum_minutes"
            )
            problems.append(InputError(project.directory / "wheelprint.toml", "models.minimum_minutes", reason))
        else:
            drivers[driver] = {output["path"]: output["sha256"] for output in entry["outputs"]}
    if not drivers and not problems:
        raise InputError(project.directory, "", "no driver has a dataset yet; run `wheelprint build` first")
    return drivers, problems


def read_series(project: Path, driver: str, config: Config) -> Series:
    """Return a driver's dataset, without lookahead distances whose spread is above `lookahead.maximum_spread`.

    Raises:
        InputError: The driver has no dataset yet, or a file of it is missing or damaged.
    """
    return _series(Project(project).dataset(driver, COLUMNS), config)


def read_recording(project: Path, driver: str, recording: str, config: Config) -> Series:
    """Return one recording of a driver's dataset, as `read_series` does all of them.

    Raises:
        InputError: Its file is missing or damaged.
    """
    table = read_table(Project(project).dataset_file(driver, recording), COLUMNS)
    return _series(table.append_column("recording", pa.array([recording] * len(table), pa.string())), config)


def _series(table: pa.Table, config: Config) -> Series:
    series = Series.from_table(table, config.sync.period)
    if (share := config.lookahead.maximum_spread) is not None:
        told = table["lookahead_spread"].to_numpy() <= share * series.lookahead
        series = replace(series, lookahead=np.where(told, series.lookahead, np.nan))
    return series


def part(series: Series, group: NDArray[Any], config: Config) -> Series:
    """Return the same rows with stretches that also end where their group changes, and divided into segments anew.

    So segments and types of path of a group rest on its own rows alone, as if the others had not been driven. Only the
    first row of a stretch, which has no course deviation, is never parted from the next one.

    Args:
        series: The driver's data.
        group: Of every row (n_rows,).
        config: The thresholds of `[segments]`.
    """
    begins = np.diff(series.stretch, prepend=-1) != 0
    begins[1:] |= (group[1:] != group[:-1]) & np.isfinite(series.course_deviation[:-1])
    stretch = np.cumsum(begins) - 1
    segment, _ = segments_of(series.course_deviation, stretch, config)
    return replace(series, stretch=stretch, segment=segment.astype(np.intp))


def training_and_test(series: Series, fold: int, config: Config) -> tuple[Mask, Mask]:
    """Return the rows to learn from and the rows to test, each (n_rows,) (PP eq. 12).

    Args:
        series: The driver's data.
        fold: The test fold, from 0.
        config: With the embargo between them.
    """
    embargo = round(config.dataset.embargo * 1e9)
    return training_mask(series.fold, series.recording, series.time, fold, embargo), series.fold == fold


def fit_path_types(series: Series, rows: Mask, config: Config, *, logarithms: bool = True) -> PathTypes:
    """Fit the types of path to the segments that lie entirely in the given rows (MP eqs. 3 to 7).

    Args:
        series: The driver's data.
        rows: Rows that may be learnt from (n_rows,).
        config: How many clusters; fewer are fitted where there are too few segments.
        logarithms: See `PathTypes`.

    Raises:
        InputError: No segment lies entirely in these rows.
    """
    whole = np.bincount(series.segment, weights=~rows) == 0
    if not whole.any():
        raise InputError("dataset", "segment", "no path segment is left to learn types of path from; add recordings")
    most = max(int(whole.sum()) // SEGMENTS_PER_CLUSTER, 1)
    wanted = config.segments.clusters
    return PathTypes.fit(
        _features(series, config)[whole],
        wanted if wanted == "bic" else min(wanted, most),
        min(config.segments.maximum_clusters, most),
        config.dataset.seed,
        logarithms=logarithms,
    )


def label_rows(series: Series, types: PathTypes, config: Config) -> NDArray[np.str_]:
    """Return the path type (`1-3-2`, MP eq. 8) of every row (n_rows,) by types fitted to these or other data."""
    begins = np.flatnonzero(np.diff(series.segment, prepend=-1))
    by_segment = path_types(types.label(_features(series, config)), series.stretch[begins])
    return np.array(by_segment, dtype=np.str_)[series.segment]


def describe_path_types(types: PathTypes) -> list[dict[str, Any]]:
    """Return the clusters as the manifest writes those of the dataset."""
    return describe_clusters(types.means, types.weights)


@contextmanager
def one_thread() -> Iterator[None]:
    """Let BLAS use one thread: tasks run side by side, and the same inputs give the same bytes with any number."""
    import scipy.linalg.blas  # noqa: F401 - loads scipy's own BLAS, which is limited only where it is loaded
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]  # it ships no types

    with threadpool_limits(1):
        yield


def _features(series: Series, config: Config) -> Floats:
    return features(series.course_deviation, series.speed, series.segment, config.sync.period)
