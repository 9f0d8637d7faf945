"""Relevance MAP adaptation: against Reynolds' formulas in a plain loop, its posterior, and its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from wheelprint.modeling.adaptation import adapt
from wheelprint.modeling.mixture import GaussianMixture

PRIOR = GaussianMixture.from_parameters(
    [0.3, 0.7], [[0.0, 0.0], [3.0, 1.0]], [[[1.0, 0.3], [0.3, 2.0]], [[0.5, -0.1], [-0.1, 0.4]]]
)


def some_rows(n: int, seed: int = 0) -> np.ndarray:
    """Rows of another mixture: moved, wider, in other shares."""
    rng = np.random.default_rng(seed)
    first = rng.random(n) < 0.6
    return np.where(first[:, None], [0.5, -1.0], [3.5, 1.5]) + rng.normal(size=(n, 2)) * [1.2, 0.8]


def test_one_step_is_reynolds() -> None:
    rows, relevance = some_rows(40), 16.0
    adapted = adapt(PRIOR, rows, relevance, steps=1)
    for k in range(2):
        count, first, second = 0.0, np.zeros(2), np.zeros((2, 2))
        for row in rows:
            densities = [
                weight * multivariate_normal(mean, covariance).pdf(row)
                for weight, mean, covariance in zip(PRIOR.weights_, PRIOR.means_, PRIOR.covariances_, strict=True)
            ]
            share = densities[k] / sum(densities)
            count += share
            first += share * row
            second += share * np.outer(row, row)
        alpha, level = count / (count + relevance), PRIOR.means_[k]
        mean = alpha * first / count + (1 - alpha) * level
        of_prior = PRIOR.covariances_[k] + np.outer(level, level)
        covariance = alpha * second / count + (1 - alpha) * of_prior - np.outer(mean, mean)
        np.testing.assert_allclose(adapted.means_[k], mean, rtol=1e-12)
        np.testing.assert_allclose(adapted.covariances_[k], covariance, rtol=1e-10)
        weight = (count + 2 * relevance * PRIOR.weights_[k]) / (len(rows) + 2 * relevance)
        assert adapted.weights_[k] == pytest.approx(weight, rel=1e-12)


def log_posterior(mixture: GaussianMixture, rows: np.ndarray, relevance: float) -> float:
    """Log-likelihood of the rows, and the expected one of the rows that the prior stands for."""
    total = float(mixture.score_samples(rows).sum())
    for k, (level, covariance) in enumerate(zip(PRIOR.means_, PRIOR.covariances_, strict=True)):
        shift = mixture.means_[k] - level
        inverse = np.linalg.inv(mixture.covariances_[k])
        spread = np.trace(inverse @ covariance) + shift @ inverse @ shift
        determinant = np.linalg.slogdet(mixture.covariances_[k])[1]
        total -= 0.5 * relevance * float(spread + determinant)
        total += relevance * len(PRIOR.weights_) * PRIOR.weights_[k] * math.log(mixture.weights_[k])
    return total


@given(st.integers(0, 1000), st.integers(1, 60), st.floats(0.5, 200.0))
@settings(max_examples=20, deadline=None)
def test_the_posterior_never_falls(seed: int, count: int, relevance: float) -> None:
    rows = some_rows(count, seed)
    posteriors = [log_posterior(PRIOR, rows, relevance)]
    posteriors += [log_posterior(adapt(PRIOR, rows, relevance, steps=n), rows, relevance) for n in range(1, 5)]
    assert (np.diff(posteriors) >= -1e-9 * np.abs(posteriors[0])).all()


def test_few_rows_leave_the_prior_and_many_leave_it_behind() -> None:
    rows = some_rows(5000)
    stays = adapt(PRIOR, rows, 1e9)
    np.testing.assert_allclose(stays.means_, PRIOR.means_, atol=1e-4)
    np.testing.assert_allclose(stays.covariances_, PRIOR.covariances_, atol=1e-4)
    goes = adapt(PRIOR, rows, 1e-9, steps=1)
    em = GaussianMixture(2, covariance_regularisation=0.0, max_iterations=1).fit(rows, initial_mixture=PRIOR)
    np.testing.assert_allclose(goes.means_, em.means_, rtol=1e-9)
    np.testing.assert_allclose(goes.covariances_, em.covariances_, rtol=1e-8)
    np.testing.assert_allclose(goes.weights_, em.weights_, rtol=1e-9)


def test_only_what_is_asked_for_is_adapted() -> None:
    adapted = adapt(PRIOR, some_rows(200), 10.0, weights=False, covariances=False)
    np.testing.assert_array_equal(adapted.weights_, PRIOR.weights_)
    np.testing.assert_array_equal(adapted.covariances_, PRIOR.covariances_)
    assert np.abs(adapted.means_ - PRIOR.means_).min() > 0.1


def test_nothing_to_adapt_to() -> None:
    assert adapt(PRIOR, np.empty((0, 2)), 10.0) is PRIOR
    with pytest.raises(ValueError, match=r"^relevance must be positive, found 0\.0$"):
        adapt(PRIOR, some_rows(5), 0.0)
