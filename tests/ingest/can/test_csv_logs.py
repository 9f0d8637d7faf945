from __future__ import annotations

import gzip
import random
from decimal import Decimal
from pathlib import Path
from typing import Any

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.ingest.can.plain_frames import Frame, frames_of
from wheelprint.ingest.account import Account
from wheelprint.ingest.can import gvret_csv, python_can_csv, text_log
from wheelprint.ingest.can.gvret_csv import GvretCsv
from wheelprint.ingest.can.python_can_csv import PythonCanCsv
from wheelprint.schemas.errors import InputError

CsvReader = type[GvretCsv] | type[PythonCanCsv]


def read(reader: CsvReader, folder: Path, content: bytes | str) -> tuple[list[Frame], Account]:
    path = folder / "can.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    account = Account()
    frames = [frame for batch in reader(path).batches(account) for frame in frames_of(batch)]
    assert account.accepted == len(frames)
    return frames, account


PYTHON_CAN = """\
timestamp,arbitration_id,extended,remote,error,dlc,data
1436509052.249713,0x44,0,0,0,5,KjZsK7o=
1436509052.2497132,0x1fffffff,1,0,0,8,AQIDBAUGBwg=
5e-07,0x7ff,0,0,0,0,
1.0,0x123,0,1,0,8,
-2.5,0x123,1,1,0,0,
1.25,0x80,0,0,1,1,/w==
0.30000000000000004,0x123,0,0,0,12,AAECAwQFBgcICQr+
"""
PYTHON_CAN_FRAMES: list[Frame] = [
    (1_436_509_052_249_713_000, "", 0x44, False, False, "data", "2A366C2BBA"),
    (1_436_509_052_249_713_200, "", 0x1FFFFFFF, True, False, "data", "0102030405060708"),
    (500, "", 0x7FF, False, False, "data", ""),
    (1_000_000_000, "", 0x123, False, False, "remote", ""),
    (-2_500_000_000, "", 0x123, True, False, "remote", ""),
    (1_250_000_000, "", 0x80, False, False, "error", "FF"),
    (300_000_000, "", 0x123, False, True, "data", "000102030405060708090AFE"),
]

SAVVYCAN = """\
Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8
166064000,0000021A,false,Rx,0,8,FE,36,12,FE,69,05,07,AD,
166064100,18DAF110,true,Tx,1,3,02,01,0C
166064200,0000021A,false,Rx,0,0,
166064300,0000021A,false,Rx,12,2,FF,00,,,,,,,
"""
SAVVYCAN_FRAMES: list[Frame] = [
    (166_064_000_000, "0", 0x21A, False, False, "data", "FE3612FE690507AD"),
    (166_064_100_000, "1", 0x18DAF110, True, False, "data", "02010C"),
    (166_064_200_000, "0", 0x21A, False, False, "data", ""),
    (166_064_300_000, "12", 0x21A, False, False, "data", "FF00"),
]

OLD_GVRET = """\
Time Stamp,ID,Extended,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8
-1500,0x21A,0,0,8,0,1,2,A,b,C,d,EF
-1000,21a,False,0,3,0,1,2,,,,,
-500,7ff,1,1,2,0,1,0,0,0,0,0,0
"""
OLD_GVRET_FRAMES: list[Frame] = [
    (-1_500_000, "0", 0x21A, False, False, "data", "0001020A0B0C0DEF"),
    (-1_000_000, "0", 0x21A, False, False, "data", "000102"),
    (-500_000, "1", 0x7FF, True, False, "data", "0001"),
]

GVRET_FD = (
    "\ufefftime stamp, ID ,Extended,Dir,Bus,LEN," + ",".join(f"D{k}" for k in range(1, 65)) + "\n"
    "1690000000000001,123,FALSE,,0,64," + ",".join(["5A"] * 64) + "\n"
    "1690000000000002,123,TRUE,rx,0,12,00,01,02,03,04,05,06,07,08,09,0A,0B" + "," * 52 + "\n"
)
GVRET_FD_FRAMES: list[Frame] = [
    (1_690_000_000_000_001_000, "0", 0x123, False, True, "data", "5A" * 64),
    (1_690_000_000_000_002_000, "0", 0x123, True, True, "data", "000102030405060708090A0B"),
]

SHORT_GVRET = """\
Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8
1,123,false,Rx,0,8,01,02,03
2,123,false,Rx,0,16,01,02,03,04,05,06,07,08
3,123,false,Rx,0,8,01,02,,,,,,
"""
SHORT_GVRET_FRAMES: list[Frame] = [
    (1000, "0", 0x123, False, False, "data", "010203"),
    (2000, "0", 0x123, False, True, "data", "0102030405060708"),
    (3000, "0", 0x123, False, False, "data", "0102"),
]

