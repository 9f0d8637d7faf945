"""The pass of expectation maximisation over rows of many columns, compiled around BLAS and without Python's lock.

A row of several hundred nats is explained by one component or two; all others are many orders of magnitude less likely.
Most need not be computed: by how far a component was in the pass before it is known to be out of question, see
`distances`. Where that is not enough, or nothing is known yet, the squared Mahalanobis distance over some of the
columns is a lower bound of the one over all of them, so that a few columns, evenly spread, show most components to be
too far.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from .densities import BLOCK
from .estimator import FloatArray
from .outer_products import outer_products
from .panels import PANEL_BYTES, TOGETHER, Floats, Panels, multiply, width

Indices = npt.NDArray[np.uint32]
"""Unsigned, so that compiled code need not ask of each whether it counts from the end."""

Distances = npt.NDArray[np.float32]

FEW = 128
"""Rows that are bounded at a time: what is computed of all components stays in a near cache."""

COLLECTED = 256
"""Rows of a component whose moments are computed at a time: they stay in a near cache."""


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


class Components(NamedTuple):
    """The mixture's components, in the units of the data.

    Attributes:
        means: μ (k, d).
        inverses: W, lower triangular (k, d, d), in inverse units.
        constants: Log density of each component at its mean, log weight included, nats (k,).
        bound: See there.
        cutoff: Nats below a row's most likely component from which on others are left out.
    """

    means: FloatArray
    inverses: Panels
    constants: FloatArray
    bound: Bound
    cutoff: float


class Buffers(NamedTuple):
    """Where a block of n rows is worked on. What is computed of a component is a piece: some rows, whitened.

    Attributes:
        joint: log p_k g_k(x), nats (k, n), −inf where a component was dismissed.
        bounds: What it is at most, nats (k, n), and is where it was computed.
        guess: Most likely component by what was known before (n,).
        totals: log Σ_k p_k g_k(x), nats (n,).
        components: Component of each piece (2·k,).
        begins: Where the rows of each piece begin in the next, and of the last one end (2·k+1,).
        rows: Rows of all pieces (k·n+1,).
        whitened: W(x − μ) of the same, without a unit (k·n + TOGETHER, ≥ d); columns from d on are zero.
    """

    joint: FloatArray
    bounds: FloatArray
    guess: Indices
    totals: FloatArray
    components: Indices
    begins: npt.NDArray[np.int64]
    rows: Indices
    whitened: Floats


class Moments(NamedTuple):
    """The sums of `expectation_maximisation.Statistics`, and rows on their way into them: many at once are faster.

    They are of y = W(x − μ), which has no unit.

    Attributes:
        counts: Sum of responsibilities (k,).
        first: Sum of r y (k, d).
        second: Sum of r y yᵀ, the lower triangle (k, d, d).
        rows: √r y that `second` lacks (k, COLLECTED, d).
        roots: Their √r (k, COLLECTED).
        collected: How many there are of each component (k,).
    """

    counts: FloatArray
    first: FloatArray
    second: FloatArray
    rows: Floats
    roots: Floats
    collected: npt.NDArray[np.int64]


@njit(cache=True, nogil=True)
def buffers_of(components: Components, n: int) -> Buffers:
    """Return buffers for blocks of n rows; see `Buffers`."""
    k = len(components.means)
    return Buffers(
        np.empty((k, n)),
        np.empty((k, n)),
        np.zeros(n, dtype=np.uint32),
        np.empty(n),
        np.empty(2 * k, dtype=np.uint32),
        np.zeros(2 * k + 1, dtype=np.int64),
        np.empty(k * n + 1, dtype=np.uint32),
        np.empty((k * n + TOGETHER, width(components.inverses)), dtype=components.inverses.values.dtype),
    )


@njit(cache=True, nogil=True)
def moments_into(counts: FloatArray, first: FloatArray, second: FloatArray, inverses: Panels) -> Moments:
    """Return moments with nothing collected yet.

    Args:
        counts: See `Moments`.
        first: See there.
        second: See there.
        inverses: W (k, d, d), in inverse units.
    """
    k, d = first.shape
    rows = np.empty((k, COLLECTED, d), dtype=inverses.values.dtype)
    return Moments(counts, first, second, rows, np.empty_like(rows[:, :, 0]), np.zeros(k, dtype=np.int64))


@njit(cache=True, nogil=True)
def wide_pass(
    rows: FloatArray,
    sample_weights: FloatArray,
    components: Components,
    distances: Distances,
    shrinks: FloatArray,
    shifts: FloatArray,
    buffers: Buffers,
    moments: Moments,
) -> float:
    """Add what the M step needs to the moments and return the log-likelihood, nats: Σ w log Σ_k p_k g_k(x).

    With j_k = log p_k g_k(x) = constant − ½ |y|² the responsibility is r = w exp(j_k) / Σ exp(j_k) (MP eq. 7). What is
    still collected in the end is added by `add_collected`.

    Args:
        rows: Shape (n, d), in the units of the components.
        sample_weights: Shape (n,), or (0,) for weights of 1.
        components: See there.
        distances: What they were at least in the pass before, and then are at least now (n, k); (0, k) to keep none.
        shrinks: How much of such a distance is left, a share (k,), or (0,) where nothing is known from before.
        shifts: What is then taken off (k,); see `distances` for the formula.
        buffers: For n rows or more; overwritten.
        moments: Added to.
    """
    joint, totals, known = buffers.joint, buffers.totals, len(shrinks) > 0
    if known:
        _recall(distances, shrinks, shifts, components.constants, buffers)
    pieces = evaluate(rows, components, known, buffers)
    log_sums(joint, len(rows), totals)
    if len(distances):
        _remember(buffers.bounds, components.constants, distances)
    log_likelihood, negligible = 0.0, math.exp(-components.cutoff)
    for row in range(len(rows)):
        log_likelihood += totals[row] * (sample_weights[row] if len(sample_weights) else 1.0)
    for piece in range(pieces):
        c = buffers.components[piece]
        for place in range(buffers.begins[piece], buffers.begins[piece + 1]):
            row = buffers.rows[place]
            r = math.exp(joint[c, row] - totals[row])
            if r > negligible:
                r *= sample_weights[row] if len(sample_weights) else 1.0
                _collect(buffers.whitened[place], r, c, moments)
    return log_likelihood


@njit(cache=True, nogil=True)
def wide_log_joint(rows: FloatArray, components: Components, joint: FloatArray) -> None:
    """Write log p_k g_k(x) of rows (n, d), in the units of the components, into `joint` (n, k), nats.

    It is −inf where it is certain to lie below the cutoff; the formula is that of `wide_pass`.
    """
    n = len(rows)
    size = min(n, BLOCK)
    buffers = buffers_of(components, size)
    for start in range(0, n, size):
        part = rows[start : start + size]
        evaluate(part, components, False, buffers)
        joint[start : start + size] = buffers.joint[:, : len(part)].T


@njit(cache=True, nogil=True)
def evaluate(rows: FloatArray, components: Components, known: bool, buffers: Buffers) -> int:
    """Fill the buffers for a block of rows and return the number of pieces; see `wide_pass` for the formula.

    Args:
        rows: Shape (n, d), in the units of the components.
        components: See there.
        known: Whether `bounds` and `guess` are filled already, or are to be by the leading columns.
        buffers: Filled.
    """
    n = len(rows)
    joint, bounds, guess, _, pieces_of, begins, chosen, _ = buffers
    if not known:
        if len(components.bound.columns):
            _bound(rows, components.bound, components.constants, buffers)
        else:
            bounds[:], guess[:] = np.inf, 0
    joint[:] = -np.inf
    floor = np.full(n, -np.inf)
    pieces = 0
    for turn in range(2):
        for c in range(len(components.means)):
            # First the guesses, then what their exact values leave worthwhile.
            begin = begins[pieces]
            stop = begin
            for row in range(n):
                chosen[stop] = row
                stop += ((guess[row] == c) == (turn == 0)) & (bounds[c, row] >= floor[row])
            if known and turn == 1 and len(components.bound.columns) and stop > begin:
                stop = begin + _still_near(rows, chosen[begin:stop], c, components, floor, bounds[c])
            if stop > begin:
                stop = _compute(rows, c, components, begin, stop, floor, buffers)
                pieces_of[pieces], begins[pieces + 1] = c, stop
                pieces += 1
        for row in range(n):
            floor[row] = joint[guess[row], row] - components.cutoff
    return pieces


@njit(cache=True, nogil=True)
def _bound(rows: FloatArray, bound: Bound, constants: FloatArray, buffers: Buffers) -> None:
    """Write the bounds by the leading columns, and the components that are most likely by them."""
    n, (k, m) = len(rows), (len(constants), len(bound.columns))
    seen, squares = np.zeros((m, FEW), dtype=bound.inverses.dtype), np.empty(FEW, dtype=bound.inverses.dtype)
    for start in range(0, n, FEW):
        part = rows[start : start + FEW]
        bounds, guess = buffers.bounds[:, start : start + FEW], buffers.guess[start : start + FEW]
        best = np.full(len(part), -np.inf)
        for row in range(len(part)):
            for i in range(m):
                seen[i, row] = part[row, bound.columns[i]] - bound.centre[i]
        whitened = np.dot(bound.inverses, seen)
        for c in range(k):
            _add_squares(whitened[c * m : (c + 1) * m], bound.offsets[c * m : (c + 1) * m], squares)
            for row in range(len(part)):
                bounds[c, row] = constants[c] - 0.5 * squares[row]
                likely = bound.constants[c] - 0.5 * squares[row]
                if likely > best[row]:
                    best[row], guess[row] = likely, c


@njit(cache=True, nogil=True)
def _still_near(
    rows: FloatArray, own: Indices, c: int, components: Components, floor: FloatArray, bounds: FloatArray
) -> int:
    """Move rows that a component's leading columns do not dismiss to the front of `own`; return their number."""
    bound, kept = components.bound, 0
    m = len(bound.columns)
    seen, squares = np.zeros((m, FEW), dtype=bound.inverses.dtype), np.empty(FEW, dtype=bound.inverses.dtype)
    for start in range(0, len(own), FEW):
        part = own[start : start + FEW]
        for place in range(len(part)):
            x = rows[part[place]]
            for i in range(m):
                seen[i, place] = x[bound.columns[i]] - bound.centre[i]
        whitened = np.dot(bound.inverses[c * m : (c + 1) * m], seen)
        _add_squares(whitened, bound.offsets[c * m : (c + 1) * m], squares)
        for place in range(len(part)):
            row = part[place]
            bounds[row] = min(bounds[row], components.constants[c] - 0.5 * squares[place])
            own[kept] = row
            kept += bounds[row] >= floor[row]
    return kept


