"""Types of path as they are known while driving: by what was driven lately and by the path ahead.

When a window is predicted at t, the path is known up to the horizon t + n₃, and nobody knows how long the segment at
the horizon will be. So the type of path at t is what `drivers.label_rows` says of a recording that begins `HISTORY`
before t, or with the stretch of t, and ends at the horizon: division, merging and labels of that piece of path alone.
Models are trained with whole segments.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..dataset.segments import Division, divide, features, path_types
from .path_types import Labels, PathTypes
from .windows import Floats, Rows, Series

HISTORY = 60_000_000_000
"""ns; a predictor that runs for hours keeps this much of the path. A longer segment looks this long."""


def label_present(
    course_deviation: Floats, speed: Floats, present: int, types: PathTypes, division: Division, period: int
) -> str:
    """Return the path type (`1-3-2`) at one row of a piece of path, known from this piece alone.

    Args:
        course_deviation: deg per sample (n_rows,), from the past to the horizon; NaN only in the first row.
        speed: m/s (n_rows,).
        present: Row that is asked for, from 0.
        types: The types of path.
        division: How the path is divided.
        period: ns between rows.
    """
    around, own = _segments_around(course_deviation, speed, present, division, period)
    return _name(types.label(around), own)


def label_windows(
    series: Series, centres: Rows, ahead: int, types: PathTypes, division: Division, period: int
) -> NDArray[np.str_]:
    """Return the path type of windows as it is known when they are predicted.

    Args:
        series: The data; its own segments are not looked at.
        centres: Row t of each window (n_windows,), from 0; t + `ahead` lies in the same stretch.
        ahead: Steps that are known of the path ahead, n₃.
        types: The types of path.
        division: How the path is divided.
        period: ns between samples.

    Returns:
        Path types such as `1-3-2` (n_windows,).
    """
    if not len(centres):
        return np.empty(0, dtype=np.str_)
    begins = np.searchsorted(series.stretch, series.stretch[centres])
    found = [
        _segments_around(
            series.course_deviation[first : centre + ahead + 1],
            series.speed[first : centre + ahead + 1],
            centre - first,
            division,
            period,
        )
        for first, centre in zip(
            np.maximum(begins, centres - HISTORY // period).tolist(), centres.tolist(), strict=True
        )
    ]
    labels = types.label(np.concatenate([around for around, _ in found]))
    ends = np.cumsum([len(around) for around, _ in found])
    own = [place for _, place in found]
    return np.array([_name(*of) for of in zip(np.split(labels, ends[:-1]), own, strict=True)], dtype=np.str_)


def _segments_around(
    course_deviation: Floats, speed: Floats, present: int, division: Division, period: int
) -> tuple[Floats, int]:
    """Return the features of the segment at a row and of its neighbours (up to 3, 4), and which one is its own."""
    segment, _ = divide(course_deviation, np.zeros(len(speed), dtype=np.int32), *division)
    own = int(segment[present])
    first, last = max(own - 1, 0), min(own + 1, int(segment[-1]))
    return features(course_deviation, speed, segment, period)[first : last + 1], own - first


def _name(labels: Labels, own: int) -> str:
    """Return the path type of one of a few segments that follow each other, with labels (n_segments,)."""
    return path_types(labels, np.zeros(len(labels), dtype=np.int32))[own]
