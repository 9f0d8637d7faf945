"""The regression against the textbook's conditional, integrals written out, and itself in other units and orders."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from wheelprint.modeling.mixture import GaussianMixture
from wheelprint.modeling.regression import MixtureRegression

Array = npt.NDArray[np.float64]


def random_mixture(seed: int, d: int, k: int, spread: float = 1.0) -> GaussianMixture:
    generator = np.random.default_rng(seed)
    factors = generator.standard_normal((k, d, d + 2))
    return GaussianMixture.from_parameters(
        generator.uniform(0.2, 1.0, k), spread * generator.standard_normal((k, d)), factors @ factors.transpose(0, 2, 1)
    )


def textbook(mixture: GaussianMixture, x: Array, inputs: list[int], outputs: list[int]) -> tuple[list[Array], ...]:
    """Each component's β, conditional mean and covariance for one x, from MP eqs. 18 to 20 with an explicit inverse."""
    densities, means, covariances = [], [], []
    for mu, sigma in zip(mixture.means_, mixture.covariances_, strict=True):
        s_in, s_es_in = sigma[np.ix_(inputs, inputs)], sigma[np.ix_(outputs, inputs)]
        densities.append(multivariate_normal(mu[inputs], s_in).pdf(x))
        means.append(mu[outputs] + s_es_in @ np.linalg.inv(s_in) @ (x - mu[inputs]))
        covariances.append(sigma[np.ix_(outputs, outputs)] - s_es_in @ np.linalg.inv(s_in) @ s_es_in.T)
    return densities, means, covariances


