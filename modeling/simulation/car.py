"""The car: a bicycle with understeer and rear slip, and what its motion means at the reference point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Car:
    """A front-steered car whose reference point is the middle of the rear axle.

    The yaw rate at speed v and road wheel angle δ is v·tan δ / (L + K·v²), with wheelbase L and understeer gradient K.
    Under lateral acceleration the rear tyres slip outwards: the course lags the heading by `rear_slip`·v²·κ.

    Attributes:
        wheelbase: m.
        track: m, between the wheels of an axle.
        steering_ratio: A ratio, steering wheel angle over road wheel angle.
        steering_offset: deg, what the car's sensor reads when the steering wheel angle is zero.
        understeer_gradient: rad/(m/s²), K above; 0 for a kinematic bicycle.
        rear_slip: rad/(m/s²), 0 for a rear axle that does not slip.
        steering_lag: s, time constant from the driver's hands to the road wheels.
        steering_speed: deg/s, the fastest the steering wheel can be turned.
        acceleration: m/s², the most the motor gives.
        deceleration: m/s², the most the brakes give.
    """

    wheelbase: float = 2.82
    track: float = 1.65
    steering_ratio: float = 15.7
    steering_offset: float = 2.3
    understeer_gradient: float = 0.002
    rear_slip: float = 0.0015
    steering_lag: float = 0.06
    steering_speed: float = 900.0
    acceleration: float = 3.5
    deceleration: float = 9.8

    def pedals(self, speed: FloatArray, acceleration: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return accelerator pedal (%) and brake pressure (bar) for a motion.

        Coasting slows the car by drag and recuperation; what is left to accelerate is the accelerator's share, what is
        left to slow down the brakes', at 11 bar per m/s²: demand = acceleration + 0.15 + 0.0006 v², pedal = 100 demand
        / (`acceleration` + 1), pressure = −11 demand; at standstill the pressure is 20 bar.

        Args:
            speed: m/s (n,).
            acceleration: m/s² (n,).

        Returns:
            Each (n,), from 0 on, the pedal up to 100.
        """
        coasting = np.where(speed > 0, -0.15 - 0.0006 * speed**2, 0.0)
        demand = acceleration - coasting
        pedal = np.clip(100 * demand / (self.acceleration + 1.0), 0, 100)
        return pedal, np.where(speed > 0, 11.0 * np.clip(-demand, 0, None), 20.0)

    def wheel_speeds(self, speed: FloatArray, yaw_rate: FloatArray, road_wheel_angle: FloatArray) -> FloatArray:
        """Return the wheel speeds (m/s) front left, front right, rear left, rear right as (4, n).

        With v_s = v ∓ ψ̇ `track` / 2 of the left and right side, rear wheels turn at v_s, front wheels at v_s cos δ +
        ψ̇ L sin δ; none turns backwards.

        Args:
            speed: m/s (n,), of the reference point.
            yaw_rate: rad/s (n,), positive to the left.
            road_wheel_angle: rad (n,), positive to the left.
        """
        left = speed - yaw_rate * self.track / 2
        right = speed + yaw_rate * self.track / 2
        sideways = yaw_rate * self.wheelbase
        across, along = np.sin(road_wheel_angle) * sideways, np.cos(road_wheel_angle)
        return np.maximum(np.stack((left * along + across, right * along + across, left, right)), 0.0)
