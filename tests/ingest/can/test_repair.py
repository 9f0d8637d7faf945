from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import cantools
import numpy as np
import pytest

from wheelprint.ingest.can.database import SignalLayout, load_databases
from wheelprint.ingest.can.repair import Repair, decode_text, repair_dbc
from wheelprint.schemas.errors import InputError

HEAD = 'VERSION ""\nNS_ :\n CM_\n VAL_\nBS_:\nBU_: CAR\n'  # six lines
STEER = 'BO_ 287 STEER: 5 CAR\n SG_ ANGLE : 0|16@1- (0.1,0) [0|0] "deg" CAR\n'
TAIL = 'CM_ SG_ 287 ANGLE "Angle, // not a comment; # nor this";\nVAL_ 287 ANGLE 0 "straight" 1 "left" ;\n'
PATH = Path("car.dbc")
ANGLE = SignalLayout("ANGLE", 0, 16, signed=True, scale=0.1, unit="deg")


def repairs_of(text: str) -> list[str]:
    repaired, repairs = repair_dbc(PATH, text)
    assert repaired.count("\n") == text.count("\n")
    cantools.database.load_string(repaired, "dbc", strict=False)
    return [str(repair).removeprefix("car.dbc: ") for repair in repairs]


def refusal_of(text: str) -> str:
    with pytest.raises(InputError) as caught:
        repair_dbc(PATH, text)
    return str(caught.value)


@pytest.mark.parametrize("text", ["", HEAD, HEAD + STEER, HEAD + STEER + TAIL, STEER, HEAD + STEER.rstrip()])
def test_what_is_right_stays_as_it_is(text: str) -> None:
    assert repair_dbc(PATH, text) == (text, [])


@pytest.mark.parametrize(
    ("text", "refused", "repairs"),
    [
        (STEER + "// the end", True, ["line 9: a comment: // the end; skipped"]),
        (
            "# made\n" + STEER + "/* by\nhand */\n",
            True,
            ["line 7: a comment: # made; skipped", "line 10: a comment: /* by hand */; skipped"],
        ),
        (
            STEER.replace("(0.1,0) [0|0]", "(.1,-.5e1) [-1.|1.]"),
            True,
            [
                "line 8: the number .1; read as 0.1",
                "line 8: the number -.5e1; read as -0.5e1",
                "line 8: the number -1.; read as -1.0",
                "line 8: the number 1.; read as 1.0",
            ],
        ),
        (
            STEER.replace("287", "419360512") + TAIL.replace("287", "419360512"),
            False,
            [
                (
                    "line 7: message STEER with the identifier 419360512 (0x18FEEF00) of more than 11 bits without the "
                    "extended flag; taken as extended, 2566844160"
                )
            ],
        ),
        (
            STEER + 'VAL_ 287 SPEED 0 "a";\nVAL_ 5 ANGLE 0 "a" ;\nSIG_VALTYPE_ 287 SPEED : 1;\n',
            True,
            [
                "line 9: a statement VAL_ about signal SPEED, which the file does not define; left out",
                "line 10: a statement VAL_ about a message 5, which the file does not define; left out",
                "line 11: a statement SIG_VALTYPE_ about signal SPEED, which the file does not define; left out",
            ],
        ),
        (
            'VAL_TABLE_ onoff 1 "on" 0 "off" ;\n' + STEER + "VAL_ 287 ANGLE onoff ;\nVAL_ 287 ANGLE other ;\n",
            True,
            [
                "line 10: values given as the table onoff; its values put there",
                "line 11: values given as the table other, which the file does not define; left out",
            ],
        ),
        (
            STEER + 'VAL_ 287 ANGLE 1. "a" 2.5 "b" 3 "c" ;\n',
            True,
            [
                "line 9: the value 1., which is not written as an integer; read as 1",
                "line 9: the value 2.5, which no raw value is; left out",
            ],
        ),
        (
            STEER + 'CM_ SG_ 287 ANGLE "a"\nCM_ BO_ 287 "b";\n',
            True,
            ["line 9: no semicolon after a statement CM_; added"],
        ),
        (STEER.replace(" CAR\n SG_", "\n SG_"), True, ["line 7: message STEER without a sender; Vector__XXX added"]),
        (
            STEER.replace('"deg" CAR', '"deg"') + TAIL,
            True,
            ["line 8: signal ANGLE without a receiver; Vector__XXX added"],
        ),
        (
            STEER.replace('"deg" CAR', '"deg" CAR LOGGER'),
            True,
            ["line 8: receivers of signal ANGLE without commas between them; put there"],
        ),
        (STEER.replace('"deg" CAR', '"deg" CAR;'), True, ["line 8: a semicolon after a statement SG_; left out"]),
        (STEER + STEER, False, ["line 9: message STEER once more, the same; left out"]),
        (STEER + "SIG_VALTYPE_ 287 ANGLE 0;\n", True, ["line 9: a statement SIG_VALTYPE_ without a colon; added"]),
        (
            STEER + 'BA_DEF_SGTYPE_ "x" INT 0 1;\n',
            True,
            ["line 9: a statement BA_DEF_SGTYPE_, which does not matter for decoding; left out"],
        ),
        (
            STEER + 'BO_ 4294967295 X: 8 CAR\n SG_ A : 0|8@1+ (1,0) [0|0] "" CAR\n',
            True,
            ["line 9: message X with the identifier 4294967295, which has more than 29 bits; left out"],
        ),
        (STEER + "\x1a", True, ["line 9: the control character 0x1A; skipped"]),
    ],
)
def test_repairs(text: str, refused: bool, repairs: list[str]) -> None:
    if refused:
        with pytest.raises(cantools.database.UnsupportedDatabaseFormatError):
            cantools.database.load_string(HEAD + text, "dbc", strict=False)
    assert repairs_of(HEAD + text) == repairs


