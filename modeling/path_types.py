"""Types of path: clusters of path segments by a Gaussian mixture (MP section III-A, eqs. 3 to 7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Self

import numpy as np
import numpy.typing as npt

from .estimator import FloatArray
from .mixture import GaussianMixture

Labels = npt.NDArray[np.integer[Any]]

RANK = (1, 2, 0, 3)
"""Columns of the features of `dataset.segments` that order the labels, each falling: label 1 has the largest average
course deviation, of equals the largest maximum, then the longest duration, then the highest speed. So a label means the
same after every run on the same data. Between drivers it means a rank: label 1 is each one's sharpest kind of segment,
and how sharp that is says its mean."""

SMALLEST_DEVIATION = 1e-3
"""deg per 0.1 s; less is below what navigation resolves, and zero has no logarithm."""

REGULARISATION = 0.05
"""Of each channel's variance. Where nothing is merged, 15 to 43 % of the segments tried last one sample: their duration
is 0.1 s exactly and their average course deviation is the largest one. Mixtures with less put components of next to no
width on such planes, and the criterion asks for ever more of them. This is about the width that sampling leaves to the
shortest durations.
"""

STARTS = 10


@dataclass(frozen=True, slots=True)
class PathTypes:
    """A driver's types of path.

    MP clusters the features as they are. Durations and deviations are positive and spread over three decades, though:
    on three drivers (two real, one simulated) a mixture of their logarithms explained held-out segments better, by 1.4
    to 4 nats each with three clusters or more, and BIC asked for 3 or 4 clusters instead of 4 to 6, where 6 was the
    most allowed. So this is the default, and `logarithms=False` is the paper.

    Attributes:
        mixture: Mixture of the transformed features, its components in the order of the labels.
        means: Mean features of each label, shape (k, 4), in the features' units.
        logarithms: Whether the mixture is one of the logarithms of the durations and deviations.
        criterion: (clusters, BIC in nats) of each number of clusters that was compared.
    """

    mixture: GaussianMixture
    means: FloatArray
    logarithms: bool
    criterion: tuple[tuple[int, float], ...]

    @classmethod
    def fit(
        cls, features: FloatArray, clusters: int | Literal["bic"], maximum: int, seed: int, *, logarithms: bool = True
    ) -> Self:
        """Cluster path segments (MP eqs. 3 to 5).

        Args:
            features: Duration (s), average and maximum course deviation (deg per sample), average speed (m/s) of each
                segment, shape (n_segments, 4).
            clusters: How many, or "bic": the number from 1 to `maximum` with the lowest BIC. There may be fewer than
                asked for, where some would have had fewer than five segments.
            maximum: Most clusters that "bic" tries.
            seed: Of the starts.
            logarithms: See the class.

        Raises:
            ValueError: There are no segments, fewer than clusters asked for, or missing features.
        """
        rows = _transform(features, logarithms=logarithms)
        counts = range(1, min(maximum, max(len(rows), 1)) + 1) if clusters == "bic" else [clusters]
        fits: dict[int, GaussianMixture] = {}
        for count in counts:
            fit = GaussianMixture(
                count, covariance_regularisation=REGULARISATION, n_starts=STARTS, max_iterations=500, random_state=seed
            ).fit(rows)
            fits.setdefault(len(fit.weights_), fit)
        criterion = {count: fit.bic(rows) for count, fit in sorted(fits.items())}
        best = fits[min(criterion, key=lambda count: criterion[count])]
        responsibilities = best.predict_proba(rows)
        means = responsibilities.T @ features / responsibilities.sum(axis=0)[:, None]
        order = np.lexsort([-means[:, feature] for feature in reversed(RANK)])
        mixture = GaussianMixture.from_parameters(best.weights_[order], best.means_[order], best.covariances_[order])
        return cls(mixture, means[order], logarithms, tuple(criterion.items()))

    @property
    def weights(self) -> FloatArray:
        """Share of each label in the segments fitted, shape (k,)."""
        return self.mixture.weights_

    def label(self, features: FloatArray) -> Labels:
        """Return the most probable label of each segment, from 1 (MP eqs. 6 and 7), shape (n_segments,).

        Args:
            features: As for `fit`, shape (n_segments, 4).

        Raises:
            ValueError: There are missing features.
        """
        return self.mixture.predict(_transform(features, logarithms=self.logarithms)) + 1


def cluster_segments(
    features: FloatArray, clusters: int | Literal["bic"], maximum: int, seed: int
) -> tuple[Labels, FloatArray, FloatArray, list[tuple[int, float]]]:
    """Cluster path segments as `dataset.segments.PathClustering` describes it; see `PathTypes.fit`, also for errors."""
    types = PathTypes.fit(features, clusters, maximum, seed)
    return types.label(features), types.means, types.weights, list(types.criterion)


def _transform(features: FloatArray, *, logarithms: bool) -> FloatArray:
    if not logarithms:
        return features
    duration, average, largest, speed = features.T
    deviations = (np.log(np.maximum(deviation, SMALLEST_DEVIATION)) for deviation in (average, largest))
    return np.column_stack([np.log(duration), *deviations, speed])