@pytest.mark.parametrize(
    ("d", "k", "inputs", "outputs"), [(3, 4, [0, 1], [2]), (7, 3, [5, 0, 2], [6, 1]), (4, 1, [3], [0, 1, 2])]
)
def test_equals_the_textbook(d: int, k: int, inputs: list[int], outputs: list[int]) -> None:
    mixture = random_mixture(1, d, k)
    regression = MixtureRegression.from_mixture(mixture, inputs, outputs)
    X = mixture.sample(200, 2)[0][:, inputs]
    mean, covariance = regression.predict(X, return_covariance=True)
    _, sd = regression.predict(X, return_sd=True)
    for row, x in enumerate(X):
        densities, means, covariances = textbook(mixture, x, inputs, outputs)
        beta = mixture.weights_ * densities / (mixture.weights_ * densities).sum()
        expected = sum(b * m for b, m in zip(beta, means, strict=True))
        second = sum(b * (c + np.outer(m, m)) for b, m, c in zip(beta, means, covariances, strict=True))
        np.testing.assert_allclose(regression.responsibilities(x[None])[0], beta, rtol=1e-10, atol=1e-14)
        np.testing.assert_allclose(mean[row], expected, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(covariance[row], second - np.outer(expected, expected), rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(sd[row] ** 2, np.diagonal(covariance[row]), rtol=1e-12)


def test_faithful_is_equations_20_to_22_as_printed() -> None:
    inputs, outputs = [0, 2], [1, 3]
    mixture = random_mixture(3, 4, 3)
    regression = MixtureRegression.from_mixture(mixture, inputs, outputs, faithful=True)
    X = mixture.sample(50, 4)[0][:, inputs]
    mean, covariance = regression.predict(X, return_covariance=True)
    _, sd = regression.predict(X, return_sd=True)
    for row, x in enumerate(X):
        densities, means, covariances = textbook(mixture, x, inputs, outputs)
        beta = np.array(densities) / sum(densities)
        np.testing.assert_allclose(regression.responsibilities(x[None])[0], beta, rtol=1e-10, atol=1e-14)
        np.testing.assert_allclose(mean[row], sum(b * m for b, m in zip(beta, means, strict=True)), rtol=1e-10)
        printed = sum(b**2 * c for b, c in zip(beta, covariances, strict=True))
        np.testing.assert_allclose(covariance[row], printed, rtol=1e-10)
        np.testing.assert_allclose(sd[row] ** 2, np.diagonal(printed), rtol=1e-10)


def test_mean_and_variance_are_the_integrals_of_the_joint_density() -> None:
    mixture = random_mixture(5, 2, 3, spread=3.0)
    regression = MixtureRegression.from_mixture(mixture, [0], [1], single_output=True)
    grid = np.linspace(-60, 60, 40_001)
    for x in (-2.0, 0.0, 3.5):
        density = np.exp(mixture.score_samples(np.column_stack([np.full_like(grid, x), grid])))
        density /= density.sum()
        mean, sd = regression.predict([[x]], return_sd=True)
        assert mean[0] == pytest.approx((density * grid).sum(), rel=1e-8)
        assert sd[0] ** 2 == pytest.approx((density * (grid - mean[0]) ** 2).sum(), rel=1e-6)


def test_one_component_is_linear_regression() -> None:
    generator = np.random.default_rng(6)
    X = generator.standard_normal((400, 3))
    Y = X @ generator.standard_normal((3, 2)) + 5 + 0.3 * generator.standard_normal((400, 2))
    design = np.column_stack([np.ones(400), X])
    coefficients = np.linalg.lstsq(design, Y)[0]
    regression = MixtureRegression(1, covariance_regularisation=0.0).fit(X, Y)
    np.testing.assert_allclose(regression.predict(X), design @ coefficients, rtol=1e-10)
    np.testing.assert_allclose(regression.matrices_[0], coefficients[1:].T, rtol=1e-10)
    residual = Y - design @ coefficients
    np.testing.assert_allclose(regression.conditional_covariances_[0], residual.T @ residual / 400, rtol=1e-9)
    assert regression.score(X, Y) == pytest.approx(1 - np.mean(residual.var(axis=0) / Y.var(axis=0)))


def test_sample_and_fit_again_predicts_the_same() -> None:
    truth = GaussianMixture.from_parameters(
        [0.4, 0.6],
        [[-4.0, 0.0, 1.0], [3.0, 1.0, -2.0]],
        [[[1.0, 0.2, 0.8], [0.2, 1.0, 0.3], [0.8, 0.3, 1.2]], [[2.0, 0.0, -1.0], [0.0, 1.0, 0.5], [-1.0, 0.5, 1.5]]],
    )
    rows = truth.sample(40_000, 7)[0]
    fitted = MixtureRegression(2, n_starts=2).fit(rows[:, :2], rows[:, 2])
    known = MixtureRegression.from_mixture(truth, [0, 1], [2], single_output=True)
    fresh = truth.sample(2000, 8)[0]
    mean, sd = fitted.predict(fresh[:, :2], return_sd=True)
    true_mean, true_sd = known.predict(fresh[:, :2], return_sd=True)
    assert mean.shape == sd.shape == (2000,)
    assert np.abs(mean - true_mean).mean() < 0.03
    assert np.abs(sd / true_sd - 1).mean() < 0.03
    inside = np.abs(fresh[:, 2] - mean) < sd
    assert inside.mean() == pytest.approx(0.68, abs=0.03)


def test_log_likelihood_integrates_to_one_and_the_domain_score_is_the_density_of_x() -> None:
    mixture = random_mixture(9, 3, 2)
    regression = MixtureRegression.from_mixture(mixture, [0, 2], [1])
    grid = np.linspace(-40, 40, 20_001)
    x = np.array([[0.3, -0.7]])
    density = np.exp(regression.log_likelihood(np.repeat(x, len(grid), axis=0), grid))
    assert density.sum() * (grid[1] - grid[0]) == pytest.approx(1.0, rel=1e-8)
    expected = sum(
        weight * multivariate_normal(mean[[0, 2]], covariance[np.ix_([0, 2], [0, 2])]).pdf(x[0])
        for weight, mean, covariance in zip(mixture.weights_, mixture.means_, mixture.covariances_, strict=True)
    )
    assert np.exp(regression.domain_score(x)[0]) == pytest.approx(expected, rel=1e-10)
    assert regression.domain_score([[1000.0, 0.0]])[0] < regression.domain_score(x)[0] - 1000


@settings(max_examples=25)
@given(
    seed=st.integers(0, 10_000),
    exponents=st.lists(st.integers(-4, 4), min_size=4, max_size=4),
    offsets=st.lists(st.floats(-100, 100), min_size=4, max_size=4),
    faithful=st.booleans(),
)
def test_units_and_origins_change_the_prediction_with_them(
    seed: int, exponents: list[int], offsets: list[float], faithful: bool
) -> None:
    mixture = random_mixture(seed, 4, 3)
    scale, offset = 10.0 ** np.array(exponents), np.array(offsets)
    moved = GaussianMixture.from_parameters(
        mixture.weights_, mixture.means_ * scale + offset, mixture.covariances_ * np.outer(scale, scale)
    )
    X = mixture.sample(30, seed)[0][:, :2]
    plain = MixtureRegression.from_mixture(mixture, [0, 1], [2, 3], faithful=faithful)
    other = MixtureRegression.from_mixture(moved, [0, 1], [2, 3], faithful=faithful)
    mean, sd = plain.predict(X, return_sd=True)
    moved_mean, moved_sd = other.predict(X * scale[:2] + offset[:2], return_sd=True)
    np.testing.assert_allclose((moved_mean - offset[2:]) / scale[2:], mean, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(moved_sd / scale[2:], sd, rtol=1e-5)


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), k=st.integers(1, 5), n=st.integers(0, 20))
def test_the_order_of_components_and_outputs_changes_nothing(seed: int, k: int, n: int) -> None:
    mixture = random_mixture(seed, 4, k)
    order = np.random.default_rng(seed).permutation(k)
    shuffled = GaussianMixture.from_parameters(
        mixture.weights_[order], mixture.means_[order], mixture.covariances_[order]
    )
    X = np.random.default_rng(seed).standard_normal((n, 2))
    mean, covariance = MixtureRegression.from_mixture(mixture, [3, 1], [0, 2]).predict(X, return_covariance=True)
    other, other_covariance = MixtureRegression.from_mixture(shuffled, [3, 1], [2, 0]).predict(
        X, return_covariance=True
    )
    assert mean.shape == (n, 2)
    assert covariance.shape == (n, 2, 2)
    np.testing.assert_allclose(other[:, ::-1], mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(other_covariance[:, ::-1, ::-1], covariance, rtol=1e-9, atol=1e-9)
    if n:
        assert (np.linalg.eigvalsh(covariance) > 0).all()


def test_prediction_far_from_everything_is_that_of_the_nearest_component() -> None:
    mixture = GaussianMixture.from_parameters(
        [0.5, 0.5], [[0.0, 0.0], [10.0, 5.0]], [[[1.0, 0.5], [0.5, 1.0]], [[1.0, 0.0], [0.0, 1.0]]]
    )
    for faithful in (False, True):
        mean = MixtureRegression.from_mixture(mixture, [0], [1], faithful=faithful).predict([[-1e4], [1e4]])
        np.testing.assert_allclose(mean, [[-5e3], [5.0]])


def test_chunks_do_not_show() -> None:
    mixture = random_mixture(10, 5, 2)
    regression = MixtureRegression.from_mixture(mixture, [0, 1], [2, 3, 4])
    X = mixture.sample(30_000, 3)[0][:, :2]
    mean, covariance = regression.predict(X, return_covariance=True)
    picked = [0, 12_345, 29_999]
    np.testing.assert_allclose(regression.predict(X[picked]), mean[picked], rtol=1e-12)
    np.testing.assert_allclose(regression.predict(X[picked], return_covariance=True)[1], covariance[picked], rtol=1e-12)


def test_what_cannot_be_done_says_why() -> None:
    mixture = random_mixture(11, 3, 2)
    message = (
        r"^inputs and outputs must each name some of the columns 0 to 2, each column once, "
        r"found \[0, 1\] and \[1, 3\]$"
    )
    with pytest.raises(ValueError, match=message):
        MixtureRegression.from_mixture(mixture, [0, 1], [1, 3])
    with pytest.raises(ValueError, match=r"found \[0\] and \[\]$"):
        MixtureRegression.from_mixture(mixture, [0], [])
    with pytest.raises(ValueError, match=r"^X and y must have the same number of rows, found 3 and 2$"):
        MixtureRegression().fit(np.zeros((3, 1)), np.zeros(2))
    regression = MixtureRegression.from_mixture(mixture, [0, 1], [2])
    with pytest.raises(ValueError, match=r"^ask for return_sd or return_covariance, not for both$"):
        regression.predict(np.zeros((1, 2)), return_sd=True, return_covariance=True)  # type: ignore[call-overload]
    with pytest.raises(ValueError, match=r"^this MixtureRegression is not fitted yet; call `fit` first$"):
        MixtureRegression().predict(np.zeros((1, 2)))


@pytest.mark.filterwarnings("ignore:Estimator .* does not inherit:UserWarning")
def test_passes_scikit_learns_own_estimator_checks() -> None:
    from sklearn.base import clone
    from sklearn.utils.estimator_checks import check_estimator

    results = check_estimator(MixtureRegression(2), on_skip=None, on_fail=None)
    assert [result["check_name"] for result in results if result["status"] == "failed"] == []
    assert sum(result["status"] == "passed" for result in results) > 40
    assert clone(MixtureRegression(2, faithful=True)).get_params()["faithful"] is True


@pytest.mark.parametrize(("d", "outputs", "k"), [(60, 5, 3), (2, 1, 1), (12, 4, 9)])
@pytest.mark.parametrize("faithful", [False, True])
def test_one_row_is_as_many(d: int, outputs: int, k: int, *, faithful: bool) -> None:
    """Rows of every component, rows between them, and rows far from all, where only logarithms tell them apart."""
    mixture = random_mixture(20, d, k)
    X = mixture.sample(40, 3)[0][:, : d - outputs]
    X = np.concatenate([X, mixture.means_[:, : d - outputs], X[:5] + 100.0])
    regression = MixtureRegression.from_mixture(mixture, range(d - outputs), range(d - outputs, d), faithful=faithful)
    mean, sd = regression.predict(X, return_sd=True)
    score = regression.domain_score(X)
    for row, x in enumerate(X):
        one, one_sd, one_score = regression.predict_one(x)
        np.testing.assert_allclose(one, mean[row], rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(one_sd, sd[row], rtol=1e-9)
        assert one_score == pytest.approx(score[row], rel=1e-10)


def test_single_precision_is_nearly_double() -> None:
    mixture = random_mixture(20, 60, 3)
    X = mixture.sample(40, 3)[0][:, :55]
    for faithful in (False, True):
        regression = MixtureRegression.from_mixture(mixture, range(55), range(55, 60), faithful=faithful)
        mean, sd = regression.predict(X, return_sd=True)
        single_mean, single_sd = regression.predict(X, return_sd=True, single=True)
        assert (np.abs(single_mean - mean) / sd).max() < 1e-2
        np.testing.assert_allclose(single_sd, sd, rtol=1e-2)


def test_domain_probability_is_uniform_for_what_was_learnt_and_zero_outside() -> None:
    mixture = random_mixture(21, 4, 3, spread=20.0)
    regression = MixtureRegression.from_mixture(mixture, [0, 1, 2], [3])
    X = mixture.sample(20_000, 4)[0][:, :3]
    shares = regression.domain_probability(X)
    np.testing.assert_allclose(np.quantile(shares, [0.1, 0.5, 0.9]), [0.1, 0.5, 0.9], atol=0.02)
    assert regression.domain_probability(X[:1] + 1e4)[0] < 1e-12