def test_bit_timing_is_left_out() -> None:
    assert repairs_of((HEAD + STEER).replace("BS_:", "BS_: 500 : 1,2")) == ["line 5: a bit timing; left out"]


def test_values_of_a_signal_in_no_message_are_left_out() -> None:
    loose = STEER.replace("287 STEER", "3221225472 VECTOR__INDEPENDENT_SIG_MSG")
    text = HEAD + STEER + loose + TAIL.replace("287", "3221225472")
    assert repairs_of(text) == [
        "line 12: a statement VAL_ about a message 3221225472, which the file does not define; left out"
    ]


def test_a_repaired_database_decodes_like_a_right_one(tmp_path: Path) -> None:
    right = HEAD + STEER.replace("287", "2566844160") + TAIL.replace("287", "2566844160")
    wrong = (
        right.replace("2566844160", "419360512")
        .replace("(0.1,0)", "(.1,0.)")
        .replace('"deg" CAR', '"deg" CAR // by hand')
        .replace("BS_:", "# none\nBS_:")
        .replace("\n", "\r")
        .replace("deg", "°")
    )
    (tmp_path / "right.dbc").write_text(right.replace("deg", "°"), "utf-8")
    (tmp_path / "wrong.dbc").write_bytes(wrong.encode("cp1252"))
    (wanted,), (got,) = (load_databases([name], tmp_path)[0].messages for name in ("right.dbc", "wrong.dbc"))
    assert got.signals == wanted.signals
    assert (got.id, got.extended, got.name) == (wanted.id, True, "STEER")
    assert got.signals[0].choices == ((0, "straight"), (1, "left"))
    assert got.signals[0].description == "Angle, // not a comment; # nor this"
    database, problems = load_databases(["wrong.dbc"], tmp_path)
    assert problems == []
    path = str(tmp_path / "wrong.dbc")
    assert database.repairs == (
        Repair(path, "line 1", "byte 0xB0, which is not UTF-8", "the file is read as Windows-1252"),
        Repair(path, "line 1", "11 carriage returns without line feed, here the first", "each ends a line"),
        Repair(path, "line 5", "a comment: # none", "skipped"),
        Repair(
            path,
            "line 8",
            "message STEER with the identifier 419360512 (0x18FEEF00) of more than 11 bits without the extended flag",
            "taken as extended, 2566844160",
        ),
        Repair(path, "line 9", "a comment: // by hand", "skipped"),
        Repair(path, "line 9", "the number .1", "read as 0.1"),
        Repair(path, "line 9", "the number 0.", "read as 0.0"),
    )


@pytest.mark.parametrize(
    ("content", "text", "repairs"),
    [
        (b"a\r\nb", "a\nb", []),
        ("a²".encode(), "a²", []),
        (b"\xef\xbb\xbfa", "a", ["f: line 1: a byte order mark; skipped"]),
        ("a²".encode("utf-16"), "a²", ["f: UTF-16 text; read as such"]),
        (b"a\n\xb2", "a\n²", ["f: line 2: byte 0xB2, which is not UTF-8; the file is read as Windows-1252"]),
        (b"\x81\xb2", "\x81²", ["f: line 1: byte 0x81, which is not UTF-8; the file is read as Latin-1"]),
        (b"a\nb\rc", "a\nb\nc", ["f: line 2: 1 carriage returns without line feed, here the first; each ends a line"]),
    ],
)
def test_decodes_text(content: bytes, text: str, repairs: list[str]) -> None:
    got, found = decode_text(Path("f"), content)
    assert (got, [str(repair) for repair in found]) == (text, repairs)


