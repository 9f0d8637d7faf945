"""Prediction by mixture regression, compiled: what `MixtureRegression.predict` does for many rows, or for one."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from .densities import BLOCK
from .estimator import FloatArray
from .wide_rows import Components, buffers_of, evaluate, log_sums


class Conditional(NamedTuple):
    """A mixture regression of q outputs on d inputs, computed once for all predictions, in the units of the data.

    Attributes:
        inputs: Components of the inputs, log p_k g_k(x), or log g_k(x) where `faithful`.
        outputs: μ_y (k, q).
        gains: W Σ_xy: the product of (W(x − μ_x))ᵀ with it is the conditional mean less μ_y (k, d, q).
        variances: Diagonals of the conditional covariances (k, q).
        deviations: Their roots (k, q).
        faithful: Whether the variance is that of MP eq. 22.
    """

    inputs: Components
    outputs: FloatArray
    gains: FloatArray
    variances: FloatArray
    deviations: FloatArray
    faithful: bool


@njit(cache=True, nogil=True)
def predict_rows(rows: FloatArray, conditional: Conditional, mean: FloatArray, sd: FloatArray) -> None:
    """Write means and standard deviations, each (n, q), in the units of the data; see `MixtureRegression`.

    Most rows belong to one component alone, and what is predicted is that component's. For others both are gathered
    about the mean of the component that a row is computed for first, its most likely one as a rule: the variance
    between components then cancels nothing, however far the outputs lie from zero.

    Args:
        rows: Inputs (n, d), in the units of the data.
        conditional: The regression.
        mean: Written (n, q), in the units of the data.
        sd: Written (n, q), in the units of the data.
    """
    n, q = len(rows), conditional.outputs.shape[1]
    size, cutoff = min(n, BLOCK), conditional.inputs.cutoff
    buffers = buffers_of(conditional.inputs, size)
    totals, about = buffers.totals, np.empty((size, q))
    leaders, mixed = np.empty(size, dtype=np.int64), np.empty(size, dtype=np.bool_)
    for start in range(0, n, size):
        part, means, spreads = rows[start : start + size], mean[start : start + size], sd[start : start + size]
        pieces = evaluate(part, conditional.inputs, False, buffers)
        log_sums(buffers.joint, len(part), totals)
        leaders[:], mixed[:] = -1, False
        for piece in range(pieces):
            c, begin, stop = buffers.components[piece], buffers.begins[piece], buffers.begins[piece + 1]
            own, y, m = buffers.rows[begin:stop], buffers.whitened[begin:stop], 0
            for place in range(len(own)):
                row = own[place]
                if leaders[row] < 0 or buffers.joint[c, row] > totals[row] - cutoff:
                    if m < place:
                        own[m], y[m] = row, y[place]
                    m += 1
            offsets = np.dot(y[:m], conditional.gains[c])
            for place in range(m):
                row = own[place]
                into, spread, origin = means[row], spreads[row], about[row]
                if leaders[row] < 0:
                    leaders[row] = c
                    for j in range(q):
                        into[j] = conditional.outputs[c, j] + offsets[place, j]
                    continue
                if not mixed[row]:
                    mixed[row] = True
                    origin[:], into[:] = into, 0.0
                    first = leaders[row]
                    beta = math.exp(buffers.joint[first, row] - totals[row])
                    spread[:] = (beta * beta if conditional.faithful else beta) * conditional.variances[first]
                beta = math.exp(buffers.joint[c, row] - totals[row])
                share = beta * beta if conditional.faithful else beta
                for j in range(q):
                    offset = conditional.outputs[c, j] + offsets[place, j] - origin[j]
                    into[j] += beta * offset
                    spread[j] += share * conditional.variances[c, j]
                    if not conditional.faithful:
                        spread[j] += beta * offset * offset
        for row in range(len(part)):
            into, spread, origin = means[row], spreads[row], about[row]
            if not mixed[row]:
                spread[:] = conditional.deviations[leaders[row]]
                continue
            for j in range(q):
                if not conditional.faithful:
                    spread[j] -= into[j] * into[j]
                spread[j] = math.sqrt(spread[j])
                into[j] += origin[j]
