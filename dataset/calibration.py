"""Steering ratio, steering offset and understeer of the car, from driving."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

MINIMUM_SPEED = 3.0
"""m/s; slower, the curvature is a small yaw rate over a small speed."""
WINDOW_S = 1.0
BLOCK_S = 10.0
"""Samples this far apart are taken as independent."""
MINIMUM_S = 30.0
MINIMUM_STEERING = 0.5
"""deg rms at the road wheels; with less, ratio and understeer cannot be told apart."""
REVERSED = -0.5
"""Correlation of steering and curvature below which one of the two has the wrong sign."""
MAXIMUM_RATIO_ERROR = 0.1
"""Largest standard error of a ratio that tells something, as a share of the ratio."""
MAXIMUM_OFFSET_ERROR = 2.0
"""Largest standard error of an offset that tells something, deg at the steering wheel."""
GRID_ERROR = 2e-4
"""Of the ratio: interpolating the angle to the grid, and averaging the yaw rate, is not the same."""
GRADIENT_STEPS = 8
GRADIENT_TOLERANCE = 1e-7
"""rad/(m/s²)."""
MAXIMUM_GRADIENT = 0.02
"""rad/(m/s²) of understeer; no car has half of it."""
HUBER = 1.345
"""Residuals beyond this many standard deviations count less; 95 % efficient where there are no outliers."""
ITERATIONS = 30


@dataclass(frozen=True, slots=True)
class SteeringCalibration:
    """What the steering wheel angle means for the road wheels.

    Attributes:
        ratio: Steering wheel angle / road wheel angle; None where it cannot be told.
        ratio_standard_error: 0 where the ratio was given, None where it cannot be told.
        offset: What the steering wheel angle reads when the car goes straight, deg; None where it cannot be told.
        offset_standard_error: deg; 0 where the offset was given, None where it cannot be told.
        understeer: Road wheel angle beyond the kinematic one per lateral acceleration, deg/(m/s²), as a by-product:
            near 0 lateral acceleration it is uncertain. None where nothing was fitted.
        samples: Samples that were used.
        reason: What cannot be told, why, and what to do; empty where everything can.
    """

    ratio: float | None
    ratio_standard_error: float | None
    offset: float | None
    offset_standard_error: float | None
    understeer: float | None
    samples: int
    reason: str = ""


def estimate_steering(
    steering_wheel_angle: npt.ArrayLike,
    yaw_rate: npt.ArrayLike,
    speed: npt.ArrayLike,
    wheelbase: float,
    *,
    ratio: float | None = None,
    offset: float | None = None,
    rate: float = 10.0,
    maximum_lateral_acceleration: float = 4.0,
) -> SteeringCalibration:
    """Fit the single-track model in steady cornering to driving.

    ``steering wheel angle = offset + ratio·atan(κ·(wheelbase + understeer·speed²))``, κ = yaw rate / speed and the
    understeer in rad/(m/s²), by Huber's robust least squares on moving averages over one second of both sides, because
    steering leads the yaw rate by a few tenths; the understeer by Gauss-Newton. Used are samples faster than 3 m/s
    below `maximum_lateral_acceleration`, where tyres are still linear. Standard errors come from the jackknife over
    blocks of ten seconds; that of the ratio holds 0.02 % for what the grid leaves.

    Args:
        steering_wheel_angle: (n_samples,) deg, positive left, on a grid. NaN where missing; stretches that do not
            follow one another have NaN in between.
        yaw_rate: (n_samples,) deg/s, positive left.
        speed: (n_samples,) m/s.
        wheelbase: m.
        ratio: Known ratio; it is then not fitted.
        offset: Known offset, deg; it is then not fitted.
        rate: Rate of the grid, Hz.
        maximum_lateral_acceleration: m/s², of speed · yaw rate.

    Returns:
        The calibration. What cannot be told is None, and `reason` says why.
    """
    window = max(1, round(WINDOW_S * rate))
    wheel, yaw, v = (np.asarray(values, np.float64) for values in (steering_wheel_angle, yaw_rate, speed))
    v = np.where(v > MINIMUM_SPEED, v, np.nan)
    curvature = np.radians(yaw) / v

    def averaged(values: Array) -> Array:
        # Missing samples behind the end make the window fit series of any length.
        return np.convolve(np.append(values, np.full(window, np.nan)), np.full(window, 1.0 / window), "valid")

    wheel, lateral = averaged(wheel), averaged(curvature * v**2)
    used = np.isfinite(wheel) & (np.abs(lateral) < maximum_lateral_acceleration)
    wheel = wheel[used]
    if len(wheel) < MINIMUM_S * rate:
        limits = f"faster than {MINIMUM_SPEED:g} m/s and below {maximum_lateral_acceleration:g} m/s² to the side"
        reason = f"only {len(wheel) / rate:.0f} s {limits}, {MINIMUM_S:.0f} s are needed"
        return _untold(ratio, offset, len(wheel), reason)
    kinematic = averaged(np.degrees(np.arctan(curvature * wheelbase)))[used]
    moves = float(np.std(wheel)) > 0 and float(np.std(kinematic)) > 0
    correlation = float(np.corrcoef(wheel, kinematic)[0, 1]) if moves else 0.0
    if correlation < REVERSED:
        reason = (
            f"the steering wheel angle turns against the yaw rate (correlation {correlation:.2f}); if the angle is "
            "positive to the right, turn it in wheelprint.toml, [can.signals]: "
            'steering_wheel_angle = { signal = "Message.Signal", sign = -1 }'
        )
        return _untold(ratio, offset, len(wheel), reason)

    ratio_error, offset_error = (None if value is None else 0.0 for value in (ratio, offset))
    fitted, understeer = _fit_model(
        wheel, curvature, v, wheelbase, lambda values: averaged(values)[used],
        np.flatnonzero(used) // round(BLOCK_S * rate), ratio, offset,
    )  # fmt: skip
    reasons = []
    if "ratio" in fitted:
        ratio, ratio_error = fitted["ratio"]
        ratio_error = float(np.hypot(ratio_error, GRID_ERROR * ratio))
        steered = float(np.std(kinematic))
        if steered < MINIMUM_STEERING or ratio <= 0 or not ratio_error <= MAXIMUM_RATIO_ERROR * ratio:
            reasons.append(
                f"the ratio cannot be told: {ratio:.1f} ± {ratio_error:.1f} from {steered:.2f} deg rms at the road "
                "wheels; record slow, tight bends, or give vehicle.steering_ratio"
            )
            ratio = ratio_error = None
    if "offset" in fitted:
        offset, offset_error = fitted["offset"]
        if not offset_error <= MAXIMUM_OFFSET_ERROR:
            reasons.append(
                f"the offset cannot be told: {offset:.1f} ± {offset_error:.1f} deg; record more driving, or give "
                "vehicle.steering_offset"
            )
            offset = offset_error = None
    told = None if ratio is None else float(np.degrees(understeer))
    return SteeringCalibration(ratio, ratio_error, offset, offset_error, told, len(wheel), "; ".join(reasons))


def _untold(ratio: float | None, offset: float | None, samples: int, reason: str) -> SteeringCalibration:
    """Return what was given, where nothing can be fitted."""
    ratio_error, offset_error = (None if value is None else 0.0 for value in (ratio, offset))
    return SteeringCalibration(ratio, ratio_error, offset, offset_error, None, samples, reason)


def _fit_model(
    wheel: Array,
    curvature: Array,
    speed: Array,
    wheelbase: float,
    averaged: Callable[[Array], Array],
    block: npt.NDArray[np.intp],
    ratio: float | None,
    offset: float | None,
) -> tuple[dict[str, tuple[float, float]], float]:
    """Fit the understeer by Gauss-Newton, and with it ratio and offset, as far as they are not given.

    Args:
        wheel: Averaged steering wheel angle, deg (n_used,).
        curvature: 1/m (n_samples,).
        speed: m/s (n_samples,).
        wheelbase: m.
        averaged: From (n_samples,) to the averages that are used (n_used,).
        block: Number of the block of each (n_used,).
        ratio: If it is given.
        offset: If it is given, deg.

    Returns:
        `ratio` and `offset` (deg) with their standard errors by name, and the understeer in rad/(m/s²).
    """
    understeer = 0.0
    for _ in range(GRADIENT_STEPS):
        tangent = curvature * (wheelbase + understeer * speed**2)
        road_wheel = averaged(np.degrees(np.arctan(tangent)))
        columns = {"step": averaged(np.degrees(curvature * speed**2 / (1 + tangent**2)))}
        if ratio is None:
            columns["ratio"] = road_wheel
        if offset is None:
            columns["offset"] = np.ones(len(wheel))
        target = wheel - (offset or 0.0) - (ratio or 0.0) * road_wheel
        fitted = dict(zip(columns, _robust_fit(np.column_stack(list(columns.values())), target, block), strict=True))
        scale, scale_error = fitted.get("ratio", (ratio, 0.0))
        # Where the ratio is not told, the understeer is not either, and the linear model is as good.
        if not scale or not scale_error <= MAXIMUM_RATIO_ERROR * scale:
            break
        step = fitted["step"][0] / scale
        if not abs(understeer + step) < MAXIMUM_GRADIENT:
            break
        understeer += step
        if abs(step) < GRADIENT_TOLERANCE:
            break
    return fitted, understeer


def _robust_fit(design: Array, target: Array, block: npt.NDArray[np.intp]) -> list[tuple[float, float]]:
    """Return Huber's estimate of each parameter and its standard error by the jackknife over blocks.

    Args:
        design: (n_samples, n_parameters).
        target: (n_samples,).
        block: (n_samples,) number of each sample's block.
    """
    estimate, weight = np.full(design.shape[1], np.inf), np.ones(len(target))
    for _ in range(ITERATIONS):
        before = estimate
        weighted = design * weight[:, None]
        # Least squares of the normal equations: where the data leave a direction open, the parameter stays 0.
        estimate = np.linalg.lstsq(weighted.T @ design, weighted.T @ target, rcond=None)[0]
        residual = target - design @ estimate
        spread = max(1.4826 * float(np.median(np.abs(residual))), 1e-9)
        weight = np.minimum(1.0, HUBER * spread / np.maximum(np.abs(residual), 1e-12))
        if np.allclose(estimate, before, rtol=1e-9, atol=1e-9):
            break
    number = np.unique(block, return_inverse=True)[1]
    n_blocks, n = int(number.max()) + 1, design.shape[1]
    weighted = design * weight[:, None]
    scores, shares = np.zeros((n_blocks, n)), np.zeros((n_blocks, n, n))
    np.add.at(scores, number, weighted * residual[:, None])
    np.add.at(shares, number, weighted[:, :, None] * design[:, None, :])
    normal = shares.sum(axis=0)
    # A share of 1e-9 keeps it finite where one block tells all of a parameter, or none does.
    ridge = 1e-9 * np.diag(np.maximum(np.diag(normal), 1e-9))
    without = np.linalg.solve(normal + ridge - shares, scores[:, :, None])[:, :, 0]
    return list(zip(estimate.tolist(), np.sqrt((without**2).sum(axis=0)).tolist(), strict=True))
