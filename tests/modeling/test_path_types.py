"""Path types on segments whose kinds are known."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from wheelprint.modeling.path_types import PathTypes, cluster_segments

Array = npt.NDArray[np.float64]

# MP's Table I: duration (s), average and maximum course deviation (deg), speed (m/s), by falling average deviation.
KINDS = np.array([[8.29, 0.15, 0.45, 9.3], [1.15, 0.024, 0.05, 15.2], [0.24, 0.008, 0.01, 14.0]])


def segments(seed: int = 0, n: int = 300) -> tuple[Array, npt.NDArray[np.intp]]:
    """Segments of MP's three kinds, log-normal about them, the kinds' rows mixed."""
    generator = np.random.default_rng(seed)
    kind = generator.integers(0, 3, n)
    return KINDS[kind] * np.exp(0.15 * generator.standard_normal((n, 4))), kind


@pytest.mark.parametrize("clusters", [3, "bic"])
def test_finds_the_papers_three_types_ordered_by_sharpness(clusters: int | str) -> None:
    features, kind = segments()
    labels, means, weights, criterion = cluster_segments(features, clusters, 6, 1)  # type: ignore[arg-type]
    np.testing.assert_array_equal(labels, kind + 1)
    np.testing.assert_allclose(means, [features[kind == own].mean(axis=0) for own in range(3)], rtol=1e-6)
    np.testing.assert_allclose(weights, np.bincount(kind) / len(kind), rtol=1e-6)
    if clusters == "bic":
        assert [count for count, _ in criterion] == [1, 2, 3, 4, 5, 6]
        assert min(criterion, key=lambda pair: pair[1])[0] == 3
    else:
        assert [count for count, _ in criterion] == [3]


def test_held_out_segments_get_the_label_of_their_kind() -> None:
    features, _ = segments(1)
    fresh, kind = segments(2)
    types = PathTypes.fit(features, "bic", 5, 0)
    np.testing.assert_array_equal(types.label(fresh), kind + 1)
    again = PathTypes.fit(features, "bic", 5, 0)
    np.testing.assert_array_equal(again.mixture.covariances_, types.mixture.covariances_)


def test_labels_are_the_arg_max_of_the_papers_equation_7() -> None:
    from scipy.stats import multivariate_normal

    features, _ = segments(3, 120)
    types = PathTypes.fit(features, 3, 3, 0, logarithms=False)
    mixture = types.mixture
    joint = np.column_stack(
        [
            weight * multivariate_normal(mean, covariance).pdf(features)
            for weight, mean, covariance in zip(mixture.weights_, mixture.means_, mixture.covariances_, strict=True)
        ]
    )
    np.testing.assert_array_equal(types.label(features), joint.argmax(axis=1) + 1)
    np.testing.assert_allclose(types.means[:, 1], np.sort(types.means[:, 1])[::-1])


def test_the_criterion_is_the_mixtures_bic_and_the_papers_features_are_taken_as_they_are() -> None:
    features, _ = segments(4, 100)
    types = PathTypes.fit(features, 2, 2, 0, logarithms=False)
    ((count, criterion),) = types.criterion
    assert count == 2
    assert criterion == pytest.approx(types.mixture.bic(features), rel=1e-9)
    np.testing.assert_allclose(types.weights @ types.mixture.means_, features.mean(axis=0), rtol=1e-6)


def test_a_third_of_one_sample_segments_does_not_multiply_the_clusters() -> None:
    features, _ = segments(5)
    generator = np.random.default_rng(6)
    deviation = 0.008 * np.exp(0.3 * generator.standard_normal(150))
    single = np.column_stack([np.full(150, 0.1), deviation, deviation, 14.0 + generator.standard_normal(150)])
    labels, means, _, _ = cluster_segments(np.vstack([features, single]), "bic", 8, 0)
    assert labels.max() <= 4
    assert len(means) == labels.max()


def test_segments_that_do_not_turn_have_a_label() -> None:
    features, _ = segments(7)
    features[:5, 1:3] = 0.0
    types = PathTypes.fit(features, 3, 3, 0)
    assert set(types.label(features[:5])) <= {1, 2, 3}
    np.testing.assert_allclose(types.weights @ types.means, features.mean(axis=0), rtol=1e-4)


def test_few_or_equal_segments_make_fewer_types() -> None:
    features, _ = segments(8, 6)
    labels, means, weights, criterion = cluster_segments(features, "bic", 6, 0)
    assert labels.min() == 1
    assert labels.max() <= len(means) == len(weights)
    assert len(criterion) == len({count for count, _ in criterion})
    same = np.tile(KINDS[:1], (40, 1))
    labels, means, weights, _ = cluster_segments(same, 3, 3, 0)
    assert (labels == labels[0]).all()
    np.testing.assert_allclose(weights @ means, KINDS[0])


def test_missing_features_and_no_segments_say_why() -> None:
    features, _ = segments(9, 20)
    features[3, 1] = np.nan
    with pytest.raises(ValueError, match=r"^X contains NaN or infinity in 1 of 20 rows, the first is row 3; leave "):
        cluster_segments(features, 2, 2, 0)
    with pytest.raises(
        ValueError, match=r"^Expected n_samples >= n_components but got n_components = 1, n_samples = 0"
    ):
        cluster_segments(np.empty((0, 4)), "bic", 3, 0)
