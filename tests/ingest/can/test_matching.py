from __future__ import annotations

from pathlib import Path

import cantools.j1939
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.ingest.can.database import Database, MessageLayout, SignalLayout, load_database, load_databases
from wheelprint.ingest.can.decode import decode, message_schema, split_by_message
from wheelprint.ingest.can.frames import FrameBatch
from wheelprint.ingest.can.matching import find_messages, is_addressed, parameter_group
from wheelprint.ingest.mapping import resolve
from wheelprint.ingest.stored_signals import find_mapped
from wheelprint.schemas.config import Can, DatabaseFile
from wheelprint.schemas.errors import InputError

HEAD = 'VERSION ""\nBS_:\nBU_: CAR\n'
FORMATS = (
    'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";\n'
    'BA_DEF_DEF_ "VFrameFormat" "ExtendedCAN";\n'
)
PROTOCOL = 'BA_DEF_ "ProtocolType" STRING ;\nBA_DEF_DEF_ "ProtocolType" "";\nBA_ "ProtocolType" "J1939";\n'


def message(number: int, name: str = "M") -> str:
    return f'BO_ {number} {name}: 8 CAR\n SG_ S : 0|8@1+ (1,0) [0|0] "" CAR\n'


def layout(number: int, *, j1939: bool = True, extended: bool = True, channel: str | None = None) -> MessageLayout:
    return MessageLayout(f"m{number:X}", number, extended, 8, "", (), channel=channel, j1939=j1939)


def found(messages: tuple[MessageLayout, ...], *identifiers: int, channel: str = "can0") -> list[str | None]:
    indexes = find_messages(
        messages, np.array(identifiers, np.uint32), np.ones(len(identifiers), bool), channel
    ).tolist()
    return [messages[k].name if k < len(messages) else None for k in indexes]


def batch(*frames: tuple[int, int], extended: bool = True, channels: tuple[str, ...] = ("can0",)) -> FrameBatch:
    """Return frames (identifier, channel) whose first byte is their number."""
    n = len(frames)
    data = np.zeros((n, 8), np.uint8)
    data[:, 0] = np.arange(n)
    return FrameBatch(
        time=np.arange(n, dtype=np.int64),
        channel=np.array([channel for _, channel in frames], np.int16),
        channels=channels,
        id=np.array([identifier for identifier, _ in frames], np.uint32),
        extended=np.full(n, extended),
        fd=np.zeros(n, bool),
        kind=np.zeros(n, np.uint8),
        length=np.full(n, 8, np.uint8),
        data=data,
    )


@given(st.integers(0, 2**29 - 1))
def test_parameter_group_equals_cantools(identifier: int) -> None:
    assert parameter_group(identifier) == cantools.j1939.pgn_from_frame_id(identifier)
    pdu_format = cantools.j1939.frame_id_unpack(identifier).pdu_format
    assert is_addressed(identifier) == cantools.j1939.is_pdu_format_1(pdu_format)


@given(
    st.lists(st.integers(0, 2**29 - 1), min_size=1, max_size=8),
    st.integers(0, 7),
    st.integers(0, 255),
    st.integers(0, 255),
)
def test_finds_whatever_priority_and_addresses(numbers: list[int], priority: int, source: int, receiver: int) -> None:
    by_group = {parameter_group(number): number for number in numbers}
    messages = tuple(layout(number) for number in by_group.values())
    for number in by_group.values():
        parts = cantools.j1939.frame_id_unpack(number)
        specific = receiver if cantools.j1939.is_pdu_format_1(parts.pdu_format) else parts.pdu_specific
        frame = cantools.j1939.frame_id_pack(
            priority, parts.reserved, parts.data_page, parts.pdu_format, specific, source
        )
        assert found(messages, frame) == [f"m{number:X}"]


def test_what_belongs_to_no_message_is_not_found() -> None:
    messages = (layout(0x0CF00400), layout(0x0CF00500, j1939=False))
    assert found(messages, 0x18F00403, 0x0CF00500, 0x18F00503, 0x0DF00400, 0x0EF00400, 0x0CF00300) == [
        "mCF00400", "mCF00500", None, None, None, None,
    ]  # fmt: skip
    standard = find_messages(messages, np.array([0x400], np.uint32), np.zeros(1, bool), "")
    assert standard.tolist() == [2]
    assert found((), 5) == [None]


def test_several_messages_of_one_group_stand_for_their_own_address() -> None:
    engine, brakes = layout(0x0CF00400), layout(0x0CF0040B)
    assert found((engine, brakes), 0x18F00400, 0x0CF0040B, 0x0CF00421) == ["mCF00400", "mCF0040B", None]
    anyone = layout(0x0CF004FE)
    assert found((engine, anyone), 0x18F00400, 0x0CF0040B, 0x0CF004FE) == ["mCF00400", "mCF004FE", "mCF004FE"]
    to_one, to_other = layout(0x18EF0102), layout(0x18EF0302)
    assert found((to_one, to_other), 0x0CEF0102, 0x18EF0302, 0x18EF0402) == ["m18EF0102", "m18EF0302", None]


