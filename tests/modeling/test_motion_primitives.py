"""Motion primitives: against closed forms, and which regression predicts which path type."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn import linear_model
from sklearn.preprocessing import StandardScaler

from wheelprint.modeling.motion_primitives import (
    EVERYTHING,
    N1,
    OUTPUT_NOISE,
    OWN_WINDOWS,
    PRIOR_WINDOWS,
    fit_motion_primitives,
)

INPUTS, OUTPUTS = 4, 3
CHANNELS = INPUTS + OUTPUTS


def gaussian(n: int, seed: int, gain: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Windows of one Gaussian: correlated inputs of unequal scales, outputs with noise of sd 1, 2 and 3."""
    rng = np.random.default_rng(seed)
    inputs = rng.normal(size=(n, INPUTS)) @ np.diag([1.0, 5.0, 0.1, 30.0]) @ (np.eye(INPUTS) + 0.3) + 2.0
    matrix = gain * np.array([[1.0, 0.2, 3.0, 0.0], [0.0, -0.5, 1.0, 0.1], [2.0, 0.0, 0.0, -0.2]])
    return inputs, inputs @ matrix.T + rng.normal(size=(n, OUTPUTS)) * [1.0, 2.0, 3.0]


def types(**counts: int) -> np.ndarray:
    """Path types, `t121=5` for five times `1-2-1`."""
    return np.repeat(["-".join(name[1:]) for name in counts], list(counts.values()))


def test_one_component_is_ridge_regression() -> None:
    inputs, outputs = gaussian(300, 0)
    primitives = fit_motion_primitives(inputs, outputs, types(t111=300), n1=1, components=1, shrinkage=7.0)
    scaler = StandardScaler().fit(inputs)
    reference = linear_model.Ridge(alpha=7.0, solver="cholesky").fit(scaler.transform(inputs), outputs)
    query = gaussian(20, 1)[0]
    mean, variance = primitives.predict(query, types(t121=20))
    np.testing.assert_allclose(mean, reference.predict(scaler.transform(query)), rtol=1e-8)
    Z, centred = scaler.transform(inputs), outputs - outputs.mean(axis=0)
    explained = (centred * (Z @ reference.coef_.T)).mean(axis=0)
    expected = (1.0 + OUTPUT_NOISE) * outputs.var(axis=0) - explained
    np.testing.assert_allclose(variance, np.broadcast_to(expected, variance.shape), rtol=1e-8)


@pytest.mark.parametrize("components", [1, 3])
def test_bands_hold_what_they_promise(components: int) -> None:
    primitives = fit_motion_primitives(
        *gaussian(4000, 2), types(t111=4000), n1=1, components=components, shrinkage=0.01
    )
    inputs, outputs = gaussian(4000, 3)
    mean, variance = primitives.predict(inputs, types(t111=4000))
    score = np.abs(outputs - mean) / np.sqrt(variance)
    assert (score <= 1.0).mean() == pytest.approx(0.683, abs=0.02)
    assert (score <= 1.96).mean() == pytest.approx(0.95, abs=0.01)
    np.testing.assert_allclose(np.sqrt(variance).mean(axis=0), [1.0, 2.0, 3.0], rtol=0.1)


ENOUGH = OWN_WINDOWS * CHANNELS


def test_rare_path_types_fall_back() -> None:
    inputs, outputs = gaussian(3 * ENOUGH + 5, 4)
    path_types = types(t121=ENOUGH, t122=ENOUGH - 1, t131=2, t111=ENOUGH + 4)
    primitives = fit_motion_primitives(inputs, outputs, path_types, n1=27, components=1, shrinkage=0.01)
    assert list(primitives.regressions) == [EVERYTHING, "1", "2", "1-1-1", "1-2-1"]
    assert primitives.samples == {
        "1": ENOUGH + 4, "1-1-1": ENOUGH + 4, "1-2-1": ENOUGH, "1-2-2": ENOUGH - 1, "1-3-1": 2,
        "2": 2 * ENOUGH - 1, "3": 2, EVERYTHING: 3 * ENOUGH + 5,
    }  # fmt: skip
    assert primitives.fallbacks() == {"1-2-2": "2", "1-3-1": EVERYTHING}
    assert primitives.coarser(3).fallbacks() == {"3": EVERYTHING}
    assert primitives.coarser(1).fallbacks() == {}
    assert [primitives.model_of(name) for name in ("1-2-1", "3-2-3", "1-4-1")] == ["1-2-1", "2", EVERYTHING]
    assert [primitives.coarser(3).model_of(name) for name in ("1-2-1", "1-3-1")] == ["2", EVERYTHING]


