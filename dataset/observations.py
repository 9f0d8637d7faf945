"""One recording as the detectors see it: measured signals, and what can be told from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..schemas.angles import wrap_degrees
from ..schemas.config import Events
from ..schemas.signals import SIGNALS
from .path import Floats

DERIVED = {"lateral_jerk": "m/s³", "yaw_rate_deviation": "deg/s"}
"""Quantities that no sensor measures, with their units."""

RATE_SPAN = 0.1
"""s to either side over which rates of change are taken, so that they mean the same at every rate of the grid."""
LAG = 0.3
"""s; the yaw rate is what the steering asked for within this time before or after."""


def unit_of(quantity: str) -> str:
    """Return the unit of a signal or of a quantity of `DERIVED`."""
    return DERIVED.get(quantity) or SIGNALS[quantity].unit


@dataclass(frozen=True, slots=True)
class Observations:
    """What the detectors compare with their thresholds.

    Attributes:
        recording: `driver/recording`.
        time: ns UTC (n_samples,).
        run: Number of the run, -1 outside.
        speed: m/s, of navigation or else of the car, not negative; NaN outside runs and where unknown.
        values: Columns of the synced table and quantities of `DERIVED`, each (n_samples,), NaN where unknown.
        period: ns.
    """

    recording: str
    time: NDArray[np.int64]
    run: NDArray[np.int64]
    speed: Floats
    values: Mapping[str, Floats]
    period: int

    @classmethod
    def of(cls, recording: str, table: pa.Table, period: int) -> Observations:
        """Return the observations of a synced table.

        A recording without a steering wheel speed has that of its angle; without a longitudinal acceleration, the rate
        of its speed; without a lateral one, speed times yaw rate, or times the rate of the course.
        """
        names = [name for name in table.column_names if name in SIGNALS]
        values: dict[str, Floats] = {name: table[name].cast(pa.float64()).to_numpy() for name in names}
        run = table["run"].fill_null(-1).to_numpy().astype(np.int64)
        span = max(1, round(RATE_SPAN * 1e9 / period))

        def lacks(*columns: str) -> bool:
            return all(np.isnan(values[column]).all() for column in columns)

        def rate(*columns: str) -> Floats:
            column = next((column for column in columns if not lacks(column)), columns[0])
            change = _shifted(values[column], run, -span) - _shifted(values[column], run, span)
            return (wrap_degrees(change) if column == "course" else change) / (2e-9 * span * period)

        if lacks("steering_wheel_speed"):
            values["steering_wheel_speed"] = rate("steering_wheel_angle")
        if lacks("longitudinal_acceleration", "nav_longitudinal_acceleration"):
            values["longitudinal_acceleration"] = rate("speed", "nav_speed")
        speed = np.where(np.isnan(values["nav_speed"]), np.abs(values["speed"]), values["nav_speed"])
        if lacks("lateral_acceleration", "nav_lateral_acceleration"):
            turning = next((values[name] for name in ("yaw_rate", "nav_yaw_rate") if not lacks(name)), rate("course"))
            values["lateral_acceleration"] = speed * np.radians(turning)
        values["lateral_jerk"] = rate("lateral_acceleration", "nav_lateral_acceleration")
        values["yaw_rate_deviation"] = np.full(len(run), np.nan)
        time = table["time"].cast(pa.int64()).to_numpy()
        return cls(recording, time, run, np.where(run < 0, np.nan, speed), values, period)

    @property
    def yaw_rate(self) -> Floats:
        """Of the car, whose clock is that of the steering, or else of navigation, deg/s."""
        own = self.values["yaw_rate"]
        return self.values["nav_yaw_rate"] if np.isnan(own).all() else own

    def expecting(self, wheelbase: float, ratio: float, offset: float, understeer: float) -> Observations:
        """Return the same with `yaw_rate_deviation`: by how much the yaw rate is not what speed and steering promise.

        Expected is ``v·tan δ / (L + K·v²)``, δ being the angle of the road wheels; what counts is the distance from
        the range of what was expected within `LAG`, because steering leads the yaw rate.

        Args:
            wheelbase: L, m.
            ratio: Steering wheel angle over δ.
            offset: deg, what the steering wheel angle reads when the car goes straight.
            understeer: K, deg/(m/s²); a negative one is taken for none.
        """
        angle = np.radians((self.values["steering_wheel_angle"] - offset) / ratio)
        length = wheelbase + np.radians(max(understeer, 0.0)) * self.speed**2
        expected = np.degrees(self.speed * np.tan(angle) / length)
        lowest = highest = expected
        for step in range(1, round(LAG * 1e9 / self.period) + 1):
            for shifted in (_shifted(expected, self.run, step), _shifted(expected, self.run, -step)):
                lowest, highest = np.fmin(lowest, shifted), np.fmax(highest, shifted)
        measured = self.yaw_rate
        deviation = np.maximum(np.maximum(measured - highest, lowest - measured), 0.0)
        return replace(self, values={**self.values, "yaw_rate_deviation": deviation})

    def reverses(self, settings: Events) -> NDArray[np.bool_]:
        """Return where the car goes backwards: course against heading, a negative speed, or a gear that says so."""
        apart = np.abs(wrap_degrees(self.values["course"] - self.values["heading"])) > settings.reversing
        backwards = self.values["speed"] <= -max(settings.standstill, 1e-9)
        in_gear = np.isin(self.values["gear"], settings.reverse_gears)
        return (apart | backwards | in_gear) & (self.speed >= settings.standstill)

    def distrusts_navigation(self, settings: Events) -> NDArray[np.bool_]:
        """Return where navigation's status or accuracy says that it is not to be trusted."""
        status = np.isin(self.values["nav_status"], settings.untrusted_status)
        return (status | (self.values["position_accuracy"] > settings.navigation_accuracy)) & (self.run >= 0)


def _shifted(values: Floats, run: NDArray[np.int64], step: int) -> Floats:
    """Return for each sample the one `step` before it, NaN where that is in another run."""
    shifted = np.full(len(values), np.nan)
    if abs(step) < len(values):
        to, of = (slice(step, None), slice(None, -step)) if step > 0 else (slice(None, step), slice(-step, None))
        shifted[to] = np.where(run[to] == run[of], values[of], np.nan)
    return shifted