OTHER_ORDER = "ID,Time Stamp,LEN,Extended,D1,D2\n12,5,2,true,0A,0B\n"
OTHER_ORDER_FRAMES: list[Frame] = [(5000, "0", 0x12, True, False, "data", "0A0B")]

SAMPLES: list[tuple[CsvReader, str, list[Frame]]] = [
    (PythonCanCsv, PYTHON_CAN, PYTHON_CAN_FRAMES),
    (GvretCsv, SAVVYCAN, SAVVYCAN_FRAMES),
    (GvretCsv, OLD_GVRET, OLD_GVRET_FRAMES),
    (GvretCsv, GVRET_FD, GVRET_FD_FRAMES),
    (GvretCsv, SHORT_GVRET, SHORT_GVRET_FRAMES),
    (GvretCsv, OTHER_ORDER, OTHER_ORDER_FRAMES),
]
NAMES = ["python-can", "savvycan", "old", "fd", "short", "other order"]


@pytest.mark.parametrize(("reader", "text", "frames"), SAMPLES, ids=NAMES)
def test_reads_every_dialect(tmp_path: Path, reader: CsvReader, text: str, frames: list[Frame]) -> None:
    assert reader.sniff(text.encode())
    assert read(reader, tmp_path, text) == (frames, Account(accepted=len(frames)))
    assert read(reader, tmp_path, text.replace("\n", "\r\n")) == (frames, Account(accepted=len(frames)))
    assert read(reader, tmp_path, gzip.compress(text.encode())) == (frames, Account(accepted=len(frames)))


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("1,5,0x44,0,0,0,1,AA==", python_can_csv.REASONS[7]),
        (".,0x44,0,0,0,1,AA==", python_can_csv.REASONS[2]),
        ("1.5.5,0x44,0,0,0,1,AA==", python_can_csv.REASONS[2]),
        ("1e,0x44,0,0,0,1,AA==", python_can_csv.REASONS[2]),
        ("1e12,0x44,0,0,0,1,AA==", python_can_csv.REASONS[3]),
        ("5000000000.5,0x44,0,0,0,1,AA==", python_can_csv.REASONS[3]),
        ("1.5,0xG4,0,0,0,1,AA==", python_can_csv.REASONS[4]),
        ("1.5,,0,0,0,1,AA==", python_can_csv.REASONS[4]),
        ("1.5,0x800,0,0,0,1,AA==", python_can_csv.REASONS[5]),
        ("1.5,0x20000000,1,0,0,1,AA==", python_can_csv.REASONS[6]),
        ("1.5,0x44,2,0,0,1,AA==", python_can_csv.REASONS[7]),
        ("1.5,0x44,0,0,0,65,AA==", python_can_csv.REASONS[8]),
        ("1.5,0x44,0,0,0,,AA==", python_can_csv.REASONS[8]),
        ("1.5,0x44,0,0,0,2,AA==", python_can_csv.REASONS[9]),
        ("1.5,0x44,0,0,0,1,AA=", python_can_csv.REASONS[9]),
        ("1.5,0x44,0,0,0,1,A===", python_can_csv.REASONS[9]),
        ("1.5,0x44,0,0,0,3,AA-A", python_can_csv.REASONS[9]),
        ("1.5,0x44,0,1,0,1,AA==", python_can_csv.REASONS[9]),
        ("1.5,0x44,0,0,0,1,AA==,", python_can_csv.REASONS[10]),
        ("1.5,0x44,0,1,0,9,", python_can_csv.REASONS[11]),
        ("1.5,0x44,0,0,0,9,AAAAAAAAAAAA", python_can_csv.REASONS[12]),
        ("1.5,0x44,0,1,1,0,", python_can_csv.REASONS[13]),
        ("1.5,0x44,0,0,0,1", python_can_csv.REASONS[1]),
        ("1.5", python_can_csv.REASONS[1]),
        ("nan,0x44,0,0,0,1,AA==", f"expected a row of numbers, or the header {python_can_csv.HEADER.decode()}"),
    ],
)
def test_python_can_rejects_with_line_and_reason(tmp_path: Path, line: str, reason: str) -> None:
    frames, account = read(PythonCanCsv, tmp_path, f"{PYTHON_CAN}\n{line}\n1.0,0x123,0,1,0,8,\n")
    assert frames == [*PYTHON_CAN_FRAMES, PYTHON_CAN_FRAMES[3]]
    assert account == Account(accepted=8, rejected=1, rejections=[("line 10", f"{reason}; found {line!r}")])


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("1.5,123,false,Rx,0,1,00", gvret_csv.REASONS[2]),
        ("1e3,123,false,Rx,0,1,00", gvret_csv.REASONS[2]),
        (",123,false,Rx,0,1,00", gvret_csv.REASONS[2]),
        ("-,123,false,Rx,0,1,00", gvret_csv.REASONS[2]),
        ("5000000000000000,123,false,Rx,0,1,00", gvret_csv.REASONS[3]),
        ("1,0x,false,Rx,0,1,00", gvret_csv.REASONS[4]),
        ("1,12 3,false,Rx,0,1,00", gvret_csv.REASONS[4]),
        ("1,800,false,Rx,0,1,00", gvret_csv.REASONS[5]),
        ("1,20000000,true,Rx,0,1,00", gvret_csv.REASONS[6]),
        ("1,123,maybe,Rx,0,1,00", gvret_csv.REASONS[7]),
        ("1,123,false,Rx,0,9,00", gvret_csv.REASONS[8]),
        ("1,123,false,Rx,0,65,00", gvret_csv.REASONS[8]),
        ("1,123,false,Rx,0,,00", gvret_csv.REASONS[8]),
        ("1,123,false,Rx,0,2,00,1G", gvret_csv.REASONS[9]),
        ("1,123,false,Rx,0,2,00,100", gvret_csv.REASONS[9]),
        ("1,123,false,Rx,0,2,00,,01", gvret_csv.REASONS[9]),
        ("1,123,false,Rx,0,2,00,01,02", gvret_csv.REASONS[10]),
        ("1,123,false,Xx,0,1,00", gvret_csv.REASONS[11]),
        ("1,123,false,Rx,256,1,00", gvret_csv.REASONS[12]),
        ("1,123,false,Rx,0", gvret_csv.REASONS[1]),
        ("1,123,false,Rx,0,1", gvret_csv.REASONS[1]),
        ("hello", gvret_csv.REASONS[2]),
        ("hello, here is a remark", "expected a row that starts with a time stamp, or the header"),
    ],
)
def test_gvret_rejects_with_line_and_reason(tmp_path: Path, line: str, reason: str) -> None:
    frames, account = read(GvretCsv, tmp_path, f"{SAVVYCAN}\n{line}\n166064200,21A,false,Rx,0,0,\n")
    assert frames == [*SAVVYCAN_FRAMES, SAVVYCAN_FRAMES[2]]
    assert account == Account(accepted=5, rejected=1, rejections=[("line 7", f"{reason}; found {line!r}")])


