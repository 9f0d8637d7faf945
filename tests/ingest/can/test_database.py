from __future__ import annotations

import pickle
from pathlib import Path

import cantools
import pytest

from wheelprint.ingest.can.database import (
    Database,
    MessageLayout,
    SignalLayout,
    load_database,
    load_databases,
    shipped_databases,
)
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.signals import CAN_SIGNALS, SIGNALS
from wheelprint.schemas.units import factor

HEAD = 'VERSION ""\nNS_ :\nBS_:\nBU_: CAR\n'
STEER = 'BO_ 287 STEER: 5 CAR\n SG_ ANGLE : 0|16@1- (0.1,0) [0|0] "deg" CAR\n'


def write(folder: Path, name: str, content: str, encoding: str = "utf-8") -> str:
    (folder / name).write_text(content, encoding=encoding)
    return name


def problems_of(folder: Path, *names: str) -> list[str]:
    _, problems = load_databases(names, folder)
    return [str(problem).removeprefix(f"{folder}/") for problem in problems]


def test_shipped_database_has_every_canonical_signal_in_a_known_unit() -> None:
    database = load_database(["byd_tang"], Path())
    mapping = {
        "steering_wheel_angle": "STEER.ANGLE",
        "steering_wheel_speed": "STEER.ANGLE_RATE",
        "speed": "MOTION.Speed",
        "accelerator_pedal": "PEDALS.ACCELERATOR",
        "brake_pedal": "PEDALS.BRAKE",
        "brake_pressure": "BRAKES.PRESSURE",
        "yaw_rate": "INERTIA.YAW_RATE",
        "longitudinal_acceleration": "INERTIA.LONGITUDINAL_ACCELERATION",
        "lateral_acceleration": "INERTIA.LATERAL_ACCELERATION",
        "gear": "DRIVE_STATE.GEAR",
    }
    assert set(CAN_SIGNALS) - set(mapping) == {"abs_active", "esc_active"}
    for canonical, place in mapping.items():
        message, signal = database.find(*place.split("."))
        assert factor(signal.unit, SIGNALS[canonical].unit) is not None, place
        assert signal.description, place
        assert message.description, place
    assert database.find("DRIVE_STATE", "GEAR")[1].choices == ((1, "P"), (2, "R"), (3, "N"), (4, "D"))


def test_shipped_databases_load_strictly_and_mark_what_is_assumed() -> None:
    import wheelprint.schemas.databases as package

    folder = Path(package.__path__[0])
    assert shipped_databases() == tuple(sorted(path.stem for path in folder.glob("*.dbc"))) == ("byd_tang", "oxts")
    strict = cantools.database.load_file(folder / "byd_tang.dbc", strict=True)
    assert all(message.comment for message in strict.messages)
    for message in ("BRAKES", "INERTIA"):
        assert strict.get_message_by_name(message).comment.startswith("ASSUMPTION")
    assert "ASSUMPTION: positive to the left" in strict.get_message_by_name("STEER").get_signal_by_name("ANGLE").comment


