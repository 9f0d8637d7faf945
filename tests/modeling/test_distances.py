"""What is left of distances when components move, against the distances themselves."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.modeling.densities import Parameters, factorise
from wheelprint.modeling.distances import Distances


def parameters(generator: np.random.Generator, k: int, d: int, spread: float) -> Parameters:
    """Components around the origin, more or less round."""
    directions = np.eye(d) + spread * generator.standard_normal((k, d, d))
    covariances = directions @ directions.transpose(0, 2, 1) + 1e-6 * np.eye(d)
    return factorise(generator.dirichlet(np.full(k, 9.0)), spread * generator.standard_normal((k, d)), covariances)


def between(rows: npt.NDArray[np.float64], components: Parameters) -> npt.NDArray[np.float64]:
    """Mahalanobis distances (n, k), written out."""
    return np.array(
        [
            [np.sqrt((x - mean) @ np.linalg.solve(covariance, x - mean)) for mean, covariance in own]
            for x in rows
            for own in [list(zip(components.means, components.covariances, strict=True))]
        ]
    )


@given(
    seed=st.integers(0, 1000),
    k=st.integers(2, 3),
    d=st.integers(12, 16),
    spread=st.floats(1e-3, 3.0),
    change=st.booleans(),
)
def test_nothing_is_nearer_than_is_known(seed: int, k: int, d: int, spread: float, change: bool) -> None:
    generator = np.random.default_rng(seed)
    rows = 10.0 * generator.standard_normal((20, d))
    before, after = parameters(generator, k, d, spread), parameters(generator, k, d, spread)
    distances = Distances.unknown(len(rows), before)
    assert distances.least.shape == (20, k)
    assert [len(values) for values in distances.move(before)] == [0, 0]
    shrinks, shifts = distances.move(after if change else before)
    left = shrinks * between(rows, before) - shifts
    assert (left <= between(rows, after if change else before) * (1 + 1e-9)).all()
    if not change:
        np.testing.assert_allclose(left, between(rows, before), rtol=1e-4)


def test_no_distances_are_kept_where_they_would_need_as_much_memory_as_rows() -> None:
    many = parameters(np.random.default_rng(0), 4, 12, 1.0)
    distances = Distances.unknown(1000, many)
    assert distances.least.shape == (0, 4)
    distances.move(many)
    assert [len(values) for values in distances.move(many)] == [0, 0]
