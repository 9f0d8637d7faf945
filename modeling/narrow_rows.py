"""Steps of k-means and expectation maximisation of few columns, compiled: BLAS and LAPACK have nothing to gain there.

Expectation maximisation takes rows in blocks, a column of a block at a time, so that all of it, exponentials too, runs
on vector units.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from .estimator import FloatArray

BLOCK = 128

LOWEST = -60.0
"""exp(−60) is nothing beside 1 in a sum of doubles; what lies below is taken as this."""

LOG2_E = 1.0 / math.log(2.0)
LN2_HIGH, LN2_LOW = 0.693147180369123816490, 1.90821492927058770002e-10
"""ln 2 in two parts; multiples of the first up to 2¹¹ are exact."""

ROUNDING = 1.5 * 2.0**52
"""A double of this size has no fraction: adding it rounds, and leaves the rounded number in the lowest bits."""

SINGULAR = 16 * 2.0**-52
"""A column's variance, given those before it, that is below this share of its own for each column is rounding alone."""

SUMS = {"reassoc", "nsz", "contract"}
"""What may be assumed of floating point: sums in any order, so that vector units can form them. Never around
`exponentials`: what a function calls inherits it, and would be free to leave out the rounding."""


@njit(cache=True, nogil=True, fastmath=SUMS)
def lloyd_step(
    rows: FloatArray,
    weights: FloatArray,
    centres: FloatArray,
    labels: npt.NDArray[np.intp],
) -> int:
    """Label rows by their nearest centre, arg min_c |x − m_c|², move the centres to m_c = Σ w x / Σ w, Lloyd's step.

    Args:
        rows: Shape (n, d), in units in which distances may be compared.
        weights: How often each row counts (n,).
        centres: Shape (k, d), in the units of the rows; one without rows stays where it is.
        labels: Before the step, from 0; written (n,).

    Returns:
        How many labels changed.
    """
    (n, d), k = rows.shape, len(centres)
    totals, sums = np.zeros(k), np.zeros((k, d))
    changed = 0
    for row in range(n):
        nearest, label = np.inf, 0
        for c in range(k):
            distance = 0.0
            for i in range(d):
                distance += (rows[row, i] - centres[c, i]) ** 2
            if distance < nearest:
                nearest, label = distance, c
        changed += labels[row] != label
        labels[row] = label
        totals[label] += weights[row]
        for i in range(d):
            sums[label, i] += weights[row] * rows[row, i]
    for c in range(k):
        if totals[c] > 0.0:
            centres[c] = sums[c] / totals[c]
    return changed


@njit(cache=True, nogil=True)
def narrow_pass(
    rows: FloatArray,
    sample_weights: FloatArray,
    means: FloatArray,
    inverses: FloatArray,
    constants: FloatArray,
    counts: FloatArray,
    first: FloatArray,
    second: FloatArray,
) -> float:
    """Add what the M step needs to the sums and return the log-likelihood, nats: Σ w log Σ_k p_k g_k(x).

    With j_k = log p_k g_k(x) = constant − ½ |y|² the responsibility is r = w exp(j_k) / Σ exp(j_k) (MP eq. 7); see
    `expectation_maximisation.Statistics` for the sums.

    Args:
        rows: Shape (n, d), in any units.
        sample_weights: Shape (n,), or (0,) for weights of 1.
        means: Shape (k, d), in the same units.
        inverses: W, lower triangular (k, d, d), in inverse units; y = W(x − μ) has none.
        constants: Log density of each component at its mean, log weight included, nats (k,).
        counts: Sum of responsibilities (k,), added to, as the following ones.
        first: Sum of responsibility times y (k, d).
        second: Sum of responsibility times y yᵀ, the lower triangle (k, d, d).
    """
    n, d = rows.shape
    k = len(means)
    columns, whitened = np.zeros((d, BLOCK)), np.empty((k, d, BLOCK))
    joint, weight = np.empty((k, BLOCK)), np.zeros(BLOCK)
    top, total = np.empty(BLOCK), np.empty(BLOCK)
    rounded = np.empty(BLOCK)
    log_likelihood = 0.0
    for start in range(0, n, BLOCK):
        size = min(BLOCK, n - start)
        for row in range(size):
            for i in range(d):
                columns[i, row] = rows[start + row, i]
            weight[row] = sample_weights[start + row] if len(sample_weights) else 1.0
        weight[size:] = 0.0
        top[:] = -np.inf
        for c in range(k):
            log_density, squares = joint[c], total
            squares[:] = 0.0
            for i in range(d):
                y = whitened[c, i]
                y[:] = 0.0
                for j in range(i + 1):
                    factor, mean, of_column = inverses[c, i, j], means[c, j], columns[j]
                    for row in range(BLOCK):
                        y[row] += factor * (of_column[row] - mean)
                for row in range(BLOCK):
                    squares[row] += y[row] * y[row]
            for row in range(BLOCK):
                log_density[row] = constants[c] - 0.5 * squares[row]
                top[row] = max(top[row], log_density[row])
        total[:] = 0.0
        for c in range(k):
            density = joint[c]
            for row in range(BLOCK):
                density[row] -= top[row]
            exponentials(density, rounded)
            for row in range(BLOCK):
                total[row] += density[row]
        for row in range(size):
            log_likelihood += weight[row] * (top[row] + math.log(total[row]))
        for row in range(BLOCK):
            total[row] = weight[row] / total[row]
        for c in range(k):
            r = joint[c]
            for row in range(BLOCK):
                r[row] *= total[row]
            counts[c] += _add_moments(r, whitened[c], top, first[c], second[c])
    return log_likelihood


