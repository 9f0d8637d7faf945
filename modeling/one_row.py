"""Prediction of one row by mixture regression, compiled: at once, and without what pays off only for many rows.

The inputs are whitened in an order in which the first few tell the components apart. A component's log density only
falls while its whitened inputs are summed up; the largest one always goes on, so that most components are dismissed
after their first few inputs.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from .estimator import FloatArray

Indices = npt.NDArray[np.intp]

STRIDE = 8
"""Inputs that are whitened before it is asked again whether the component is worth it."""

TOGETHER = 4
"""Rows of a matrix that are multiplied at a time."""


class OneRow(NamedTuple):
    """A mixture regression of q outputs on d inputs in the units of the data, as `predict_row` takes it.

    Matrices are filled up with zeros: e and f are the multiples of `STRIDE` next to d and q.

    Attributes:
        order: In which the inputs are whitened (d,).
        means: μ_x in that order (k, d).
        inverses: W of Σ_xx in that order, lower triangular (k, e, e).
        constants: log p_k g_k(x) at μ_x (k,).
        log_weights: log p_k (k,).
        outputs: μ_y (k, q).
        gains: Σ_yx Wᵀ, whose product with W(x − μ_x) is the conditional mean less μ_y (k, f, e).
        variances: Diagonals of the conditional covariances (k, q).
        cutoff: Nats below the most likely component from which on a component is left out.
        faithful: Responsibilities without the weights and the variance of MP eq. 22.
    """

    order: Indices
    means: FloatArray
    inverses: FloatArray
    constants: FloatArray
    log_weights: FloatArray
    outputs: FloatArray
    gains: FloatArray
    variances: FloatArray
    cutoff: float
    faithful: bool


def filled(matrices: FloatArray) -> FloatArray:
    """Return matrices (k, rows, columns), of any units, with zeros up to multiples of `STRIDE` rows and columns."""
    k, rows, columns = matrices.shape
    result = np.zeros((k, rows + -rows % STRIDE, columns + -columns % STRIDE))
    result[:, :rows, :columns] = matrices
    return result


@njit(cache=True, nogil=True)
def predict_row(
    order: Indices,
    means: FloatArray,
    inverses: FloatArray,
    constants: FloatArray,
    log_weights: FloatArray,
    outputs: FloatArray,
    gains: FloatArray,
    variances: FloatArray,
    cutoff: float,
    faithful: bool,
    x: FloatArray,
    mean: FloatArray,
    sd: FloatArray,
) -> float:
    """Write the mean and the standard deviation of each output and return the log density of the inputs, nats.

    Both are gathered about the mean of the most likely component, as in `conditional.predict_rows`; see
    `MixtureRegression` for the formulas.

    Args:
        order: This and the following: see `OneRow`.
        means: See there.
        inverses: See there.
        constants: See there.
        log_weights: See there.
        outputs: See there.
        gains: See there.
        variances: See there.
        cutoff: See there.
        faithful: See there.
        x: Inputs (d,), in the units of the data.
        mean: Written (q,), in the units of the data.
        sd: Written (q,), in the units of the data.
    """
    k, d = means.shape
    q, wide = outputs.shape[1], inverses.shape[2]
    joint, done = constants.copy(), np.zeros(k, dtype=np.intp)
    centred, whitened = np.zeros((k, wide)), np.empty((k, wide))
    best = -1
    while True:
        top = -np.inf if best < 0 else joint[best]
        c = -1
        for other in range(k):
            if done[other] < wide and joint[other] > top - cutoff and (c < 0 or joint[other] > joint[c]):
                c = other
        if c < 0:
            break
        start, own = done[c], centred[c]
        stop = start + STRIDE
        for i in range(start, min(stop, d)):
            own[i] = x[order[i]] - means[c, i]
        _multiply(inverses[c, start:stop], own[:stop], whitened[c, start:stop])
        for i in range(start, stop):
            joint[c] -= 0.5 * whitened[c, i] * whitened[c, i]
        done[c] = stop
        if stop == wide and (best < 0 or joint[c] > joint[best]):
            best = c
    total = 0.0
    for c in range(k):
        if done[c] == wide:
            total += math.exp(joint[c] - joint[best])
    score = joint[best] + math.log(total)
    if faithful:
        total = 0.0
        for c in range(k):
            joint[c] -= log_weights[c]
        for c in range(k):
            if done[c] == wide:
                total += math.exp(joint[c] - joint[best])
        normaliser = joint[best] + math.log(total)
    else:
        normaliser = score
    about, own_mean = np.empty(q), np.empty(gains.shape[1])
    mean[:] = 0.0
    sd[:] = 0.0
    for turn in range(k):
        c = (best + turn) % k
        if done[c] < wide or joint[c] < normaliser - cutoff:
            continue
        beta = math.exp(joint[c] - normaliser)
        share = beta * beta if faithful else beta
        _multiply(gains[c], whitened[c], own_mean)
        for j in range(q):
            value = outputs[c, j] + own_mean[j]
            sd[j] += share * variances[c, j]
            if turn == 0:
                about[j] = value
            else:
                offset = value - about[j]
                mean[j] += beta * offset
                if not faithful:
                    sd[j] += beta * offset * offset
    for j in range(q):
        if not faithful:
            sd[j] -= mean[j] * mean[j]
        sd[j] = math.sqrt(sd[j])
        mean[j] += about[j]
    return float(score)


# The sums are vectorised, hence in an order of the compiler's choice.
@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def _multiply(matrix: FloatArray, x: FloatArray, into: FloatArray) -> None:
    """Write the product of the first columns of a matrix (n, …), n a multiple of `TOGETHER`, with x (d,)."""
    for i in range(0, len(matrix), TOGETHER):
        first, second, third, fourth = matrix[i], matrix[i + 1], matrix[i + 2], matrix[i + 3]
        a = b = c = d = 0.0
        for j in range(len(x)):
            a += first[j] * x[j]
            b += second[j] * x[j]
            c += third[j] * x[j]
            d += fourth[j] * x[j]
        into[i], into[i + 1], into[i + 2], into[i + 3] = a, b, c, d
