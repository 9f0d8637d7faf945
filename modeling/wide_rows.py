"""The pass of expectation maximisation over rows of many columns, compiled around BLAS and without Python's lock.

A row of several hundred nats is explained by one component or two; all others are many orders of magnitude less likely.
The squared Mahalanobis distance over some of the columns is a lower bound of the one over all of them, so that a few
columns, evenly spread, show most components to be out of question before their d² products are done. What was in
question for a row is remembered: the next few passes compute nothing else.

Rows of the data are columns here: whatever is done to one column of the data runs along memory.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from .estimator import FloatArray
from .triangular import multiply_triangular, square

Floats = npt.NDArray[np.floating[Any]]
Indices = npt.NDArray[np.uint32]
"""Unsigned, so that compiled code need not ask of each whether it counts from the end."""

Candidates = npt.NDArray[np.uint64]
"""Components in question, a bit each."""

BLOCK = 1024
"""Rows that are taken at a time."""

TILE = 16
"""Rows that are transposed at a time: their values stay in the nearest cache."""


class Bound(NamedTuple):
    """What bounds log densities by m leading columns; with none of them, every component is computed.

    log p_k g_k(x) ≤ log p_k g_k(μ_k) − ½ |W (x − μ)|² of the leading columns alone. In the units of the data.

    Attributes:
        columns: The leading columns (m,).
        centre: Taken from them (m,).
        inverses: W of each component's leading columns, one below the other (k·m, m).
        offsets: W (μ − centre) of the same, one after another (k·m,).
        constants: Log density of the leading columns at the component's mean, log weight included (k,).
    """

    columns: Indices
    centre: FloatArray
    inverses: Floats
    offsets: Floats
    constants: FloatArray


class Buffers(NamedTuple):
    """Where a block of n rows is worked on. What is computed of a component is a piece: some rows, whitened.

    Attributes:
        joint: log p_k g_k(x), nats (k, n), −inf where a component was dismissed.
        bounds: Nothing in `joint` lies above these, nats (k, n).
        guess: Most likely component by the leading columns (n,).
        components: Component of each piece (2·k,).
        begins: Where the rows of each piece begin in the next, and of the last one end (2·k+1,).
        rows: Rows of all pieces (k·n+1,).
        whitened: W(x − μ), without a unit, of all pieces, each (d, rows of the piece), one after another (k·d·n,).
    """

    joint: FloatArray
    bounds: FloatArray
    guess: Indices
    components: Indices
    begins: Indices
    rows: Indices
    whitened: Floats


@njit(cache=True, nogil=True)
def wide_pass(
    rows: Floats,
    sample_weights: FloatArray,
    means: FloatArray,
    inverses: Floats,
    constants: FloatArray,
    bound: Bound,
    negligible: float,
    candidates: Candidates,
    search: bool,
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
        inverses: W, lower triangular (k, d, d), in inverse units; their type is that of the products. y = W(x − μ).
        constants: Log density of each component at its mean, log weight included, nats (k,).
        bound: See there.
        negligible: Responsibilities below this are left out, a share.
        candidates: Bit c says whether component c is in question for a row (n,), or (0,) to remember nothing.
        search: Whether `candidates` is written, from all components, or read.
        counts: Sum of responsibilities (k,), added to, as the following ones.
        first: Sum of responsibility times y (k, d).
        second: Sum of responsibility times y yᵀ, the lower triangle (k, d, d).
    """
    n, d = rows.shape
    k = len(means)
    size = min(n, BLOCK)
    buffers = buffers_of(k, d, size, inverses)
    weighted, product = np.empty(d * size, dtype=inverses.dtype), np.empty((d, d), dtype=inverses.dtype)
    totals, root, kept = np.empty(size), np.empty(size, dtype=inverses.dtype), np.empty(size, dtype=np.uint32)
    cutoff = -math.log(negligible)
    log_likelihood = 0.0
    for start in range(0, n, size):
        part, weights = rows[start : start + size], sample_weights[start : start + size]
        known = candidates[start : start + size]
        pieces = evaluate(part, means, inverses, constants, bound, cutoff, known[:0] if search else known, buffers)
        log_sums(buffers.joint, len(part), totals)
        if search and len(known):
            _remember(buffers.joint, totals, cutoff, known)
        for row in range(len(part)):
            log_likelihood += totals[row] * (weights[row] if len(weights) else 1.0)
        for piece in range(pieces):
            c, begin, stop = buffers.components[piece], buffers.begins[piece], buffers.begins[piece + 1]
            m = 0
            for place in range(stop - begin):
                row = buffers.rows[begin + place]
                r = math.exp(buffers.joint[c, row] - totals[row])
                if r > negligible:
                    r *= weights[row] if len(weights) else 1.0
                    counts[c] += r
                    root[m], kept[m] = math.sqrt(r), place
                    m += 1
            if m > 0:
                y = buffers.whitened[d * begin : d * stop].reshape(d, stop - begin)
                _add_moments(y, kept[:m], root[:m], weighted[: d * m].reshape(d, m), product, first[c], second[c])
    return log_likelihood


