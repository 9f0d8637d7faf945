"""The shift between two clocks, from signals that are measured on both.

Signals are compared as changes between neighbouring windows of a second or two: that takes away what a constant or
slowly moving error of a sensor adds, and the noise above a few Hz. `search` finds the shift to one period of the grid
by cross-correlation over all allowed shifts; `refine` finds shift and drift by Gauss-Newton on robust least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .resample import Times, Values, resample

SECOND = 1_000_000_000
WINDOW_S = 1.0
TYPICAL_DRIFT_PPM = 60.0
"""Standard deviation of a drift before anything is measured: quartz clocks keep within 100 ppm or so."""
BLOCK_S = 10.0
"""Residuals this far apart count as independent: several windows, and the time in which a sensor's error moves."""
MINIMUM_OVERLAP_S = 30.0
AMBIGUITY = 1.25
"""A shift that leaves less than this times the best one's unexplained variance explains the signals as well."""
STEP_BLOCKS = 3
"""So many blocks on either side tell a jump of the shift from a block that is wrong."""
SIGNIFICANT_STEP = 6.0
SMALLEST_STEP_S = 0.005
HUBER = 1.345
"""Residuals beyond this many standard deviations count less; 95 % efficient where there are no outliers."""
ITERATIONS = 30
TOLERANCE_S = 1e-5


class Signal(NamedTuple):
    """A quantity measured on both clocks.

    Attributes:
        name: What a person calls it.
        values: (n_grid,) on the grid of the first clock, NaN where missing.
        reference: Stamps on the second clock (n_samples,) in ns and values there.
    """

    name: str
    values: Values
    reference: tuple[Times, Values]


class Peak(NamedTuple):
    """The best shift on the grid.

    Attributes:
        shift_s: First clock - second clock, s.
        correlations: Of each signal at this shift, without sign.
        rival_s: Another shift that explains the signals nearly as well, if there is one.
    """

    shift_s: float
    correlations: tuple[float, ...]
    rival_s: float | None


class Step(NamedTuple):
    """A jump of the shift: `block` is the first block of ten seconds after it, `size_s` what the shift gains, s."""

    block: int
    size_s: float


class Fit(NamedTuple):
    """The refined shift, first clock - second clock = `shift_s` + `gain_s`·(share of the grid that has passed).

    Attributes:
        shift_s: At the grid's first sample, s.
        gain_s: What the shift gains until the grid's last sample, s.
        standard_error_s: Of the shift, where on the grid it is largest, s.
        residual_s: Weighted rms of what the shift of single blocks differs from the line, s.
        correlation: Between the changes on both clocks once aligned, of the signal that agrees best.
        converged: Whether the iteration came to rest.
        gain_standard_error_s: Of the gain, s.
        pull: (n_blocks,) gradient of the likelihood in the shift, of each block of ten seconds.
        grip: (n_blocks,) its curvature; pull/grip is what the shift of a block differs from the line.
    """

    shift_s: float
    gain_s: float
    standard_error_s: float
    residual_s: float
    correlation: float
    converged: bool
    gain_standard_error_s: float
    pull: Values
    grip: Values


def changes(values: Values, period: int, window_s: float = WINDOW_S) -> Values:
    """Return at each grid point the mean over the next window less the mean over the last (n - 2·window + 1,).

    NaN where one of them touches a gap. The filter is the same for both clocks and so shifts nothing between them.
    """
    window = max(1, round(window_s * SECOND / period))
    if len(values) < 2 * window:
        return np.empty(0)
    return np.convolve(values, np.repeat([1.0 / window, -1.0 / window], window), "valid")


def search(
    pairs: Sequence[tuple[Values, Values]], period_s: float, start_s: float, maximum_s: float | None
) -> Peak | None:
    """Return the shift at which all signals together agree best.

    The score is the log-likelihood of linear relations with free scale and bias, ``-Σ n/2·log(1 - r²)``.

    Args:
        pairs: Of each signal the changes on the grids of the first and of the second clock.
        period_s: Period of both grids, s.
        start_s: First stamp of the first clock's grid - first stamp of the second one's, s.
        maximum_s: Largest shift allowed, s; None allows all at which half of the shorter side overlaps.

    Returns:
        The peak; None where no allowed shift has half a minute in common.
    """
    from scipy.signal import correlation_lags

    needed = MINIMUM_OVERLAP_S / period_s
    scores = [_correlation(first, second) for first, second in pairs]
    scores = [(np.where(n >= needed, r, 0.0), n) for r, n in scores]
    count = np.max([n for _, n in scores], axis=0)
    shift = correlation_lags(len(pairs[0][0]), len(pairs[0][1])) * period_s + start_s
    allowed = count >= needed
    if maximum_s is None:
        allowed &= count >= 0.5 * count.max(initial=0)
    else:
        allowed &= np.abs(shift) <= maximum_s
    if not allowed.any():
        return None
    likelihood = np.sum([-0.5 * n * np.log(np.maximum(1 - r**2, 1e-9)) for r, n in scores], axis=0)
    best = int(np.argmax(np.where(allowed, likelihood, -np.inf)))
    explained = likelihood / np.maximum(count, 1)
    summit = (explained >= np.roll(explained, 1)) & (explained >= np.roll(explained, -1))
    rivals = allowed & summit & (np.abs(shift - shift[best]) > WINDOW_S)
    rival = int(np.argmax(np.where(rivals, explained, -np.inf)))
    as_good = bool(rivals[rival]) and 2 * (explained[best] - explained[rival]) < np.log(AMBIGUITY)
    return Peak(
        float(shift[best]), tuple(float(abs(r[best])) for r, _ in scores), float(shift[rival]) if as_good else None
    )


