"""Steering ratio, steering offset and understeer of the car, from driving."""

from __future__ import annotations

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
    """Fit the linear single-track model in steady cornering to driving.

    ``steering wheel angle = offset + ratio·(atan(wheelbase·κ) + understeer·κ·speed²)``, κ = yaw rate / speed, by
    Huber's robust least squares on moving averages over one second, because steering leads the yaw rate by a few
    tenths. Used are samples faster than 3 m/s below `maximum_lateral_acceleration`, where tyres are still linear.
    Standard errors come from the jackknife over blocks of ten seconds.

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
    # Missing samples behind the end make the window fit series of any length.
    beyond = np.full(window, np.nan)
    wheel, yaw, v = (
        np.convolve(np.append(np.asarray(values, np.float64), beyond), np.full(window, 1.0 / window), "valid")
        for values in (steering_wheel_angle, yaw_rate, speed)
    )
    lateral = v * np.radians(yaw)
    used = np.isfinite(wheel) & (v > MINIMUM_SPEED) & (np.abs(lateral) < maximum_lateral_acceleration)
    wheel, yaw, v, lateral = wheel[used], yaw[used], v[used], lateral[used]
    if len(wheel) < MINIMUM_S * rate:
        limits = f"faster than {MINIMUM_SPEED:g} m/s and below {maximum_lateral_acceleration:g} m/s² to the side"
        reason = f"only {len(wheel) / rate:.0f} s {limits}, {MINIMUM_S:.0f} s are needed"
        return _untold(ratio, offset, len(wheel), reason)
    kinematic = np.degrees(np.arctan(wheelbase * np.radians(yaw) / v))
    moves = float(np.std(wheel)) > 0 and float(np.std(kinematic)) > 0
    correlation = float(np.corrcoef(wheel, kinematic)[0, 1]) if moves else 0.0
    if correlation < REVERSED:
        reason = (
            f"the steering wheel angle turns against the yaw rate (correlation {correlation:.2f}); if the angle is "
            "positive to the right, turn it in wheelprint.toml, [can.signals]: "
            'steering_wheel_angle = { signal = "Message.Signal", sign = -1 }'
        )
        return _untold(ratio, offset, len(wheel), reason)

    target = wheel - (offset or 0.0) - (ratio or 0.0) * kinematic
    columns = {"lateral": lateral}
    if ratio is None:
        columns["ratio"] = kinematic
    if offset is None:
        columns["offset"] = np.ones(len(wheel))
    block = np.flatnonzero(used) // round(BLOCK_S * rate)
    fitted = dict(zip(columns, _robust_fit(np.column_stack(list(columns.values())), target, block), strict=True))
    reasons = []
    ratio_error, offset_error = (None if value is None else 0.0 for value in (ratio, offset))
    if "ratio" in fitted:
        ratio, ratio_error = fitted["ratio"]
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
    understeer = None if ratio is None else fitted["lateral"][0] / ratio
    return SteeringCalibration(ratio, ratio_error, offset, offset_error, understeer, len(wheel), "; ".join(reasons))


def _untold(ratio: float | None, offset: float | None, samples: int, reason: str) -> SteeringCalibration:
    """Return what was given, where nothing can be fitted."""
    ratio_error, offset_error = (None if value is None else 0.0 for value in (ratio, offset))
    return SteeringCalibration(ratio, ratio_error, offset, offset_error, None, samples, reason)


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