def test_a_rejection_reads_like_this(tmp_path: Path) -> None:
    _, account = read(GvretCsv, tmp_path, SAVVYCAN + "1,800,false,Rx,0,1,00\n")
    assert account.rejections == [
        (
            "line 6",
            "the identifier is beyond 11 bits (7FF), and Extended says false; found '1,800,false,Rx,0,1,00'",
        )
    ]


@pytest.mark.parametrize(
    ("header", "reason"),
    [
        (
            "Time Stamp,ID,Dir,Bus",
            (
                "the header lacks the columns extended, len, d1; expected one such as "
                "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8"
            ),
        ),
        (
            "Time Stamp,ID,Extended,LEN,D1,D2,Bus",
            "the header has columns behind D1 that are not bytes; put them before it",
        ),
    ],
)
def test_a_header_that_cannot_be_understood(tmp_path: Path, header: str, reason: str) -> None:
    with pytest.raises(InputError) as caught:
        read(GvretCsv, tmp_path, f"\n{header}\n1,123,false,Rx,0,1,00\n")
    assert str(caught.value) == f"{tmp_path / 'can.csv'}: line 2: {reason}; found {header!r}"


@pytest.mark.parametrize("end", ["", ",", "x", "9,", ",hello"])
def test_a_row_that_has_joined_the_header_is_rejected(tmp_path: Path, end: str) -> None:
    header, first, *rows = SAVVYCAN.splitlines()
    joined = f"{header}{end}{first}"
    frames, account = read(GvretCsv, tmp_path, "\n".join([joined, *rows, ""]))
    assert frames == SAVVYCAN_FRAMES[1:]
    reason = "expected the column D{}, or the header's end: a row has joined it, or it has other columns"
    reason = reason.format(9 if end.startswith(",") else 8)
    assert account == Account(
        accepted=3, rejected=1, rejections=[("line 1", f"{reason}; found {joined[:80]!r} and more")]
    )


