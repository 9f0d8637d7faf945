"""The narrow pass: its exponentials against the C library's, its sums against their formulas."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit
from numpy.typing import NDArray

from wheelprint.modeling.densities import factorise, log_constants
from wheelprint.modeling.narrow_rows import LOWEST, exponential, narrow_pass


def each_exponential(values: NDArray[np.float64]) -> NDArray[np.float64]:
    found = np.empty_like(values)
    for place in range(len(values)):
        found[place] = exponential(values[place])
    return found


exponentials = njit(each_exponential)


@given(st.lists(st.floats(-1000.0, 0.0), min_size=1, max_size=40))
def test_exponentials_are_those_of_the_library(values: list[float]) -> None:
    np.testing.assert_allclose(exponentials(np.array(values)), np.exp(np.maximum(values, LOWEST)), rtol=1e-15)


def test_exponentials_at_the_ends() -> None:
    found = exponentials(np.array([0.0, -0.0, LOWEST, -np.inf]))
    np.testing.assert_allclose(found, [1.0, 1.0, np.exp(LOWEST), np.exp(LOWEST)], rtol=1e-15)


@pytest.mark.parametrize("columns", [1, 3, 8])
@pytest.mark.parametrize("rows", [1, 127, 700])
@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("cutoff", [37.0, np.inf])
def test_sums_are_those_of_the_formulas(columns: int, rows: int, weighted: bool, cutoff: float) -> None:
    """Rows come in groups, so that with a cutoff a component that is far from all of a block is left out."""
    rng = np.random.default_rng(rows + columns)
    k, x = 4, np.repeat(rng.normal(scale=20.0, size=(4, columns)), -(-rows // 4), axis=0)[:rows]
    x = x + rng.normal(size=x.shape)
    spread = rng.normal(size=(k, columns, columns))
    covariances = spread @ spread.transpose(0, 2, 1) + np.eye(columns)
    parameters = factorise(rng.uniform(0.1, 1.0, k), rng.normal(scale=20.0, size=(k, columns)), covariances)
    constants = log_constants(parameters.weights, parameters.inverses)
    weights = rng.uniform(0.0, 3.0, rows) if weighted else np.empty(0)
    sums = np.zeros(k), np.zeros((k, columns)), np.zeros((k, columns, columns))
    found = narrow_pass(x, weights, parameters.means, parameters.inverses, constants, cutoff, *sums)

    y = np.einsum("kij,nkj->nki", parameters.inverses, x[:, None] - parameters.means)
    joint = constants - 0.5 * np.square(y).sum(axis=2)
    total = np.logaddexp.reduce(joint, axis=1)
    counted = weights if weighted else np.ones(rows)
    r = counted[:, None] * np.exp(joint - total[:, None])
    second = np.einsum("nk,nki,nkj->kij", r, y, y)
    assert found == pytest.approx(counted @ total, rel=1e-12)
    for ours, theirs in zip(sums, (r.sum(axis=0), np.einsum("nk,nki->ki", r, y), np.tril(second)), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)