def test_one_component_adapts_as_if_windows_of_its_parent_stood_beside() -> None:
    """By the moments of everything, the windows of one label, and the prior; inputs standardised for the noise."""
    (inputs, outputs), own = gaussian(500, 5), slice(0, 120)
    inputs[own] += 1.0
    outputs[own] *= 2.0
    path_types = types(t121=120, t131=380)
    shrinkage, prior = 3.0, PRIOR_WINDOWS * CHANNELS
    primitives = fit_motion_primitives(inputs, outputs, path_types, n1=3, components=1, shrinkage=shrinkage)
    joint = np.column_stack([inputs, outputs])
    noise = np.diag(shrinkage * joint.var(axis=0)) * (np.arange(CHANNELS) < INPUTS)
    level, moments = joint.mean(axis=0), len(joint) * np.cov(joint.T, bias=True)
    of_all = (moments + noise) / len(joint)
    mean = (joint[own].sum(axis=0) + prior * level) / (120 + prior)
    about = (joint[own] - mean).T @ (joint[own] - mean) + prior * (of_all + np.outer(level - mean, level - mean))
    covariance = (about + noise) / (120 + prior)
    matrix = np.linalg.solve(covariance[:INPUTS, :INPUTS], covariance[:INPUTS, INPUTS:])
    query = gaussian(20, 6)[0]
    predicted, variance = primitives.predict(query, types(t121=20))
    np.testing.assert_allclose(predicted, mean[INPUTS:] + (query - mean[:INPUTS]) @ matrix, rtol=1e-4)
    conditional = np.diag(covariance[INPUTS:, INPUTS:] - matrix.T @ covariance[:INPUTS, INPUTS:])
    np.testing.assert_allclose(variance, np.broadcast_to(conditional, variance.shape), rtol=1e-3)


def test_many_windows_make_a_path_type_its_own() -> None:
    left, right = gaussian(6000, 5, gain=1.0), gaussian(6000, 6, gain=-1.0)
    inputs, outputs = (np.concatenate(pair) for pair in zip(left, right, strict=True))
    path_types = types(t121=6000, t131=6000)
    primitives = fit_motion_primitives(inputs, outputs, path_types, n1=3, components=1, shrinkage=0.01)
    shuffled = np.random.default_rng(0).permutation(12000)
    mean, _ = primitives.predict(inputs[shuffled], path_types[shuffled])
    # Noise of sd 1, 2 and 3 alone makes a mean error of 1.6.
    assert np.abs(mean - outputs[shuffled]).mean() < 1.8
    together, _ = primitives.coarser(1).predict(inputs, path_types)
    assert np.abs(together - outputs).mean() > 4.0


def test_coarser_structures_are_those_fitted_alone() -> None:
    inputs, outputs = gaussian(900, 7)
    path_types = types(t121=450, t131=450)
    whole = fit_motion_primitives(inputs, outputs, path_types, n1=27, components=2, shrinkage=0.01, seed=3)
    for n1 in (1, 3):
        alone = fit_motion_primitives(inputs, outputs, path_types, n1=n1, components=2, shrinkage=0.01, seed=3)
        coarser = whole.coarser(n1)
        assert list(coarser.regressions) == list(alone.regressions)
        for ours, theirs in zip(coarser.predict(inputs, path_types), alone.predict(inputs, path_types), strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_forecasts_of_several_structures_are_those_of_each() -> None:
    inputs, outputs = gaussian(900, 7)
    path_types = types(t121=450, t131=450)
    whole = fit_motion_primitives(inputs, outputs, path_types, n1=27, components=2, shrinkage=0.01)
    levels: tuple[N1, ...] = (27, 1, 3)
    for n1, forecast in zip(levels, whole.forecasts(inputs, path_types, levels), strict=True):
        alone = whole.coarser(n1).forecast(inputs, path_types)
        np.testing.assert_array_equal(forecast.mean, alone.mean)
        np.testing.assert_array_equal(forecast.sd, alone.sd)


def test_units_change_nothing() -> None:
    inputs, outputs = gaussian(400, 8)
    path_types = types(t111=400)
    units = np.array([1e3, 0.01, 57.3, 1.0])
    one = fit_motion_primitives(inputs, outputs, path_types, n1=1, components=2, shrinkage=0.01).predict(
        inputs, path_types
    )
    other = fit_motion_primitives(inputs * units, outputs, path_types, n1=1, components=2, shrinkage=0.01).predict(
        inputs * units, path_types
    )
    for ours, theirs in zip(one, other, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-6)


def test_too_few_windows() -> None:
    inputs, outputs = gaussian(20, 9)
    message = "^3 components of 7 channels need 21 windows, not 20$"
    with pytest.raises(ValueError, match=message):
        fit_motion_primitives(inputs, outputs, types(t111=20), n1=1, components=3, shrinkage=0.01)
