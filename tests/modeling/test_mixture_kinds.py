"""Covariance types, weights, starts, precisions and sources of rows of the mixture."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from wheelprint.modeling.estimator import RowSource
from wheelprint.modeling.expectation_maximisation import SINGLE_NOISE
from wheelprint.modeling.mixture import GaussianMixture, Precision

from .test_mixture import clusters, soft_labels

Rows = npt.NDArray[np.float64]
KINDS = {"full": "full", "tied": "tied", "diagonal": "diag"}


class Chunked(RowSource):
    """Rows of an array, as though they were made when asked for."""

    def __init__(self, rows: Rows) -> None:
        self.shape = rows.shape
        self._rows = rows

    def __getitem__(self, index: slice | npt.NDArray[np.intp]) -> Rows:
        return self._rows[index].copy()


def smooth_windows(seed: int, n: int, length: int) -> Rows:
    """Overlapping windows of a smooth series with two regimes: many columns that nearly depend on each other."""
    generator = np.random.default_rng(seed)
    noise = np.convolve(generator.standard_normal(n + length + 20), np.hanning(20) / 10, "valid")[: n + length - 1]
    regime = np.repeat(generator.integers(0, 2, -(-len(noise) // 500)), 500)[: len(noise)]
    series = noise * np.where(regime, 1.0, 0.2) + 3.0 * regime + 1e-3 * generator.standard_normal(len(noise))
    rows = np.lib.stride_tricks.sliding_window_view(series, length)[:n]
    standard: Rows = (rows - rows.mean(axis=0)) / rows.std(axis=0)
    return standard


@pytest.mark.parametrize("kind", ["tied", "diagonal"])
@pytest.mark.parametrize("d", [3, 12, 60])
def test_other_covariances_equal_scikit_learns_from_the_same_start(kind: str, d: int) -> None:
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.mixture import GaussianMixture as Reference

    rows, start = clusters(1, 1500, d, 3, spread=1.0), soft_labels(2, 1500, 3)
    first = GaussianMixture(3, covariance_type=kind, max_iterations=0).fit(rows, initial_responsibilities=start)  # type: ignore[arg-type]
    mixture = GaussianMixture(3, covariance_type=kind, max_iterations=5, tolerance=0.0)  # type: ignore[arg-type]
    mixture.fit(rows, initial_mixture=first)
    inverse = np.linalg.inv(first.covariances_)
    precisions = inverse[0] if kind == "tied" else np.diagonal(inverse, axis1=1, axis2=2)
    reference = Reference(
        3, covariance_type=KINDS[kind], max_iter=5, tol=0.0, weights_init=first.weights_, means_init=first.means_,
        precisions_init=precisions if kind == "diagonal" else (precisions + precisions.T) / 2,
    )  # fmt: skip
    with pytest.warns(ConvergenceWarning):
        reference.fit(rows)
    expected = reference.covariances_
    expected = np.repeat(expected[None], 3, axis=0) if kind == "tied" else np.array([np.diag(v) for v in expected])
    np.testing.assert_allclose(mixture.weights_, reference.weights_, rtol=1e-8)
    np.testing.assert_allclose(mixture.means_, reference.means_, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(mixture.covariances_, expected, rtol=1e-8, atol=1e-10)
    assert mixture.bic(rows) == pytest.approx(reference.bic(rows), rel=1e-9)


@pytest.mark.parametrize("d", [2, 12])
def test_weights_are_repetitions(d: int) -> None:
    rows, start = clusters(3, 400, d, 2, spread=1.0), soft_labels(4, 400, 2)
    times = np.random.default_rng(5).integers(0, 4, 400)
    weighted, repeated = (GaussianMixture(2, max_iterations=4, tolerance=0.0) for _ in range(2))
    weighted.fit(rows, sample_weight=0.5 * times, initial_responsibilities=start)
    repeated.fit(np.repeat(rows, times, axis=0), initial_responsibilities=np.repeat(start, times, axis=0))
    np.testing.assert_allclose(weighted.weights_, repeated.weights_, rtol=1e-9)
    np.testing.assert_allclose(weighted.covariances_, repeated.covariances_, rtol=1e-9, atol=1e-12)
    assert weighted.score(rows, sample_weight=times) == pytest.approx(repeated.log_likelihoods_[-1], rel=1e-9)


def test_single_precision_finds_scikit_learns_optimum_of_ill_conditioned_windows() -> None:
    from sklearn.mixture import GaussianMixture as Reference

    rows = smooth_windows(6, 22_000, 60)
    first = GaussianMixture(2, max_iterations=3).fit(rows[::4])
    fits = {}
    for precision in ("auto", "double"):
        mixture = GaussianMixture(2, max_iterations=4, tolerance=0.0, precision=precision)
        fits[precision] = mixture.fit(rows, initial_mixture=first)
        assert (np.diff(mixture.log_likelihoods_) >= -1e-9 * abs(mixture.log_likelihoods_[-1])).all()
    inverse = np.linalg.inv(np.linalg.cholesky(first.covariances_))
    reference = Reference(
        2, reg_covar=1e-6, max_iter=4, tol=1e-12, init_params="random", weights_init=first.weights_,
        means_init=first.means_, precisions_init=inverse.transpose(0, 2, 1) @ inverse,
    )  # fmt: skip
    import warnings

    with warnings.catch_warnings(action="ignore"):
        expected = reference.fit(rows).score(rows)
    assert np.linalg.cond(np.corrcoef(rows.T)) > 1e4
    assert fits["double"].log_likelihoods_[-1] == pytest.approx(expected, rel=1e-8)
    assert fits["auto"].log_likelihoods_[-1] == pytest.approx(expected, rel=1e-6)
    assert fits["auto"].score(rows) == pytest.approx(expected, rel=1e-6)


def test_single_precision_gives_way_where_it_is_too_coarse() -> None:
    rows = smooth_windows(7, 22_000, 12)
    rows[:, 1] = rows[:, 0] + 1e-7 * np.random.default_rng(8).standard_normal(len(rows))
    first = GaussianMixture(1, covariance_regularisation=0.0, max_iterations=1).fit(rows[::2])
    auto, double = (
        GaussianMixture(1, covariance_regularisation=0.0, max_iterations=2, precision=precision).fit(
            rows, initial_mixture=first
        )
        for precision in ("auto", "double")
    )
    np.testing.assert_array_equal(auto.covariances_, double.covariances_)


@pytest.mark.parametrize("precision", ["auto", "double"])
def test_threads_and_sources_change_nothing(precision: Precision) -> None:
    rows = smooth_windows(9, 22_000, 60)
    first = GaussianMixture(2, max_iterations=1).fit(rows[::4])
    settings = {"max_iterations": 2, "tolerance": 0.0, "precision": precision}
    one = GaussianMixture(2, **settings).fit(rows, initial_mixture=first)  # type: ignore[arg-type]
    two = GaussianMixture(2, threads=2, **settings).fit(Chunked(rows), initial_mixture=first)  # type: ignore[arg-type]
    np.testing.assert_array_equal(one.covariances_, two.covariances_)
    np.testing.assert_array_equal(one.log_likelihoods_, two.log_likelihoods_)


def test_what_the_bound_dismisses_does_not_matter() -> None:
    rows = smooth_windows(10, 3000, 60)
    mixture = GaussianMixture(3, max_iterations=2).fit(rows)
    joint = mixture.log_joint(rows)
    top = joint.max(axis=1, keepdims=True)
    expected = np.exp(joint - top)
    np.testing.assert_allclose(
        mixture.predict_proba(rows), expected / expected.sum(axis=1, keepdims=True), rtol=1e-9, atol=1e-16
    )
    np.testing.assert_array_equal(mixture.predict(rows), joint.argmax(axis=1))


@pytest.mark.parametrize(("precision", "tolerance"), [("auto", 1e-6), ("double", 1e-10)])
def test_what_distances_dismiss_does_not_matter(
    precision: Precision, tolerance: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = smooth_windows(13, 22_000, 60)
    generator = np.random.default_rng(14)
    responsibilities = generator.dirichlet(np.ones(4), len(rows))
    settings = {"max_iterations": 30, "tolerance": 0.0, "precision": precision}
    remembering = GaussianMixture(4, **settings).fit(rows, initial_responsibilities=responsibilities)  # type: ignore[arg-type]
    monkeypatch.setattr("wheelprint.modeling.distances.WORTH_KEEPING", 10**9)
    forgetting = GaussianMixture(4, **settings).fit(rows, initial_responsibilities=responsibilities)  # type: ignore[arg-type]
    # Where it goes over from single to double precision the likelihood is that of unrounded rows.
    assert (np.diff(remembering.log_likelihoods_) >= (-SINGLE_NOISE if precision == "auto" else 0.0)).all()
    assert remembering.score(rows) == pytest.approx(remembering.log_likelihoods_[-1], rel=tolerance)
    assert remembering.log_likelihoods_[-1] == pytest.approx(forgetting.log_likelihoods_[-1], rel=tolerance)
    np.testing.assert_allclose(remembering.means_, forgetting.means_, atol=1e3 * tolerance)


def test_random_starts_and_warm_starts() -> None:
    rows = clusters(11, 900, 3, 3, spread=4.0)
    random = GaussianMixture(3, start="random", n_starts=8, tolerance=1e-7).fit(rows)
    k_means = GaussianMixture(3, n_starts=8, tolerance=1e-7).fit(rows)
    assert random.score(rows) == pytest.approx(k_means.score(rows), abs=0.3)
    warm = GaussianMixture(3, warm_start=True, max_iterations=2, tolerance=0.0).fit(rows)
    before = warm.log_likelihoods_[-1]
    assert warm.fit(rows).log_likelihoods_[0] == pytest.approx(before, rel=1e-12)


def test_many_starts_on_many_rows_are_never_worse_than_one() -> None:
    rows = clusters(12, 60_000, 3, 6, spread=1.0)
    one, several = (GaussianMixture(6, n_starts=n, random_state=1).fit(rows).score(rows) for n in (1, 6))
    assert several >= one - 1e-6


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        (np.ones((3, 1)), "Sample weights must be 1D array or scalar, found shape (3, 1)"),
        (np.ones(2), "sample_weight.shape == (2,), expected (3,)!"),
        (np.array([1.0, -1.0, 1.0]), "sample_weight must be finite, zero or positive, and not zero everywhere"),
        (np.zeros(3), "sample_weight must be finite, zero or positive, and not zero everywhere"),
    ],
)
def test_weights_that_do_not_fit_say_why(weights: Rows, message: str) -> None:
    with pytest.raises(ValueError) as error:  # noqa: PT011 - the whole message is compared
        GaussianMixture().fit(np.arange(6.0).reshape(3, 2), sample_weight=weights)
    assert str(error.value) == message


def test_settings_that_do_not_exist_say_why() -> None:
    with pytest.raises(ValueError) as error:  # noqa: PT011 - the whole message is compared
        GaussianMixture(covariance_type="spherical", start="best", precision="half", threads=0).fit(np.eye(3))  # type: ignore[arg-type]
    assert str(error.value) == (
        "covariance_type must be full, tied or diagonal, found 'spherical'; start must be k-means or random, found "
        "'best'; precision must be auto or double, found 'half'; threads must be at least 1, found 0"
    )