def test_overlaps_and_signals_outside_are_kept_and_reported(tmp_path: Path) -> None:
    text = (
        "BO_ 5 X: 4 CAR\n"
        ' SG_ M M : 0|8@1+ (1,0) [0|0] "" CAR\n SG_ A m0 : 8|8@1+ (1,0) [0|0] "" CAR\n'
        ' SG_ B m1 : 8|8@1+ (1,0) [0|0] "" CAR\n SG_ C : 13|4@0+ (1,0) [0|0] "" CAR\n'
        ' SG_ D : 28|8@1+ (1,0) [0|0] "" CAR\n'
    )
    (tmp_path / "a.dbc").write_text(HEAD + text)
    database, problems = load_databases(["a.dbc"], tmp_path)
    assert problems == []
    assert [signal.name for signal in database.messages[0].signals] == ["M", "A", "B", "C", "D"]
    assert [str(repair).removeprefix(f"{tmp_path}/") for repair in database.repairs] == [
        (
            "a.dbc: line 7: signal D of message X (0x005) ends in byte 5 of 4; "
            "kept; it is null in frames that are too short for it"
        ),
        "a.dbc: line 7: signals A and C of message X (0x005) overlap; both are kept",
        "a.dbc: line 7: signals B and C of message X (0x005) overlap; both are kept",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            HEAD + STEER + 'CM_ SG_ 287 ANGLE "Angle of the\nsteering',
            (
                'car.dbc: line 9: the text that begins here has no closing quotation mark: "Angle of the steering '
                "The file is cut off there, or the mark is missing; copy or export it again"
            ),
        ),
        (
            HEAD + STEER[:-20],
            (
                "car.dbc: line 8: the file ends within the statement that begins here: SG_ ANGLE : 0|16@1- (0.1 "
                "It is cut off; copy or export it again"
            ),
        ),
        (
            HEAD + STEER[:-2],
            (
                "car.dbc: line 8: the file ends within the statement that begins here: "
                'SG_ ANGLE : 0|16@1- (0.1,0) [0|0] "deg" … It is cut off; copy or export it again'
            ),
        ),
        (
            HEAD + STEER + "\nBO_ 288 SP",
            (
                "car.dbc: line 10: the file ends within the statement that begins here: BO_ 288 SP "
                "It is cut off; copy or export it again"
            ),
        ),
        (
            HEAD + STEER + TAIL + "VA",
            (
                "car.dbc: line 11: the file ends within the statement that begins here: VA "
                "It is cut off; copy or export it again"
            ),
        ),
    ],
)
def test_a_cut_file_is_refused(text: str, message: str) -> None:
    assert refusal_of(text) == message


def test_cut_anywhere_it_is_refused_or_ends_with_a_statement() -> None:
    text = HEAD + STEER + STEER.replace("287 STEER", "288 SPEED") + TAIL.replace("comment;", "comment")
    ends = {
        text.index(end, place) + len(end)
        for place in range(len(text))
        for end in ("CAR", ";", ":")
        if end in text[place:]
    }
    for cut in range(len(HEAD) + 3, len(text) + 1):
        whole = text[:cut].rstrip()
        is_whole = len(whole) in ends and whole.endswith(("CAR", ";"))
        with nullcontext() if is_whole else pytest.raises(InputError, match=r"car.dbc: line \d+: .* cut off"):
            assert repair_dbc(PATH, text[:cut]) == (text[:cut], [])


def test_mutations_end_as_a_database_or_an_input_error(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    source = (HEAD + STEER + STEER.replace("287 STEER", "419360512 SPEED") + TAIL).encode()
    pieces = [
        b'"',
        b";",
        b"//",
        b"#",
        b".",
        b"VAL_ ",
        b"BO_ ",
        b"SG_ ",
        b"9" * 30,
        b"\r",
        b"\0",
        b"\xff",
        b"\n",
        b"m0 ",
        b"1.",
    ]
    loaded = 0
    for _ in range(200):
        content = bytearray(source)
        for _ in range(rng.integers(1, 4)):
            place = int(rng.integers(len(content)))
            content[place : place + int(rng.integers(5))] = pieces[rng.integers(len(pieces))]
        (tmp_path / "a.dbc").write_bytes(content)
        database, problems = load_databases(["a.dbc"], tmp_path)
        assert database.messages or problems
        loaded += bool(database.messages)
    assert 20 < loaded < 200
