"""Prediction by mixture regression, compiled: what `MixtureRegression.predict` does for many rows, or for one."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from .estimator import FloatArray
from .wide_rows import BLOCK, Bound, buffers_of, evaluate, log_sums


class Conditional(NamedTuple):
    """A mixture regression of q outputs on d inputs, computed once for all predictions, in the units of the data.

    Attributes:
        means: μ_x (k, d).
        inverses: W of Σ_xx (k, d, d).
        constants: Log p_k g_k(x) at μ_x, or log g_k (`faithful`), nats (k,).
        bound: See there.
        outputs: μ_y (k, q).
        gains: Σ_yx Wᵀ, whose product with W(x − μ_x) is the conditional mean less μ_y (k, q, d).
        variances: Diagonals of the conditional covariances (k, q).
        faithful: Whether the variance is that of MP eq. 22.
    """

    means: FloatArray
    inverses: FloatArray
    constants: FloatArray
    bound: Bound
    outputs: FloatArray
    gains: FloatArray
    variances: FloatArray
    faithful: bool


@njit(cache=True, nogil=True)
def predict_rows(rows: FloatArray, conditional: Conditional, cutoff: float, mean: FloatArray, sd: FloatArray) -> None:
    """Write means and standard deviations, each (n, q), in the units of the data; see `MixtureRegression`.

    Both are gathered about the mean of the component that a row is computed for first, its most likely one as a rule:
    the variance between components then cancels nothing, however far the outputs lie from zero.

    Args:
        rows: Inputs (n, d), in the units of the data.
        conditional: The regression.
        cutoff: Nats below a row's most likely component from which on components may be left out.
        mean: Written (n, q), in the units of the data.
        sd: Written (n, q), in the units of the data.
    """
    n, d = rows.shape
    k, q = conditional.outputs.shape
    size = min(n, BLOCK)
    buffers = buffers_of(k, d, size, conditional.inverses)
    totals, known = np.empty(size), np.empty(size, dtype=np.bool_)
    reference, kept = np.empty((size, q)), np.empty(size, dtype=np.uint32)
    gathered, everything = np.empty(d * size, dtype=conditional.inverses.dtype), np.empty(0, dtype=np.uint64)
    for start in range(0, n, size):
        part = rows[start : start + size]
        pieces = evaluate(
            part,
            conditional.means,
            conditional.inverses,
            conditional.constants,
            conditional.bound,
            cutoff,
            everything,
            buffers,
        )
        log_sums(buffers.joint, len(part), totals)
        known[:] = False
        for piece in range(pieces):
            c, begin, stop = buffers.components[piece], buffers.begins[piece], buffers.begins[piece + 1]
            m = 0
            for place in range(stop - begin):
                row = buffers.rows[begin + place]
                kept[m] = place
                m += not known[row] or buffers.joint[c, row] > totals[row] - cutoff
            if m == 0:
                continue
            all_y, y = buffers.whitened[d * begin : d * stop].reshape(d, stop - begin), gathered[: d * m].reshape(d, m)
            for i in range(d):
                of_column, into_column = all_y[i], y[i]
                for place in range(m):
                    into_column[place] = of_column[kept[place]]
            own = np.dot(conditional.gains[c], y)
            for place in range(m):
                row = buffers.rows[begin + kept[place]]
                beta = math.exp(buffers.joint[c, row] - totals[row])
                share = beta * beta if conditional.faithful else beta
                into, spread, about = mean[start + row], sd[start + row], reference[row]
                if not known[row]:
                    known[row] = True
                    for j in range(q):
                        about[j] = conditional.outputs[c, j] + own[j, place]
                        into[j] = 0.0
                        spread[j] = share * conditional.variances[c, j]
                else:
                    for j in range(q):
                        offset = conditional.outputs[c, j] + own[j, place] - about[j]
                        into[j] += beta * offset
                        spread[j] += share * conditional.variances[c, j]
                        if not conditional.faithful:
                            spread[j] += beta * offset * offset
        for row in range(len(part)):
            into, spread, about = mean[start + row], sd[start + row], reference[row]
            for j in range(q):
                if not conditional.faithful:
                    spread[j] -= into[j] * into[j]
                spread[j] = math.sqrt(spread[j])
                into[j] += about[j]
