"""The pass of expectation maximisation over rows of a few columns, compiled: there BLAS has nothing to gain.

Rows are taken in blocks, a column of a block at a time, so that all but the exponentials runs on vector units.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .estimator import FloatArray

BLOCK = 64


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
    """Add what the M step needs to the sums and return the log-likelihood, see `expectation_maximisation.Statistics`.

    Args:
        rows: Shape (n, d).
        sample_weights: Shape (n,), or (0,) for weights of 1.
        means: Shape (k, d).
        inverses: Shape (k, d, d).
        constants: Log density of each component at its mean, log weight included (k,).
        counts: Sum of responsibilities (k,).
        first: Sum of r y (k, d).
        second: Sum of r y yᵀ, the lower triangle (k, d, d).
    """
    n, d = rows.shape
    k = len(means)
    columns, whitened = np.empty((d, BLOCK)), np.empty((k, d, BLOCK))
    joint = np.empty((k, BLOCK))
    difference = np.empty((d, BLOCK))
    log_likelihood = 0.0
    for start in range(0, n, BLOCK):
        size = min(BLOCK, n - start)
        for row in range(size):
            for i in range(d):
                columns[i, row] = rows[start + row, i]
        for c in range(k):
            squares = joint[c]
            for row in range(BLOCK):
                squares[row] = constants[c]
            for i in range(d):
                mean = means[c, i]
                of_column, into = columns[i], difference[i]
                for row in range(BLOCK):
                    into[row] = of_column[row] - mean
            for i in range(d):
                y = whitened[c, i]
                for row in range(BLOCK):
                    y[row] = 0.0
                for j in range(i + 1):
                    factor = inverses[c, i, j]
                    of_column = difference[j]
                    for row in range(BLOCK):
                        y[row] += factor * of_column[row]
                for row in range(BLOCK):
                    squares[row] -= 0.5 * y[row] * y[row]
        for row in range(size):
            top = joint[0, row]
            for c in range(1, k):
                top = max(top, joint[c, row])
            total = 0.0
            for c in range(k):
                below = joint[c, row] - top
                # exp(−37) is what a double loses beside 1.
                joint[c, row] = math.exp(below) if below > -37.0 else 0.0
                total += joint[c, row]
            weight = sample_weights[start + row] if len(sample_weights) else 1.0
            log_likelihood += weight * (top + math.log(total))
            share = weight / total
            for c in range(k):
                if joint[c, row] > 0.0:
                    r = share * joint[c, row]
                    counts[c] += r
                    for i in range(d):
                        ry = r * whitened[c, i, row]
                        first[c, i] += ry
                        for j in range(i + 1):
                            second[c, i, j] += ry * whitened[c, j, row]
    return log_likelihood