def test_a_whole_identifier_goes_before_a_group() -> None:
    messages = (layout(0x0CF00400), layout(0x0CF00403, j1939=False))
    assert found(messages, 0x0CF00403, 0x18F00403) == ["mCF00403", "mCF00400"]


@pytest.mark.parametrize(
    ("text", "said", "expected"),
    [
        ("", None, [False, False]),
        ("", True, [False, True]),
        (PROTOCOL, None, [False, True]),
        (PROTOCOL, False, [False, False]),
        (PROTOCOL.replace('"J1939"', '"OBD"'), None, [False, False]),
        (FORMATS, None, [False, False]),
        (FORMATS + 'BA_ "VFrameFormat" BO_ 2364540158 3;\n', None, [False, True]),
        (FORMATS + PROTOCOL + 'BA_ "VFrameFormat" BO_ 2364540158 1;\n', None, [False, False]),
        (FORMATS.replace('_ "VFrameFormat" "ExtendedCAN"', '_ "VFrameFormat" "J1939PG"'), None, [False, True]),
        (
            'BA_DEF_ "ProtocolType" ENUM "CAN","J1939";\nBA_DEF_DEF_ "ProtocolType" "CAN";\nBA_ "ProtocolType" 1;\n',
            None,
            [False, True],
        ),
    ],
)
def test_dbc_or_project_says_what_is_j1939(tmp_path: Path, text: str, said: bool | None, expected: list[bool]) -> None:
    (tmp_path / "a.dbc").write_text(HEAD + message(5, "A") + message(2364540158, "B") + text)
    database = load_database([DatabaseFile(file="a.dbc", j1939=said)], tmp_path)
    assert [m.j1939 for m in database.messages] == expected


def test_sources_stay_apart_in_the_table(tmp_path: Path) -> None:
    (tmp_path / "a.dbc").write_text(
        HEAD + message(0x8CF004FE, "EEC1") + message(0x98EF00FE, "ASK").replace(" S ", " source ") + PROTOCOL
    )
    frames = batch((0x0CF00400, 0), (0x18F00421, 0), (0x0CF00500, 0), (0x18EF2103, 0), (0x1CEF2203, 0))
    tables = decode(frames, load_database(["a.dbc"], tmp_path))
    assert tables["EEC1"].drop_columns(["time", "channel"]).to_pydict() == {"source": [0, 0x21], "S": [0, 1]}
    assert tables["ASK"].drop_columns(["time", "channel"]).to_pydict() == {
        "source": [3, 3],
        "destination": [0x21, 0x22],
        "source_": [3, 4],
    }
    schema = tables["EEC1"].schema
    assert schema.field("source").type == pa.uint8()
    assert schema.metadata[b"pgn"] == b"0xF004"
    plain = MessageLayout("M", 0x0CF00400, True, 8, "", (SignalLayout("S", 0, 8),))
    assert message_schema(plain).names == ["time", "channel", "S"]


def test_a_message_of_one_bus_is_not_found_on_others(tmp_path: Path) -> None:
    for name, number in (("one", 5), ("two", 5), ("all", 6)):
        (tmp_path / f"{name}.dbc").write_text(HEAD + message(number, name.upper()))
    files: list[str | DatabaseFile] = [
        DatabaseFile(file="one.dbc", channel="can1"),
        DatabaseFile(file="two.dbc", channel="can2"),
        "all.dbc",
    ]
    database, problems = load_databases(files, tmp_path)
    assert problems == []
    assert [(m.name, m.channel, m.source) for m in database.messages] == [
        ("ONE", "can1", "one.dbc on can1"),
        ("TWO", "can2", "two.dbc on can2"),
        ("ALL", None, "all.dbc"),
    ]
    frames = batch((5, 0), (5, 1), (5, 2), (6, 0), (6, 1), (5, 1), extended=False, channels=("can0", "can1", "can2"))
    tables = decode(frames, database)
    assert {name: table["S"].to_pylist() for name, table in tables.items()} == {
        "ONE": [1, 5],
        "TWO": [2],
        "ALL": [3, 4],
    }
    assert split_by_message(frames, database)[1] == {(5, False): 1}


def test_same_name_on_two_buses_is_kept_apart(tmp_path: Path) -> None:
    (tmp_path / "a.dbc").write_text(HEAD + message(5, "WHEELS") + message(6, "SPEED"))
    (tmp_path / "b.dbc").write_text(HEAD + message(7, "WHEELS"))
    files: list[str | DatabaseFile] = [
        DatabaseFile(file="a.dbc", channel="can0"),
        DatabaseFile(file="b.dbc", channel="can1"),
    ]
    database, problems = load_databases(files, tmp_path)
    assert problems == []
    assert [m.name for m in database.messages] == ["WHEELS@can0", "SPEED", "WHEELS@can1"]
    assert database.find("WHEELS", "S", "can1")[0].id == 7
    assert database.find("WHEELS@can0", "S")[0].id == 5
    assert database.find("SPEED", "S", "can0")[0].id == 6
    for channel, place, text in (
        (None, "WHEELS", 'message WHEELS is in the databases of channels can0 and can1; say which: channel = "can0"'),
        ("can2", "WHEELS", "message WHEELS is in the databases of channels can0 and can1, not of can2"),
        ("can1", "SPEED", "message SPEED (0x006) is in the database of channel can0, not of can1"),
    ):
        with pytest.raises(LookupError) as caught:
            database.find(place, "S", channel)
        assert str(caught.value) == text