@njit(cache=True, nogil=True)
def _add_squares(whitened: Floats, offsets: Floats, squares: Floats) -> None:
    """Write the squared distances (n,) of columns (m, n) from the offsets (m,)."""
    squares[:] = 0.0
    for i in range(len(offsets)):
        of_column, offset = whitened[i], offsets[i]
        for row in range(len(squares)):
            y = of_column[row] - offset
            squares[row] += y * y


@njit(cache=True, nogil=True)
def _compute(
    rows: FloatArray, c: int, components: Components, begin: int, stop: int, floor: FloatArray, buffers: Buffers
) -> int:
    """Write y = W(x − μ) of the chosen rows of a piece, the component's log densities, and what they are at most.

    A log density only falls while y is computed: once all of a few rows are below the floor, the rest is left out. Rows
    below it leave the piece, whose new end is returned.
    """
    joint, bounds, chosen, y = buffers.joint, buffers.bounds, buffers.rows, buffers.whitened
    means, constant, (values, begins, reaches) = components.means, components.constants[c], components.inverses
    panels, lanes = len(reaches), PANEL_BYTES // values.itemsize
    centred, (squares, most) = np.empty((TOGETHER, means.shape[1]), y.dtype), np.empty((2, TOGETHER), y.dtype)
    kept = begin
    # No part of an array is taken in these loops: counting who uses it costs as much as the arithmetic.
    for first in range(begin, stop, TOGETHER):
        together, into = min(TOGETHER, stop - first), kept
        for place in range(TOGETHER):
            row = chosen[first + min(place, together - 1)]
            squares[place], most[place] = 0.0, 2.0 * (constant - floor[row])
            for i in range(means.shape[1]):
                centred[place, i] = rows[row, i] - means[c, i]
        panel, near = 0, 0
        while panel < panels and near < together:
            multiply(values, c, begins[panel], reaches[panel], centred, 0, y, into, panel * lanes, squares)
            panel += 1
            near = 0
            while near < together and squares[near] > most[near]:
                near += 1
        for place in range(together):
            row = chosen[first + place]
            bounds[c, row] = constant - 0.5 * squares[place]
            if panel == panels and squares[place] <= most[place]:
                joint[c, row] = bounds[c, row]
                chosen[kept] = row
                if kept < into + place:
                    for i in range(y.shape[1]):
                        y[kept, i] = y[into + place, i]
                kept += 1
    return kept


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
def _recall(
    distances: Distances, shrinks: FloatArray, shifts: FloatArray, constants: FloatArray, buffers: Buffers
) -> None:
    """Write the bounds that distances (n, k) of the pass before leave, and the components that they leave nearest."""
    bounds, guess, best = buffers.bounds, buffers.guess, np.full(len(distances), -np.inf)
    for c in range(len(constants)):
        for row in range(len(distances)):
            least = max(shrinks[c] * distances[row, c] - shifts[c], 0.0)
            bounds[c, row] = constants[c] - 0.5 * least * least
            if bounds[c, row] > best[row]:
                best[row], guess[row] = bounds[c, row], c


