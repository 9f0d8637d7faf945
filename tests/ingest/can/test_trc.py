from __future__ import annotations

import gzip
import random
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.ingest.can.plain_frames import Frame, frames_of
from wheelprint.ingest.account import Account
from wheelprint.ingest.can import text_log, trc
from wheelprint.ingest.can.trc import Trc
from wheelprint.schemas.errors import InputError


def read(folder: Path, content: bytes | str, name: str = "can.trc") -> tuple[list[Frame], Account]:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    account = Account()
    frames = [frame for batch in Trc(path).batches(account) for frame in frames_of(batch)]
    assert account.accepted == len(frames)
    return frames, account


START_11 = 1_048_510_352_483_997_120
"""2003-03-24 12:52:32.48399712: 37704.5364870833 days after 1899-12-30 are exactly that."""
START_21 = 1_506_809_173_219_999_949
"""43008.920986342592 days are 2017-09-30 22:06:13.2199999488."""

V10 = """\
;##########################################################################
;   C:\\TraceFile.trc
;
;    CAN activities recorded by PCAN Explorer
;    Start time: 11.09.2002 16:04:13.241
;    PCAN-Net: N/A
;
;----+- ---+--- ----+--- + -+ -- -- ...
     1)      1841      0001  8  00 01 02 03 04 05 06 07
     2)      1842  18EFC034  2  0A 0b
     3)      1843      0100  8  RTR
     4)      1844  FFFFFFFF  4  00 00 00 08 BUSHEAVY
"""
START_10 = 1_031_760_253_241_000_000
V10_FRAMES = [
    (START_10 + 1841_000_000, "1", 0x1, False, False, "data", "0001020304050607"),
    (START_10 + 1842_000_000, "1", 0x18EFC034, True, False, "data", "0A0B"),
    (START_10 + 1843_000_000, "1", 0x100, False, False, "remote", ""),
    (START_10 + 1844_000_000, "1", 0, False, False, "error", "00000008"),
]

V11 = """\
;$FILEVERSION=1.1
;$STARTTIME=37704.5364870833
;
;   Start time: 24.03.2003 12:52:32.484
;---+--   ----+----  --+--  ----+---  +  -+ -- -- -- -- -- -- --
     1)      1059.9  Rx         0300  7  00 00 00 00 04 00 00
     2)      1283.2  Tx     18EFC034  0
     3)      1298.9  Warng  FFFFFFFF  4  00 00 00 08  BUSHEAVY
     4)      1298.95 Rx         0300  0  RTR
     5)      1299.0  Error      0008  4  01 0B 0A 02
"""
V11_FRAMES = [
    (START_11 + 1059_900_000, "1", 0x300, False, False, "data", "00000000040000"),
    (START_11 + 1283_200_000, "1", 0x18EFC034, True, False, "data", ""),
    (START_11 + 1298_900_000, "1", 0, False, False, "error", "00000008"),
    (START_11 + 1298_950_000, "1", 0x300, False, False, "remote", ""),
    (START_11 + 1299_000_000, "1", 8, False, False, "error", "010B0A02"),
]

V12 = """\
;$FILEVERSION=1.2
;$STARTTIME=37704.5364870833
     1)      1059.900 1  Rx        0300 7    00 00 00 00 04 00 00
     2)      1283.231 2  Tx        0400 2    00 FF
     3)      1298.945 12 Rx    00000100 1    RTR
"""
V12_FRAMES = [
    (START_11 + 1059_900_000, "1", 0x300, False, False, "data", "00000000040000"),
    (START_11 + 1283_231_000, "2", 0x400, False, False, "data", "00FF"),
    (START_11 + 1298_945_000, "12", 0x100, True, False, "remote", ""),
]