@njit(cache=True, nogil=True)
def wide_log_joint(
    rows: Floats,
    means: FloatArray,
    inverses: Floats,
    constants: FloatArray,
    bound: Bound,
    cutoff: float,
    joint: FloatArray,
) -> None:
    """Write log p_k g_k(x) into `joint` (n, k), −inf where it is certain to lie more than `cutoff` nats below the top.

    The other arguments and the formula are those of `wide_pass`.
    """
    n, d = rows.shape
    size = min(n, BLOCK)
    buffers = buffers_of(len(means), d, size, inverses)
    everything = np.empty(0, dtype=np.uint64)
    for start in range(0, n, size):
        part = rows[start : start + size]
        evaluate(part, means, inverses, constants, bound, cutoff, everything, buffers)
        joint[start : start + size] = buffers.joint[:, : len(part)].T


@njit(cache=True, nogil=True)
def buffers_of(k: int, d: int, n: int, inverses: Floats) -> Buffers:
    """Return buffers for blocks of n rows, `whitened` of the type of `inverses` (k, d, d), whatever their units."""
    return Buffers(
        np.empty((k, n)),
        np.empty((k, n)),
        np.zeros(n, dtype=np.uint32),
        np.empty(2 * k, dtype=np.uint32),
        np.zeros(2 * k + 1, dtype=np.int64),
        np.empty(k * n + 1, dtype=np.uint32),
        np.empty(k * d * n, dtype=inverses.dtype),
    )


@njit(cache=True, nogil=True)
def evaluate(
    rows: Floats,
    means: FloatArray,
    inverses: Floats,
    constants: FloatArray,
    bound: Bound,
    cutoff: float,
    candidates: Candidates,
    buffers: Buffers,
) -> int:
    """Fill the buffers for a block of rows and return the number of pieces; see `wide_pass` for the formula.

    Args:
        rows: Shape (n, d), in any units.
        means: As in `wide_pass`, and so `inverses`, `constants` and `bound`.
        inverses: See above.
        constants: See above.
        bound: See above.
        cutoff: Nats below a row's most likely component from which on others are left out.
        candidates: The components to compute, a bit each (n,), or (0,) for all that the bound does not dismiss.
        buffers: Filled.
    """
    joint, bounds, guess, components, begins, chosen, whitened = buffers
    n, d = rows.shape
    restricted = len(candidates) > 0
    bounded = len(bound.columns) > 0 and not restricted
    if bounded:
        _bound(rows, bound, constants, bounds, guess)
    joint[:] = -np.inf
    floor = np.full(n, -np.inf)
    pieces = 0
    for turn in range(2 if bounded else 1):
        for c in range(len(means)):
            # First the guesses, then what their exact values leave worthwhile; without leading columns, all.
            begin = begins[pieces]
            stop = begin
            if restricted:
                for row in range(n):
                    chosen[stop] = row
                    stop += (candidates[row] >> np.uint64(c)) & np.uint64(1) != 0
            else:
                for row in range(n):
                    chosen[stop] = row
                    stop += not bounded or ((guess[row] == c) == (turn == 0) and bounds[c, row] >= floor[row])
            if stop > begin:
                own, y = chosen[begin:stop], whitened[d * begin : d * stop].reshape(d, stop - begin)
                _whiten(rows, own, means[c], inverses[c], y)
                _log_densities(y, own, constants[c], joint[c])
                components[pieces], begins[pieces + 1] = c, stop
                pieces += 1
        for row in range(n):
            floor[row] = joint[guess[row], row] - cutoff
    return pieces


