from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from wheelprint.ingest.can.database import Database, load_database
from wheelprint.ingest.mapping import resolve
from wheelprint.schemas.config import Can

DBC = """VERSION ""
NS_ :
BS_:
BU_: CAR
BO_ 291 WHEEL: 8 CAR
 SG_ Angle : 0|16@1- (0.1,0) [0|0] "rad" XXX
 SG_ Turns : 16|16@1- (0.1,0) [0|0] "turns" XXX
BO_ 512 MOTION: 8 CAR
 SG_ Speed : 0|16@1+ (0.01,0) [0|655.35] "km/h" XXX
"""


@pytest.fixture
def database(tmp_path: Path) -> Database:
    (tmp_path / "car.dbc").write_text(DBC)
    return load_database(["car.dbc"], tmp_path)


def mapped(database: Database, **signals: Any) -> tuple[dict[str, float], list[str]]:
    found, problems = resolve(Can.model_validate({"signals": signals}), database, Path("wheelprint.toml"))
    return {name: signal.factor for name, signal in found.items()}, [str(problem) for problem in problems]


def test_units_of_the_database_are_converted_without_being_asked(database: Database) -> None:
    factors, problems = mapped(database, speed="MOTION.Speed", steering_wheel_angle="WHEEL.Angle")
    assert factors == {"speed": pytest.approx(1 / 3.6), "steering_wheel_angle": pytest.approx(57.29577951308232)}
    assert problems == []


def test_sign_and_scale_come_from_the_mapping(database: Database) -> None:
    factors, problems = mapped(
        database,
        speed={"signal": "MOTION.Speed", "scale": 0.5},
        steering_wheel_angle={"signal": "WHEEL.Turns", "scale": 360, "sign": -1},
    )
    assert factors == {"speed": 0.5, "steering_wheel_angle": -360}
    assert problems == []


def test_an_unknown_unit_without_a_scale_says_so_and_the_others_are_mapped(database: Database) -> None:
    factors, problems = mapped(database, speed="MOTION.Speed", steering_wheel_angle="WHEEL.Turns")
    assert list(factors) == ["speed"]
    assert problems == [
        (
            "wheelprint.toml: can.signals.steering_wheel_angle: the database gives WHEEL.Turns the unit 'turns', which "
            "is not known as a unit of deg (deg, degree, degrees, °, grad, rad, radian, radians are); say what to "
            'multiply it by: steering_wheel_angle = { signal = "WHEEL.Turns", scale = … }'
        )
    ]


def test_every_signal_that_is_not_there_is_named(database: Database) -> None:
    _, problems = mapped(database, speed="MOTION.Sped", steering_wheel_angle="WHEELS.Angle")
    assert problems == [
        "wheelprint.toml: can.signals.speed: message MOTION (0x200) has no signal Sped; did you mean Speed?",
        (
            "wheelprint.toml: can.signals.steering_wheel_angle: the database has no message WHEELS; did you mean "
            "WHEEL? A signal Angle is in WHEEL"
        ),
    ]


def test_without_any_database_the_message_says_that_there_are_no_messages(database: Database) -> None:
    assert database.messages
    _, problems = mapped(Database(), speed="MOTION.Speed")
    assert problems == [
        "wheelprint.toml: can.signals.speed: the database has no message MOTION. It has no messages at all"
    ]
