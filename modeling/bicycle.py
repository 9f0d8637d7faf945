"""The car as a bicycle: which path a steering wheel angle makes at a speed, and back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from ..schemas.errors import InputError
from ..schemas.project import Project

FloatArray = npt.NDArray[np.float64]

LOCK = 38.0
"""deg at the road wheels, beyond which no passenger car's turn."""


@dataclass(frozen=True, slots=True)
class Bicycle:
    """A front-steered car, its reference point the middle of the rear axle.

    At speed v and road wheel angle δ it goes along the curvature κ = tan δ / (L + K v²); angles and curvatures are
    positive to the left. Steering wheel angles are without the sensor's offset, as in the dataset.

    Attributes:
        wheelbase: L, m.
        ratio: Steering ratio, steering wheel angle over road wheel angle; 1 where angles of the road wheels are meant.
        understeer: K, rad/(m/s²); 0 for a kinematic bicycle.
    """

    wheelbase: float
    ratio: float = 1.0
    understeer: float = 0.0

    @classmethod
    def of_project(cls, project: Project) -> Self:
        """Return the project's vehicle as `wheelprint build` calibrated it; a negative understeer is taken for none.

        Raises:
            InputError: It was not calibrated yet, or the project file or the manifest cannot be read.
        """
        known = project.manifest.get("calibration", {})
        if not known.get("steering_ratio"):
            reason = "the steering of the vehicle was not calibrated yet; run `wheelprint build` first"
            raise InputError(project.directory / "manifest.json", "calibration", reason)
        understeer = np.radians(max(known.get("understeer_deg_per_m_s2") or 0.0, 0.0))
        return cls(project.config.vehicle.wheelbase, known["steering_ratio"], float(understeer))

    def curvature(self, steering_wheel_angle: FloatArray, speed: FloatArray) -> FloatArray:
        """Return κ = tan(δ_s / ratio) / (L + K v²), 1/m (n,).

        Args:
            steering_wheel_angle: δ_s, deg (n,).
            speed: v, m/s (n,).
        """
        found: FloatArray = np.tan(np.radians(steering_wheel_angle) / self.ratio)
        return found / (self.wheelbase + self.understeer * speed**2)

    def steering_wheel_angle(self, curvature: FloatArray, speed: FloatArray) -> FloatArray:
        """Return the steering wheel angle that goes along a curvature, ratio · atan(κ (L + K v²)), deg (n,).

        Args:
            curvature: κ, 1/m (n,).
            speed: v, m/s (n,).
        """
        found: FloatArray = np.degrees(np.arctan(curvature * (self.wheelbase + self.understeer * speed**2)))
        return found * self.ratio
