"""The page of benchmarks says what was measured, and the comparison of ratios finds one that fell."""

from __future__ import annotations

import json
from itertools import pairwise
from xml.etree import ElementTree as ET

import pytest

from benchmarks.performance_page import DOCS, bars, curves, pages
from benchmarks.run import EXPECTED, RESULTS, fallen


def test_the_page_and_its_plots_are_what_the_results_give() -> None:
    drawn = pages(json.loads(RESULTS.read_text(encoding="utf-8")))
    assert "performance.md" in drawn
    for name, content in drawn.items():
        assert (DOCS / name).read_text(encoding="utf-8") == content, "run `python -m benchmarks.performance_page`"


def test_a_plot_is_xml_with_a_bar_for_each_row() -> None:
    picture = ET.fromstring(bars("a < b", [("Wheelprint", 4.0, "4 & more"), ("other", 1.0, "1")]))  # noqa: S314
    rectangles = picture.findall("{http://www.w3.org/2000/svg}rect")[1:]
    widths = [float(rectangle.get("width", "0")) for rectangle in rectangles]
    assert widths[0] == 4 * widths[1]


def test_a_plot_of_curves_has_equal_steps_for_equal_ratios() -> None:
    lines = {"Wheelprint": [(1.0, 3.0), (10.0, 30.0), (100.0, 300.0)], "other": [(1.0, 9.0), (100.0, 9.0)]}
    picture = ET.fromstring(curves("t", "x", "y", lines))  # noqa: S314
    first, second = picture.findall("{http://www.w3.org/2000/svg}polyline")
    places = [tuple(map(float, point.split(","))) for point in first.get("points", "").split()]
    steps = [(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(places)]
    assert steps[0] == pytest.approx(steps[1], abs=0.1)
    assert steps[0][0] > 0 > steps[0][1]
    heights = {point.split(",")[1] for point in second.get("points", "").split()}
    assert len(heights) == 1


def test_a_ratio_that_falls_by_a_third_is_told() -> None:
    expected = {"one": 30.0, "two": 3.0, "three": 1.0}
    assert fallen({"one": 20.1, "two": 2.1, "three": 9.0}, expected) == []
    assert fallen({"one": 19.9, "three": 1.0}, expected) == ["one: 19.9 ×, of 30.0 × expected", "two: not measured"]


def test_ratios_are_expected_of_each_kind() -> None:
    names = " ".join(json.loads(EXPECTED.read_text(encoding="utf-8")))
    assert all(kind in names for kind in ("candump", "BLF", "NCOM", "EM"))
