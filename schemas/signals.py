"""The vocabulary: every canonical signal with its unit, range, kind and resampling, in one table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Resampling = Literal["linear", "angle", "mean", "hold"]


@dataclass(frozen=True, slots=True)
class Signal:
    """One canonical signal.

    Attributes:
        name: Column name.
        unit: Unit of the stored values; empty for states.
        description: What it is, with its positive direction (ISO 8855: left).
        source: `can` or `nav`: whose clock stamps it.
        minimum: Smallest plausible value; below it a sample is rejected.
        maximum: Largest plausible value.
        resampling: How it comes to the grid. `linear`: between the neighbours; `angle`: the same on the circle, in
            [-180, 180); `mean`: average over one grid period, for vibrating quantities; `hold`: the last value.
        vss: COVESA Vehicle Signal Specification path where one exists, else empty.
    """

    name: str
    unit: str
    description: str
    source: Literal["can", "nav"]
    minimum: float
    maximum: float
    resampling: Resampling
    vss: str = ""


SIGNALS: dict[str, Signal] = {
    signal.name: signal
    for signal in (
        Signal("steering_wheel_angle", "deg", "steering wheel angle, positive to the left", "can",
               -1440, 1440, "linear", "Vehicle.Chassis.SteeringWheel.Angle"),
        Signal("steering_wheel_speed", "deg/s", "rate of the steering wheel angle, positive to the left", "can",
               -2500, 2500, "linear"),
        Signal("speed", "m/s", "vehicle speed measured by the car", "can",
               -30, 120, "linear", "Vehicle.Speed"),
        Signal("accelerator_pedal", "%", "accelerator pedal position", "can",
               0, 130, "linear", "Vehicle.Chassis.Accelerator.PedalPosition"),
        Signal("brake_pedal", "%", "brake pedal position", "can",
               0, 130, "linear", "Vehicle.Chassis.Brake.PedalPosition"),
        Signal("brake_pressure", "bar", "brake pressure", "can", -5, 400, "linear"),
        Signal("abs_active", "", "1 while the anti-lock brakes work, else 0", "can",
               0, 1, "hold", "Vehicle.ADAS.ABS.IsEngaged"),
        Signal("esc_active", "", "1 while the stability control works, else 0", "can",
               0, 1, "hold", "Vehicle.ADAS.ESC.IsEngaged"),
        Signal("yaw_rate", "deg/s", "yaw rate measured by the car, positive to the left", "can",
               -250, 250, "mean", "Vehicle.AngularVelocity.Yaw"),
        Signal("longitudinal_acceleration", "m/s²", "acceleration measured by the car, positive forwards", "can",
               -60, 60, "mean", "Vehicle.Acceleration.Longitudinal"),
        Signal("lateral_acceleration", "m/s²", "acceleration measured by the car, positive to the left", "can",
               -60, 60, "mean", "Vehicle.Acceleration.Lateral"),
        Signal("gear", "", "gear as the car codes it", "can",
               -128, 255, "hold", "Vehicle.Powertrain.Transmission.CurrentGear"),
        Signal("latitude", "deg", "WGS 84 latitude, positive north", "nav",
               -90, 90, "linear", "Vehicle.CurrentLocation.Latitude"),
        Signal("longitude", "deg", "WGS 84 longitude, positive east", "nav",
               -180, 180, "angle", "Vehicle.CurrentLocation.Longitude"),
        Signal("altitude", "m", "altitude as the navigation unit gives it", "nav",
               -1000, 20000, "linear", "Vehicle.CurrentLocation.Altitude"),
        Signal("x", "m", "east of the recording's origin", "nav", -1e7, 1e7, "linear"),
        Signal("y", "m", "north of the recording's origin", "nav", -1e7, 1e7, "linear"),
        Signal("course", "deg", "direction of travel, anticlockwise from east", "nav", -180, 180, "angle"),
        Signal("heading", "deg", "where the car points, anticlockwise from east", "nav", -180, 180, "angle"),
        Signal("nav_speed", "m/s", "horizontal speed from navigation", "nav", 0, 120, "linear"),
        Signal("nav_yaw_rate", "deg/s", "yaw rate from navigation, positive to the left", "nav", -250, 250, "mean"),
        Signal("nav_longitudinal_acceleration", "m/s²", "acceleration from navigation, positive forwards", "nav",
               -60, 60, "mean"),
        Signal("nav_lateral_acceleration", "m/s²", "acceleration from navigation, positive to the left", "nav",
               -60, 60, "mean"),
        Signal("position_accuracy", "m", "horizontal standard deviation of the position", "nav", 0, 1e6, "hold"),
        Signal("nav_status", "", "navigation status as the unit codes it (NCOM: 4 is locked)", "nav",
               0, 255, "hold"),
    )
}  # fmt: skip
"""Every canonical signal by name, in the order of the stored columns."""

CAN_SIGNALS = tuple(name for name, signal in SIGNALS.items() if signal.source == "can")
NAV_SIGNALS = tuple(name for name, signal in SIGNALS.items() if signal.source == "nav")
