"""Baselines against scikit-learn and against what they are by definition."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn import linear_model
from sklearn.preprocessing import StandardScaler

from wheelprint.modeling.baselines import Persistence, Ridge


def linear(n: int, noise: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """Inputs of unequal scales, one of them constant and two nearly the same, and two outputs."""
    rng = np.random.default_rng(5)
    inputs = rng.normal([3.0, -50.0, 0.0, 7.0], [1.0, 20.0, 1e-3, 0.0], (n, 4))
    inputs = np.column_stack([inputs, inputs[:, 1] + rng.normal(0, 1e-3, n)])
    outputs = np.column_stack([2.0 * inputs[:, 0] - inputs[:, 1], 300.0 * inputs[:, 2] + 4.0])
    return inputs, outputs + rng.normal(0, noise, (n, 2))


def test_persistence_keeps_the_angle() -> None:
    current = np.array([1.0, -2.0, 5.0])
    outputs = np.array([[1.0, 2.0], [-2.0, -4.0], [5.0, 9.0]])
    mean, variance = Persistence.fit(current, outputs).predict(np.array([7.0, -1.5]))
    assert mean.tolist() == [[7.0, 7.0], [-1.5, -1.5]]
    assert variance.tolist() == [[0.0, 7.0], [0.0, 7.0]]


@pytest.mark.parametrize("penalty", [1e-3, 1.0, 300.0])
def test_ridge_is_that_of_scikit_learn(penalty: float) -> None:
    inputs, outputs = linear(80)
    scaler = StandardScaler().fit(inputs)
    reference = linear_model.Ridge(alpha=penalty, solver="svd").fit(scaler.transform(inputs), outputs)
    ours = Ridge.fit(inputs, outputs, penalties=[penalty])
    np.testing.assert_allclose(
        ours.predict(inputs)[0], reference.predict(scaler.transform(inputs)), rtol=1e-7, atol=1e-7
    )


def test_penalty_is_chosen_over_blocks_with_gaps() -> None:
    inputs, outputs = linear(60, noise=60.0)
    penalties, blocks, gap = (0.1, 10.0, 1000.0), 4, 3
    Z, level = StandardScaler().fit_transform(inputs), outputs.mean(axis=0)
    errors = {penalty: np.empty_like(outputs) for penalty in penalties}
    for block in np.array_split(np.arange(60), blocks):
        outside = [row for row in range(60) if row < block[0] - gap or row > block[-1] + gap]
        for penalty in penalties:
            model = linear_model.Ridge(alpha=penalty, fit_intercept=False).fit(Z[outside], (outputs - level)[outside])
            errors[penalty][block] = model.predict(Z[block]) - (outputs - level)[block]
    best = min(penalties, key=lambda penalty: float(np.abs(errors[penalty]).mean()))
    ridge = Ridge.fit(inputs, outputs, blocks=blocks, gap=gap, penalties=penalties)
    assert ridge.penalty == best == 10.0
    np.testing.assert_allclose(ridge.variances, np.square(errors[best]).mean(axis=0), rtol=1e-9)


def test_bands_of_ridge_hold_what_they_promise() -> None:
    inputs, outputs = linear(4000, noise=2.0)
    ridge = Ridge.fit(inputs[:2000], outputs[:2000])
    mean, variance = ridge.predict(inputs[2000:])
    inside = np.abs(outputs[2000:] - mean) <= np.sqrt(variance)
    assert inside.mean() == pytest.approx(0.683, abs=0.03)
    assert np.sqrt(variance[0]) == pytest.approx(2.0, rel=0.05)


def test_ridge_needs_samples() -> None:
    inputs, outputs = linear(19)
    with pytest.raises(ValueError, match=r"^ridge regression with 10 blocks needs at least 20 samples, found 19$"):
        Ridge.fit(inputs, outputs)