V13 = """\
;$FILEVERSION=1.3
;$STARTTIME=37704.5364870833
     1)      1059.900 1  Rx        0300 -  7    00 00 00 00 04 00 00
     2)      1283.231 2  Tx    18EFC034 -  2    00 FF
     3)      1298.945 1  Rx        0300 -  9    01 02 03 04 05 06 07 08
     4)      1299.945 1  Warng FFFFFFFF -  4    00 00 00 08 BUSHEAVY
     5)      1300.945 1  Error     0002 -  4    00 18 0A 02
"""
V13_FRAMES = [
    (START_11 + 1059_900_000, "1", 0x300, False, False, "data", "00000000040000"),
    (START_11 + 1283_231_000, "2", 0x18EFC034, True, False, "data", "00FF"),
    (START_11 + 1298_945_000, "1", 0x300, False, False, "data", "0102030405060708"),
    (START_11 + 1299_945_000, "1", 0, False, False, "error", "00000008"),
    (START_11 + 1300_945_000, "1", 2, False, False, "error", "00180A02"),
]

TWELVE = " ".join(f"{k:02X}" for k in range(12))
V20 = f"""\
;$FILEVERSION=2.0
;$STARTTIME=43008.920986342592
;$COLUMNS=N,O,T,I,d,l,D
;
      1      1059.900 DT     0300 Rx 7  00 00 00 00 04 00 00
      2      1334.416 FB     0500 Tx 12 {TWELVE}
      3      1334.522 ER          Rx    04 00 02 00 00
      4      1334.531 ST          Rx    00 00 00 08
      5      1334.643 EC          Rx    02 02
      6      1335.156 DT 18EFC034 Tx 8  01 02 03 04 05 06 07 08
      7      1336.543 RR     0100 Rx 3
      8      1336.600 EV User-defined event for bus 1
      9      1336.687 BI     0100 Rx 3  01 02 03
"""
V20_FRAMES = [
    (START_21 + 1059_900_000, "1", 0x300, False, False, "data", "00000000040000"),
    (START_21 + 1334_416_000, "1", 0x500, False, True, "data", TWELVE.replace(" ", "")),
    (START_21 + 1334_522_000, "1", 0, False, False, "error", "0400020000"),
    (START_21 + 1334_531_000, "1", 0, False, False, "error", "00000008"),
    (START_21 + 1334_643_000, "1", 0, False, False, "error", "0202"),
    (START_21 + 1335_156_000, "1", 0x18EFC034, True, False, "data", "0102030405060708"),
    (START_21 + 1336_543_000, "1", 0x100, False, False, "remote", ""),
    (START_21 + 1336_687_000, "1", 0x100, False, True, "data", "010203"),
]

V21 = f"""\
;$FILEVERSION=2.1
;$STARTTIME=43008.920986342592
;$COLUMNS=N,O,T,B,I,d,R,L,D
;
      1      1059.900 DT 1      0300 Rx -  7    00 00 00 00 04 00 00
      2      1334.416 FD 2      0500 Tx -  9    {TWELVE}
      3      1334.416 FE 2      0500 Tx -  15   {"5A " * 63}5A
      4      1334.522 ER 1         - Rx -  5    04 00 02 00 00
      5      1334.531 ST 2         - Rx -  4    00 00 00 08
      6      1334.643 EC 1         - Rx -  2    02 02
      7      1335.156 DT 1  18EFC034 Tx FF 12   01 02 03 04 05 06 07 08
      8      1336.543 RR 1      0100 Rx -  3
      9      1336.600 EV 1  User-defined event for bus 1
     10      -0.5     DT 16  000000A Rx -  0
"""
V21_FRAMES = [
    (START_21 + 1059_900_000, "1", 0x300, False, False, "data", "00000000040000"),
    (START_21 + 1334_416_000, "2", 0x500, False, True, "data", TWELVE.replace(" ", "")),
    (START_21 + 1334_416_000, "2", 0x500, False, True, "data", "5A" * 64),
    (START_21 + 1334_522_000, "1", 0, False, False, "error", "0400020000"),
    (START_21 + 1334_531_000, "2", 0, False, False, "error", "00000008"),
    (START_21 + 1334_643_000, "1", 0, False, False, "error", "0202"),
    (START_21 + 1335_156_000, "1", 0x18EFC034, True, False, "data", "0102030405060708"),
    (START_21 + 1336_543_000, "1", 0x100, False, False, "remote", ""),
    (START_21 - 500_000, "16", 0xA, True, False, "data", ""),
]

