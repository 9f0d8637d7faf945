"""Prediction by mixture regression, compiled: what `MixtureRegression.predict` does for many rows, or for one."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from .densities import BLOCK
from .estimator import FloatArray
from .panels import PANEL_BYTES, TOGETHER, Panels, multiply
from .wide_rows import Buffers, Components, buffers_of, evaluate, log_sums


class Conditional(NamedTuple):
    """A mixture regression of q outputs on d inputs, computed once for all predictions, in the units of the data.

    Attributes:
        order: In which the inputs are taken, so that a few of them tell most components to be too far (d,).
        inputs: Components of the inputs in that order, log p_k g_k(x), or log g_k(x) where `faithful`.
        outputs: μ_y (k, q).
        gains: Σ_yx Wᵀ, whose product with W(x − μ_x) is the conditional mean less μ_y (k, q, d).
        variances: Diagonals of the conditional covariances (k, q).
        deviations: Their roots (k, q).
        faithful: Whether the variance is that of MP eq. 22.
    """

    order: npt.NDArray[np.intp]
    inputs: Components
    outputs: FloatArray
    gains: Panels
    variances: FloatArray
    deviations: FloatArray
    faithful: bool


@njit(cache=True, nogil=True)
def predict_rows(rows: FloatArray, conditional: Conditional, mean: FloatArray, sd: FloatArray) -> None:
    """Write means and standard deviations, each (n, q), in the units of the data; see `MixtureRegression`.

    Most rows belong to one component alone, and what is predicted is that component's. For others both are gathered
    about the mean of their most likely component, which leads them: the variance between components then cancels
    nothing, however far the outputs lie from zero.

    Args:
        rows: Inputs (n, d), in the units of the data.
        conditional: The regression.
        mean: Written (n, q), in the units of the data.
        sd: Written (n, q), in the units of the data.
    """
    (n, d), (k, q) = rows.shape, conditional.outputs.shape
    size = min(n, BLOCK)
    inputs, about, mixed = np.empty((size, d)), np.empty((size, q)), np.empty(size, np.bool_)
    buffers = buffers_of(conditional.inputs, size)
    joint, leaders, deviations = buffers.joint, buffers.guess, conditional.deviations
    for start in range(0, n, size):
        part, means, spreads = rows[start : start + size], mean[start : start + size], sd[start : start + size]
        for row in range(len(part)):
            for i in range(d):
                inputs[row, i] = part[row, conditional.order[i]]
        pieces = evaluate(inputs[: len(part)], conditional.inputs, False, buffers)
        log_sums(joint, len(part), buffers.totals)
        for row in range(len(part)):
            for c in range(k):
                if joint[c, row] > joint[leaders[row], row]:
                    leaders[row] = c
        mixed[:] = False
        for leading in (True, False):
            for piece in range(pieces):
                _add_piece(piece, leading, conditional, buffers, about, mixed, means, spreads)
        for row in range(len(part)):
            if not mixed[row]:
                for j in range(q):
                    spreads[row, j] = deviations[leaders[row], j]
                continue
            for j in range(q):
                shift = means[row, j] - about[row, j]
                between = 0.0 if conditional.faithful else shift * shift
                spreads[row, j] = math.sqrt(spreads[row, j] - between)


@njit(cache=True, nogil=True)
def _add_piece(
    piece: int,
    leading: bool,
    conditional: Conditional,
    buffers: Buffers,
    about: FloatArray,
    mixed: npt.NDArray[np.bool_],
    mean: FloatArray,
    variance: FloatArray,
) -> None:
    """Add what a component has to those of a piece's rows that it leads, or to the others, about their leader's mean.

    Args:
        piece: Which one.
        leading: Whether to those that it leads, which come first.
        conditional: The regression.
        buffers: What is known of the rows; `guess` holds their leaders.
        about: Leaders' means (n, q), written where others are added.
        mixed: Whether others were (n,).
        mean: The mean (n, q).
        variance: Variances about `about` (n, q), written where others are added.
    """
    c, begin, stop = buffers.components[piece], buffers.begins[piece], buffers.begins[piece + 1]
    joint, totals, leaders, rows, y = buffers.joint, buffers.totals, buffers.guess, buffers.rows, buffers.whitened
    outputs, variances, faithful = conditional.outputs, conditional.variances, conditional.faithful
    values, begins, reaches = conditional.gains
    lanes, q, cutoff = PANEL_BYTES // values.itemsize, outputs.shape[1], conditional.inputs.cutoff
    chosen, m = np.empty(stop - begin + 1, np.uint32), 0
    for place in range(begin, stop):
        row = rows[place]
        chosen[m] = place
        m += (leading == (leaders[row] == c)) & (joint[c, row] > totals[row] - cutoff)
    tile, offsets = np.empty((TOGETHER, y.shape[1]), y.dtype), np.empty((TOGETHER, len(reaches) * lanes), y.dtype)
    for first in range(0, m, TOGETHER):
        for place in range(TOGETHER):
            at = chosen[min(first + place, m - 1)]
            for i in range(y.shape[1]):
                tile[place, i] = y[at, i]
        for p in range(len(reaches)):
            multiply(values, c, begins[p], reaches[p], tile, 0, offsets, 0, p * lanes, None)
        for place in range(min(TOGETHER, m - first)):
            row = rows[chosen[first + place]]
            if leading:
                for j in range(q):
                    mean[row, j] = outputs[c, j] + offsets[place, j]
                continue
            if not mixed[row]:
                mixed[row], leader = True, leaders[row]
                beta = math.exp(joint[leader, row] - totals[row])
                share = beta * beta if faithful else beta
                for j in range(q):
                    about[row, j], variance[row, j] = mean[row, j], share * variances[leader, j]
            beta = math.exp(joint[c, row] - totals[row])
            share, between = (beta * beta, 0.0) if faithful else (beta, beta)
            for j in range(q):
                offset = outputs[c, j] + offsets[place, j] - about[row, j]
                mean[row, j] += beta * offset
                variance[row, j] += share * variances[c, j] + between * offset * offset
