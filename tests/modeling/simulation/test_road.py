from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

from wheelprint.modeling.simulation.road import KINDS, STEP, Road, generate_road


@pytest.fixture(scope="module", params=range(4))
def road(request: pytest.FixtureRequest) -> Road:
    return generate_road(np.random.default_rng(request.param), 12_000.0)


def test_road_is_as_long_as_asked_and_begins_at_the_origin(road: Road) -> None:
    assert road.s[-1] >= 12_000
    assert (road.x[0], road.y[0]) == (0, 0)
    assert np.allclose(np.diff(road.s), STEP)


def test_curvature_is_continuous_and_the_heading_its_integral(road: Road) -> None:
    assert np.abs(np.diff(road.curvature)).max() < 0.005
    turned = cumulative_simpson(road.curvature, x=road.s, initial=0)
    assert np.abs(road.heading - road.heading[0] - turned).max() < 1e-2


def test_centre_line_follows_the_heading(road: Road) -> None:
    assert np.abs(road.x - cumulative_simpson(np.cos(road.heading), x=road.s, initial=0)).max() < 0.02
    assert np.abs(road.y - cumulative_simpson(np.sin(road.heading), x=road.s, initial=0)).max() < 0.02
    chords = np.hypot(np.diff(road.x), np.diff(road.y))
    assert chords.max() < STEP + 1e-11
    assert chords.min() > STEP * 0.9998


def test_turns_are_right_angles_of_small_radius_behind_a_stop_line(road: Road) -> None:
    turning = road.kind == KINDS.index("turn")
    edges = np.flatnonzero(np.diff(turning.astype(int)))
    turns = [(first + 1, last) for first, last in pairwise(edges) if turning[first + 1]]
    angles = np.degrees([abs(road.heading[last] - road.heading[first]) for first, last in turns])
    radii = np.array([1 / np.abs(road.curvature[first:last]).max() for first, last in turns])
    lines = np.array([np.abs(road.stop_lines - road.s[first]).min() for first, _ in turns])
    assert len(turns) >= 3
    # The parts of a turn are elements of their own; the straight one behind the stop line does not turn.
    assert (angles > 83).all()
    assert (angles < 97).all()
    assert (radii > 7.9).all()
    assert (radii < 16.1).all()
    assert (lines <= STEP).all()


def test_straights_are_straight_and_lane_changes_keep_the_heading(road: Road) -> None:
    assert (road.curvature[road.kind == KINDS.index("straight")] == 0).mean() > 0.99
    changing = road.kind == KINDS.index("lane change")
    edges = np.flatnonzero(np.diff(changing.astype(int)))
    for first, last in pairwise(edges):
        if not changing[first + 1]:
            continue
        across = -np.sin(road.heading[first]) * (road.x[last] - road.x[first]) + np.cos(road.heading[first]) * (
            road.y[last] - road.y[first]
        )
        assert abs(road.heading[last] - road.heading[first]) < 0.01
        assert abs(abs(across) - 3.5) < 0.1


def test_every_kind_and_speeds_from_town_to_highway_occur(road: Road) -> None:
    assert {"straight", "curve", "turn", "lane change"} <= {KINDS[kind] for kind in np.unique(road.kind)}
    assert 10 < road.limit.min() < 14
    assert 22 < road.limit.max() <= 25


def test_the_same_seed_gives_the_same_road() -> None:
    first, second = (generate_road(np.random.default_rng(3), 3000.0) for _ in range(2))
    assert all(np.array_equal(getattr(first, name), getattr(second, name)) for name in Road.__slots__)
