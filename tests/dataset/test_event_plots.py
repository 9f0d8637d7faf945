"""The small plots of the review page: scales, breaks, marks."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.dataset.event_plots import BOTTOM, LEFT, PANELS, RIGHT, TOP, _marks, plot
from wheelprint.dataset.events import Event
from wheelprint.schemas.tables import SYNCED

START = 1_700_000_000_000_000_000
TICK = 100_000_000
SPEED, ACCELERATION, STEERING = PANELS
EVENT = Event("anna/ring", START + 200 * TICK, START + 240 * TICK, "swerve", 1.0, "proposed", "", "")


def synced(**columns: Any) -> pa.Table:
    """One minute with some columns; the others are null."""
    arrays = {f.name: pa.nulls(600, f.type) for f in SYNCED}
    arrays["time"] = pa.array(START + TICK * np.arange(600)).cast(SYNCED.field("time").type)
    for name, values in columns.items():
        arrays[name] = pa.array(np.asarray(values, float), from_pandas=True)
    return pa.table(arrays, schema=SYNCED)


def points(path: str) -> list[tuple[str, float, float]]:
    """Pen, x and y of every point of an SVG path."""
    return [(pen, float(x), float(y)) for pen, x, y in re.findall(r"([ML])(-?[\d.]+) (-?[\d.]+)", path)]


def test_a_line_is_where_its_time_and_value_are() -> None:
    drawn = plot(SPEED, synced(nav_speed=np.arange(600) / 36), EVENT)
    ((name, _, path),) = drawn.lines
    found = points(path)
    assert name == ""
    assert len(found) == 200, "8 s, the event of 4 s, and 8 s, half-open"
    assert [pen for pen, _, _ in found] == ["M"] + ["L"] * 199
    assert found[0][1] == LEFT
    at_start = found[80]
    assert at_start[1] == pytest.approx(drawn.start, abs=0.05)
    highest = 31.9  # km/h at 31.9 s
    assert at_start[2] == pytest.approx(BOTTOM - (BOTTOM - TOP) * 20.0 / highest, abs=0.05)
    assert found[-1][2] == pytest.approx(TOP, abs=0.05)
    assert drawn.stop - drawn.start == pytest.approx((RIGHT - LEFT) * 4 / 20)


def test_a_line_breaks_where_values_are_missing() -> None:
    speed = np.full(600, 10.0)
    speed[210:215] = np.nan
    ((_, _, path),) = plot(SPEED, synced(nav_speed=speed), EVENT).lines
    found = points(path)
    assert len(found) == 195
    assert [number for number, (pen, _, _) in enumerate(found) if pen == "M"] == [0, 90]


def test_where_navigation_is_missing_the_car_s_own_signal_is_drawn() -> None:
    ((_, _, path),) = plot(SPEED, synced(speed=np.full(600, 5.0)), EVENT).lines
    assert points(path)[0][2] == pytest.approx(BOTTOM - (BOTTOM - TOP) * 18 / 20, abs=0.05)


def test_without_values_there_are_axes_and_no_line() -> None:
    drawn = plot(ACCELERATION, synced(), EVENT)
    assert [(name, path) for name, _, path in drawn.lines] == [("longitudinal", ""), ("lateral", "")]
    assert [label for _, label in drawn.marks_y] == ["−4", "−2", "0", "2", "4"]
    assert [label for _, label in drawn.marks_x] == ["−5", "0", "5", "10"]


def test_a_long_event_is_thinned() -> None:
    long = Event("anna/ring", START, START + 20_000 * TICK, "standstill", 0.0, "proposed", "", "")
    arrays = {f.name: pa.nulls(20_000, f.type) for f in SYNCED}
    arrays["time"] = pa.array(START + TICK * np.arange(20_000)).cast(SYNCED.field("time").type)
    arrays["steering_wheel_angle"] = pa.array(np.zeros(20_000))
    ((_, _, path),) = plot(STEERING, pa.table(arrays, schema=SYNCED), long).lines
    assert 600 < len(points(path)) <= 1200


@given(low=st.floats(-1e6, 1e6), width=st.floats(1e-3, 1e6), intervals=st.integers(2, 10))
def test_marks_are_round_numbers_within_the_axis(low: float, width: float, intervals: int) -> None:
    values = np.array([value for value, _ in _marks(low, low + width, intervals)])
    assert len(values) <= intervals + 1
    assert (values >= low - 1e-9 * abs(low)).all()
    assert (values <= low + width + 1e-9 * (abs(low) + width)).all()
    if len(values) > 1:
        step = np.diff(values).mean()
        mantissa = step / 10.0 ** np.floor(np.log10(step) + 1e-6)
        assert min(abs(mantissa - nice) for nice in (1, 2, 5)) < 1e-3
