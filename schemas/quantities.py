"""What a mapping of navigation may name: the canonical signals, and the other forms in which units tell them."""

from __future__ import annotations

from dataclasses import dataclass

from .signals import NAV_SIGNALS, SIGNALS


@dataclass(frozen=True, slots=True)
class Quantity:
    """What navigation units measure, in the axes of its own name.

    Attributes:
        name: As the project file writes it.
        unit: What values are converted to.
        description: What it is, with its positive direction.
        resampling: How values between two samples are found: `linear`, or `angle` on the circle.
    """

    name: str
    unit: str
    description: str
    resampling: str = "linear"


QUANTITIES: dict[str, Quantity] = {
    quantity.name: quantity
    for quantity in (
        *(
            Quantity(name, SIGNALS[name].unit, SIGNALS[name].description, SIGNALS[name].resampling)
            for name in NAV_SIGNALS
        ),
        Quantity("course_clockwise", "deg", "direction of travel (track), clockwise from north", "angle"),
        Quantity("heading_clockwise", "deg", "where the car points, clockwise from north", "angle"),
        Quantity("velocity_north", "m/s", "velocity to the north"),
        Quantity("velocity_east", "m/s", "velocity to the east"),
        Quantity("position_accuracy_north", "m", "standard deviation of the position to the north"),
        Quantity("position_accuracy_east", "m", "standard deviation of the position to the east"),
    )
}
"""By name; what is not canonical becomes so on the way in."""

TIME_QUANTITIES: dict[str, str] = {
    "gps_time": "GPS time since 1980-01-06",
    "unix_time": "UTC since 1970-01-01",
    "utc_offset": "UTC - GPS time; default: the table of leap seconds",
}
"""The unit's own time in CAN frames; it tells the offset of the clock that stamps them."""
