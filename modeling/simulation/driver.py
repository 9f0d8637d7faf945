"""Drivers: how far ahead they look, how fast they go, what makes them brake, and the drive that results."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from .car import Car
from .road import KINDS, STEP, Road

RATE = 100  # Hz

FloatArray = npt.NDArray[np.float64]
Emergency = Literal["braking", "swerve"]


@dataclass(frozen=True, slots=True)
class Driver:
    """What tells one driver from another.

    The driver steers by pure pursuit (PP eq. 1) towards the point of the centre line that is h(v) away,
    h(v) = `lookahead_base` + `lookahead_time`·v within the bounds, taking the car for a kinematic bicycle: understeer
    is not compensated, so that the eq. 1 holds for the centre line and a fast curve is driven somewhat wide.

    Attributes:
        name: Also the name of the folder of the driver's recordings.
        lookahead_base: m, h at standstill.
        lookahead_time: s, growth of h with speed.
        lookahead_minimum: m, lower bound of h.
        lookahead_maximum: m, upper bound of h.
        lateral_comfort: m/s², the lateral acceleration that curves are taken with.
        acceleration: m/s², after a stop or a slow stretch.
        deceleration: m/s², before one.
        speed_factor: Share of the speed limit that the driver likes.
        steering_noise: deg at the steering wheel, standard deviation of the driver's slow unsteadiness.
        steering_smoothing: s, time constant with which the hands follow the eye.
    """

    name: str
    lookahead_base: float = 4.5
    lookahead_time: float = 0.7
    lookahead_minimum: float = 4.0
    lookahead_maximum: float = 30.0
    lateral_comfort: float = 2.2
    acceleration: float = 1.5
    deceleration: float = 1.8
    speed_factor: float = 1.0
    steering_noise: float = 0.8
    steering_smoothing: float = 0.1

    def lookahead(self, speed: FloatArray) -> FloatArray:
        """Return h(v) in m for speeds in m/s."""
        bounded: FloatArray = np.clip(
            self.lookahead_base + self.lookahead_time * speed, self.lookahead_minimum, self.lookahead_maximum
        )
        return bounded


def coloured_noise(generator: np.random.Generator, samples: int, deviation: float, time: float) -> FloatArray:
    """Return noise (samples,) of a standard deviation that forgets itself with a time constant in s, at `RATE`."""
    from scipy.signal import lfilter

    kept = np.exp(-1 / (RATE * time))
    white = generator.standard_normal(samples)
    white[1:] *= np.sqrt(1 - kept**2)
    noise: FloatArray = deviation * lfilter([1.0], [1.0, -kept], white)
    return noise
