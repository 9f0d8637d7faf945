"""Angles on the circle."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.schemas.angles import unwrap_degrees, wrap_degrees

angles = st.floats(-1e6, 1e6)


def test_named_angles() -> None:
    assert wrap_degrees([0, 179, 180, 181, -180, -181, 360, 540, -540]).tolist() == [
        0, 179, -180, -179, -180, 179, 0, -180, -180,
    ]  # fmt: skip


def test_rounding_at_the_ends_stays_inside() -> None:
    last = np.nextafter(180.0, 0.0)
    assert wrap_degrees([last, np.nextafter(-180.0, -np.inf)]).tolist() == [last, last]
    for turns in range(-20, 20):
        ends = 360.0 * turns + np.array([-180.0, 180.0])
        around = wrap_degrees(np.concatenate((ends, np.nextafter(ends, -np.inf), np.nextafter(ends, np.inf))))
        assert ((around >= -180.0) & (around < 180.0)).all()


def test_shape_and_nan_are_kept() -> None:
    wrapped = wrap_degrees([[np.nan, 190.0], [370.0, -10.0]])
    np.testing.assert_array_equal(wrapped, [[np.nan, -170.0], [10.0, -10.0]])


@given(angles)
def test_wrapped_is_the_same_direction_in_range(angle: float) -> None:
    wrapped = float(wrap_degrees(angle))
    assert -180.0 <= wrapped < 180.0
    assert math.cos(math.radians(wrapped - angle)) > 1 - 1e-12


@given(st.floats(-180, 180, exclude_max=True))
def test_what_is_in_range_comes_back_bit_for_bit(angle: float) -> None:
    assert float(wrap_degrees(angle)) == angle


@given(st.integers(-180, 179), st.integers(-1000, 1000))
def test_turns_do_not_matter(angle: int, turns: int) -> None:
    assert float(wrap_degrees(angle + 360 * turns)) == angle


@given(st.lists(st.integers(-179, 179), min_size=1, max_size=50), st.integers(-180, 179))
def test_unwrapping_undoes_wrapping(steps: list[int], start: int) -> None:
    path = start + np.concatenate(([0], np.cumsum(steps))).astype(float)
    np.testing.assert_array_equal(unwrap_degrees(wrap_degrees(path)), path)


def test_unwrapping_passes_over_nan() -> None:
    wrapped = np.array([np.nan, 170.0, np.nan, -175.0, -160.0, np.nan])
    np.testing.assert_array_equal(unwrap_degrees(wrapped), [np.nan, 170.0, np.nan, 185.0, 200.0, np.nan])
    assert wrapped[3] == -175.0
