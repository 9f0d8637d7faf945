"""Products with packed matrices against numpy's, and the order in which columns are evenly spread."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from wheelprint.modeling.input_order import spread
from wheelprint.modeling.panels import PANEL_BYTES, TOGETHER, Panels, multiply, packed, width

Floats = npt.NDArray[np.floating[Any]]


def product(rows: Floats, panels: Panels, c: int, squares: Floats) -> Floats:
    """Rows with all panels, from the second row on into the third row on of what is returned."""
    into = np.full((TOGETHER + 3, width(panels)), np.nan, rows.dtype)
    for p in range(len(panels.reaches)):
        column = p * (PANEL_BYTES // rows.itemsize)
        multiply(panels.values, c, panels.begins[p], panels.reaches[p], rows, 1, into, 2, column, squares)
    return into


compiled_product = njit(product)


@settings(max_examples=60)
@given(
    seed=st.integers(0, 1000),
    m=st.integers(1, 40),
    d=st.integers(1, 40),
    triangular=st.booleans(),
    kind=st.sampled_from([np.float32, np.float64]),
)
def test_products_are_numpys(seed: int, m: int, d: int, triangular: bool, kind: type[np.floating[Any]]) -> None:
    generator = np.random.default_rng(seed)
    matrices = generator.standard_normal((2, m, d))
    if triangular:
        matrices = np.tril(matrices)
    rows = generator.standard_normal((TOGETHER + 2, d)).astype(kind)
    panels, squares = packed(matrices, kind), np.ones(TOGETHER, kind)
    found = compiled_product(rows, panels, 1, squares)
    expected = rows[1 : 1 + TOGETHER].astype(np.float64) @ matrices[1].T
    tolerance = 1e-13 if kind == np.float64 else 1e-5
    assert found.dtype == kind
    np.testing.assert_allclose(found[2 : 2 + TOGETHER, :m], expected, rtol=tolerance, atol=40 * tolerance)
    assert (found[2 : 2 + TOGETHER, m:] == 0).all()
    assert np.isnan(found[:2]).all()
    assert np.isnan(found[2 + TOGETHER :]).all()
    squared = 1 + np.square(expected).sum(axis=1)
    np.testing.assert_allclose(squares, squared, rtol=40 * tolerance)


@pytest.mark.parametrize(("kind", "values"), [(np.float64, 8 * (8 + 16 + 20)), (np.float32, 16 * (16 + 20))])
def test_zeros_of_triangular_matrices_are_left_out(kind: type[np.floating[Any]], values: int) -> None:
    panels = packed(np.tril(np.ones((1, 20, 20))), kind)
    assert panels.values.shape == (1, values)
    assert packed(np.zeros((3, 20, 20)), kind).values.shape == (3, 0)


@given(n=st.integers(1, 200), first=st.integers(1, 200))
def test_the_first_few_columns_are_evenly_spread(n: int, first: int) -> None:
    order = spread(n)
    assert sorted(order) == list(range(n))
    gaps = np.diff([-1, *sorted(order[:first]), n])
    assert gaps.max() <= 4 * n / min(first, n)
    assert order[0] == 0