@njit(cache=True, nogil=True)
def _bound(rows: Floats, bound: Bound, constants: FloatArray, bounds: FloatArray, guess: Indices) -> None:
    """Write the bounds, and the components that are most likely by the leading columns."""
    n, (k, m) = len(rows), (len(constants), len(bound.columns))
    seen = np.empty((m, n), dtype=bound.inverses.dtype)
    for row in range(n):
        for i in range(m):
            seen[i, row] = rows[row, bound.columns[i]] - bound.centre[i]
    whitened = np.dot(bound.inverses, seen)
    best, squares = np.full(n, -np.inf), np.empty(n, dtype=seen.dtype)
    for c in range(k):
        squares[:] = 0.0
        for i in range(c * m, (c + 1) * m):
            of_column, offset = whitened[i], bound.offsets[i]
            for row in range(n):
                y = of_column[row] - offset
                squares[row] += y * y
        for row in range(n):
            bounds[c, row] = constants[c] - 0.5 * squares[row]
            likely = bound.constants[c] - 0.5 * squares[row]
            if likely > best[row]:
                best[row], guess[row] = likely, c


@njit(cache=True, nogil=True)
def _whiten(rows: Floats, own: Indices, mean: FloatArray, inverse: Floats, y: Floats) -> None:
    """Write W(x − μ) of some rows into y (d, m)."""
    d, m = y.shape
    for start in range(0, m, TILE):
        stop = min(start + TILE, m)
        for i in range(d):
            for place in range(start, stop):
                y[i, place] = rows[own[place], i] - mean[i]
    multiply_triangular(inverse, y)


@njit(cache=True, nogil=True)
def _log_densities(y: Floats, own: Indices, constant: float, joint: FloatArray) -> None:
    """Write the log densities of some rows (n,), which y (d, m) is of."""
    d, m = y.shape
    squares = np.zeros(m, dtype=y.dtype)
    for i in range(d):
        of_column = y[i]
        for place in range(m):
            squares[place] += of_column[place] * of_column[place]
    for place in range(m):
        joint[own[place]] = constant - 0.5 * squares[place]


@njit(cache=True, nogil=True)
def log_sums(joint: FloatArray, n: int, totals: FloatArray) -> None:
    """Write log Σ_k exp j_k of each of the first n columns j of `joint` (k, ≥ n) into `totals` (≥ n,), both in nats."""
    for row in range(n):
        top = joint[0, row]
        for c in range(1, len(joint)):
            top = max(top, joint[c, row])
        total = 0.0
        for c in range(len(joint)):
            below = joint[c, row] - top
            # exp(−40) is less than what a double loses beside 1.
            if below > -40.0:
                total += math.exp(below)
        totals[row] = top + math.log(total)


@njit(cache=True, nogil=True)
def _remember(joint: FloatArray, totals: FloatArray, cutoff: float, candidates: Candidates) -> None:
    """Write which components of each row lie within `cutoff` nats of all together."""
    for row in range(len(candidates)):
        bits = np.uint64(0)
        for c in range(len(joint)):
            if joint[c, row] > totals[row] - cutoff:
                bits |= np.uint64(1) << np.uint64(c)
        candidates[row] = bits


@njit(cache=True, nogil=True)
def _add_moments(
    y: Floats, kept: Indices, root: Floats, weighted: Floats, product: Floats, first: FloatArray, second: FloatArray
) -> None:
    """Add the moments of the columns `kept` of y (d, …), each times its root of the responsibility."""
    for i in range(len(y)):
        of_column, into = y[i], weighted[i]
        for place in range(len(kept)):
            into[place] = of_column[kept[place]] * root[place]
    first += np.dot(weighted, root)
    square(weighted, product)
    for i in range(len(y)):
        for j in range(i + 1):
            second[i, j] += product[i, j]
