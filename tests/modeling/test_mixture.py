"""The mixture against scikit-learn, against formulas written out, and against itself under changes of units."""

from __future__ import annotations

import math
import subprocess
import sys
from typing import get_args

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wheelprint.modeling.mixture import GaussianMixture, Precision

Rows = npt.NDArray[np.float64]


def clusters(seed: int, n: int, d: int, k: int, spread: float = 3.0) -> Rows:
    """Rows of k Gaussians with random covariances, every column standardised."""
    generator = np.random.default_rng(seed)
    parts = [
        generator.standard_normal((n // k, d)) @ generator.standard_normal((d, d)) / math.sqrt(d)
        + spread * generator.standard_normal(d)
        for _ in range(k)
    ]
    rows = generator.permutation(np.vstack(parts))
    standard: Rows = (rows - rows.mean(axis=0)) / rows.std(axis=0)
    return standard


def soft_labels(seed: int, n: int, k: int) -> Rows:
    return np.random.default_rng(seed).dirichlet(np.ones(k), n)


@pytest.mark.parametrize(("n", "d", "k"), [(600, 1, 2), (900, 3, 4), (1998, 8, 3)])
@pytest.mark.parametrize("regularisation", [0.0, 1e-3])
def test_equals_scikit_learn_from_the_same_start(n: int, d: int, k: int, regularisation: float) -> None:
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.mixture import GaussianMixture as Reference

    rows, start = clusters(1, n, d, k, spread=1.0), soft_labels(2, n, k)
    mixture = GaussianMixture(k, covariance_regularisation=regularisation, max_iterations=6, tolerance=0.0)
    mixture.fit(rows, initial_responsibilities=start)
    # scikit-learn takes a start as parameters: one M step written out.
    weights = start.sum(axis=0)
    means = start.T @ rows / weights[:, None]
    precisions = [
        np.linalg.inv(
            (start[:, c, None] * (rows - means[c])).T @ (rows - means[c]) / weights[c] + regularisation * np.eye(d)
        )
        for c in range(k)
    ]
    reference = Reference(
        k,
        reg_covar=regularisation,
        max_iter=6,
        tol=0.0,
        weights_init=weights / weights.sum(),
        means_init=means,
        precisions_init=[(precision + precision.T) / 2 for precision in precisions],
    )
    with pytest.warns(ConvergenceWarning):
        reference.fit(rows)
    assert mixture.n_iterations_ == 6
    assert not mixture.converged_
    np.testing.assert_allclose(mixture.weights_, reference.weights_, rtol=1e-8)
    np.testing.assert_allclose(mixture.means_, reference.means_, rtol=1e-8, atol=1e-11)
    np.testing.assert_allclose(mixture.covariances_, reference.covariances_, rtol=1e-8, atol=1e-11)
    np.testing.assert_allclose(mixture.score_samples(rows), reference.score_samples(rows), rtol=1e-8)
    np.testing.assert_allclose(mixture.predict_proba(rows), reference.predict_proba(rows), rtol=1e-8, atol=1e-14)
    np.testing.assert_array_equal(mixture.predict(rows), reference.predict(rows))
    assert mixture.score(rows) == pytest.approx(reference.score(rows), rel=1e-10)
    assert mixture.bic(rows) == pytest.approx(reference.bic(rows), rel=1e-10)
    assert mixture.aic(rows) == pytest.approx(reference.aic(rows), rel=1e-10)


def test_one_component_is_the_mean_and_the_covariance() -> None:
    rows = clusters(3, 500, 5, 1)
    mixture = GaussianMixture(covariance_regularisation=0.0).fit(rows)
    np.testing.assert_allclose(mixture.means_[0], rows.mean(axis=0), atol=1e-14)
    np.testing.assert_allclose(mixture.covariances_[0], np.cov(rows.T, bias=True), rtol=1e-12)
    assert mixture.converged_


@pytest.mark.parametrize("seed", range(5))
def test_the_likelihood_never_falls_and_is_that_of_the_result(seed: int) -> None:
    rows = clusters(seed, 900, 4, 5, spread=1.0)
    mixture = GaussianMixture(5, random_state=seed, tolerance=1e-9, max_iterations=400).fit(rows)
    assert (np.diff(mixture.log_likelihoods_) >= 0).all()
    assert len(mixture.log_likelihoods_) == mixture.n_iterations_ + 1
    assert mixture.score(rows) == pytest.approx(mixture.log_likelihoods_[-1], rel=1e-12)


def test_a_regularisation_that_lowers_the_likelihood_ends_the_fit() -> None:
    rows = clusters(4, 600, 3, 2)
    mixture = GaussianMixture(2, covariance_regularisation=0.5, tolerance=0.0, max_iterations=100)
    exact = GaussianMixture(2, covariance_regularisation=0.0).fit(rows)
    mixture.fit(rows, initial_mixture=exact)
    assert mixture.n_iterations_ == 0
    assert mixture.converged_
    np.testing.assert_array_equal(mixture.means_, exact.means_)


def test_more_starts_are_never_worse_and_the_seed_decides() -> None:
    rows = clusters(5, 600, 2, 4, spread=2.0)
    one, five = (GaussianMixture(4, n_starts=starts, random_state=3).fit(rows) for starts in (1, 5))
    assert five.score(rows) >= one.score(rows)
    again = GaussianMixture(4, n_starts=5, random_state=3).fit(rows)
    np.testing.assert_array_equal(again.covariances_, five.covariances_)


def test_many_rows_start_from_a_part_of_them_and_are_not_copied() -> None:
    import tracemalloc

    truth = GaussianMixture.from_parameters([0.3, 0.7], [[0.0] * 12, [3.0] * 12], [np.eye(12), 2 * np.eye(12)])
    rows = truth.sample(60_000, 1)[0].astype(np.float32)
    for precision in get_args(Precision):  # what is compiled is no memory of the rows
        GaussianMixture(2, max_iterations=1, precision=precision).fit(rows)
    tracemalloc.start()
    mixture = GaussianMixture(2).fit(rows)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    order = np.argsort(mixture.weights_)
    np.testing.assert_allclose(mixture.weights_[order], truth.weights_, atol=0.01)
    np.testing.assert_allclose(mixture.means_[order], truth.means_, atol=0.05)
    np.testing.assert_allclose(mixture.covariances_[order], truth.covariances_, atol=0.06)
    assert peak < 11e6  # the rows as float64, twice over for two components, would be 11.5 MB


def test_sample_and_fit_again_finds_the_parameters() -> None:
    truth = GaussianMixture.from_parameters(
        [0.2, 0.5, 0.3],
        [[0.0, 0.0], [6.0, 1.0], [-2.0, 7.0]],
        [[[1.0, 0.6], [0.6, 2.0]], [[0.5, 0.0], [0.0, 0.5]], [[3.0, -1.0], [-1.0, 1.0]]],
    )
    rows, labels = truth.sample(30_000, np.random.default_rng(7))
    np.testing.assert_allclose(np.bincount(labels) / len(labels), truth.weights_, atol=0.01)
    mixture = GaussianMixture(3, n_starts=3).fit(rows)
    order = [int(np.square(mixture.means_ - mean).sum(axis=1).argmin()) for mean in truth.means_]
    np.testing.assert_allclose(mixture.weights_[order], truth.weights_, atol=0.01)
    np.testing.assert_allclose(mixture.means_[order], truth.means_, atol=0.06)
    np.testing.assert_allclose(mixture.covariances_[order], truth.covariances_, atol=0.12)


@settings(max_examples=20)
@given(
    seed=st.integers(0, 1000),
    exponents=st.lists(st.integers(-6, 6), min_size=3, max_size=3),
    offset=st.floats(-1e3, 1e3),
)
def test_units_and_origin_change_nothing(seed: int, exponents: list[int], offset: float) -> None:
    rows = clusters(seed, 300, 3, 2)
    scale = 10.0 ** np.array(exponents)
    plain = GaussianMixture(2, covariance_regularisation=1e-2).fit(rows)
    moved = GaussianMixture(2, covariance_regularisation=1e-2).fit((rows + offset) * scale)
    np.testing.assert_allclose(moved.weights_, plain.weights_, rtol=1e-6)
    np.testing.assert_allclose(moved.means_ / scale - offset, plain.means_, atol=1e-6)
    np.testing.assert_allclose(moved.covariances_ / np.outer(scale, scale), plain.covariances_, atol=1e-6)


@settings(max_examples=20)
@given(seed=st.integers(0, 1000), n=st.integers(12, 60), d=st.integers(1, 4), k=st.integers(1, 6))
def test_every_fit_is_a_distribution(seed: int, n: int, d: int, k: int) -> None:
    rows = np.random.default_rng(seed).standard_normal((n, d))
    mixture = GaussianMixture(k, random_state=seed).fit(rows)
    assert 1 <= len(mixture.weights_) <= k
    assert mixture.weights_.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(mixture.predict_proba(rows).sum(axis=1), 1.0)
    assert (np.linalg.eigvalsh(mixture.covariances_) > 0).all()
    assert (np.diff(mixture.log_likelihoods_) >= 0).all()


def test_narrow_components_far_from_the_origin_keep_their_covariance() -> None:
    generator = np.random.default_rng(8)
    rows = np.vstack(
        [1e6 + 1e-3 * generator.standard_normal((400, 2)), -1e6 + 1e-3 * generator.standard_normal((400, 2))]
    )
    mixture = GaussianMixture(2, covariance_regularisation=0.0).fit(rows)
    for mean, covariance in zip(mixture.means_, mixture.covariances_, strict=True):
        own = rows[np.sign(rows[:, 0]) == np.sign(mean[0])]
        np.testing.assert_allclose(covariance, np.cov(own.T, bias=True), rtol=1e-5)


def test_chunks_without_a_row_of_some_component_pass_in_silence(capfd: pytest.CaptureFixture[str]) -> None:
    rows = np.vstack([clusters(17, 40_000, 3, 1), clusters(18, 40_000, 3, 1) + 1000.0])
    mixture = GaussianMixture(2).fit(rows)
    np.testing.assert_allclose(np.sort(mixture.means_[:, 0]), [0.0, 1000.0], atol=1e-9)
    assert capfd.readouterr() == ("", "")


def test_regularisation_is_in_units_of_the_channels_variance() -> None:
    rows = np.random.default_rng(9).standard_normal((400, 2)) * [1.0, 1000.0]
    bare, regularised = (GaussianMixture(covariance_regularisation=r).fit(rows).covariances_[0] for r in (0.0, 0.1))
    np.testing.assert_allclose(regularised - bare, np.diag(0.1 * rows.var(axis=0)), rtol=1e-9, atol=1e-9)


def test_a_constant_channel_is_taken_with_unit_variance() -> None:
    rows = np.column_stack([np.random.default_rng(10).standard_normal(100), np.full(100, 7.3)])
    mixture = GaussianMixture(2).fit(rows)
    np.testing.assert_allclose(mixture.means_[:, 1], 7.3)
    np.testing.assert_allclose(mixture.covariances_[:, 1, 1], 1e-6)


def test_a_component_of_too_few_rows_is_dropped() -> None:
    rows = np.vstack([clusters(11, 300, 3, 1), [[50.0, 50.0, 50.0], [50.1, 50.0, 50.0]]])
    start = np.zeros((302, 2))
    start[:300, 0] = start[300:, 1] = 1.0
    mixture = GaussianMixture(2).fit(rows, initial_responsibilities=start)
    assert mixture.n_components == 2
    np.testing.assert_array_equal(mixture.weights_, [1.0])
    np.testing.assert_allclose(mixture.means_[0], rows.mean(axis=0))
    assert mixture.n_parameters() == 9


def test_components_on_one_point_are_dropped_and_the_rest_goes_on() -> None:
    rows = np.vstack([clusters(12, 300, 2, 1), np.full((50, 2), 30.0)])
    start = np.zeros((350, 2))
    start[:300, 0] = start[300:, 1] = 1.0
    mixture = GaussianMixture(2, covariance_regularisation=0.0).fit(rows, initial_responsibilities=start)
    np.testing.assert_array_equal(mixture.weights_, [1.0])


def test_dependent_columns_need_regularisation() -> None:
    column = np.random.default_rng(13).standard_normal(200)
    rows = np.column_stack([column, column])
    with pytest.raises(ValueError, match=r"^no component has a positive definite covariance: columns depend on each "):
        GaussianMixture(2, covariance_regularisation=0.0).fit(rows)
    assert np.isfinite(GaussianMixture(2).fit(rows).score(rows))


def test_parameter_counts_and_the_criteria_are_those_of_the_formulas() -> None:
    rows = clusters(14, 600, 4, 3)
    mixture = GaussianMixture(3).fit(rows)
    n, k, d = 600, 3, 4
    log_likelihood = mixture.score_samples(rows).sum()
    assert mixture.n_parameters() == (k - 1) + k * d + k * d * (d + 1) // 2 == 44
    assert mixture.n_parameters("paper") == 2 * k + k * d == 18
    assert mixture.bic(rows) == pytest.approx(-2 * log_likelihood + 44 * math.log(n))
    # PP eq. 8 is −½ times this.
    assert -0.5 * mixture.bic(rows, "paper") == pytest.approx(log_likelihood - 0.5 * (2 * k + k * d) * math.log(n))
    assert mixture.aic(rows) == pytest.approx(-2 * log_likelihood + 88)


def test_marginal_is_the_density_of_the_columns_alone() -> None:
    from scipy.stats import multivariate_normal

    rows = clusters(15, 500, 4, 2)
    mixture = GaussianMixture(2).fit(rows)
    marginal = mixture.marginal([3, 1])
    expected = sum(
        weight * multivariate_normal(mean[[3, 1]], covariance[np.ix_([3, 1], [3, 1])]).pdf(rows[:, [3, 1]])
        for weight, mean, covariance in zip(mixture.weights_, mixture.means_, mixture.covariances_, strict=True)
    )
    np.testing.assert_allclose(np.exp(marginal.score_samples(rows[:, [3, 1]])), expected, rtol=1e-10)


def test_densities_far_outside_do_not_underflow() -> None:
    mixture = GaussianMixture.from_parameters([0.5, 0.5], [[0.0], [1.0]], [[[1.0]], [[1.0]]])
    far = np.array([[1e4]])
    assert mixture.score_samples(far)[0] == pytest.approx(
        math.log(0.5) - 0.5 * math.log(2 * math.pi) - 0.5 * (1e4 - 1) ** 2, rel=1e-12
    )
    np.testing.assert_allclose(mixture.predict_proba(far), [[0.0, 1.0]], atol=1e-300)
    assert mixture.score_samples(np.empty((0, 1))).shape == (0,)


@pytest.mark.parametrize(
    ("settings_", "rows", "message"),
    [
        (
            {"n_components": 0, "tolerance": -1.0},
            np.zeros((3, 1)),
            "n_components must be at least 1, found 0; tolerance must be zero or positive, found -1.0",
        ),
        (
            {"n_components": 5},
            np.zeros((3, 1)),
            "Expected n_samples >= n_components but got n_components = 5, n_samples = 3: a minimum of 5 is required.",
        ),
        (
            {},
            np.array([[1.0, 2.0], [np.nan, 3.0], [4.0, np.inf]]),
            "X contains NaN or infinity in 2 of 3 rows, the first is row 1; leave rows with missing values out",
        ),
    ],
)
def test_what_cannot_be_fitted_says_why(settings_: dict[str, float], rows: Rows, message: str) -> None:
    with pytest.raises(ValueError) as error:  # noqa: PT011 - the whole message is compared
        GaussianMixture(**settings_).fit(rows)  # type: ignore[arg-type]
    assert str(error.value) == message


def test_starts_and_parameters_that_do_not_fit_say_why() -> None:
    rows = clusters(16, 30, 2, 2)
    with pytest.raises(ValueError, match=r"^initial_responsibilities must have the shape \(30, 2\), found \(30, 3\)$"):
        GaussianMixture(2).fit(rows, initial_responsibilities=soft_labels(0, 30, 3))
    with pytest.raises(ValueError, match=r"^initial_responsibilities must be positive, and their sum 1 in every row$"):
        GaussianMixture(2).fit(rows, initial_responsibilities=np.ones((30, 2)))
    with pytest.raises(ValueError, match=r"^X has 2 features, but initial_mixture has 1$"):
        GaussianMixture(1).fit(rows, initial_mixture=GaussianMixture(1).fit(rows[:, :1]))
    with pytest.raises(ValueError, match=r"^X has 1 features, but GaussianMixture is expecting 2 features as input$"):
        GaussianMixture(1).fit(rows).score(rows[:, :1])
    with pytest.raises(ValueError, match=r"^the covariance of component 1 is not positive definite$"):
        GaussianMixture.from_parameters([1, 1], [[0.0], [0.0]], [[[1.0]], [[-1.0]]])
    with pytest.raises(ValueError, match=r"^expected weights \(k,\), .* found \(2,\), \(1, 1\) and \(1, 1, 1\)$"):
        GaussianMixture.from_parameters([1, 1], [[0.0]], [[[1.0]]])
    with pytest.raises(ValueError, match=r"^weights must be positive, found 0\.0$"):
        GaussianMixture.from_parameters([0.0, 1.0], [[0.0], [0.0]], [[[1.0]], [[1.0]]])


@pytest.mark.filterwarnings("ignore:Estimator .* does not inherit:UserWarning")
def test_passes_scikit_learns_own_estimator_checks() -> None:
    from sklearn.utils.estimator_checks import check_estimator

    results = check_estimator(GaussianMixture(2), on_skip=None, on_fail=None)
    assert [result["check_name"] for result in results if result["status"] == "failed"] == []
    assert sum(result["status"] == "passed" for result in results) > 30


def test_clone_and_parameters_follow_scikit_learn() -> None:
    from sklearn.base import clone

    mixture = GaussianMixture(4, tolerance=1e-3)
    copy = clone(mixture)
    assert copy is not mixture
    assert copy.get_params() == mixture.get_params()
    assert copy.set_params(n_components=2).n_components == 2
    with pytest.raises(ValueError, match=r"^GaussianMixture has no parameter components; its parameters are n_comp"):
        copy.set_params(components=3)
    assert repr(GaussianMixture(2)) == (
        "GaussianMixture(n_components=2, covariance_type='full', covariance_regularisation=1e-06, start='k-means', "
        "n_starts=1, max_iterations=200, tolerance=1e-05, warm_start=False, precision='auto', threads=1, "
        "random_state=0)"
    )


def test_fitting_imports_no_scikit_learn() -> None:
    code = (
        "import sys, numpy as np; from wheelprint.modeling.mixture import GaussianMixture; "
        "assert 'scipy' not in sys.modules; GaussianMixture(2).fit(np.random.default_rng(0).normal(size=(50, 2))); "
        "assert 'sklearn' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
