"""Tracks to drive: PP's test track, and what a driver drove, by the metre instead of by the second."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ..dataset.reference import Reference

FloatArray = npt.NDArray[np.float64]

SPACING = 0.25
"""m between the points of a track."""

STEP = 0.1
"""s, by which PP counts course deviations."""

PIECES = ((40, 0), (31, 20), (25, 0), (25, -12), (20, -30), (19, 12), (30, 0), (75, 40), (12, -8), (60, 0))
"""Length (m) and signed radius (m, 0: straight) of the pieces of PP's test track; PP gives none."""

TRANSITION = 6.0
"""m over which it goes from one piece's curvature to the next one's, as clothoids do."""

SLOWEST, FASTEST = 10 / 3.6, 40 / 3.6
"""m/s on it, PP section IV-D."""

LATERAL_ACCELERATION, ACCELERATION = 2.0, 1.5
"""m/s², by which its speed follows from its curvature within those limits, and by which it changes."""

MOVING = 1.0
"""m/s; a recording is cut where the car is slower."""

SHORTEST = 60.0
"""m; shorter stretches of a recording are no track."""

CURVATURE_BASE = 4.0
"""m over which the curvature of a recorded path is averaged, as that of a reference is."""


@dataclass(frozen=True, slots=True)
class Track:
    """A path with a speed along it, every `SPACING` metres, and what the driver did there, NaN where nobody knows.

    All arrays are (n_points,).

    Attributes:
        x: m, east.
        y: m, north.
        course: rad anticlockwise from east, not wrapped.
        curvature: 1/m, positive to the left.
        speed: m/s.
        steering_wheel_angle: deg, the driver's at this place.
        lookahead: m, the driver's.
        deviation: m, how far to the left of the path the driver was.
        start: Where a car begins: m to the left of the first point, and rad from its course.
    """

    x: FloatArray
    y: FloatArray
    course: FloatArray
    curvature: FloatArray
    speed: FloatArray
    steering_wheel_angle: FloatArray
    lookahead: FloatArray
    deviation: FloatArray
    start: tuple[float, float] = (0.0, 0.0)

    @property
    def inputs(self) -> FloatArray:
        """[Δθ, v] of every point (n_points, 2), Δθ = κ v `STEP`, deg per `STEP` and m/s: PP's inputs (II-B)."""
        return np.column_stack([np.degrees(self.curvature * self.speed * STEP), self.speed])

    @property
    def distance(self) -> FloatArray:
        """Arc length of every point (n_points,), m: s_i = i · `SPACING`."""
        return SPACING * np.arange(len(self.x), dtype=np.float64)


def lay_track(pieces: Sequence[tuple[float, float]] = PIECES) -> Track:
    """Return a track of straights and arcs with `TRANSITION` in between.

    Its speed is the greatest up to `FASTEST` that keeps to v² |κ| ≤ `LATERAL_ACCELERATION` and |d(v²)/ds| ≤ 2 ·
    `ACCELERATION`, and `SLOWEST` at least. Between points κ is constant: a chord is 2 sin(κ ds / 2) / κ long.

    Args:
        pieces: Length (m) and signed radius (m, positive to the left, 0: straight) of each.
    """
    by_piece = np.concatenate([np.full(round(length / SPACING), 1 / r if r else 0.0) for length, r in pieces])
    curvature = _averaged(by_piece, TRANSITION)
    turned = np.concatenate([[0.0], np.cumsum(curvature)[:-1]]) * SPACING
    middle = turned[:-1] + curvature[:-1] * SPACING / 2
    chord = SPACING * np.sinc(curvature[:-1] * SPACING / (2 * np.pi))
    square = np.clip(LATERAL_ACCELERATION / np.maximum(np.abs(curvature), 1e-6), SLOWEST**2, FASTEST**2)
    # v² changes by 2·a per metre at most: the lowest of all cones that open backwards, then forwards.
    change = 2 * ACCELERATION * SPACING * np.arange(len(square))
    square = np.minimum.accumulate((square + change)[::-1])[::-1] - change
    square = np.minimum.accumulate(square - change) + change
    unknown = np.full(len(curvature), np.nan)
    return Track(
        x=np.concatenate([[0.0], np.cumsum(chord * np.cos(middle))]),
        y=np.concatenate([[0.0], np.cumsum(chord * np.sin(middle))]),
        course=turned,
        curvature=curvature,
        speed=np.sqrt(square),
        steering_wheel_angle=unknown,
        lookahead=unknown,
        deviation=unknown,
    )


