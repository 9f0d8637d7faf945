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


class OneRow(NamedTuple):
    """A mixture regression of q outputs on d inputs in the units of the data, as `predict_row` takes it.

    Attributes:
        order: In which the inputs are whitened (d,).
        means: μ_x in that order (k, d).
        inverses: W of Σ_xx in that order, lower triangular (k, d, d).
        constants: log p_k g_k(x) at μ_x (k,).
        log_weights: log p_k (k,).
        outputs: μ_y (k, q).
        gains: Σ_yx Wᵀ, whose product with W(x − μ_x) is the conditional mean less μ_y (k, q, d).
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


# The sums are vectorised, hence in an order of the compiler's choice.
@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def predict_row(
    x: FloatArray,
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
    mean: FloatArray,
    sd: FloatArray,
) -> float:
    """Write the mean and the standard deviation of each output and return the log density of the inputs, nats.

    Both are gathered about the mean of the most likely component, as in `conditional.predict_rows`; see
    `MixtureRegression` for the formulas.

    Args:
        x: Inputs (d,), in the units of the data.
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
        mean: Written (q,), in the units of the data.
        sd: Written (q,), in the units of the data.
    """
    k, d = means.shape
    q = outputs.shape[1]
    joint, done = constants.copy(), np.zeros(k, dtype=np.intp)
    centred, whitened = np.empty((k, d)), np.empty((k, d))
    best = -1
    while True:
        top = -np.inf if best < 0 else joint[best]
        c = -1
        for other in range(k):
            if done[other] < d and joint[other] > top - cutoff and (c < 0 or joint[other] > joint[c]):
                c = other
        if c < 0:
            break
        start, stop = done[c], min(done[c] + STRIDE, d)
        own = centred[c]
        for i in range(start, stop):
            own[i] = x[order[i]] - means[c, i]
            row, total = inverses[c, i], 0.0
            for j in range(i + 1):
                total += row[j] * own[j]
            whitened[c, i] = total
            joint[c] -= 0.5 * total * total
        done[c] = stop
        if stop == d and (best < 0 or joint[c] > joint[best]):
            best = c
    total = 0.0
    for c in range(k):
        if done[c] == d:
            total += math.exp(joint[c] - joint[best])
    score = joint[best] + math.log(total)
    if faithful:
        total = 0.0
        for c in range(k):
            joint[c] -= log_weights[c]
        for c in range(k):
            if done[c] == d:
                total += math.exp(joint[c] - joint[best])
        normaliser = joint[best] + math.log(total)
    else:
        normaliser = score
    about = np.empty(q)
    mean[:] = 0.0
    sd[:] = 0.0
    for turn in range(k):
        c = (best + turn) % k
        if done[c] < d or joint[c] < normaliser - cutoff:
            continue
        beta = math.exp(joint[c] - normaliser)
        share = beta * beta if faithful else beta
        y = whitened[c]
        for j in range(q):
            row, value = gains[c, j], outputs[c, j]
            for i in range(d):
                value += row[i] * y[i]
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
