"""Types of path as they are known while driving: by what was driven so far and by the path ahead.

When a window is predicted at t, the path is known from the beginning of the stretch up to the horizon t + n₃. Of a
recording that ends there, the type of path at t is what `drivers.label_rows` says:

    own        the segment at t, from its beginning to its end or the horizon
    previous   the one before it, whole; the own label where the stretch begins with the own segment
    next       the one after it, up to its end or the horizon; the own label where it begins beyond the horizon

So a long segment may be labelled otherwise near its beginning than near its end, and nobody needs to know the future.
Models are trained with whole segments.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..dataset.segments import divide
from .path_types import PathTypes
from .windows import Floats, Rows, Series


def label_windows(
    series: Series, centres: Rows, ahead: int, types: PathTypes, neutral: float, period: int
) -> NDArray[np.str_]:
    """Return the path type (`1-3-2`) of windows as it is known when they are predicted.

    Args:
        series: The data; its own segments are not looked at.
        centres: Row t of each window (n_windows,); t + `ahead` lies in the same stretch.
        ahead: Steps that are known of the path ahead, n₃.
        types: The types of path.
        neutral: deg per sample; a smaller course deviation is neutral.
        period: ns between samples.

    Returns:
        Shape (n_windows,).
    """
    if not len(centres):
        return np.empty(0, dtype=np.str_)
    segment, _ = divide(series.course_deviation, series.stretch, neutral)
    begins = np.flatnonzero(np.diff(segment, prepend=-1))
    last = np.append(begins[1:], len(segment)) - 1
    label = types.label(_features_so_far(series, segment, begins, period))
    own, horizon = segment[centres], centres + ahead
    own_label = label[np.minimum(last[own], horizon)]
    before = begins[own] - 1
    is_first = (before < 0) | (series.stretch[before] != series.stretch[centres])
    ends = last[own] < horizon
    after = np.minimum(last[np.minimum(own + 1, len(last) - 1)], horizon)
    names = (np.where(is_first, own_label, label[before]), own_label, np.where(ends, label[after], own_label))
    return np.array(["-".join(map(str, one)) for one in zip(*(part.tolist() for part in names), strict=True)])


@dataclass(slots=True)
class SegmentSoFar:
    """What is known of a path segment: the sums that MP eq. 3 is made of.

    Attributes:
        samples: Number of samples.
        known: Those with a course deviation.
        total: Sum of |Δθ|, deg per sample.
        largest: Largest |Δθ|.
        speed: Sum of the speeds, m/s.
    """

    samples: int = 0
    known: int = 0
    total: float = 0.0
    largest: float = 0.0
    speed: float = 0.0

    def and_then(self, course_deviation: Floats, speed: Floats) -> SegmentSoFar:
        """Return the segment with further samples (n_samples,)."""
        amount = np.abs(course_deviation[np.isfinite(course_deviation)])
        return SegmentSoFar(
            self.samples + len(speed),
            self.known + len(amount),
            self.total + float(amount.sum()),
            max(self.largest, float(amount.max(initial=0.0))),
            self.speed + float(speed.sum()),
        )

    def features(self, period: int) -> list[float]:
        """Return MP eq. 3: duration in s, average and largest |Δθ| in deg per sample, average speed in m/s."""
        average = self.total / max(self.known, 1)
        return [self.samples * (period / 1e9), average, self.largest, self.speed / self.samples]


class PathSoFar:
    """The segments of a stretch while it is driven, in bounded memory: the previous one and the one at hand.

    Args:
        types: The types of path.
        neutral: deg per sample.
        period: ns between samples.
    """

    def __init__(self, types: PathTypes, neutral: float, period: int) -> None:
        self._types, self._neutral, self._period = types, neutral, period
        self._previous: SegmentSoFar | None = None
        self._own = SegmentSoFar()
        self._side = 0

    def add(self, course_deviation: float, speed: float) -> None:
        """Take the next sample; the first one of a stretch belongs to the segment of the one after it."""
        side = int(self._sides(np.array(course_deviation)))
        if side != self._side and not self._takes_any_side:
            self._previous, self._own = self._own, SegmentSoFar()
        self._side = side
        self._own = self._own.and_then(np.array([course_deviation]), np.array([speed]))

    def path_type(self, course_deviation: Floats, speed: Floats) -> str:
        """Return the path type at the last sample taken, given the path ahead (n₃,)."""
        sides = self._sides(course_deviation)
        changes = np.flatnonzero(np.diff(sides, prepend=sides[0] if self._takes_any_side else self._side))
        first, second = (int(changes[place]) if len(changes) > place else len(speed) for place in (0, 1))
        segments = [self._own.and_then(course_deviation[:first], speed[:first])]
        if self._previous is not None:
            segments.append(self._previous)
        if first < len(speed):
            segments.append(SegmentSoFar().and_then(course_deviation[first:second], speed[first:second]))
        labels = self._types.label(np.array([one.features(self._period) for one in segments])).tolist()
        own = labels[0]
        previous = own if self._previous is None else labels[1]
        return f"{previous}-{own}-{labels[-1] if first < len(speed) else own}"

    @property
    def _takes_any_side(self) -> bool:
        return self._previous is None and self._own.samples <= 1

    def _sides(self, course_deviation: Floats) -> NDArray[np.int8]:
        left, right = course_deviation > self._neutral, course_deviation < -self._neutral
        return left.astype(np.int8) - right.astype(np.int8)


def _features_so_far(series: Series, segment: NDArray[np.int32], begins: Rows, period: int) -> Floats:
    """Return MP eq. 3 at every row, of its segment up to that row (n_rows, 4)."""
    first = begins[segment]
    amount = np.abs(series.course_deviation)
    is_known = np.isfinite(amount)
    amount = np.where(is_known, amount, 0.0)

    def so_far(values: Floats) -> Floats:
        sums: Floats = np.cumsum(values)
        return sums - (sums - values)[first]

    samples = np.arange(len(segment)) - first + 1
    # The segments' numbers keep the largest of one from reaching into the next.
    order = np.lexsort((amount, segment))
    rank = np.empty(len(order), dtype=np.intp)
    rank[order] = np.arange(len(order))
    largest = amount[order][np.maximum.accumulate(rank)]
    average = so_far(amount) / np.maximum(so_far(is_known.astype(np.float64)), 1.0)
    return np.column_stack([samples * (period / 1e9), average, largest, so_far(series.speed) / samples])