def test_layouts_are_plain_data(tmp_path: Path) -> None:
    text = (
        HEAD
        + "BO_ 2566844926 M: 8 CAR\n"
        + ' SG_ Mode M : 0|8@1+ (1,0) [0|0] "" CAR\n'
        + ' SG_ A m1 : 15|12@0- (0.5,-3) [0|0] "°C" CAR\n'
        + ' SG_ F m3 : 32|32@1- (1,0) [0|0] "" CAR\n'
        + ' SG_ W : 24|8@1+ (2.0,1) [0|0] "" CAR\n'
        + 'CM_ BO_ 2566844926 "What it is";\nCM_ SG_ 2566844926 A "Temperature";\n'
        + 'VAL_ 2566844926 Mode 1 "on" 0 "off" ;\nSIG_VALTYPE_ 2566844926 F : 1;\n'
        + "SG_MUL_VAL_ 2566844926 A Mode 1-1, 5-6;\n"
    )
    database = load_database([write(tmp_path, "m.dbc", text)], tmp_path)
    assert pickle.loads(pickle.dumps(database)) == database
    assert database == Database(
        (
            MessageLayout(
                "M",
                0x18FEF1FE,
                True,
                8,
                "What it is",
                (
                    SignalLayout("Mode", 0, 8, choices=((1, "on"), (0, "off"))),
                    SignalLayout("A", 15, 12, True, True, False, 0.5, -3, "°C", "Temperature", (), "Mode", (1, 5, 6)),
                    SignalLayout("F", 32, 32, False, True, True, multiplexer="Mode", multiplexer_values=(3,)),
                    SignalLayout("W", 24, 8, scale=2, offset=1),
                ),
                "m.dbc",
            ),
        )
    )
    assert isinstance(database.messages[0].signals[3].scale, int)
    assert database.messages[0].label == "M (0x18FEF1FE)"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_units_survive_either_encoding(tmp_path: Path, encoding: str) -> None:
    name = write(tmp_path, "u.dbc", HEAD + STEER.replace("deg", "m/s²"), encoding)
    assert load_database([name], tmp_path).find("STEER", "ANGLE")[1].unit == "m/s²"


@pytest.mark.parametrize("suffix", ["kcd", "sym", "DBC"])
def test_other_formats(tmp_path: Path, suffix: str) -> None:
    write(tmp_path, "a.dbc", HEAD + STEER)
    source = cantools.database.load_file(tmp_path / "a.dbc")
    cantools.database.dump_file(source, tmp_path / f"b.{suffix}")
    ((message),) = load_database([f"b.{suffix}"], tmp_path).messages
    (signal,) = message.signals
    assert (message.name, message.id, message.length, message.source) == ("STEER", 287, 5, f"b.{suffix}")
    assert (signal.name, signal.start, signal.length, signal.signed, signal.scale) == ("ANGLE", 0, 16, True, 0.1)


def test_several_databases_merge(tmp_path: Path) -> None:
    other = write(tmp_path, "other.dbc", HEAD + STEER.replace("287", "300").replace("STEER", "OTHER"))
    database = load_database(["byd_tang", other, "byd_tang"], tmp_path)
    assert [m.name for m in database.messages][-2:] == ["INERTIA", "OTHER"]
    assert len(database.messages) == 8


def test_standard_and_extended_identifiers_do_not_collide(tmp_path: Path) -> None:
    name = write(tmp_path, "a.dbc", HEAD + STEER + STEER.replace("287", str(287 + (1 << 31))).replace("STEER", "X"))
    assert [(m.id, m.extended) for m in load_database([name], tmp_path).messages] == [(287, False), (287, True)]


def test_same_identifier_or_name_in_two_databases(tmp_path: Path) -> None:
    variants = {"STEER": "287", "SPEEDY": "289", "PEDALS": "5", "FINE": "6"}
    text = "".join(STEER.replace("STEER", name).replace("287", number) for name, number in variants.items())
    other = write(tmp_path, "other.dbc", HEAD + text)
    database, problems = load_databases(["byd_tang", other], tmp_path)
    assert [m.source for m in database.messages] == ["byd_tang"] * 7 + [other]
    assert [str(problem) for problem in problems] == [
        (
            f"{tmp_path}/other.dbc: same message name or identifier in this database and in byd_tang: STEER (0x11F), "
            "SPEEDY (0x121) against MOTION (0x121), PEDALS (0x005) against PEDALS (0x342). "
            "Which one a frame is cannot be known; remove one of each pair"
        )
    ]
    with pytest.raises(InputError) as caught:
        load_database(["byd_tang", other], tmp_path)
    assert str(caught.value) == str(problems[0])


def test_same_identifier_twice_in_one_database(tmp_path: Path) -> None:
    name = write(tmp_path, "a.dbc", HEAD + STEER + STEER.replace("STEER", "AGAIN"))
    assert problems_of(tmp_path, name) == [
        (
            "a.dbc: same message name or identifier twice in this database: AGAIN (0x11F) against STEER (0x11F). "
            "Which one a frame is cannot be known; remove one of each pair"
        )
    ]


