"""The arg max of a conditional density against a fine grid of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from wheelprint.modeling.conditional_mode import conditional_mode
from wheelprint.modeling.mixture import GaussianMixture
from wheelprint.modeling.regression import MixtureRegression


def random_mixture(rng: np.random.Generator, components: int) -> GaussianMixture:
    roots = rng.normal(size=(components, 3, 3))
    covariances = roots @ roots.transpose(0, 2, 1) + 0.05 * np.eye(3)
    return GaussianMixture.from_parameters(
        rng.uniform(0.2, 1, components), 2 * rng.normal(size=(components, 3)), covariances
    )


@pytest.mark.parametrize("seed", range(8))
def test_no_point_of_a_grid_is_more_probable(seed: int) -> None:
    rng = np.random.default_rng(seed)
    regression = MixtureRegression.from_mixture(random_mixture(rng, 4), [0, 1], [2], single_output=True)
    inputs = 2 * rng.normal(size=(60, 2))
    mode = conditional_mode(regression, inputs)
    beta = regression.responsibilities(inputs)
    mixture = regression.mixture_
    grid = np.linspace(-25, 25, 20001)
    for x, found, share in zip(inputs, mode.tolist(), beta, strict=True):
        means, deviations = [], []
        for mu, sigma in zip(mixture.means_, mixture.covariances_, strict=True):
            slope = sigma[2, :2] @ np.linalg.inv(sigma[:2, :2])
            means.append(mu[2] + slope @ (x - mu[:2]))
            deviations.append(np.sqrt(sigma[2, 2] - slope @ sigma[:2, 2]))
        density = share @ norm.pdf(grid, np.array(means)[:, None], np.array(deviations)[:, None])
        height = share @ norm.pdf(found, means, deviations)
        assert height >= density.max() * (1 - 1e-6)


def test_one_component_has_its_mean() -> None:
    rng = np.random.default_rng(1)
    regression = MixtureRegression.from_mixture(random_mixture(rng, 1), [0, 1], [2], single_output=True)
    inputs = rng.normal(size=(20, 2))
    np.testing.assert_allclose(conditional_mode(regression, inputs), regression.predict(inputs), rtol=1e-9)


def test_several_outputs_are_refused() -> None:
    regression = MixtureRegression.from_mixture(random_mixture(np.random.default_rng(2), 2), [0], [1, 2])
    with pytest.raises(ValueError, match="the mode is found for one output, and this regression has 2"):
        conditional_mode(regression, np.zeros((1, 1)))