def test_empty_columns_behind_the_bytes_of_the_header(tmp_path: Path) -> None:
    header, rows = SAVVYCAN.split("\n", 1)
    assert read(GvretCsv, tmp_path, f"{header},,\n{rows}") == (SAVVYCAN_FRAMES, Account(accepted=4))


def test_counters_of_32_bits_go_on_where_they_pass_their_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text_log, "BATCH", 2)
    turn, half = 1 << 32, 1 << 31
    stamps = {
        "unsigned": ([turn - 1, 1, turn - 1, 2, 5], [turn - 1, turn + 1, turn - 1, turn + 2, turn + 5]),
        "signed": ([half - 3, half - 1, 1 - half, 5 - half], [half - 3, half - 1, half + 1, half + 5]),
        "twice": ([turn - 1, 0, half, turn - 1, 0], [turn - 1, turn, turn + half, 2 * turn - 1, 2 * turn]),
        "started anew": ([turn - 120_000_000, 0, 10], [turn - 120_000_000, 0, 10]),
        "date": ([1_690_000_000_000_000, 7], [1_690_000_000_000_000, 7]),
    }  # fmt: skip
    for written, expected in stamps.values():
        rows = "".join(f"{stamp},1,false,Rx,0,0,\n" for stamp in written)
        frames, _ = read(GvretCsv, tmp_path, SAVVYCAN.partition("\n")[0] + "\n" + rows)
        assert [frame[0] for frame in frames] == [1000 * stamp for stamp in expected]


def test_logs_put_together_keep_their_own_columns(tmp_path: Path) -> None:
    frames, account = read(GvretCsv, tmp_path, SAVVYCAN + OLD_GVRET + SAVVYCAN)
    assert frames == SAVVYCAN_FRAMES + OLD_GVRET_FRAMES + SAVVYCAN_FRAMES
    assert account == Account(accepted=len(frames))


def needed(reader: CsvReader, line: str) -> int:
    """Return how many characters make a line whole; one more than it has where only its end shows it."""
    if reader is PythonCanCsv:
        return len(line)
    fields = line.split(",")
    first = 5 if fields[3] in {"0", "1"} else 6
    size, given = int(fields[first - 1]), fields[first:]
    if len([byte for byte in given if byte]) < size:
        return len(line) + 1
    # The byte's second digit or the comma behind its only one says that it is whole.
    behind = len(",".join(fields[: first + size]))
    padded = size == 0 or len(given[size - 1]) == 2
    return behind + (not padded)


@pytest.mark.parametrize(("reader", "text", "frames"), SAMPLES[:5], ids=NAMES[:5])
def test_cut_anywhere_gives_the_whole_frames_before_the_cut(
    tmp_path: Path, reader: CsvReader, text: str, frames: list[Frame]
) -> None:
    content = text.encode()
    header, *lines = text.splitlines()
    for size in range(len(header.encode()) + 1, len(content)):
        got, account = read(reader, tmp_path, content[:size])
        whole, within, start = 0, False, len(header.encode()) + 1
        for line in lines:
            whole += size >= start + needed(reader, line)
            within |= start < size < start + needed(reader, line)
            start += len(line) + 1
        assert (got, account.rejected, account.truncated) == (frames[:whole], within, within)


def test_says_that_the_file_may_end_within_a_line(tmp_path: Path) -> None:
    _, account = read(GvretCsv, tmp_path, SAVVYCAN + "1,123,false,Rx,0,2,00,1")
    assert account.rejections == [
        (
            "line 6",
            (
                "the file ends within this line, or behind a byte of it that may not be its last; "
                "found '1,123,false,Rx,0,2,00,1'"
            ),
        )
    ]
    _, account = read(PythonCanCsv, tmp_path, PYTHON_CAN + "1.5,0x123,0,0,0,2,A")
    assert account.rejections == [
        (
            "line 9",
            (
                "the file ends within this line: expected as many bytes in base64 as dlc says; "
                "found '1.5,0x123,0,0,0,2,A'"
            ),
        )
    ]


@pytest.mark.parametrize("block", [1, 7, 40, 1000])
@pytest.mark.parametrize("lines", [1, 3, 1000])
def test_blocks_and_batches_cut_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int, lines: int
) -> None:
    monkeypatch.setattr(text_log, "BLOCK", block)
    monkeypatch.setattr(text_log, "BATCH", lines)
    for reader, text, frames in SAMPLES:
        got, account = read(reader, tmp_path, text + "\n???\n" + text)
        assert got == frames * 2
        ((where, _),) = account.rejections
        assert where == f"line {text.count(chr(10)) + 2}"


