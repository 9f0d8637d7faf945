from __future__ import annotations

import math

import pytest

from wheelprint.schemas.signals import SIGNALS
from wheelprint.schemas.units import UNITS, factor, known_units


@pytest.mark.parametrize(
    ("found", "stored", "expected"),
    [
        ("km/h", "m/s", 1 / 3.6),
        ("KPH", "m/s", 1 / 3.6),
        (" m / s ", "m/s", 1.0),
        ("rad", "deg", 180 / math.pi),
        ("rad/s", "deg/s", 180 / math.pi),
        ("kPa", "bar", 0.01),
        ("m/s^2", "m/s²", 1.0),
        ("g", "m/s²", 9.80665),
        ("anything", "", 1.0),
        ("km/h", "deg", None),
        ("", "m/s", None),
        ("furlong", "m", None),
    ],
)
def test_factor(found: str, stored: str, expected: float | None) -> None:
    assert factor(found, stored) == (None if expected is None else pytest.approx(expected, rel=1e-15))


def test_every_stored_unit_is_known_as_itself() -> None:
    for signal in SIGNALS.values():
        assert factor(signal.unit, signal.unit) == 1.0
    assert all(factor(written, quantity) == scale for written, (quantity, scale) in UNITS.items())
    assert "km/h" in known_units("m/s")