def test_collisions_on_one_bus_are_said(tmp_path: Path) -> None:
    (tmp_path / "a.dbc").write_text(HEAD + message(5, "A"))
    (tmp_path / "b.dbc").write_text(HEAD + message(5, "B") + PROTOCOL + message(0x8CF004FE, "C"))
    (tmp_path / "c.dbc").write_text(HEAD + PROTOCOL + message(0x98F004FE, "D") + message(0x98F00400, "E"))
    files: list[str | DatabaseFile] = [
        "a.dbc",
        DatabaseFile(file="b.dbc", channel="can1"),
        DatabaseFile(file="c.dbc", channel="can1"),
    ]
    database, problems = load_databases(files, tmp_path)
    assert [m.name for m in database.messages] == ["A", "C", "E"]
    tail = "Which one a frame is cannot be known; remove one of each pair"
    assert [str(problem).removeprefix(f"{tmp_path}/") for problem in problems] == [
        f"b.dbc: same message name or identifier in this database and in a.dbc: B (0x005) against A (0x005). {tail}",
        (
            "c.dbc: same message name or identifier in this database and in b.dbc on can1: "
            f"D (0x18F004FE) against C (0x0CF004FE). {tail}"
        ),
    ]
    with pytest.raises(InputError):
        load_database(files, tmp_path)


@given(
    st.lists(
        st.tuples(st.integers(0, 9), st.booleans(), st.sampled_from([None, "can0", "can1"])), unique=True, max_size=9
    ),
    st.lists(st.tuples(st.integers(0, 9), st.integers(0, 1)), max_size=40),
    st.booleans(),
)
def test_matches_like_a_plain_loop(
    stated: list[tuple[int, bool, str | None]], frames: list[tuple[int, int]], extended: bool
) -> None:
    channels = ("can0", "can1")
    messages: list[MessageLayout] = []
    for number, is_extended, channel in stated:
        if not any((m.id, m.extended) == (number, is_extended) and (not channel or m.channel in (None, channel))
                   for m in messages):  # fmt: skip
            messages.append(
                MessageLayout(f"{number}{is_extended}{channel}", number, is_extended, 8, "", (), channel=channel)
            )
    groups, unknown = split_by_message(batch(*frames, extended=extended, channels=channels), Database(tuple(messages)))
    wanted: dict[str, list[int]] = {}
    lost = 0
    for row, (number, channel_index) in enumerate(frames):
        name = next(
            (
                m.name
                for m in messages
                if (m.id, m.extended) == (number, extended) and m.channel in (None, channels[channel_index])
            ),
            None,
        )
        if name is None:
            lost += 1
        else:
            wanted.setdefault(name, []).append(row)
    assert {m.name: part.time.tolist() for m, part in groups} == wanted
    assert sum(unknown.values()) == lost


@pytest.mark.parametrize(("wanted", "expected", "source"), [(None, [1, 3], 5), (0, [0], 0), (7, None, None)])
def test_a_mapped_signal_comes_from_one_sender(
    tmp_path: Path, wanted: int | None, expected: list[int] | None, source: int | None
) -> None:
    (tmp_path / "a.dbc").write_text(HEAD + message(0x8CF004FE, "EEC1").replace('""', '"m/s"') + PROTOCOL)
    database = load_database(["a.dbc"], tmp_path)
    tables = decode(batch((0x0CF00400, 0), (0x0CF00405, 0), (0x0CF00405, 1), (0x0CF00405, 0),
                          channels=("can0", "can1")), database)  # fmt: skip
    pq.write_table(tables["EEC1"], tmp_path / "a.parquet")
    can = Can.model_validate({"signals": {"speed": {"signal": "EEC1.S", "source": wanted}}})
    mapping, problems = resolve(can, database, tmp_path / "wheelprint.toml")
    assert problems == []
    signal = find_mapped([tmp_path / "a.parquet"], mapping["speed"])
    assert (None if signal is None else signal.read().values.tolist()) == expected
    assert (None if signal is None else signal.source) == source


def test_the_project_file_names_databases_and_their_buses() -> None:
    can = Can.model_validate({"database": ["a.dbc", {"file": "b.dbc", "channel": "can1", "j1939": True}]})
    assert can.database == [DatabaseFile(file="a.dbc"), DatabaseFile(file="b.dbc", channel="can1", j1939=True)]
