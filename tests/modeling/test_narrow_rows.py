"""The compiled exponentials of the narrow pass, against the C library's."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.modeling.narrow_rows import LOWEST, exponentials


@given(st.lists(st.floats(-1000.0, 0.0), min_size=1, max_size=40))
def test_exponentials_are_those_of_the_library(values: list[float]) -> None:
    found = np.array(values)
    exponentials(found, np.empty(len(found)))
    np.testing.assert_allclose(found, np.exp(np.maximum(values, LOWEST)), rtol=1e-15)


def test_exponentials_at_the_ends() -> None:
    found = np.array([0.0, -0.0, LOWEST, -np.inf])
    exponentials(found, np.empty(4))
    np.testing.assert_allclose(found, [1.0, 1.0, np.exp(LOWEST), np.exp(LOWEST)], rtol=1e-15)
