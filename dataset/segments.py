"""Path segments, their features and their types (MP III-A)."""

from __future__ import annotations

import heapq
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from .path import Floats, Runs, begins_run

Integers = NDArray[np.integer[Any]]

SIDES = {1: "left", 0: "neutral", -1: "right"}
"""Sign of the course deviation -> `path_side`."""


SEGMENTS_PER_CLUSTER = 10
"""Fewer do not determine the covariance of four features."""


class Division(NamedTuple):
    """Thresholds of `divide`.

    Attributes:
        neutral: deg per sample.
        release: deg per sample.
        shortest: Samples.
    """

    neutral: float
    release: float
    shortest: int


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
            as in MP's Table I, and among equals by falling mean maximum, duration and speed; means (k, 4) in the
            features' units and weights (k,), both in the order of the labels; and the (clusters, criterion) pairs that
            were compared.
        """


def divide(
    course_deviation: Floats, run: Runs, neutral: float, release: float | None = None, shortest: int = 1
) -> tuple[NDArray[np.int32], NDArray[np.int8]]:
    """Divide a recording into segments of one side each.

    Left is a course deviation above `neutral`, right one below `-neutral`, neutral what lies between. With a lower
    `release` a bend that has begun goes on until the course deviation falls to that. A segment ends where the side
    changes and at the end of a run. The first sample of a run has no course deviation and belongs to the segment of the
    sample after it.

    MP finds that its segments switch too often and that some can be merged, without saying how. Here a segment of fewer
    than `shortest` samples takes the side of its longer neighbour within the run, the earlier one among equals, and is
    joined with it (and with the other one where that has the same side); the shortest comes first, and of equals the
    earliest. Only a run that is too short itself keeps a segment below `shortest`.

    Args:
        course_deviation: deg per sample (n_samples,), NaN for the first sample of a run.
        run: Number of the run of every sample.
        neutral: deg per sample, above 0.
        release: deg per sample, at most `neutral`, which it is by default.
        shortest: Samples; 1, as in MP: nothing is merged.

    Returns:
        The segment of every sample, from 0, and its side: 1 left, 0 neutral, -1 right; both (n_samples,).
    """
    side = _sides(course_deviation, run, neutral, neutral if release is None else release)
    begins_side = begins_run(run)
    begins_side[1:] |= side[1:] != side[:-1]
    if shortest > 1:
        first = np.flatnonzero(begins_side)
        lengths = np.diff(np.append(first, len(side)))
        side = _merge_short(side[first], lengths, run[first], shortest)
        begins_side = begins_run(run)
        begins_side[1:] |= side[1:] != side[:-1]
    return (np.cumsum(begins_side) - 1).astype(np.int32), side


def _sides(course_deviation: Floats, run: Runs, neutral: float, release: float) -> NDArray[np.int8]:
    amount = np.nan_to_num(np.abs(course_deviation))
    turn = np.sign(np.nan_to_num(course_deviation)).astype(np.int8)
    side = np.where(amount > neutral, turn, 0).astype(np.int8)
    begins = begins_run(run)
    if release < neutral:
        # What lies between the thresholds goes on with a bend to its own side, where such a bend leads up to it.
        level = np.where(amount > neutral, 2, np.where(amount > release, 1, 0)) * turn
        first = np.flatnonzero(begins | (level != np.roll(level, 1)))
        before = np.where(begins[first], 0, np.roll(level, 1)[first])
        goes_on = (np.abs(level[first]) == 1) & (before == 2 * level[first])
        lengths = np.diff(np.append(first, len(side)))
        side = np.where(np.repeat(goes_on, lengths), turn, side)
    alone = begins & np.append(begins[1:], True)
    start = np.flatnonzero(begins & ~alone)
    side[start] = side[start + 1]
    return side


def _merge_short(side: NDArray[np.int8], lengths: Integers, run: Runs, shortest: int) -> NDArray[np.int8]:
    """Merge segments as `divide` says; return the side of every sample.

    Args:
        side: Of every segment (n_segments,), in the order of time.
        lengths: Samples of every segment.
        run: Run of every segment.
        shortest: Samples.
    """
    begins = begins_run(run)
    index = np.arange(len(side))
    before = np.where(begins, -1, index - 1).tolist()
    after = np.where(np.append(begins[1:], True), -1, index + 1).tolist()
    length, sides = lengths.tolist(), side.tolist()
    waiting = [(samples, number) for number, samples in enumerate(length) if samples < shortest]
    heapq.heapify(waiting)
    while waiting:
        samples, own = heapq.heappop(waiting)
        neighbours = [number for number in (before[own], after[own]) if number >= 0]
        if length[own] != samples or not neighbours:  # joined with another one in the meantime, or a whole run
            continue
        sides[own] = sides[max(neighbours, key=lambda number: length[number])]
        for other in neighbours:
            if sides[other] == sides[own]:
                length[own] += length[other]
                length[other] = 0
                if other == before[own]:
                    before[own] = before[other]
                else:
                    after[own] = after[other]
        if before[own] >= 0:
            after[before[own]] = own
        if after[own] >= 0:
            before[after[own]] = own
        if length[own] < shortest:
            heapq.heappush(waiting, (length[own], own))
    return np.repeat(np.array(sides, np.int8), length)


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


def describe_clusters(means: Floats, weights: Floats) -> list[dict[str, Any]]:
    """Return clusters of segments as the manifest has them.

    Args:
        means: Features of each label, as `features` returns them, (k, 4).
        weights: Share of each label (k,).
    """
    names = ("duration_s", "average_course_deviation_deg", "maximum_course_deviation_deg", "average_speed_m_s")
    return [
        {"label": label, "share": float(share), **dict(zip(names, mean.tolist(), strict=True))}
        for label, (share, mean) in enumerate(zip(weights, means, strict=True), start=1)
    ]