@njit(cache=True, nogil=True)
def _remember(bounds: FloatArray, constants: FloatArray, distances: Distances) -> None:
    """Write the distances (n, k) at which log densities are as large as `bounds` (k, …)."""
    for c in range(len(constants)):
        for row in range(len(distances)):
            distances[row, c] = math.sqrt(max(2.0 * (constants[c] - bounds[c, row]), 0.0))


@njit(cache=True, nogil=True)
def _collect(y: Floats, r: float, c: int, moments: Moments) -> None:
    """Add a row of a component, whitened (d,), of responsibility r."""
    place = moments.collected[c]
    into, root = moments.rows[c, place], y.dtype.type(math.sqrt(r))
    for i in range(len(into)):
        into[i] = root * y[i]
    moments.roots[c, place] = root
    moments.counts[c] += r
    moments.collected[c] += 1
    if moments.collected[c] == COLLECTED:
        add_collected(c, moments)


@njit(cache=True, nogil=True)
def add_collected(c: int, moments: Moments) -> None:
    """Add what was collected of a component to its sums: Σ r y and Σ r y yᵀ."""
    m = moments.collected[c]
    if m == 0:
        return
    y, second = moments.rows[c, :m], moments.second[c]
    product = np.empty((y.shape[1], y.shape[1]), dtype=y.dtype)
    outer_products(y, product)
    for i in range(len(product)):
        of_row, into = product[i], second[i]
        for j in range(i + 1):
            into[j] += of_row[j]
    moments.first[c] += np.dot(moments.roots[c, :m], y)
    moments.collected[c] = 0
