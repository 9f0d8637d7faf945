"""Path segments, their features and their types (MP III-A)."""

from __future__ import annotations

from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from .path import Floats, Runs, begins_run

Integers = NDArray[np.integer[Any]]

SIDES = {1: "left", 0: "neutral", -1: "right"}
"""Sign of the course deviation -> `path_side`."""


class PathClustering(Protocol):
    """Clusters path segments; handed to the build, because models stand after datasets."""

    def __call__(
        self, features: Floats, clusters: int | Literal["bic"], maximum: int, seed: int
    ) -> tuple[Integers, Floats, Floats, list[tuple[int, float]]]:
        """Cluster path segments by a Gaussian mixture.

        Args:
            features: (n_segments, 4), as `features` returns them.
            clusters: How many, or `bic`: the number from 1 to `maximum` that the Bayesian criterion prefers.
            maximum: Most clusters that are tried.
            seed: Of all that is random.

        Returns:
            Labels (n_segments,) from 1, ordered by falling mean average course deviation, so that 1 is the sharpest
            as in MP's Table I; means (k, 4) in the features' units and weights (k,), both in the order of the labels;
            and the (clusters, criterion) pairs that were compared.
        """


def divide(course_deviation: Floats, run: Runs, neutral: float) -> tuple[NDArray[np.int32], NDArray[np.int8]]:
    """Divide a recording into segments of one side each.

    Left is a course deviation above `neutral`, right one below `-neutral`, neutral what lies between. A segment ends
    where the side changes and at the end of a run. The first sample of a run has no course deviation and belongs to
    the segment of the sample after it.

    Args:
        course_deviation: deg per sample (n_samples,), NaN for the first sample of a run.
        run: Number of the run of every sample.
        neutral: deg per sample, above 0.

    Returns:
        The segment of every sample, from 0, and its side: 1 left, 0 neutral, -1 right; both (n_samples,).
    """
    side = (course_deviation > neutral).astype(np.int8) - (course_deviation < -neutral).astype(np.int8)
    begins = begins_run(run)
    alone = begins & np.append(begins[1:], True)
    first = np.flatnonzero(begins & ~alone)
    side[first] = side[first + 1]
    begins[1:] |= side[1:] != side[:-1]
    return (np.cumsum(begins) - 1).astype(np.int32), side


def features(course_deviation: Floats, speed: Floats, segment: Integers, period: int) -> Floats:
    """Return MP eq. 3 for every segment.

    Args:
        course_deviation: deg per sample (n_samples,); NaN, of the first sample of a run, is passed over.
        speed: m/s (n_samples,).
        segment: As `divide` returns it, at least one sample each.
        period: ns between samples.

    Returns:
        (n_segments, 4): duration in s (samples times period), average and maximum of |Δθ| in deg per sample, and
        average speed in m/s. The averages of a run of one sample, which has no Δθ, are NaN.
    """
    if len(segment) == 0:
        return np.empty((0, 4))
    samples = np.bincount(segment)
    amount = np.abs(course_deviation)
    known = np.bincount(segment, weights=~np.isnan(amount))
    total = np.bincount(segment, weights=np.nan_to_num(amount))
    average = np.divide(total, known, out=np.full(len(samples), np.nan), where=known > 0)
    largest = np.fmax.reduceat(amount, np.cumsum(samples) - samples)
    mean_speed = np.bincount(segment, weights=speed) / samples
    return np.column_stack((samples * (period / 1e9), average, largest, mean_speed))


def path_types(labels: Integers, run: Runs) -> list[str]:
    """Return `previous-own-next` of every segment, such as `1-3-2` (MP eq. 8).

    MP does not say what stands beside the first and the last segment. Nothing is known there, so the own label is
    repeated: the number of types stays that of MP, k³, and every type can be read the same way.

    Args:
        labels: Label of every segment (n_segments,), in the order of time.
        run: Run that every segment belongs to.
    """
    begins = begins_run(run)
    ends = np.append(begins[1:], True)
    before = np.where(begins, labels, np.roll(labels, 1))
    after = np.where(ends, labels, np.roll(labels, -1))
    return [f"{a}-{b}-{c}" for a, b, c in zip(before, labels, after, strict=True)]
