"""Expectation maximisation from several starts: on a part of the rows, the best of them on all."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from .estimator import FloatArray
from .expectation_maximisation import Run, Sample, Settings, maximise, moments_of, step

StartKind = Literal["k-means", "random"]

START_ROWS = 20_000
"""Most rows that a start sees."""

FINALISTS = 3
"""Starts that are followed on all rows."""

FINAL_STEPS = 5
"""M steps on all rows after which the most likely finalist goes on alone."""


def search(
    sample: Sample,
    components: int,
    kind: StartKind,
    starts: int,
    scale: FloatArray,
    settings: Settings,
    generator: np.random.Generator,
) -> Run:
    """Return what EM leads to from the best of several starts.

    Each start runs EM to its end on at most `START_ROWS` rows. On these the best few differ by chance, so that they
    first compete on all rows for a few steps.

    Args:
        sample: All rows (n, d).
        components: k.
        kind: Labels of k-means of the scaled rows, or random responsibilities.
        starts: How many.
        scale: Standard deviation of each channel (d,), in the units of the rows.
        settings: Of EM.
        generator: Source of all choices.

    Raises:
        ValueError: No component keeps a positive definite covariance.
    """
    part = sample
    n = len(sample.rows)
    if n > START_ROWS:
        chosen = np.sort(generator.choice(n, START_ROWS, replace=False))
        weights = None if sample.weights is None else sample.weights[chosen]
        part = Sample(sample.rows[chosen], weights)
    rows = part.rows[:]
    weights = np.ones(len(rows)) if part.weights is None else part.weights
    runs: list[Run] = []
    for _ in range(starts):
        if kind == "k-means":
            responsibilities = np.eye(components)[k_means(rows / scale, weights, components, generator)]
        else:
            responsibilities = generator.dirichlet(np.ones(components), len(rows))
        runs.append(maximise(part, moments_of(part, responsibilities, settings), settings))
    runs.sort(key=lambda run: run.log_likelihoods[-1], reverse=True)
    if part is sample:
        return runs[0]
    best = [step(sample, run.parameters, settings) for run in runs[:FINALISTS]]
    if len(best) > 1:
        few = settings.steps(FINAL_STEPS)
        finals = [maximise(sample, parameters, few) for parameters in best]
        best = [max(finals, key=lambda run: run.log_likelihoods[-1]).parameters]
    return maximise(sample, best[0], settings)


def k_means(
    rows: npt.NDArray[np.floating[Any]],
    weights: FloatArray,
    k: int,
    generator: np.random.Generator,
    iterations: int = 30,
) -> npt.NDArray[np.intp]:
    """Return the labels of k-means from 0, shape (n,), which lower Σ w |x − c|² over clusters with centres c.

    A k-means++ start (Arthur and Vassilvitskii 2007), then Lloyd's steps until they settle.

    Args:
        rows: Shape (n, d), of channels in the same unit or divided by their scales.
        weights: How often each counts (n,).
        k: Clusters.
        generator: Source of the start.
        iterations: Most steps.
    """
    from .narrow_rows import lloyd_step

    rows = rows - np.average(rows, axis=0, weights=weights)
    squares = np.einsum("ij,ij->i", rows, rows)

    def distances_to(points: npt.NDArray[np.floating[Any]]) -> npt.NDArray[np.floating[Any]]:
        """Return squared distances of all rows (n, points), rounded but never negative."""
        of_points = np.einsum("ij,ij->i", points, points)
        distances: npt.NDArray[np.floating[Any]] = squares[:, None] - 2.0 * rows @ points.T + of_points
        np.maximum(distances, 0.0, out=distances)
        return distances

    centres = rows[[generator.choice(len(rows), p=weights / weights.sum())]]
    nearest = distances_to(centres)[:, 0]
    while len(centres) < k:
        # Of a few candidates, each drawn in proportion to its distance, the one that leaves least is taken.
        far = np.cumsum(weights * nearest)
        drawn = generator.random(2 + int(math.log(k))) * far[-1]
        candidates = rows[np.searchsorted(far, drawn, side="right") % len(rows)]
        left = np.minimum(nearest[:, None], distances_to(candidates))
        best = int(np.argmin(weights @ left))
        centres, nearest = np.vstack([centres, candidates[best]]), left[:, best]
    labels = np.full(len(rows), -1, dtype=np.intp)
    for _ in range(iterations):
        if lloyd_step(rows, weights, centres, labels) == 0:
            break
    return labels