def _correlation(first: Values, second: Values) -> tuple[Values, Values]:
    """Return, for every shift, Pearson's correlation over the samples present on both sides, and their number."""
    from scipy.signal import correlate

    def total(a: Values, b: Values) -> Values:
        return np.asarray(correlate(a, b, "full", "fft"), np.float64)

    m, n = np.isfinite(first).astype(np.float64), np.isfinite(second).astype(np.float64)
    x, y = _clipped(first), _clipped(second)
    count = np.rint(total(m, n))
    divisor = np.maximum(count, 1)
    sum_x, sum_y = total(x, n), total(m, y)
    spread_x = total(x * x, n) - sum_x**2 / divisor
    spread_y = total(m, y * y) - sum_y**2 / divisor
    product = total(x, y) - sum_x * sum_y / divisor
    # A shift at which one side hardly moves would divide rounding errors by rounding errors.
    moving = (spread_x > 1e-6 * (x @ x)) & (spread_y > 1e-6 * (y @ y))
    return np.where(moving, product / np.sqrt(np.where(moving, spread_x * spread_y, 1.0)), 0.0), count


def _clipped(values: Values) -> Values:
    """Return the values with single wild ones cut, and 0 for missing ones."""
    present = np.isfinite(values)
    bound = 3 * np.quantile(np.abs(values[present]), 0.95) if present.any() else 0.0
    return np.clip(np.where(present, values, 0.0), -bound, bound)


def refine(
    signals: Sequence[Signal], grid_time: Times, shift_s: float, period: int, max_gap: int, window_s: float
) -> Fit | None:
    """Refine a shift, and estimate the drift, in ``first(t) = scale·second(t - shift - gain·share) + bias``.

    `share` runs from 0 to 1 over the grid; scale and bias are free for each signal, and the bias vanishes in the
    changes. The gain has a prior of 0 ± 60 ppm. The covariance is the jackknife over blocks of ten seconds, so that it
    holds for residuals that hang together within a block, and where few blocks tell it all.

    Args:
        signals: What is compared.
        grid_time: (n_grid,) stamps of the first clock, ns.
        shift_s: Where to start from, s, right to half a window.
        period: Period of the grid, ns.
        max_gap: Longest gap of the second clock's samples that is bridged, ns.
        window_s: Window of the changes, s.

    Returns:
        The fit; None where a signal has less than half a minute of changes on both clocks.
    """
    n = 2 + len(signals)
    span = int(grid_time[-1] - grid_time[0])
    share = (grid_time - grid_time[0]) / span
    block = (grid_time - grid_time[0]) // round(BLOCK_S * SECOND)
    prior = np.zeros((n, n))
    prior[1, 1] = (1e-6 * TYPICAL_DRIFT_PPM * span / SECOND) ** -2
    start_s, gain_s, converged = shift_s, 0.0, False
    for _ in range(ITERATIONS):
        time = grid_time - np.rint((shift_s + gain_s * share) * SECOND).astype(np.int64)
        terms = [_linearise(signal, time, share, period, max_gap, window_s) for signal in signals]
        if min(len(term.rows) for term in terms) * period < MINIMUM_OVERLAP_S * SECOND:
            return None
        normal, gradient = prior.copy(), -prior[:, 1] * gain_s
        for k, term in enumerate(terms):
            columns = np.array([0, 1, 2 + k])
            normal[np.ix_(columns, columns)] += (term.design * term.weight[:, None]).T @ term.design
            gradient[columns] += term.design.T @ (term.weight * term.residual)
        step = np.linalg.solve(normal, gradient)
        shift_s, gain_s = shift_s + float(step[0]), gain_s + float(step[1])
        converged = bool(np.abs(step[:2]).max() < TOLERANCE_S)
        if converged or abs(shift_s - start_s) > 2 * WINDOW_S:
            break

    scores, shares = np.zeros((block[-1] + 1, n)), np.zeros((block[-1] + 1, n, n))
    for k, term in enumerate(terms):
        columns, at = np.array([0, 1, 2 + k]), block[term.rows]
        weighted = term.design * term.weight[:, None]
        np.add.at(scores, (at[:, None], columns), weighted * term.residual[:, None])
        products = weighted[:, :, None] * term.design[:, None, :]
        np.add.at(shares, (at[:, None, None], columns[:, None], columns), products)
    # What the parameters would be without one block; a share of 1e-9 keeps this finite where one block tells it all.
    ridge = 1e-9 * np.diag(np.diag(normal))
    without = np.linalg.solve(normal + ridge - shares, scores[:, :, None])[:, :, 0]
    inverse = np.linalg.inv(normal)
    covariance = (without.T @ without + inverse @ prior @ inverse)[:2, :2]
    pull, grip = scores[:, 0], shares[:, 0, 0]
    ends = np.array([[1.0, 0.0], [1.0, 1.0]])
    return Fit(
        shift_s=shift_s,
        gain_s=gain_s,
        standard_error_s=float(np.sqrt(np.einsum("ij,jk,ik->i", ends, covariance, ends).max())),
        residual_s=float(np.sqrt(np.sum(pull**2 / np.where(grip > 0, grip, 1.0)) / grip.sum())),
        correlation=max(term.correlation for term in terms),
        converged=converged,
        gain_standard_error_s=float(np.sqrt(covariance[1, 1])),
        pull=pull,
        grip=grip,
    )


