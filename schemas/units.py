"""Conversion of the units that databases and logs write into the units that Wheelprint stores."""

from __future__ import annotations

import math

# unit as written in the wild (lower case, no blanks) -> (stored unit of that quantity, factor to it)
UNITS: dict[str, tuple[str, float]] = {
    **dict.fromkeys(("deg", "degree", "degrees", "°", "grad"), ("deg", 1.0)),
    **dict.fromkeys(("rad", "radian", "radians"), ("deg", 180.0 / math.pi)),
    **dict.fromkeys(("deg/s", "degree/s", "degrees/s", "deg/sec", "°/s", "°/sec", "degpersec", "dps"), ("deg/s", 1.0)),
    **dict.fromkeys(("rad/s", "rad/sec", "radians/s"), ("deg/s", 180.0 / math.pi)),
    **dict.fromkeys(("m/s", "m/sec", "mps", "meterpersec", "ms-1"), ("m/s", 1.0)),
    **dict.fromkeys(("km/h", "kmh", "kph", "kmph"), ("m/s", 1.0 / 3.6)),
    **dict.fromkeys(("mph", "mi/h", "miles/h"), ("m/s", 0.44704)),
    **dict.fromkeys(("kn", "kt", "knot", "knots"), ("m/s", 1852.0 / 3600.0)),
    **dict.fromkeys(("m/s²", "m/s2", "m/s^2", "m/s/s", "meterpersec2", "ms-2"), ("m/s²", 1.0)),
    **dict.fromkeys(("g", "gn", "g0"), ("m/s²", 9.80665)),
    **dict.fromkeys(("bar",), ("bar", 1.0)),
    **dict.fromkeys(("mbar", "hpa"), ("bar", 1e-3)),
    **dict.fromkeys(("kpa",), ("bar", 1e-2)),
    **dict.fromkeys(("mpa",), ("bar", 10.0)),
    **dict.fromkeys(("pa",), ("bar", 1e-5)),
    **dict.fromkeys(("psi",), ("bar", 0.0689475729317831)),
    **dict.fromkeys(("%", "percent", "pct"), ("%", 1.0)),
    **dict.fromkeys(("m", "meter", "metre", "meters"), ("m", 1.0)),
    **dict.fromkeys(("km",), ("m", 1000.0)),
    **dict.fromkeys(("ft", "feet"), ("m", 0.3048)),
}


NANOSECONDS = {"s": 10**9, "sec": 10**9, "ms": 10**6, "µs": 10**3, "us": 10**3, "ns": 1}
"""ns in a unit of time, as databases write it."""


def factor(found: str, stored: str) -> float | None:
    """Return what a value in the unit `found` is multiplied by to be in the unit `stored`.

    Args:
        found: Unit as a database or log writes it; case and blanks do not matter.
        stored: A unit of the signal table; the empty unit accepts any found unit as it is.

    Returns:
        The factor, or None where the unit is unknown, missing or measures another quantity.
    """
    if stored == "":
        return 1.0
    quantity, scale = UNITS.get("".join(found.lower().split()), ("", 0.0))
    return scale if quantity == stored else None


def known_units(stored: str) -> list[str]:
    """Return every way of writing a unit of the same quantity as `stored`."""
    return [written for written, (quantity, _) in UNITS.items() if quantity == stored]
