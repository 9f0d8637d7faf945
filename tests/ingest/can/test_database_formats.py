"""KCD, SYM and ARXML, each a small file written by hand from its format."""

from __future__ import annotations

from pathlib import Path

import pytest

from wheelprint.ingest.can.database import MessageLayout, SignalLayout, load_database, load_databases
from wheelprint.schemas.config import DatabaseFile

ANGLE = SignalLayout("ANGLE", 0, 16, signed=True, scale=0.1, offset=-5, unit="deg")
GEAR = SignalLayout("GEAR", 16, 4, choices=((0, "P"), (1, "R")))

KCD = """<?xml version="1.0" encoding="UTF-8"?>
<NetworkDefinition xmlns="http://kayak.2codeornot2code.org/1.0">
  <Document name="car"/>
  <Node id="1" name="CAR"/>
  <Bus name="chassis">
    <Message id="0x11F" length="8" name="STEER">
      <Notes>Steering wheel</Notes>
      <Signal name="ANGLE" offset="0" length="16">
        <Value type="signed" slope="0.1" intercept="-5" unit="deg"/>
      </Signal>
      <Signal name="GEAR" offset="16" length="4">
        <LabelSet><Label name="P" value="0"/><Label name="R" value="1"/></LabelSet>
      </Signal>
    </Message>
    <Message id="0x18FEF100" format="extended" length="8" name="SPEED">
      <Multiplex name="MODE" offset="0" length="8">
        <MuxGroup count="2">
          <Signal name="WHEEL" offset="8" length="16" endianess="big"><Value slope="0.5" unit="km/h"/></Signal>
        </MuxGroup>
      </Multiplex>
      <Signal name="TRUE_SPEED" offset="32" length="32"><Value type="single" unit="m/s"/></Signal>
    </Message>
  </Bus>
</NetworkDefinition>
"""

SYM = """FormatVersion=6.0 // Do not edit this line!
Title="car"

{ENUMS}
Enum=gears(0="P", 1="R")

{SIGNALS}
Sig=ANGLE signed 16 /u:deg /f:0.1 /o:-5
Sig=GEAR unsigned 4 /e:gears
Sig=WHEEL unsigned 16 -m /u:"km/h" /f:0.5
Sig=TRUE_SPEED float 32 /u:"m/s"

{SENDRECEIVE}

[STEER]
ID=11Fh // Steering wheel
Len=8
Sig=ANGLE 0
Sig=GEAR 16

[SPEED]
ID=18FEF100h
Type=Extended
Len=8
Mux=two 0,8 2
Sig=WHEEL 8
Sig=TRUE_SPEED 32
"""