def find_step(pull: Values, grip: Values) -> Step | None:
    """Find a jump of the shift in what single blocks say of it.

    For each block, the blocks' own shifts, pull/grip ± grip^-1/2 up to a common factor, are explained by a line and a
    jump before that block.

    Args:
        pull: (n_blocks,) gradient of the likelihood in the shift.
        grip: (n_blocks,) its curvature, 0 where a block says nothing.

    Returns:
        The jump that explains most, where it is more than six standard errors and 5 ms; None where there is none.
    """
    block = np.flatnonzero(grip > 1e-3 * np.median(grip[grip > 0])) if (grip > 0).any() else np.empty(0, np.intp)
    if len(block) < 3 * STEP_BLOCKS:
        return None
    weight, shift = grip[block], pull[block] / grip[block]
    place = block / block[-1]
    best, best_t = None, SIGNIFICANT_STEP
    for k in range(STEP_BLOCKS, len(block) - STEP_BLOCKS + 1):
        design = np.column_stack([np.ones(len(block)), place, np.arange(len(block)) >= k])
        normal = (design * weight[:, None]).T @ design
        solution = np.linalg.solve(normal, (design * weight[:, None]).T @ shift)
        left = weight * (shift - design @ solution) ** 2
        variance = float(left.sum()) / (len(block) - 3)
        t = abs(float(solution[2])) / np.sqrt(max(variance, 1e-12) * float(np.linalg.inv(normal)[2, 2]))
        if t > best_t and abs(solution[2]) > SMALLEST_STEP_S:
            best, best_t = Step(int(block[k]), float(solution[2])), t
    return best


class _Term(NamedTuple):
    """One signal's share of the least squares: residual = design @ (shift, gain, scale), rows of the changes."""

    design: npt.NDArray[np.float64]
    residual: Values
    weight: Values
    rows: npt.NDArray[np.intp]
    correlation: float


def _linearise(signal: Signal, time: Times, share: Values, period: int, max_gap: int, window_s: float) -> _Term:
    """Linearise one signal about `time`, the grid on the second clock as far as it is known."""
    level = resample(*signal.reference, time, "mean", max_gap, period)
    # A derivative over a whole window: over one period it would be mostly noise.
    width = max(round(WINDOW_S * SECOND), period)
    before = resample(*signal.reference, time - width // 2, "mean", max_gap, width)
    after = resample(*signal.reference, time + width // 2, "mean", max_gap, width)
    slope = (after - before) / (width / SECOND)
    y, s = changes(signal.values, period, window_s), changes(level, period, window_s)
    shifted, gained = changes(slope, period, window_s), changes(slope * share, period, window_s)
    rows = np.flatnonzero(np.isfinite(y + s + shifted))
    y, s, shifted, gained = y[rows], s[rows], shifted[rows], gained[rows]
    weight = np.ones(len(rows))
    for _ in range(5):
        scale = float(np.sum(weight * s * y) / np.sum(weight * s * s))
        residual = y - scale * s
        spread = max(1.4826 * float(np.median(np.abs(residual))), 0.1 * float(np.std(residual)), 1e-9)
        weight = np.minimum(1.0, HUBER * spread / np.maximum(np.abs(residual), 1e-12))
    variance = float(np.sum(weight * residual**2) / np.sum(weight))
    correlation = float(np.sqrt(max(0.0, 1.0 - np.sum(weight * residual**2) / np.sum(weight * y**2))))
    design = np.column_stack([-scale * shifted, -scale * gained, s])
    return _Term(design, residual, weight / max(variance, 1e-18), rows, correlation)
