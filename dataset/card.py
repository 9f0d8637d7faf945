"""The data card of a driver: how much driving of which kind the dataset holds, and what was left out of it."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..schemas.config import Config
from ..schemas.tables import DATASET
from ..schemas.times import iso_utc
from .path import Floats

SPEEDS = (0.0, 5.0, 10.0, 15.0, 20.0, 30.0)
"""m/s, where the ranges of speed begin; the last one has no end."""

CURVATURES = (0.0, 0.001, 0.005, 0.02, 0.05)
"""1/m, where the ranges of the path's curvature begin: radii above 1000, 200, 50 and 20 m, and below."""


def data_card(
    driver: str,
    tables: Mapping[str, pa.Table],
    distances: Mapping[str, float],
    excluded: Mapping[str, int],
    undecided: Mapping[str, int],
    clusters: Sequence[Mapping[str, Any]],
    made_from: Mapping[str, Any],
    config: Config,
) -> dict[str, Any]:
    """Return what a reader of a driver's dataset has to know of it, ready for JSON.

    Ranges are half-open and sum up to all of the driving; `curvature` is |Δθ| over the way in one step, null in the
    first row of a run.

    Args:
        driver: Name.
        tables: The dataset's tables by recording, in the order of time.
        distances: m driven on each recording.
        excluded: Rows of the synced tables that are absent, by the reason.
        undecided: Those of them that are absent because of proposals that nobody decided about, by the kind.
        clusters: The types of path, as the manifest has them.
        made_from: Parameters, versions and what identifies the inputs, as the files themselves carry them.
        config: The project file.
    """
    period = config.sync.period / 1e9
    whole = pa.concat_tables([table.replace_schema_metadata() for table in tables.values()])
    speed = whole["speed"].to_numpy()
    way = speed * period
    turned = np.radians(np.abs(whole["course_deviation"].to_numpy()))
    curvature = np.divide(turned, way, out=np.full(len(way), np.nan), where=way > 0)
    present = len(whole)
    recorded = present + sum(excluded.values())
    samples_of_fold = np.bincount(whole["fold"].to_numpy(), minlength=config.dataset.folds).tolist()
    return {
        "driver": driver,
        "driven_s": present * period,
        "distance_m": sum(distances.values()),
        "sampling": {"rate_hz": config.sync.rate, "period_s": period},
        "units": {f.name: (f.metadata or {}).get(b"unit", b"").decode() for f in DATASET},
        "recordings": [
            {
                "recording": name,
                "start": iso_utc(_times(table)[0]),
                "stop": iso_utc(_times(table)[-1] + config.sync.period),
                "samples": len(table),
                "runs": int(table["run"].to_numpy()[-1]) + 1,
                "distance_m": distances[name],
            }
            for name, table in tables.items()
        ],
        "road": {
            "speed_m_s": _ranges(speed, SPEEDS, way, period),
            "curvature_1_m": _ranges(curvature, CURVATURES, way, period),
            **({"situation": _situations(whole, way, period)} if "situation" in whole.column_names else {}),
        },
        "segments": {"by_side": _sides(tables, period), "by_label": list(clusters)},
        "excluded": [
            {
                "kind": kind,
                "seconds": samples * period,
                "share": samples / recorded,
                "undecided_s": undecided.get(kind, 0) * period,
            }
            for kind, samples in sorted(excluded.items())
        ],
        "folds": {
            "by": config.dataset.by,
            "samples": samples_of_fold,
            "recordings": _recordings_of_folds(tables, config.dataset.folds),
        },
        **made_from,
    }


def _times(table: pa.Table) -> NDArray[np.int64]:
    time: NDArray[np.int64] = table["time"].cast(pa.int64()).to_numpy()
    return time


def _ranges(values: Floats, edges: Sequence[float], way: Floats, period: float) -> list[dict[str, Any]]:
    place = np.maximum(np.searchsorted(edges, values, side="right") - 1, 0)
    place[np.isnan(values)] = len(edges)
    samples = np.bincount(place, minlength=len(edges) + 1)
    metres = np.bincount(place, weights=way, minlength=len(edges) + 1)
    rows: list[dict[str, Any]] = [
        {"from": low, "to": high, "seconds": count * period, "distance_m": float(distance)}
        for (low, high), count, distance in zip(
            itertools.pairwise([*edges, None]), samples.tolist(), metres.tolist(), strict=False
        )
    ]
    if samples[-1]:
        rows.append({"from": None, "to": None, "seconds": int(samples[-1]) * period, "distance_m": float(metres[-1])})
    return rows


def _situations(whole: pa.Table, way: Floats, period: float) -> list[dict[str, Any]]:
    situation = np.array([name or "" for name in whole["situation"].to_pylist()])
    return [
        {
            "situation": name or None,
            "seconds": int(np.count_nonzero(situation == name)) * period,
            "distance_m": float(way[situation == name].sum()),
        }
        for name in sorted(set(situation.tolist()))
    ]


def _sides(tables: Mapping[str, pa.Table], period: float) -> dict[str, dict[str, float]]:
    segments: Counter[str] = Counter()
    samples: Counter[str] = Counter()
    for table in tables.values():
        side = table["path_side"].to_numpy()
        segments.update(side[np.flatnonzero(np.diff(table["segment"].to_numpy(), prepend=-1))].tolist())
        samples.update(side.tolist())
    return {side: {"segments": segments[side], "seconds": samples[side] * period} for side in sorted(samples)}


def _recordings_of_folds(tables: Mapping[str, pa.Table], folds: int) -> list[list[str]]:
    within = {name: set(table["fold"].to_pylist()) for name, table in tables.items()}
    return [[name for name, own in within.items() if fold in own] for fold in range(folds)]
