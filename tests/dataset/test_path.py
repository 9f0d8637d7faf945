"""Course deviation and distance against arithmetic done by hand, and never across runs."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.dataset.path import begins_run, course_deviation, distance


def test_course_deviation_wraps_and_begins_anew_in_every_run() -> None:
    course = np.array([170.0, 179.0, -172.0, 10.0, 5.0, np.nan, 6.0])
    run = np.array([0, 0, 0, 1, 1, 1, 1])
    deviation = course_deviation(course, run)
    np.testing.assert_array_equal(deviation, [np.nan, 9.0, 9.0, np.nan, -5.0, np.nan, np.nan])


@given(st.lists(st.tuples(st.floats(-180, 179.99), st.integers(0, 1)), max_size=40))
def test_course_deviation_equals_the_loop(samples: list[tuple[float, int]]) -> None:
    course = np.array([angle for angle, _ in samples])
    run = np.cumsum([step for _, step in samples]).astype(np.int32)
    found = course_deviation(course, run)
    assert len(found) == len(samples)
    for t in range(len(samples)):
        if t == 0 or run[t] != run[t - 1]:
            assert math.isnan(found[t])
        else:
            turned = math.radians(course[t] - course[t - 1])
            expected = math.degrees(math.atan2(math.sin(turned), math.cos(turned)))
            assert -180 <= found[t] < 180
            assert abs((found[t] - expected + 180) % 360 - 180) < 1e-9


def test_distance_leaves_gaps_out() -> None:
    x, y = np.array([0.0, 3.0, 103.0, 103.0]), np.array([0.0, 4.0, 0.0, 2.0])
    assert distance(x, y, np.array([0, 0, 1, 1])) == 7.0
    assert distance(x[:0], y[:0], np.zeros(0, int)) == 0.0


def test_runs_begin_where_the_number_changes() -> None:
    assert begins_run(np.array([4, 4, 5, 0, 0])).tolist() == [True, False, True, True, False]
    assert begins_run(np.zeros(0, int)).tolist() == []