def arxml() -> str:
    """Return a cluster with one frame of one PDU of two signals, as AUTOSAR 4 nests it."""

    def named(tag: str, name: str, *content: str) -> str:
        return f"<{tag}><SHORT-NAME>{name}</SHORT-NAME>{''.join(content)}</{tag}>"

    def package(name: str, *elements: str) -> str:
        return named("AR-PACKAGE", name, f"<ELEMENTS>{''.join(elements)}</ELEMENTS>")

    def reference(tag: str, kind: str, path: str) -> str:
        return f'<{tag} DEST="{kind}">{path}</{tag}>'

    def mapping(name: str, start: int) -> str:
        return named(
            "I-SIGNAL-TO-I-PDU-MAPPING",
            f"{name}_place",
            reference("I-SIGNAL-REF", "I-SIGNAL", f"/Signals/{name}"),
            "<PACKING-BYTE-ORDER>MOST-SIGNIFICANT-BYTE-LAST</PACKING-BYTE-ORDER>",
            f"<START-POSITION>{start}</START-POSITION>",
        )

    def signal(name: str, length: int, kind: str) -> str:
        return named(
            "I-SIGNAL",
            name,
            f"<LENGTH>{length}</LENGTH><NETWORK-REPRESENTATION-PROPS><SW-DATA-DEF-PROPS-VARIANTS>",
            "<SW-DATA-DEF-PROPS-CONDITIONAL>",
            reference("BASE-TYPE-REF", "SW-BASE-TYPE", f"/Types/{kind}"),
            "</SW-DATA-DEF-PROPS-CONDITIONAL></SW-DATA-DEF-PROPS-VARIANTS></NETWORK-REPRESENTATION-PROPS>",
            reference("SYSTEM-SIGNAL-REF", "SYSTEM-SIGNAL", f"/System/{name}"),
        )

    def system_signal(name: str, *references: str) -> str:
        return named(
            "SYSTEM-SIGNAL",
            name,
            "<PHYSICAL-PROPS><SW-DATA-DEF-PROPS-VARIANTS><SW-DATA-DEF-PROPS-CONDITIONAL>",
            *references,
            "</SW-DATA-DEF-PROPS-CONDITIONAL></SW-DATA-DEF-PROPS-VARIANTS></PHYSICAL-PROPS>",
        )

    def base_type(name: str, encoding: str) -> str:
        return named("SW-BASE-TYPE", name, f"<BASE-TYPE-ENCODING>{encoding}</BASE-TYPE-ENCODING>")

    linear = (
        "<COMPU-INTERNAL-TO-PHYS><COMPU-SCALES><COMPU-SCALE><COMPU-RATIONAL-COEFFS>"
        "<COMPU-NUMERATOR><V>-5</V><V>0.1</V></COMPU-NUMERATOR><COMPU-DENOMINATOR><V>1</V></COMPU-DENOMINATOR>"
        "</COMPU-RATIONAL-COEFFS></COMPU-SCALE></COMPU-SCALES></COMPU-INTERNAL-TO-PHYS>"
    )
    names = "".join(
        f"<COMPU-SCALE><LOWER-LIMIT>{k}</LOWER-LIMIT><UPPER-LIMIT>{k}</UPPER-LIMIT>"
        f"<COMPU-CONST><VT>{name}</VT></COMPU-CONST></COMPU-SCALE>"
        for k, name in enumerate("PR")
    )
    triggering = named(
        "CAN-FRAME-TRIGGERING",
        "STEER_sent",
        reference("FRAME-REF", "CAN-FRAME", "/Frames/STEER"),
        "<CAN-ADDRESSING-MODE>STANDARD</CAN-ADDRESSING-MODE><IDENTIFIER>287</IDENTIFIER>",
    )
    channel = named("CAN-PHYSICAL-CHANNEL", "CH", f"<FRAME-TRIGGERINGS>{triggering}</FRAME-TRIGGERINGS>")
    packages = (
        package(
            "Cluster",
            named(
                "CAN-CLUSTER",
                "chassis",
                "<CAN-CLUSTER-VARIANTS><CAN-CLUSTER-CONDITIONAL><BAUDRATE>500000</BAUDRATE>",
                f"<PHYSICAL-CHANNELS>{channel}</PHYSICAL-CHANNELS>",
                "</CAN-CLUSTER-CONDITIONAL></CAN-CLUSTER-VARIANTS>",
            ),
        ),
        package(
            "Frames",
            named(
                "CAN-FRAME",
                "STEER",
                "<FRAME-LENGTH>8</FRAME-LENGTH><PDU-TO-FRAME-MAPPINGS>",
                named(
                    "PDU-TO-FRAME-MAPPING",
                    "STEER_place",
                    "<PACKING-BYTE-ORDER>MOST-SIGNIFICANT-BYTE-LAST</PACKING-BYTE-ORDER>",
                    reference("PDU-REF", "I-SIGNAL-I-PDU", "/Pdus/STEER"),
                    "<START-POSITION>0</START-POSITION>",
                ),
                "</PDU-TO-FRAME-MAPPINGS>",
            ),
        ),
        package(
            "Pdus",
            named(
                "I-SIGNAL-I-PDU",
                "STEER",
                "<LENGTH>8</LENGTH><I-SIGNAL-TO-PDU-MAPPINGS>",
                mapping("ANGLE", 0),
                mapping("GEAR", 16),
                "</I-SIGNAL-TO-PDU-MAPPINGS>",
            ),
        ),
        package("Signals", signal("ANGLE", 16, "signed"), signal("GEAR", 4, "unsigned")),
        package(
            "System",
            system_signal(
                "ANGLE",
                reference("COMPU-METHOD-REF", "COMPU-METHOD", "/Methods/angle"),
                reference("UNIT-REF", "UNIT", "/Units/deg"),
            ),
            system_signal("GEAR", reference("COMPU-METHOD-REF", "COMPU-METHOD", "/Methods/gear")),
        ),
        package("Types", base_type("signed", "2C"), base_type("unsigned", "NONE")),
        package("Units", named("UNIT", "deg", "<DISPLAY-NAME>deg</DISPLAY-NAME>")),
        package(
            "Methods",
            named("COMPU-METHOD", "angle", "<CATEGORY>LINEAR</CATEGORY>", linear),
            named(
                "COMPU-METHOD",
                "gear",
                "<CATEGORY>TEXTTABLE</CATEGORY>",
                f"<COMPU-INTERNAL-TO-PHYS><COMPU-SCALES>{names}</COMPU-SCALES></COMPU-INTERNAL-TO-PHYS>",
            ),
        ),
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>'
        '<AUTOSAR xmlns="http://autosar.org/schema/r4.0" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
        'xsi:schemaLocation="http://autosar.org/schema/r4.0 AUTOSAR_00046.xsd">'
        f"<AR-PACKAGES>{''.join(packages)}</AR-PACKAGES></AUTOSAR>"
    )