SAMPLES = [
    (V10, V10_FRAMES), (V11, V11_FRAMES), (V12, V12_FRAMES), (V13, V13_FRAMES), (V20, V20_FRAMES), (V21, V21_FRAMES),
]  # fmt: skip
VERSIONS = ["1.0", "1.1", "1.2", "1.3", "2.0", "2.1"]


@pytest.mark.parametrize(("text", "frames"), SAMPLES, ids=VERSIONS)
def test_reads_every_version(tmp_path: Path, text: str, frames: list[Frame]) -> None:
    assert read(tmp_path, text) == (frames, Account(accepted=len(frames)))
    assert read(tmp_path, text.replace("\n", "\r\n")) == (frames, Account(accepted=len(frames)))
    assert read(tmp_path, gzip.compress(text.encode())) == (frames, Account(accepted=len(frames)))


def test_starts_are_what_the_remarks_of_the_samples_say() -> None:
    def ns(*date: int) -> int:
        return int(datetime(*date, tzinfo=UTC).timestamp()) * 10**9  # type: ignore[misc,arg-type]

    assert ns(2002, 9, 11, 16, 4, 13) + 241_000_000 == START_10
    assert abs(ns(2003, 3, 24, 12, 52, 32) + 484_000_000 - START_11) < 1_000_000
    assert abs(ns(2017, 9, 30, 22, 6, 13) + 220_000_000 - START_21) < 1_000


@pytest.mark.parametrize(
    ("header", "start"),
    [
        (";$STARTTIME=25569\n", 0),
        (";$STARTTIME=25569.000000000000011574\n", 1),
        (";$STARTTIME=25569.0000000000000057\n", 0),
        (";$STARTTIME=25568.5\n", -43_200 * 10**9),
        (";$STARTTIME=25570,25\n", 108_000 * 10**9),
        ("; Start time: 02.01.1970 00:00:01.123.4\n", 86_401_123_400_000),
        (";    Start time: 1970-01-02 00:00:01.123456+00:00\n", 86_401_123_456_000),
        (";   Start time: 45.01.1970 00:00:01\n", 0),
        (";   Start time: 24.03.9003 00:00:01\n", 0),
        (";$STARTTIME=25570\n; Start time: 30.12.1999 10:00:00.000\n", 86_400 * 10**9),
        ("", 0),
    ],
)
def test_start_time(tmp_path: Path, header: str, start: int) -> None:
    frames, _ = read(tmp_path, header + "     1)      0  0001  0\n")
    assert frames == [(start, "1", 1, False, False, "data", "")]


@pytest.mark.parametrize(
    ("columns", "line"),
    [
        ("O,T,I,L,D", "1.5 DT 0123 2 0A 0B"),
        ("T,I,O,L,D", "DT 0123 1.5 2 0A 0B"),
        ("L,d,I,B,T,O,N,D", "2 Rx 0123 1 DT 1.5 17 0A 0B"),
        ("N, O, T, B, I, d, R, l, D", "17 1.5 DT 1 0123 Rx - 2 0A 0B"),
    ],
)
def test_columns_in_any_order(tmp_path: Path, columns: str, line: str) -> None:
    header = f";$FILEVERSION=2.1\n;$STARTTIME=25569\n;$COLUMNS={columns}\n"
    frames, account = read(tmp_path, header + line + "\n")
    assert frames == [(1_500_000, "1", 0x123, False, False, "data", "0A0B")]
    assert account == Account(accepted=1)


def test_status_lines_in_columns_of_any_order(tmp_path: Path) -> None:
    header = ";$FILEVERSION=2.1\n;$STARTTIME=25569\n;$COLUMNS=O,d,T,B,I,R,L,D\n"
    frames, account = read(tmp_path, header + "1.5 Rx ST 2 - - 4 00 00 00 08\n")
    assert frames == [(1_500_000, "2", 0, False, False, "error", "00000008")]
    assert account == Account(accepted=1)


def test_traces_put_together_keep_their_own_starts_and_columns(tmp_path: Path) -> None:
    frames, account = read(tmp_path, V21 + V11 + V20)
    assert frames == V21_FRAMES + V11_FRAMES + V20_FRAMES
    assert account == Account(accepted=len(frames))