@njit(cache=True, nogil=True, error_model="numpy")
def moments_about_means(
    means: FloatArray, factors: FloatArray, counts: FloatArray, first: FloatArray, second: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return each component's mean, μ + F s, and its covariance about that, F (M − s sᵀ) Fᵀ.

    s and M are the first and second moments of y = F⁻¹(x − μ), divided by the counts: the M step of
    `expectation_maximisation.maximise`, without its ridge.

    Args:
        means: μ of the pass (k, d), in the units of the data.
        factors: Lower F of the pass (k, d, d), in the same units.
        counts: Numbers of rows that divide the sums, Σ r (k,).
        first: Σ r y (k, d), without a unit.
        second: Σ r y yᵀ, the lower triangle (k, d, d), without a unit.

    Returns:
        Means (k, d) in the units of the data, and covariances (k, d, d) in their squares.
    """
    k, d = means.shape
    moved, covariances = means.copy(), np.empty((k, d, d))
    within, product = np.empty((d, d)), np.empty((d, d))
    for c in range(k):
        for i in range(d):
            for j in range(i + 1):
                within[i, j] = second[c, i, j] / counts[c] - first[c, i] / counts[c] * (first[c, j] / counts[c])
                within[j, i] = within[i, j]
                moved[c, i] += factors[c, i, j] * (first[c, j] / counts[c])
        for i in range(d):
            for j in range(d):
                total = 0.0
                for l in range(i + 1):
                    total += factors[c, i, l] * within[l, j]
                product[i, j] = total
        for i in range(d):
            for j in range(i + 1):
                total = 0.0
                for l in range(j + 1):
                    total += product[i, l] * factors[c, j, l]
                covariances[c, i, j] = total
                covariances[c, j, i] = total
    return moved, covariances


@njit(cache=True, nogil=True, error_model="numpy")
def lower_factors(matrices: FloatArray) -> tuple[FloatArray, FloatArray, bool]:
    """Return the lower factors F of Σ = F Fᵀ (Cholesky) and W = F⁻¹, and whether there are any.

    Args:
        matrices: Σ, symmetric (k, d, d), in the squared units of the data.

    Returns:
        F in the units of the data and W in the inverse units (k, d, d), and whether all matrices are positive definite:
        else neither means anything.
    """
    k, d, _ = matrices.shape
    factors, inverses = np.zeros((k, d, d)), np.zeros((k, d, d))
    for c in range(k):
        lower, inverse = factors[c], inverses[c]
        for j in range(d):
            pivot = matrices[c, j, j]
            for l in range(j):
                pivot -= lower[j, l] * lower[j, l]
            if not pivot > SINGULAR * d * matrices[c, j, j]:
                return factors, inverses, False
            lower[j, j] = math.sqrt(pivot)
            for i in range(j + 1, d):
                rest = matrices[c, i, j]
                for l in range(j):
                    rest -= lower[i, l] * lower[j, l]
                lower[i, j] = rest / lower[j, j]
        for j in range(d):
            inverse[j, j] = 1.0 / lower[j, j]
            for i in range(j + 1, d):
                rest = 0.0
                for l in range(j, i):
                    rest += lower[i, l] * inverse[l, j]
                inverse[i, j] = -rest / lower[i, i]
    return factors, inverses, True


@njit(cache=True, nogil=True, fastmath=SUMS)
def _add_moments(
    r: FloatArray, whitened: FloatArray, weighted: FloatArray, first: FloatArray, second: FloatArray
) -> float:
    """Add the moments of y (d, n) by r (n,) and return the sum of r; `weighted` (n,) is overwritten."""
    count = 0.0
    for row in range(len(r)):
        count += r[row]
    for i in range(len(whitened)):
        y = whitened[i]
        moment = 0.0
        for row in range(len(r)):
            weighted[row] = r[row] * y[row]
            moment += weighted[row]
        first[i] += moment
        for j in range(i + 1):
            other = whitened[j]
            moment = 0.0
            for row in range(len(r)):
                moment += weighted[row] * other[row]
            second[i, j] += moment
    return count


@njit(cache=True, nogil=True)
def exponentials(values: npt.NDArray[Any], rounded: npt.NDArray[Any]) -> None:
    """Replace values from `LOWEST` to 0 by their exponentials, right to 1e-15.

    exp(x) = 2ⁿ exp(r) with n = round(x / ln 2) and |r| ≤ ln 2 / 2, exp(r) by its Taylor series.

    Args:
        values: Pure numbers (n,); smaller ones count as `LOWEST`.
        rounded: Pure numbers, overwritten (n,).
    """
    bits = rounded.view(np.int64)
    for i in range(len(values)):
        x = max(values[i], LOWEST)
        shifted = x * LOG2_E + ROUNDING
        rounded[i] = shifted
        n = shifted - ROUNDING
        r = (x - n * LN2_HIGH) - n * LN2_LOW
        series = 1.0 / 6227020800.0
        series = series * r + 1.0 / 479001600.0
        series = series * r + 1.0 / 39916800.0
        series = series * r + 1.0 / 3628800.0
        series = series * r + 1.0 / 362880.0
        series = series * r + 1.0 / 40320.0
        series = series * r + 1.0 / 5040.0
        series = series * r + 1.0 / 720.0
        series = series * r + 1.0 / 120.0
        series = series * r + 1.0 / 24.0
        series = series * r + 1.0 / 6.0
        series = series * r + 0.5
        series = series * r + 1.0
        values[i] = series * r + 1.0
    for i in range(len(values)):
        bits[i] = (bits[i] + 1023) << 52  # 2ⁿ: n in the exponent's place
    for i in range(len(values)):
        values[i] *= rounded[i]