@pytest.mark.parametrize(
    ("suffix", "content", "description"),
    [("kcd", KCD, "Steering wheel"), ("sym", SYM, "Steering wheel"), ("arxml", arxml(), "")],
)
def test_the_same_message_in_every_format(tmp_path: Path, suffix: str, content: str, description: str) -> None:
    (tmp_path / f"car.{suffix}").write_text(content, "utf-8")
    database, problems = load_databases([f"car.{suffix}"], tmp_path)
    assert problems == []
    assert database.repairs == ()
    assert database.by_name["STEER"] == MessageLayout(
        "STEER", 0x11F, False, 8, description, (ANGLE, GEAR), f"car.{suffix}"
    )


@pytest.mark.parametrize(
    ("suffix", "content", "selector", "speed"),
    [
        ("kcd", KCD, "MODE", SignalLayout("TRUE_SPEED", 32, 32, is_float=True, unit="m/s")),
        # A SYM file selects everything that it writes below a multiplexer.
        (
            "sym",
            SYM,
            "two",
            SignalLayout("TRUE_SPEED", 32, 32, is_float=True, unit="m/s", multiplexer="two", multiplexer_values=(2,)),
        ),
    ],
)
def test_multiplexed_big_endian_and_float_signals(
    tmp_path: Path, suffix: str, content: str, selector: str, speed: SignalLayout
) -> None:
    (tmp_path / f"car.{suffix}").write_text(content, "utf-8")
    message = load_database([f"car.{suffix}"], tmp_path).by_name["SPEED"]
    assert (message.id, message.extended, message.length, message.j1939) == (0x18FEF100, True, 8, False)
    assert {signal.name: signal for signal in message.signals} == {
        selector: SignalLayout(selector, 0, 8),
        "WHEEL": SignalLayout(
            "WHEEL", 15, 16, True, scale=0.5, unit="km/h", multiplexer=selector, multiplexer_values=(2,)
        ),
        "TRUE_SPEED": speed,
    }


@pytest.mark.parametrize(("suffix", "content"), [("kcd", KCD), ("sym", SYM)])
def test_the_project_may_call_it_j1939_and_name_its_bus(tmp_path: Path, suffix: str, content: str) -> None:
    (tmp_path / f"car.{suffix}").write_text(content, "utf-8")
    database = load_database([DatabaseFile(file=f"car.{suffix}", channel="can1", j1939=True)], tmp_path)
    assert {m.name: (m.j1939, m.channel) for m in database.messages} == {
        "STEER": (False, "can1"),
        "SPEED": (True, "can1"),
    }