BAD_21 = [
    ("x 1.0 DT 1 0300 Rx - 0", trc.REASONS[2]),
    ("1 1,0 DT 1 0300 Rx - 0", trc.REASONS[3]),
    ("1 nan DT 1 0300 Rx - 0", trc.REASONS[3]),
    ("1 99999999999999 DT 1 0300 Rx - 0", trc.REASONS[3]),
    ("1 1.0 Rx 1 0300 Rx - 0", trc.REASONS[4]),
    ("1 1.0 DX 1 0300 Rx - 0", trc.REASONS[4]),
    ("1 1.0 DT 256 0300 Rx - 0", trc.REASONS[5]),
    ("1 1.0 DT 1 03G0 Rx - 0", trc.REASONS[6]),
    ("1 1.0 DT 1 000000300 Rx - 0", trc.REASONS[6]),
    ("1 1.0 DT 1 0800 Rx - 0", trc.REASONS[7]),
    ("1 1.0 DT 1 20000000 Rx - 0", trc.REASONS[8]),
    ("1 1.0 DT 1 0300 Xx - 0", trc.REASONS[9]),
    ("1 1.0 ER 1 0300 Xx - 0", trc.REASONS[9]),
    ("1 1.0 DT 1 0300 Rx - 16", trc.REASONS[10]),
    ("1 1.0 DT 1 0300 Rx - -1", trc.REASONS[10]),
    ("1 1.0 ST 1 - Rx - x 00", trc.REASONS[10]),
    ("1 1.0 DT 1 0300 Rx - 2 00 1", trc.REASONS[13]),
    ("1 1.0 DT 1 0300 Rx - 2 00 XX", trc.REASONS[13]),
    ("1 1.0 EC 1 - Rx - 2 00 XX", trc.REASONS[13]),
    ("1 1.0 DT 1 0300 Rx - 2 00", trc.REASONS[14]),
    ("1 1.0 EC 1 - Rx - 2 00", trc.REASONS[14]),
    ("1 1.0 FD 1 0300 Rx - 9 00 00 00 00 00 00 00 00", trc.REASONS[14]),
    ("1 1.0 DT 1 0300 Rx - 2 00 01 02", trc.REASONS[15]),
    ("1 1.0 RR 1 0300 Rx - 2 00 01", trc.REASONS[15]),
    ("1 1.0 EC 1 - Rx - 2 00 01 02", trc.REASONS[15]),
    ("1 1.0 DT 1 0300 Rx", trc.REASONS[1]),
    ("1", trc.REASONS[1]),
]  # fmt: skip


@pytest.mark.parametrize(("line", "reason"), BAD_21)
def test_rejects_with_line_and_reason(tmp_path: Path, line: str, reason: str) -> None:
    head, tail = V21.rsplit("     10", 1)
    frames, account = read(tmp_path, f"{head}{line}\n     10{tail}")
    assert frames == V21_FRAMES
    assert account == Account(
        accepted=len(frames), rejected=1, rejections=[("line 14", f"{reason}; found {line!r}")]
    )  # fmt: skip


@pytest.mark.parametrize(
    ("line", "reason"), [("1 1.0 DT 0300 Rx 9 " + "00 " * 9, trc.REASONS[11]), ("1 1.0 FD 0300 Rx 9", trc.REASONS[12])]
)
def test_rejects_lengths_in_bytes_that_no_frame_has(tmp_path: Path, line: str, reason: str) -> None:
    _, account = read(tmp_path, V20 + line + "\n")
    assert account.rejections == [("line 14", f"{reason}; found {line.strip()!r}")]