def test_what_cannot_be_loaded_is_all_said_and_the_rest_is_there(tmp_path: Path) -> None:
    write(tmp_path, "giulia.dbc", HEAD + STEER)
    write(tmp_path, "broken.dbc", HEAD + "BO_ 12 X 8 CAR\n")
    write(tmp_path, "empty.dbc", HEAD)
    write(tmp_path, "page.kcd", "<html>")
    (tmp_path / "folder.dbc").mkdir()
    names = "byd_tung nothing giula.dbc zzz.arxml broken.dbc empty.dbc page.kcd folder.dbc byd_tang car.xls".split()
    database, problems = load_databases(names, tmp_path)
    assert len(database.messages) == 7
    assert [str(problem).removeprefix(f"{tmp_path}/") for problem in problems] == [
        (
            "byd_tung: neither a shipped database (byd_tang, oxts) nor a path that ends in .dbc, .kcd, .sym, .arxml; "
            "did you mean byd_tang?"
        ),
        "nothing: neither a shipped database (byd_tang, oxts) nor a path that ends in .dbc, .kcd, .sym, .arxml",
        (
            "giula.dbc: no such file; did you mean giulia.dbc? "
            "A database is a shipped name (byd_tang, oxts) or the path of a file"
        ),
        "zzz.arxml: no such file. A database is a shipped name (byd_tang, oxts) or the path of a file",
        (
            "broken.dbc: line 5: cantools cannot read this DBC file: Invalid syntax at line 5, column 10: "
            '"BO_ 12 X >>!<<8 CAR". Correct the file there, or export it again'
        ),
        "empty.dbc: holds no messages; it is empty, cut off, or not the file that was meant. Export it again",
        (
            "page.kcd: line 1: cantools cannot read this KCD file: no element found: line 1, column 6. "
            "Correct the file there, or export it again"
        ),
        "folder.dbc: cannot be read: Is a directory",
        "car.xls: neither a shipped database (byd_tang, oxts) nor a path that ends in .dbc, .kcd, .sym, .arxml",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "BO_ 12 X: 100000000 CAR\n",
            (
                "line 5: 100000000 bytes in a message, where at most 4096 make sense; "
                "the file is damaged or not meant for CAN"
            ),
        ),
        (
            'BO_ 12 X: 8 CAR\n SG_ S : 99999|8@1+ (1,0) [0|0] "" CAR\n',
            (
                "line 6: 99999 as start bit of a signal, where at most 32768 make sense; "
                "the file is damaged or not meant for CAN"
            ),
        ),
        (
            'BO_ 12 X: 8 CAR\n SG_ S : 0|800000000@1+ (1,0) [0|0] "" CAR\n',
            (
                "line 6: 800000000 bits in a signal, where at most 32768 make sense; "
                "the file is damaged or not meant for CAN"
            ),
        ),
        (
            (
                'BO_ 12 X: 8 CAR\n SG_ S M : 0|8@1+ (1,0) [0|0] "" CAR\n SG_ T m0 : 8|8@1+ (1,0) [0|0] "" CAR\n'
                "SG_MUL_VAL_ 12 T S 0-4000000000;\n"
            ),
            (
                "line 8: a multiplexed signal with the values 0-4000000000, where at most 65536 make sense; "
                "the file is damaged"
            ),
        ),
    ],
)
def test_monsters_are_refused_before_they_take_the_memory(tmp_path: Path, text: str, message: str) -> None:
    assert problems_of(tmp_path, write(tmp_path, "a.dbc", HEAD + text)) == [f"a.dbc: {message}"]