def recorded_tracks(table: pa.Table, period: int, reference: Reference | None = None) -> list[Track]:
    """Return the stretches of a recording as tracks: uninterrupted, faster than `MOVING`, and of `SHORTEST` at least.

    A track is the reference path that the driver followed where there is one, else the path that was driven, of
    curvature κ = Δθ / (v Δt), averaged over `CURVATURE_BASE`.

    Args:
        table: Columns of `DATASET`, one recording.
        period: ns between two rows of a run.
        reference: In the recording's plane.
    """
    columns = {name: table[name].to_numpy() for name in (
        "x", "y", "course", "course_deviation", "speed", "steering_wheel_angle", "lookahead",
    )}  # fmt: skip
    time = table["time"].cast(pa.int64()).to_numpy()
    needed = np.isfinite([columns[name] for name in ("x", "y", "course", "course_deviation", "speed")]).all(axis=0)
    needed &= columns["speed"] > MOVING
    run = table["run"].to_numpy()
    place = np.full(len(time), np.nan)
    if reference is not None:
        place = reference.locate(columns["x"], columns["y"], columns["course"], run)
        needed &= np.isfinite(place)
    begins = np.ones(len(time), np.bool_)
    begins[1:] = (run[1:] != run[:-1]) | (np.diff(time) != period) | (needed[1:] != needed[:-1])
    tracks: list[Track] = []
    for rows in np.split(np.arange(len(time)), np.flatnonzero(begins)[1:]):
        if len(rows) > 1 and needed[rows[0]]:
            own = {name: values[rows] for name, values in columns.items()}
            tracks += _as_driven(own, period) if reference is None else _along(own, place[rows], reference)
    return tracks


def _as_driven(own: dict[str, FloatArray], period: int) -> Iterator[Track]:
    s = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(own["x"]), np.diff(own["y"])))])
    kept = np.concatenate([[True], np.diff(s) > 0])
    s = s[kept]
    if s[-1] < SHORTEST:
        return
    at = np.arange(0.0, s[-1], SPACING)

    def sampled(values: FloatArray) -> FloatArray:
        found: FloatArray = np.interp(at, s, values[kept])
        return found

    bent = np.radians(own["course_deviation"]) / (own["speed"] * period / 1e9)
    yield Track(
        x=sampled(own["x"]),
        y=sampled(own["y"]),
        course=sampled(np.unwrap(np.radians(own["course"]))),
        curvature=_averaged(sampled(bent), CURVATURE_BASE),
        speed=sampled(own["speed"]),
        steering_wheel_angle=sampled(own["steering_wheel_angle"]),
        lookahead=sampled(own["lookahead"]),
        deviation=np.zeros(len(at)),
    )


def _along(own: dict[str, FloatArray], place: FloatArray, reference: Reference) -> Iterator[Track]:
    length = float(np.hypot(np.diff(reference.x), np.diff(reference.y)).sum())
    if reference.closed:
        place = np.unwrap(place, period=length)
    kept = np.concatenate([[True], np.diff(np.maximum.accumulate(place)) > 0])
    s = place[kept]
    if s[-1] - s[0] < SHORTEST:
        return
    at = np.arange(s[0], s[-1], SPACING)
    grid = np.linspace(0.0, length, len(reference.x))

    def point(where: FloatArray) -> tuple[FloatArray, FloatArray]:
        # Beyond the ends of an open path the chord is shorter, and no less a direction.
        within = where % length if reference.closed else np.clip(where, 0.0, length)
        return np.interp(within, grid, reference.x), np.interp(within, grid, reference.y)

    def sampled(values: FloatArray) -> FloatArray:
        found: FloatArray = np.interp(at, s, values[kept])
        return found

    (x, y), (behind_x, behind_y), (ahead_x, ahead_y) = (point(at + by) for by in (0.0, -1.0, 1.0))
    course = np.unwrap(np.arctan2(ahead_y - behind_y, ahead_x - behind_x))
    deviation = np.cos(course) * (sampled(own["y"]) - y) - np.sin(course) * (sampled(own["x"]) - x)
    yield Track(
        x=x,
        y=y,
        course=course,
        curvature=reference.curvature(at),
        speed=sampled(own["speed"]),
        steering_wheel_angle=sampled(own["steering_wheel_angle"]),
        lookahead=sampled(own["lookahead"]),
        deviation=deviation,
        start=(float(deviation[0]), float(np.angle(np.exp(1j * (np.radians(own["course"][0]) - course[0]))))),
    )


def _averaged(values: FloatArray, over: float) -> FloatArray:
    """Return values at the points averaged over so many metres around each, the ends held."""
    around = round(over / SPACING / 2)
    padded = np.pad(values, around, mode="edge")
    return np.convolve(padded, np.full(2 * around + 1, 1 / (2 * around + 1)), mode="valid")