def test_a_rejection_reads_like_this(tmp_path: Path) -> None:
    _, account = read(tmp_path, V11 + "     6)      1300.0  Xx     0300  1  00\n")
    assert account.rejections == [
        (
            "line 11",
            (
                "expected a type: Rx, Tx, Warng, Error (versions 1) or DT, FD, FB, FE, BI, RR, ST, ER, EC, EV "
                "(versions 2); found '6)      1300.0  Xx     0300  1  00'"
            ),
        )
    ]


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (
            ";$FILEVERSION=3.0",
            "expected $FILEVERSION to be one of 1.0, 1.1, 1.2, 1.3, 2.0, 2.1; export the trace as one",
        ),
        (
            ";$STARTTIME=today",
            "expected $STARTTIME as days since 1899-12-30, such as 43008.920986342592; correct it",
        ),
        (
            ";$STARTTIME=9999999.5",
            "expected $STARTTIME before the year 2116, in days since 1899-12-30; correct it",
        ),
        (
            ";$COLUMNS=N,X,D,T,T",
            (
                "expected $COLUMNS such as N,O,T,B,I,d,R,L,D "
                "(unknown: X; missing: O, I, l or L; twice: T; the payload, D, is not the last)"
            ),
        ),
        (";$COLUMNS=N,O,T,I,l,L,D", "expected $COLUMNS such as N,O,T,B,I,d,R,L,D (both l and L)"),
    ],
)
def test_a_header_that_cannot_be_understood(tmp_path: Path, line: str, reason: str) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, f";\n{line}\n")
    assert str(caught.value) == f"{tmp_path / 'can.trc'}: line 2: {reason}; found {line!r}"


def needed(line: str) -> int:
    """Return how many characters of a line make it whole; one more than it has where only its end shows it."""
    if " EV " in line:
        return line.index(" EV ") + 3
    if "BUSHEAVY" in line:
        return len(line.removesuffix("BUSHEAVY").rstrip())
    # Version 2.0 leaves the length of three types blank; RTR can follow the length 0 of versions 1.
    unsure = ("ER          Rx", "ST          Rx", "EC          Rx", "18EFC034  0")
    return len(line) + any(word in line for word in unsure)


@pytest.mark.parametrize(("text", "frames"), SAMPLES, ids=VERSIONS)
def test_cut_anywhere_gives_the_whole_frames_before_the_cut(tmp_path: Path, text: str, frames: list[Frame]) -> None:
    lines = text.splitlines()
    header = sum(len(line) + 1 for line in lines if line.startswith(";"))
    for size in range(header, len(text)):
        got, account = read(tmp_path, text[:size])
        whole, within, start = 0, False, 0
        for line in lines:
            if not line.startswith(";"):
                whole += " EV " not in line and size >= start + needed(line)
                within |= start + len(line) - len(line.lstrip()) < size < start + needed(line)
            start += len(line) + 1
        assert (got, account.rejected, account.truncated) == (frames[:whole], within, within)


def test_a_header_that_breaks_off(tmp_path: Path) -> None:
    for size in range(V21.index("      1")):
        got, account = read(tmp_path, V21[:size])
        assert got == []
        assert account.truncated == bool(account.rejections)
    _, account = read(tmp_path, ";$FILEVERSION=2.")
    assert account == Account(
        rejected=1,
        truncated=True,
        rejections=[
            (
                "line 1",
                (
                    "the file ends within this line: expected $FILEVERSION to be one of 1.0, 1.1, 1.2, 1.3, 2.0, 2.1; "
                    "export the trace as one; found ';$FILEVERSION=2.'"
                ),
            )
        ],
    )


@pytest.mark.parametrize("block", [1, 7, 40, 1000])
@pytest.mark.parametrize("lines", [1, 3, 1000])
def test_blocks_and_batches_cut_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int, lines: int
) -> None:
    monkeypatch.setattr(text_log, "BLOCK", block)
    monkeypatch.setattr(text_log, "BATCH", lines)
    frames, account = read(tmp_path, V21 + "\n bad\n" + V11)
    assert frames == V21_FRAMES + V11_FRAMES
    ((where, _),) = account.rejections
    assert where == "line 16"


def test_a_tail_of_zeros_takes_no_memory_and_is_one_rejection(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text_log, "BLOCK", 1000)
    zeros = bytes(200_000)
    frames, account = read(tmp_path, V12.encode() + zeros + b"\n" + V12.encode() + zeros)
    assert frames == V12_FRAMES * 2
    found = repr("\0" * 80)
    assert account.rejections == [
        ("line 6", f"too long for a line of such a log; found {found} and more"),
        ("line 12", f"too long for a line of such a log; found {found} and more"),
    ]


