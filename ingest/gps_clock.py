"""The CAN logger's clock against UTC, from frames that tell the navigation unit's own GPS time."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .clock import CONFIDENCE, MAXIMUM_DRIFT_PPM, SHORT_TOLERANCE_S, ClockEstimate

Times = npt.NDArray[np.int64]
Values = npt.NDArray[np.float64]

SECOND = 1_000_000_000
BLOCK_S = 10
LEAST_TIMES = 10
FARTHEST_S = 3600.0
"""From the median offset; what is farther is a time that the unit did not know yet."""
DRIFT_DEVIATION = 60e-6
"""s/s, what drifts of loggers' clocks are like before anything is measured."""
SMALLEST_NOISE_S = 1e-4
DEVIATION = 1.4826
"""Standard deviations in a median absolute deviation."""
TURNING_POINT = 1.5
"""Deviations beyond which a block counts less (Huber)."""
IN_STEP_S = 0.1
ITERATIONS = 30


def clock_from_gps(stamps: Times, utc: Times, source: str) -> ClockEstimate:
    """Return the clock that stamps frames, from the times that the frames tell.

    A line through the medians of ten-second blocks, by weighted least squares that count outliers less; the drift is
    0 ± 60 ppm before anything is measured. The offset holds what a time is old when it comes, some milliseconds with
    an inertial unit; samples of the unit that come as late are so carried to when they were measured.

    Args:
        stamps: (n,) when the logger saw the frames, ns.
        utc: (n,) what they tell, ns since 1970.
        source: Message and signal that tells it, for the reason.

    Returns:
        The estimate, applied unless the times are too few or do not keep step with the stamps.
    """
    late = (stamps - utc) / SECOND
    if len(late):
        sensible = np.abs(late - np.median(late)) <= FARTHEST_S
        stamps, utc = stamps[sensible], utc[sensible]
    if len(stamps) < LEAST_TIMES:
        return ClockEstimate.trusted(f"{source} tells the time {len(stamps)} times, {LEAST_TIMES} are needed")
    start = int(stamps.min())
    base = int(np.median(stamps - utc))
    seconds, late = (stamps - start) / SECOND, (stamps - utc - base) / SECOND
    at, offset, scatter = _block_medians(seconds, late)
    # The line stands at the middle, where offset and drift are independent.
    middle = float(at.mean())
    level, drift, covariance, residual = _fit(at - middle, offset, max(scatter, SMALLEST_NOISE_S))
    ends = np.array([[1.0, 0.0 - middle], [1.0, float(seconds.max()) - middle]])
    error = float(np.sqrt(np.einsum("ij,jk,ik->i", ends, covariance, ends).max()))
    doubt = ""
    if np.mean(np.abs(residual) <= IN_STEP_S) < 0.9 or abs(drift) * 1e6 > MAXIMUM_DRIFT_PPM:
        doubt = f"the stamps do not keep step with the time that {source} tells; one of the two clocks was set"
    elif CONFIDENCE * error > SHORT_TOLERANCE_S:
        doubt = f"the time that {source} tells is too coarse: the offset has a standard error of {1e3 * error:.0f} ms"
    return ClockEstimate(
        offset_s=0.0 if doubt else base / SECOND + level - drift * middle,
        drift_ppm=0.0 if doubt else 1e6 * drift,
        residual_ms=1e3 * float(np.sqrt(np.mean(np.minimum(np.abs(residual), IN_STEP_S) ** 2))),
        standard_error_ms=1e3 * error,
        correlation=None,
        applied=not doubt,
        reason=doubt or f"the unit's own time in {source}, told {len(stamps)} times in frames with the logger's stamps",
        reference=start,
    )


def _block_medians(seconds: Values, late: Values) -> tuple[Values, Values, float]:
    """Return each block's middle and median, and the standard error that such a median has by what scatters in it."""
    block = (seconds // BLOCK_S).astype(np.int64)
    order = np.argsort(block, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(block[order])) + 1)
    medians = np.array([np.median(late[part]) for part in parts])
    deviations = np.array([np.median(np.abs(late[part] - median)) for part, median in zip(parts, medians, strict=True)])
    errors = DEVIATION * deviations * np.sqrt(np.pi / 2 / np.array([len(part) for part in parts]))
    return np.array([np.mean(seconds[part]) for part in parts]), medians, float(np.median(errors))


def _fit(at: Values, offset: Values, least_noise: float) -> tuple[float, float, Values, Values]:
    """Return level, slope, their covariance and the residuals of a robust line."""
    X = np.column_stack((np.ones_like(at), at))
    prior = np.diag([0.0, DRIFT_DEVIATION**-2])
    solution, precision = np.array([np.median(offset), 0.0]), prior
    for _ in range(ITERATIONS):
        residual = offset - X @ solution
        noise = max(DEVIATION * float(np.median(np.abs(residual))), least_noise)
        weight = np.minimum(1.0, TURNING_POINT * noise / np.maximum(np.abs(residual), 1e-12))
        precision = (X.T * weight) @ X / noise**2 + prior
        solution = np.linalg.solve(precision, (X.T * weight) @ offset / noise**2)
    return float(solution[0]), float(solution[1]), np.linalg.inv(precision), offset - X @ solution