@pytest.mark.parametrize(("suffix", "content"), [("kcd", KCD), ("sym", SYM), ("arxml", arxml())])
def test_a_cut_file_ends_as_a_database_or_a_problem(tmp_path: Path, suffix: str, content: str) -> None:
    for cut in range(0, len(content), 97):
        (tmp_path / f"car.{suffix}").write_text(content[:cut], "utf-8")
        database, problems = load_databases([f"car.{suffix}"], tmp_path)
        assert problems or database.messages
        if suffix != "sym":
            assert problems


@pytest.mark.parametrize(
    ("kind", "written", "monster", "what"),
    [
        ("kcd", 'length="8" name="STEER"', 'length="100000000" name="STEER"', "bytes in a message or bits in a signal"),
        ("kcd", 'name="GEAR" offset="16"', 'name="GEAR" offset="100000000"', "as start bit of a signal"),
        ("sym", "Len=8", "Len=100000000", "bytes in a message"),
        ("sym", "signed 16 /u:deg", "signed 100000000 /u:deg", "bits in a signal"),
        ("sym", "Sig=GEAR 16", "Sig=GEAR 100000000", "as start bit of a signal"),
        ("sym", "Mux=two 0,8", "Mux=two 0,100000000", "bits in a signal"),
        ("arxml", "<LENGTH>16<", "<LENGTH>100000000<", "bytes in a message or bits in a signal"),
        ("arxml", "<START-POSITION>16<", "<START-POSITION>100000000<", "as start bit of a signal"),
    ],
)
def test_monsters_are_refused_before_they_take_the_memory(
    tmp_path: Path, kind: str, written: str, monster: str, what: str
) -> None:
    text = {"kcd": KCD, "sym": SYM, "arxml": arxml()}[kind]
    assert written in text
    (tmp_path / f"car.{kind}").write_text(text.replace(written, monster, 1))
    _, problems = load_databases([f"car.{kind}"], tmp_path)
    (problem,) = problems
    assert problem.where.startswith("line ")
    limit = {"arxml": 1 << 20}.get(kind, 4096 if what == "bytes in a message" else 32768)
    reason = f"100000000 {what}, where at most {limit} make sense; the file is damaged or not meant for CAN"
    assert problem.reason == reason


@pytest.mark.parametrize(
    ("end", "line", "sign"),
    [
        ("Sig=GEAR 16", 19, "the last line has no line end"),
        ("[SPEED]\n", 21, "the last message has no signals"),
        ("[SPEED]\nID=18FEF100h\nType=Extended\nLen=8\n", 24, "the last message has no signals"),
    ],
)
def test_a_sym_file_that_was_cut_off_says_so(tmp_path: Path, end: str, line: int, sign: str) -> None:
    (tmp_path / "car.sym").write_text(SYM[: SYM.index(end) + len(end)])
    assert [str(repair) for repair in load_database(["car.sym"], tmp_path).repairs] == [
        (
            f"{tmp_path / 'car.sym'}: line {line}: {sign}, as where a file was cut off; "
            "what is there was taken; compare it with the file it was copied from"
        )
    ]


def test_a_message_with_a_nameless_signal_is_left_out(tmp_path: Path) -> None:
    assert ' name="GEAR"' in KCD
    (tmp_path / "whole.kcd").write_text(KCD, "utf-8")
    (tmp_path / "nameless.kcd").write_text(KCD.replace(' name="GEAR"', "", 1), "utf-8")
    whole, _ = load_databases(["whole.kcd"], tmp_path)
    database, problems = load_databases(["nameless.kcd"], tmp_path)
    assert [problem.reason for problem in problems] == ["a signal has no name. It is left out"]
    assert len(database.messages) == len(whole.messages) - 1