def test_mutations_end_as_a_result_or_as_an_input_error(tmp_path: Path) -> None:
    source = random.Random(3)  # noqa: S311 - mutations, no secrets
    unreadable = 0
    for _ in range(240):
        text = bytearray(source.choice(SAMPLES)[0].encode())
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
                    text[k] = source.choice(b"0123456789 .-;\n")
        try:
            frames, account = read(tmp_path, bytes(text))
        except InputError:
            unreadable += 1
        else:
            records = [line for line in bytes(text).split(b"\n") if line.strip(b" \t\r") and line.strip()[:1] != b";"]
            assert len(frames) + account.rejected <= len(records)
    assert 0 < unreadable < 60


messages = st.lists(
    st.tuples(
        st.integers(0, 10**9),
        st.integers(0, 20),
        st.tuples(st.integers(0, 0x7FF), st.just(False)) | st.tuples(st.integers(0, 0x1FFFFFFF), st.just(True)),
        st.binary(max_size=8),
    ),
    min_size=1,
    max_size=20,
)  # fmt: skip


@given(messages)
def test_reads_what_python_can_writes(tmp_path_factory: pytest.TempPathFactory, rows: list[Any]) -> None:
    path = tmp_path_factory.mktemp("trc") / "can.trc"
    with can.TRCWriter(path) as writer:
        for ms, bus, (number, extended), payload in rows:
            writer.on_message_received(
                can.Message(
                    timestamp=1_436_509_052 + ms / 1000,
                    arbitration_id=number,
                    is_extended_id=extended,
                    channel=bus,
                    data=payload,
                )
            )
    account = Account()
    frames = [frame for batch in Trc(path).batches(account) for frame in frames_of(batch)]
    # python-can numbers buses from 1 in the file; it takes start and offsets from floats.
    assert [frame[1:] for frame in frames] == [
        (str(bus + 1), number, extended, False, "data", payload.hex().upper())
        for _, bus, (number, extended), payload in rows
    ]
    for frame, (ms, *_) in zip(frames, rows, strict=True):
        assert abs(frame[0] - (1_436_509_052_000 + ms) * 10**6) < 2_000
    assert account == Account(accepted=len(rows))


def test_reads_version_1_0_of_python_can(tmp_path: Path) -> None:
    with can.TRCWriter(tmp_path / "can.trc") as writer:
        writer.file_version = can.TRCFileVersion.V1_0
        writer.on_message_received(can.Message(1_436_509_052.5, 0x123, False, data=b"\x01\x02", channel=0))
        writer.on_message_received(can.Message(1_436_509_053.5, 0x123, True, data=b"", channel=0))
    content = (tmp_path / "can.trc").read_bytes()
    assert read(tmp_path, content)[0] == [
        (1_436_509_052_500_000_000, "1", 0x123, False, False, "data", "0102"),
        (1_436_509_053_500_000_000, "1", 0x123, True, False, "data", ""),
    ]
    assert Trc.sniff(content)


@pytest.mark.parametrize("text", [sample for sample, _ in SAMPLES], ids=VERSIONS)
def test_recognises_its_files(text: str) -> None:
    assert Trc.sniff(text.encode())
    assert Trc.sniff(b"\r\n" + text.replace("\n", "\r\n").encode())


def test_recognises_version_1_0_without_header() -> None:
    assert Trc.sniff(V10.split("...\n")[1].encode())


@pytest.mark.parametrize(
    "head",
    [
        b"",
        b"\n\n",
        b"; a remark\n[section]\nkey = 1\n",
        b";a;b\n1;2\n",
        b"\xe7" * 72,
        b"(1436509052.249713) can0 044#2A366C2BBA\n",
        b"1524311386.811100 1R11 7EC 03 41\n",
        b"Time Stamp,ID,Extended,Dir,Bus,LEN,D1\n",
        b"base hex timestamps absolute\n",
        b"$GPRMC,1,A\n",
        b"1) a list\n2) of things\n",
    ],
)
def test_refuses_others(head: bytes) -> None:
    assert not Trc.sniff(head)


def test_missing_and_empty_files(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        list(Trc(tmp_path / "no.trc").batches(Account()))
    assert str(caught.value) == f"{tmp_path / 'no.trc'}: no such file; check the path, or whether the disk is mounted"
    for content in (b"", b"\n \n", b";$FILEVERSION=1.1\n"):
        assert read(tmp_path, content) == ([], Account())