def test_mutations_end_as_a_result_or_as_an_input_error(tmp_path: Path) -> None:
    source = random.Random(5)  # noqa: S311 - mutations, no secrets
    unreadable = 0
    for _ in range(240):
        reader, sample, _ = source.choice(SAMPLES)
        text = bytearray(sample.encode())
        for _ in range(source.randint(1, 6)):
            k = source.randrange(len(text))
            match source.randrange(4):
                case 0:
                    text[k] = source.randrange(256)
                case 1:
                    del text[k : k + source.randint(1, 40)]
                case 2:
                    text[k:k] = source.randbytes(source.randint(1, 10))
                case _:
                    text[k] = source.choice(b"0123456789,.-=\n")
        try:
            frames, account = read(reader, tmp_path, bytes(text))
        except InputError:
            unreadable += 1
        else:
            lines = [line for line in bytes(text).split(b"\n") if line.strip(b" \t\r")]
            assert len(lines) - 2 <= len(frames) + account.rejected <= len(lines)
    assert 0 < unreadable < 120


messages = st.lists(
    st.tuples(
        st.one_of(
            st.integers(0, 4 * 10**15).map(lambda us: us / 10**6),
            st.floats(0, 4e9, allow_subnormal=False),
            st.floats(0, 1e-3),
        ),
        st.tuples(st.integers(0, 0x7FF), st.just(False)) | st.tuples(st.integers(0, 0x1FFFFFFF), st.just(True)),
        st.sampled_from(["data", "remote", "error", "fd"]),
        st.binary(max_size=8),
        st.sampled_from([12, 16, 20, 24, 32, 48, 64]),
    ),
    max_size=20,
)  # fmt: skip


@given(messages)
def test_reads_what_python_can_writes(tmp_path_factory: pytest.TempPathFactory, rows: list[Any]) -> None:
    path = tmp_path_factory.mktemp("csv") / "can.csv"
    expected: list[Frame] = []
    with can.CSVWriter(path) as writer:
        for stamp, (number, extended), kind, short, size in rows:
            payload = b"" if kind == "remote" else short.ljust(size, b"\xf7") if kind == "fd" else short
            writer.on_message_received(
                can.Message(
                    timestamp=stamp,
                    arbitration_id=number,
                    is_extended_id=extended,
                    is_remote_frame=kind == "remote",
                    is_error_frame=kind == "error",
                    is_fd=kind == "fd",
                    dlc=len(short) if kind == "remote" else None,
                    data=payload,
                )
            )
            ns = (Decimal(repr(stamp)) * 10**9).quantize(Decimal(1), "ROUND_HALF_UP")
            name = "data" if kind == "fd" else kind
            expected.append((int(ns), "", number, extended, kind == "fd", name, payload.hex().upper()))
    account = Account()
    frames = [frame for batch in PythonCanCsv(path).batches(account) for frame in frames_of(batch)]
    assert frames == expected
    assert account == Account(accepted=len(rows))


@pytest.mark.parametrize("reader", [PythonCanCsv, GvretCsv])
@pytest.mark.parametrize(
    "head",
    [
        b"",
        b"\n\n",
        b"\xe7" * 72,
        b"\xef\xbb\xbf",
        b"(1436509052.249713) can0 044#2A366C2BBA\n",
        b"1524311386.811100 1R11 7EC 03 41\n",
        b";$FILEVERSION=2.1\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n",
        b"base hex timestamps absolute\n",
        b"$GPRMC,1,A\n",
        b"timestamp,latitude,longitude\n1.0,2.0,3.0\n",
        b"time,id,len\n1,2,3\n",
        b"1.5,0x44,0,0,0,1,AA==\n",
    ],
)
def test_refuses_others(reader: CsvReader, head: bytes) -> None:
    assert not reader.sniff(head)


def test_each_refuses_the_others_files() -> None:
    for reader, text, _ in SAMPLES:
        other: CsvReader = GvretCsv if reader is PythonCanCsv else PythonCanCsv
        assert not other.sniff(text.encode())


def test_missing_and_empty_files(tmp_path: Path) -> None:
    for reader in (PythonCanCsv, GvretCsv):
        with pytest.raises(InputError) as caught:
            list(reader(tmp_path / "no.csv").batches(Account()))
        assert str(caught.value).startswith(f"{tmp_path / 'no.csv'}: no such file; ")
        assert read(reader, tmp_path, "\n \n") == ([], Account())
    for reader, text, _ in SAMPLES:
        assert read(reader, tmp_path, text.split("\n")[0] + "\n") == ([], Account())
