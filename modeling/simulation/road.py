"""Generated roads: straights, clothoids and arcs joined into towns, ring roads and highways."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

STEP = 0.25  # m between samples of the centre line: 1 mm of sagitta in the tightest turn
KINDS = ("straight", "curve", "turn", "lane change", "crossing")


@dataclass(frozen=True, slots=True)
class Road:
    """The centre line of the lane that is driven, sampled every `STEP` metres of arc length.

    It begins at the origin, in any direction. Curvature is continuous and linear in arc length between the joints.

    Attributes:
        s: m (n,), arc length from the beginning.
        x: m (n,), east.
        y: m (n,), north.
        heading: rad (n,), direction, anticlockwise from east, not wrapped.
        curvature: 1/m (n,), positive to the left.
        kind: uint8 (n,), index into `KINDS`.
        limit: m/s (n,), speed limit.
        stop_lines: m (k,), arc lengths at which traffic lights may stop the car.
    """

    s: npt.NDArray[np.float64]
    x: npt.NDArray[np.float64]
    y: npt.NDArray[np.float64]
    heading: npt.NDArray[np.float64]
    curvature: npt.NDArray[np.float64]
    kind: npt.NDArray[np.uint8]
    limit: npt.NDArray[np.float64]
    stop_lines: npt.NDArray[np.float64]


@dataclass(slots=True)
class _Layout:
    """Joints of a road that grows: arc length and curvature where the rate of curvature changes, and what begins where.

    Every element begins and ends with zero curvature.
    """

    s: list[float] = field(default_factory=lambda: [0.0])
    curvature: list[float] = field(default_factory=lambda: [0.0])
    starts: list[tuple[float, int, float]] = field(default_factory=list)
    stop_lines: list[float] = field(default_factory=list)

    def _add(self, kind: str, limit: float, *pieces: tuple[float, float]) -> None:
        """Append an element: pieces of a length along which the curvature goes linearly to a value."""
        self.starts.append((self.s[-1], KINDS.index(kind), limit))
        for length, curvature in pieces:
            self.s.append(self.s[-1] + length)
            self.curvature.append(curvature)

    def straight(self, length: float, limit: float) -> None:
        """Append a straight."""
        self._add("straight", limit, (length, 0.0))

    def crossing(self, limit: float) -> None:
        """Append an intersection that is crossed straight on."""
        self.stop_lines.append(self.s[-1])
        self._add("crossing", limit, (25.0, 0.0))

    def curve(self, radius: float, angle: float, limit: float, kind: str = "curve") -> None:
        """Append clothoid, arc and clothoid that turn by `angle` (rad, positive to the left)."""
        # As long as comfort asks for at the limit (1 m/s³ of lateral jerk), and never more than 0.7 of the angle.
        clothoid = min(max(limit**3 / radius, 0.6 * radius), 0.7 * radius * abs(angle))
        arc = radius * abs(angle) - clothoid
        top = np.sign(angle) / radius
        self._add(kind, limit, (clothoid, top), (arc, top), (clothoid, 0.0))

    def turn(self, radius: float, side: float, angle: float, limit: float) -> None:
        """Append a turn at an intersection, behind its stop line; `side` is 1 for left, -1 for right."""
        self.stop_lines.append(self.s[-1])
        # The light stops the car before the bend begins.
        self._add("turn", limit, (3.0, 0.0))
        self.curve(radius, side * angle, limit, kind="turn")

    def lane_change(self, side: float, duration: float, limit: float, width: float = 3.5) -> None:
        """Append a change to the next lane that takes `duration` s at the limit: four clothoids."""
        length = limit * duration
        top = side * 8 * width / length**2
        quarter = length / 4
        self._add("lane change", limit, (quarter, top), (quarter, 0.0), (quarter, -top), (quarter, 0.0))


def _town(layout: _Layout, generator: np.random.Generator) -> None:
    """Five to seven blocks at 40 to 50 km/h, right turns tighter than left ones, as where one drives on the right."""
    limit = generator.choice([40.0, 45.0, 50.0]) / 3.6
    for _ in range(generator.integers(5, 8)):
        layout.straight(generator.uniform(60, 180), limit)
        what = generator.random()
        if what < 0.55:
            side = generator.choice([-1.0, 1.0])
            radius = generator.uniform(8, 11) if side < 0 else generator.uniform(11, 16)
            layout.turn(radius, side, np.radians(generator.uniform(84, 96)), limit)
        elif what < 0.7:
            layout.crossing(limit)
        elif what < 0.85:
            angle = np.radians(generator.uniform(20, 60)) * generator.choice([-1.0, 1.0])
            layout.curve(generator.uniform(40, 120), angle, limit)
        else:
            layout.lane_change(generator.choice([-1.0, 1.0]), generator.uniform(4, 5), limit)
    layout.straight(generator.uniform(40, 100), limit)


def _main_road(
    layout: _Layout, generator: np.random.Generator, limit: float, radii: tuple[float, float], straights: float
) -> None:
    """Two to four gentle curves and lane changes; an overtaking is a change to the left and one back."""
    for _ in range(generator.integers(2, 5)):
        layout.straight(generator.uniform(0.3, 1.0) * straights, limit)
        what = generator.random()
        if what < 0.6:
            radius = generator.uniform(*radii)
            length = limit * generator.uniform(6, 12)
            layout.curve(radius, min(length / radius, 1.2) * generator.choice([-1.0, 1.0]), limit)
        elif what < 0.8:
            layout.lane_change(generator.choice([-1.0, 1.0]), generator.uniform(4, 6), limit)
        else:
            layout.lane_change(1.0, generator.uniform(4, 6), limit)
            layout.straight(limit * generator.uniform(2, 5), limit)
            layout.lane_change(-1.0, generator.uniform(4, 6), limit)
    layout.straight(0.3 * straights, limit)


def generate_road(generator: np.random.Generator, length: float) -> Road:
    """Generate a road: town, ring road and highway in turn, joined by ramps, from one of the three on.

    Args:
        generator: Source of all choices.
        length: m, the least length of the road.

    Returns:
        The road, somewhat longer than asked: between joints dκ/ds is constant, x and y are sums of chords.
    """
    layout = _Layout()
    layout.straight(40.0, 40.0 / 3.6)
    district = int(generator.integers(3))
    while layout.s[-1] < length:
        if district == 0:
            _town(layout, generator)
        elif district == 1:
            _main_road(layout, generator, generator.choice([60.0, 70.0, 80.0]) / 3.6, (100, 350), 200)
        else:
            _main_road(layout, generator, generator.choice([80.0, 90.0]) / 3.6, (300, 900), 300)
        ramp = np.radians(generator.uniform(50, 120)) * generator.choice([-1.0, 1.0])
        layout.curve(generator.uniform(35, 70), ramp, 50.0 / 3.6)
        district = (district + 1) % 3
    layout.straight(100.0, 40.0 / 3.6)
    return _sample(layout, generator.uniform(-np.pi, np.pi))


def _sample(layout: _Layout, direction: float) -> Road:
    s = np.arange(0, layout.s[-1], STEP)
    curvature = np.interp(s, layout.s, layout.curvature)
    turned = STEP * (curvature[1:] + curvature[:-1]) / 2
    heading = direction + np.concatenate(([0.0], np.cumsum(turned)))
    middle = heading[:-1] + turned / 2
    chord = STEP * np.sinc(turned / (2 * np.pi))
    starts, kinds, limits = (np.array(column) for column in zip(*layout.starts, strict=True))
    element = np.searchsorted(starts, s, side="right") - 1
    return Road(
        s=s,
        x=np.concatenate(([0.0], np.cumsum(chord * np.cos(middle)))),
        y=np.concatenate(([0.0], np.cumsum(chord * np.sin(middle)))),
        heading=heading,
        curvature=curvature,
        kind=kinds[element].astype(np.uint8),
        limit=limits[element],
        stop_lines=np.array(layout.stop_lines),
    )