@pytest.mark.parametrize(
    ("signals", "message"),
    [
        (
            ' SG_ S : 0|8@1+ (1,0) [0|0] "" CAR\n SG_ S : 8|8@1+ (1,0) [0|0] "" CAR\n',
            "message X (0x00C): 2 signals are called S; rename all but one. It is left out",
        ),
        (
            ' SG_ time : 0|8@1+ (1,0) [0|0] "" CAR\n SG_ time_ : 8|8@1+ (1,0) [0|0] "" CAR\n',
            "message X (0x00C): 2 signals are called time_; rename all but one. It is left out",
        ),
        (
            ' SG_ S : 0|8@1+ (1e301,0) [0|0] "" CAR\n',
            "message X (0x00C): signal S has a scale or offset beyond 1e+300. It is left out",
        ),
        (
            ' SG_ S : -3|8@0+ (1,0) [0|0] "" CAR\n',
            "message X (0x00C): signal S has 8 bits from bit -3. It is left out",
        ),
        (
            ' SG_ F : 0|24@1- (1,0) [0|0] "" CAR\nSIG_VALTYPE_ 12 F : 1;\n',
            "message X (0x00C): signal F is a float of 24 bits, where 16, 32 and 64 exist. It is left out",
        ),
        (
            (
                ' SG_ A m1M : 0|8@1+ (1,0) [0|0] "" CAR\n SG_ B m1M : 8|8@1+ (1,0) [0|0] "" CAR\n'
                "SG_MUL_VAL_ 12 A B 1-1;\nSG_MUL_VAL_ 12 B A 1-1;\n"
            ),
            (
                "message X (0x00C): multiplexers select each other: A by B by A; "
                "multiplexers select each other: B by A by B. It is left out"
            ),
        ),
    ],
)
def test_messages_that_cannot_be_decoded_are_left_out_alone(tmp_path: Path, signals: str, message: str) -> None:
    name = write(tmp_path, "a.dbc", HEAD + STEER + "BO_ 12 X: 8 CAR\n" + signals)
    database, problems = load_databases([name], tmp_path)
    assert [m.name for m in database.messages] == ["STEER"]
    assert [str(problem) for problem in problems] == [f"{tmp_path}/a.dbc: {message}"]


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("STEER.ANGEL", "message STEER (0x11F) has no signal ANGEL; did you mean ANGLE?"),
        ("steer.angle", "the database has no message steer; did you mean STEER? A signal angle is in STEER"),
        ("STEERING.X", "the database has no message STEERING; did you mean STEER?"),
        ("PEDALS.GEAR", "message PEDALS (0x342) has no signal GEAR. A signal GEAR is in DRIVE_STATE"),
        ("EPS.GEAR", "the database has no message EPS. A signal GEAR is in DRIVE_STATE"),
        ("STEER.Torque", "message STEER (0x11F) has no signal Torque. Its signals are ANGLE and ANGLE_RATE"),
        (
            "EPS.Torque",
            (
                "the database has no message EPS. The messages are STEER, MOTION, WHEEL_SPEEDS, DRIVE_STATE, PEDALS, "
                "BRAKES and INERTIA"
            ),
        ),
    ],
)
def test_a_signal_that_is_not_there_gets_a_suggestion(place: str, message: str) -> None:
    database = load_database(["byd_tang"], Path())
    with pytest.raises(LookupError) as caught:
        database.find(*place.split("."))
    assert str(caught.value) == message


def test_empty_database_says_so() -> None:
    with pytest.raises(LookupError) as caught:
        Database().find("A", "B")
    assert str(caught.value) == "the database has no message A. It has no messages at all"


@pytest.mark.parametrize(
    ("end", "signs"),
    [
        ("", []),
        (' SG_ RATE : 16|8@1+ (1,0) [0|0] "" CAR', ["line 7: the last line has no line end"]),
        ("BO_ 288 X: 8 CAR\n", ["line 7: the last message has no signals"]),
        ("BO_ 288 X: 8 CAR", ["line 7: the last line has no line end", "line 7: the last message has no signals"]),
    ],
)
def test_a_dbc_that_was_cut_off_behind_a_statement_says_so(tmp_path: Path, end: str, signs: list[str]) -> None:
    name = write(tmp_path, "car.dbc", HEAD + STEER + end)
    assert [str(repair) for repair in load_database([name], tmp_path).repairs] == [
        f"{tmp_path / name}: {sign}, as where a file was cut off; "
        "what is there was taken; compare it with the file it was copied from"
        for sign in signs
    ]
