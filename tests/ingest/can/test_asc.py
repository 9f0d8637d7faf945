from __future__ import annotations

import gzip
from datetime import UTC, datetime
from pathlib import Path

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.ingest.can.plain_frames import Frame, frames_of
from wheelprint.ingest.account import Account
from wheelprint.ingest.can import asc, text_log
from wheelprint.ingest.can.asc import Asc
from wheelprint.schemas.errors import InputError

HEADER = b"date Sat Sep 30 15:06:13.191 2017\nbase hex  timestamps absolute\ninternal events logged\n"
ZERO = 1506783973_191000000
GOOD = b"   0.500000 1  123             Rx   d 2 11 22\n"

LOG = b"""date Sam Sep 30 15:06:13.191 2017
base hex  timestamps absolute
internal events logged
// version 9.0.0
Begin Triggerblock Sam Sep 30 15:06:13.191 2017
   0.000000 Start of measurement
   0.015991 CAN 1 Status:chip status error passive - TxErr: 132 RxErr: 0
   0.015991 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%
   2.501000 1  ErrorFrame
   2.501010 1  ErrorFrame\tECC: 10100010
   2.501020 2  ErrorFrame\tFlags = 0xe\tCodeExt = 0x20a2\tCode = 0x82\tID = 0\tDLC = 0\tPosition = 5\tLength = 11300
   2.510001 2  100             Tx   r
   2.520002 3  200             Tx   r Length = 1704000 BitCount = 145 ID = 88888888x
   2.584921 4  300             Tx   r 8 Length = 1704000 BitCount = 145 ID = 88888888x
   3.098426 1  18EBFF00x       Rx   d 8 01 A0 0F A6 60 3B D1 40 Length = 273910 BitCount = 141 ID = 418119424x
   3.297743 1  J1939TP FEE3p 6 0 0 - Rx d 23 A0 0F A6 60 3B D1 40 1F DE 80 25 DF C0 2B E1 00 4B FF FF 3C 0F 00 4B FF FF FF
   3.300000 1  6F8             TxRq d 1 05
   3.300001 L1 2A              Rx   2 01 02 checksum = D2
   3.300002 SV: 3 0 1 ::Door::Left = 1
  17.876708 1  6F8             Tx   d 1 05  Length = 240015 BitCount = 124 ID = 1784
  20.105214 1  7ff             rx   d F 00 01 02 03 04 05 06 aB // raw length code
  30.005021 CANFD   1 Rx        300  Generic_Name_12                   1 0 8  8 01 02 03 04 05 06 07 08   102203  133   303000 e0006659 46500250 4b140250 20011736 2001040d
  30.305898 CANFD   2 Tx   1C4D80FFx                                   0 0 a 16 00 01 02 03 04 05 06 07 08 09 0A 0B 0C 0D 0E 0F   102203  133   1000 0 0 0 0 0
  30.506898 CANFD   2 Rx        500                                    0 0 8  8 01 02 03 04 05 06 07 08   140000  73   200000 7a60 0 0 0 0
  30.806898 CANFD   3 Tx        500x                                   0 0 8  0   140000  73   200010 7a60 46500250 460a0250 20011736 20010205
  31.000000 CANFD   3 Tx     ErrorFrame   Not Acknowledge error, dominant error flag fffe c7 31ca Arb. 556 44
  31.100000 CANFD   1 Rx        301                                    0 1 0  0
End TriggerBlock
"""  # noqa: E501  the lines are as long as the format's

FRAMES: list[Frame] = [
    (ZERO + 2_501000000, "1", 0, False, False, "error", ""),
    (ZERO + 2_501010000, "1", 0, False, False, "error", ""),
    (ZERO + 2_501020000, "2", 0, False, False, "error", ""),
    (ZERO + 2_510001000, "2", 0x100, False, False, "remote", ""),
    (ZERO + 2_520002000, "3", 0x200, False, False, "remote", ""),
    (ZERO + 2_584921000, "4", 0x300, False, False, "remote", ""),
    (ZERO + 3_098426000, "1", 0x18EBFF00, True, False, "data", "01A00FA6603BD140"),
    (ZERO + 17_876708000, "1", 0x6F8, False, False, "data", "05"),
    (ZERO + 20_105214000, "1", 0x7FF, False, False, "data", "00010203040506AB"),
    (ZERO + 30_005021000, "1", 0x300, False, True, "data", "0102030405060708"),
    (ZERO + 30_305898000, "2", 0x1C4D80FF, True, True, "data", "000102030405060708090A0B0C0D0E0F"),
    (ZERO + 30_506898000, "2", 0x500, False, False, "data", "0102030405060708"),
    (ZERO + 30_806898000, "3", 0x500, True, False, "remote", ""),
    (ZERO + 31_000000000, "3", 0, False, False, "error", ""),
    (ZERO + 31_100000000, "1", 0x301, False, True, "data", ""),
]


def read(folder: Path, content: bytes, name: str = "can.asc") -> tuple[list[Frame], Account]:
    path = folder / name
    path.write_bytes(content)
    account = Account()
    frames: list[Frame] = []
    for batch in Asc(path).batches(account):
        frames += frames_of(batch)
    assert account.accepted == len(frames)
    return frames, account


@pytest.mark.parametrize("pack", [bytes, lambda log: log.replace(b"\n", b"\r\n"), gzip.compress])
def test_reads_every_kind_of_line(tmp_path: Path, pack: type[bytes]) -> None:
    frames, account = read(tmp_path, pack(LOG))
    assert frames == FRAMES
    assert account == Account(accepted=len(FRAMES))


@pytest.mark.parametrize(("block", "capacity"), [(1, 1000), (7, 4), (300, 1), (1000, 5)])
def test_blocks_and_batches_cut_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int, capacity: int
) -> None:
    monkeypatch.setattr(text_log, "BLOCK", block)
    monkeypatch.setattr(text_log, "BATCH", capacity)
    assert read(tmp_path, LOG) == (FRAMES, Account(accepted=len(FRAMES)))


def test_narrow_batches_are_narrow(tmp_path: Path) -> None:
    (tmp_path / "can.asc").write_bytes(GOOD)
    assert [batch.data.shape for batch in Asc(tmp_path / "can.asc").batches(Account())] == [(1, 8)]


def test_decimal_base(tmp_path: Path) -> None:
    log = (
        b"base dec  timestamps absolute\n"
        b"0.5 1 291 Rx d 3 0 17 255\n"
        b"0.5 2 418119424x Rx d 10 0 1 2 3 4 5 6 7 Length = 1\n"
        b"0.5 2 26 Rx d a 0 1 2 3 4 5 6 7\n"
        b"0.5 2 26 Rx r 10\n"
        b"0.5 CANFD 2 Rx 26x 0 0 9 12 0 1 2 3 4 5 6 7 8 9 10 255 1000 100 1000 0 0 0 0 0\n"
        b"0.5 2 418119424 Rx d 0\n"
        b"0.5 2 1A Rx d 0\n"
        b"0.5 2 26 Rx d 1 256\n"
        b"0.5 2 26 Rx d 1 1A\n"
    )
    frames, account = read(tmp_path, log)
    assert frames == [
        (500_000_000, "1", 291, False, False, "data", "0011FF"),
        (500_000_000, "2", 418119424, True, False, "data", "0001020304050607"),
        (500_000_000, "2", 26, False, False, "data", "0001020304050607"),
        (500_000_000, "2", 26, False, False, "remote", ""),
        (500_000_000, "2", 26, True, True, "data", "000102030405060708090AFF"),
    ]
    assert [where for where, _ in account.rejections] == ["line 7", "line 8", "line 9", "line 10"]


@pytest.mark.parametrize(
    ("date", "expected"),
    [
        ("Sat Sep 30 15:06:13.191 2017", "2017-09-30 15:06:13.191"),
        ("Sat Sep 30 03:06:13.191 pm 2017", "2017-09-30 15:06:13.191"),
        ("Sat Sep 30 12:06:13 am 2017", "2017-09-30 00:06:13.000"),
        ("Sat Sep 30 12:06:13 PM 2017", "2017-09-30 12:06:13.000"),
        ("Sat Sep 30 15:06:13.191 pm 2017", "2017-09-30 15:06:13.191"),
        ("Don Mär 1 05:06:13.050 2018", "2018-03-01 05:06:13.050"),
        ("Don Mrz 1 05:06:13 2018", "2018-03-01 05:06:13.000"),
        ("Die Mai 1 05:06:13 2018", "2018-05-01 05:06:13.000"),
        ("Mon Okt 1 05:06:13 2018", "2018-10-01 05:06:13.000"),
        ("Sam Dez 1 05:06:13.000 2018", "2018-12-01 05:06:13.000"),
        ("Sam Dezember 1 05:06:13 2018", "2018-12-01 05:06:13.000"),
        ("Sat Sep 30 15:06:13.7 2017", "2017-09-30 15:06:13.007"),
        ("Sat Sep 30 15:06:13.123456 2017", "2017-09-30 15:06:13.123456"),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_dates(tmp_path: Path, date: str, expected: str, encoding: str) -> None:
    moment = datetime.fromisoformat(expected).replace(tzinfo=UTC)
    zero = (int(moment.timestamp()) * 10**6 + moment.microsecond) * 1000
    content = f"date {date}\nbase hex timestamps absolute\n".encode(encoding)
    assert Asc.sniff(content)
    frames, account = read(tmp_path, content + GOOD)
    assert frames == [(zero + 500_000_000, "1", 0x123, False, False, "data", "1122")]
    assert account.rejected == 0


@pytest.mark.parametrize(
    "date",
    [
        "Sat Foo 30 15:06:13 2017",
        "Sat Feb 30 15:06:13 2017",
        "Sat Sep 30 25:06:13 2017",
        "Sat Sep 30 15:06:13 1969",
        "?",
    ],
)
@pytest.mark.parametrize("line", ["date", "Begin Triggerblock"])
def test_a_date_that_cannot_be_read_is_told(tmp_path: Path, date: str, line: str) -> None:
    frames, account = read(tmp_path, f"{line} {date}\n".encode() + GOOD)
    assert [frame[0] for frame in frames] == [500_000_000]
    assert account.rejections == [
        (
            "line 1",
            (
                "expected a date from 1970 to 2261 such as Mon Sep 30 15:06:13.191 2017 (am, pm or 24 hours); "
                f"found '{line} {date}'"
            ),
        )
    ]


def times(folder: Path, content: bytes) -> list[int]:
    return [frame[0] for frame in read(folder, content)[0]]


def frame_at(stamp: str) -> bytes:
    return f"{stamp} 1 123 Rx d 0\n".encode()


def test_relative_stamps_count_from_the_line_before_whatever_it_is(tmp_path: Path) -> None:
    log = HEADER.replace(b"absolute", b"relative") + (
        b"0.25 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%\n"
        + frame_at("0.25")
        + b"0.25 something else\n"
        + frame_at("0.000001")
    )
    assert times(tmp_path, log) == [ZERO + 500_000_000, ZERO + 750_001_000]


def test_a_header_that_says_absolute_of_relative_stamps_is_not_believed(tmp_path: Path) -> None:
    steps = [1, 3, 2, 5, 1, 4, 2, 3, 1, 5, 2, 4, 1, 2]
    log = HEADER + b"".join(frame_at(f"0.00{step}") for step in steps)
    assert times(tmp_path, log) == [ZERO + 1_000_000 * int(k) for k in np.cumsum(steps)]


def test_one_step_back_does_not_make_stamps_relative(tmp_path: Path) -> None:
    stamps = [1, 2, 3, 5, 4, 6, 7, 8, 9, 10, 11, 12, 13, 14]
    log = HEADER + b"".join(frame_at(f"0.{stamp:03d}") for stamp in stamps)
    assert times(tmp_path, log) == [ZERO + 1_000_000 * stamp for stamp in stamps]


def test_stamps_that_count_from_1970(tmp_path: Path) -> None:
    assert times(tmp_path, HEADER + frame_at("1436509052.249713")) == [1436509052_249713000]


def test_trigger_blocks(tmp_path: Path) -> None:
    begin = b"Begin Triggerblock Sat Sep 30 %b 2017\n"
    end = b"End TriggerBlock\n"
    log = (
        HEADER
        + (begin % b"15:06:18.000" + frame_at("4.5") + frame_at("5.0") + end)
        + (begin % b"15:06:23.000" + frame_at("9.5") + frame_at("9.25") + end)
        + (begin % b"16:00:00.000" + frame_at("0.0") + frame_at("0.5") + end)
        + (begin % b"17:00:00.000" + frame_at("0.25") + end)
    )
    four, five = 1506787200_000000000, 1506790800_000000000
    assert times(tmp_path, log) == [
        ZERO + 4_500_000_000,
        ZERO + 5_000_000_000,
        ZERO + 9_500_000_000,
        ZERO + 9_250_000_000,
        four,
        four + 500_000_000,
        five + 250_000_000,
    ]
    assert times(tmp_path, begin % b"16:00:00.000" + frame_at("0.5")) == [four + 500_000_000]


@pytest.mark.parametrize(
    "line",
    [
        "no internal events logged",
        "// 0.500000 1 123 Rx d 0",
        "Begin TriggerBlock",
        "base hex",
        "0.5 log trigger event",
        "0.5 log direct start (0ms)",
        "0.5 1 OverloadFrame",
        "0.5 CANFD 1 Statistic: D 0",
        "0.5 1 123x TxRq d 1 00",
        "0.5 CANFD 1 TxRq 123 0 0 0 0",
        "0.5 EnvSpeed := 12",
        "0.5 // remark",
        "0.5 Fr RMSG 0 0 1 1 1 11 Rx 0 4 10 10 00 00",
        "0.5 ETH 1 Rx 64:FF",
        "0.5 M1 Status",
        "0.5 TFS: [1 1] Test start",
    ],
)
def test_known_lines_that_are_no_frames(tmp_path: Path, line: str) -> None:
    frames, account = read(tmp_path, HEADER + GOOD + line.encode() + b"\n" + GOOD)
    assert [frame[0] for frame in frames] == [ZERO + 500_000_000] * 2
    assert account == Account(accepted=2)


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("hello", 0),
        ("Begin", 0),
        ("base oct", 0),
        ("nan 1 123 Rx d 0", 0),
        ("-0.5 1 123 Rx d 0", 0),
        ("0.5", 0),
        ("0.5 1", 0),
        ("0.5 1 123 Fx d 0", 0),
        ("0.5 can0 123 Rx d 0", 0),
        ("0.5 1234 123 Rx d 0", 0),
        ("0.5 CANFD 1 123 Rx 0 0 0 0", 0),
        ("5 1 123 Rx d 0", 1),
        ("0. 1 123 Rx d 0", 1),
        ("0.5s 1 123 Rx d 0", 1),
        ("0.0123456789 1 123 Rx d 0", 1),
        ("9223372036.5 1 123 Rx d 0", 2),
        ("9999999999.5 1 123 Rx d 0", 2),
        ("999999999999999999999.5 1 123 Rx d 0", 2),
        ("0.5 1 EngineData Rx d 0", 3),
        ("0.5 1 x Rx d 0", 3),
        ("0.5 1 123456789AB Rx d 0", 3),
        ("0.5 1 800 Rx d 0", 4),
        ("0.5 CANFD 1 Rx 800 0 0 0 0", 4),
        ("0.5 1 20000000x Rx d 0", 5),
        ("0.5 1 123 Rx", 6),
        ("0.5 1 123 Rx e 0", 6),
        ("0.5 1 123 Rx d", 7),
        ("0.5 1 123 Rx d 10 00", 7),
        ("0.5 1 123 Rx d 008", 7),
        ("0.5 1 123 Rx d G", 7),
        ("0.5 CANFD 1 Rx 123 0 0 g 0", 7),
        ("0.5 1 123 Rx d 2 11", 8),
        ("0.5 1 123 Rx d 2 11 Length = 5", 8),
        ("0.5 CANFD 1 Rx 123 0 0 2 2 11", 8),
        ("0.5 1 123 Rx d 2 11 2", 9),
        ("0.5 1 123 Rx d 2 11 222", 9),
        ("0.5 1 123 Rx d 2 11 2G", 9),
        ("0.5 1 123 Rx d 2 11 22 33", 10),
        ("0.5 1 123 Rx r 8 33", 10),
        ("0.5 CANFD 1 Rx 123", 11),
        ("0.5 CANFD 1 Rx 123 name 0 2 0 0", 11),
        ("0.5 CANFD 1 Rx 123 0 0 9 9 11 11 11 11 11 11 11 11 11", 12),
        ("0.5 CANFD 1 Rx 123 0 0 f 65 11", 12),
        ("0.5 CANFD 1 Rx 123 0 0 2 2 11 22 0 0 zz 0 0 0 0 0", 13),
    ],
)
def test_rejects_with_line_and_reason(tmp_path: Path, line: str, code: int) -> None:
    frames, account = read(tmp_path, HEADER + GOOD + line.encode() + b"\n" + GOOD)
    assert [frame[6] for frame in frames] == ["1122", "1122"]
    assert account == Account(accepted=2, rejected=1, rejections=[("line 5", f"{asc.REASONS[code]}; found {line!r}")])


def test_rejections_read_like_this(tmp_path: Path) -> None:
    _, account = read(tmp_path, b"0.5 1 800 Rx d 0\n\n0.5 1 123 Rx d 2 11\n" + b"x" * 70_000 + b"\n0.5 1 123 Rx d 1 1")
    assert account == Account(
        rejected=4,
        truncated=True,
        rejections=[
            (
                "line 1",
                "the identifier is beyond 11 bits (7FF); identifiers of 29 bits end in x; found '0.5 1 800 Rx d 0'",
            ),
            ("line 3", "fewer bytes than the line's own length; found '0.5 1 123 Rx d 2 11'"),
            ("line 4", f"longer than 65536 bytes, no line of this format; found '{'x' * 80}' and more"),
            (
                "line 5",
                (
                    "the file ends within this line: expected bytes in the base that the header names: 2 hex digits, "
                    "or decimal 0 to 255; found '0.5 1 123 Rx d 1 1'"
                ),
            ),
        ],
    )


def test_more_channels_than_there_are(tmp_path: Path) -> None:
    frames, account = read(tmp_path, b"".join(b"0.5 %d 123 Rx d 0\n" % k for k in (*range(257), 0)))
    assert [frame[1] for frame in frames] == [str(k) for k in (*range(256), 0)]
    assert account.rejections == [
        ("line 257", "one channel more than the 256 that a log may have; found '0.5 256 123 Rx d 0'")
    ]


def test_cut_at_every_byte(tmp_path: Path) -> None:
    ends = [k + 1 for k, byte in enumerate(LOG) if byte == 10]
    whole = [len(read(tmp_path, LOG[:end])[0]) for end in [0, *ends]]
    assert whole[-1] == len(FRAMES)
    for cut in range(0, len(LOG), 3):
        frames, account = read(tmp_path, LOG[:cut])
        line = sum(end <= cut for end in ends)
        assert len(frames) in (whole[line], whole[line + 1])
        assert frames == FRAMES[: len(frames)], "a frame that is cut is not taken for another one"
        assert account.truncated == (account.rejected == 1)
        if whole[line + 1] > len(frames) and LOG[[0, *ends][line] : cut].strip():
            assert account.truncated
            assert account.rejections[0][1].startswith("the file ends within this line: ")


def test_a_cut_decimal_byte_is_not_taken_for_a_smaller_one(tmp_path: Path) -> None:
    _, account = read(tmp_path, b"base dec\n0.5 1 123 Rx d 1 25")
    assert account.rejections == [
        ("line 2", "the file ends within this line: the last number may be cut; found '0.5 1 123 Rx d 1 25'")
    ]
    assert account.truncated


def test_cut_gzip_gives_what_stands_before(tmp_path: Path) -> None:
    frames, account = read(tmp_path, gzip.compress(LOG, mtime=0)[:-300])
    assert 0 < len(frames) < len(FRAMES)
    assert frames == FRAMES[: len(frames)]
    assert account.truncated


def test_mutations_end_as_a_result(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        log = bytearray(LOG)
        for place in rng.integers(0, len(log), rng.integers(1, 9)):
            log[place] = rng.integers(0, 256)
        frames, account = read(tmp_path, bytes(log))
        assert len(frames) + account.rejected <= log.count(b"\n") + 1
        assert len(frames) + account.rejected >= len(FRAMES) - 9


def test_noise_ends_as_a_result(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    alphabet = np.frombuffer(b"0123456789abcdefx.  \t\n\nRxTxdrCANFDErrorFrame", np.uint8)
    for alphabet_or_any in (alphabet, np.arange(256, dtype=np.uint8)):
        noise = rng.choice(alphabet_or_any, 100_000).tobytes()
        frames, account = read(tmp_path, noise)
        lines = sum(bool(line.strip(b" \t\r")) for line in noise.split(b"\n"))
        assert len(frames) + account.rejected == lines


messages = st.lists(
    st.tuples(
        st.integers(0, 10_000_000),
        st.integers(0, 3),
        st.integers(0, 0x7FF) | st.integers(0x800, 0x1FFFFFFF),
        st.booleans(),
        st.sampled_from(["data", "remote", "error", "fd"]),
        st.binary(max_size=64),
    ),
    min_size=1,
    max_size=20,
)


@given(st.integers(200_000_000, 2_000_000_000_000), messages)
def test_reads_what_python_can_writes(
    tmp_path_factory: pytest.TempPathFactory, start_ms: int, rows: list[tuple[int, int, int, bool, str, bytes]]
) -> None:
    path = tmp_path_factory.mktemp("asc") / "can.asc"
    # The writer's date is the local time; what it reads as UTC is what the reader has to give.
    local = datetime.fromtimestamp(start_ms / 1000).replace(microsecond=start_ms % 1000 * 1000)  # noqa: DTZ006
    zero = int((local.replace(tzinfo=UTC) - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds() * 1000) * 10**6
    expected: list[Frame] = []
    with can.ASCWriter(path) as writer:
        elapsed = 0
        for k, (step, channel, number, wide, kind, payload) in enumerate(rows):
            elapsed += step if k else 0
            extended = wide or number > 0x7FF
            size = max(n for n in (*range(9), 12, 16, 20, 24, 32, 48, 64) if n <= len(payload))
            size = 0 if kind in ("remote", "error") else size if kind == "fd" else min(size, 8)
            writer.on_message_received(
                can.Message(
                    timestamp=local.timestamp() + elapsed / 1e6,
                    channel=channel,
                    arbitration_id=number,
                    is_extended_id=extended,
                    is_fd=kind == "fd",
                    is_remote_frame=kind == "remote",
                    is_error_frame=kind == "error",
                    data=payload[:size],
                    is_rx=step % 2 == 0,
                )
            )
            known = (0, False) if kind == "error" else (number, extended)
            name = "data" if kind == "fd" else kind
            expected.append(
                (zero + elapsed * 1000, str(channel + 1), *known, kind == "fd", name, payload[:size].hex().upper())
            )
    frames, account = read(path.parent, path.read_bytes())
    assert [frame[1:] for frame in frames] == [frame[1:] for frame in expected]
    # The writer subtracts floats, which lose up to half a microsecond.
    assert max(abs(a[0] - b[0]) for a, b in zip(frames, expected, strict=True)) <= 1000
    assert account == Account(accepted=len(rows))


@pytest.mark.parametrize(
    ("head", "claimed"),
    [
        (LOG, True),
        (b"\xef\xbb\xbf" + LOG, True),
        (b"// comment\n\n" + LOG, True),
        (GOOD, True),
        (b"base dec\n", True),
        (b"0.5 CANFD 1 Rx 123 0 0 0 0\n", True),
        (b"0.5 1 ErrorFrame\n", True),
        (b"(1436509052.249713) can0 044#2A366C2BBA\n", False),
        (b" (1436509052.249713)  can0  044   [1]  2A\n", False),
        (b";$FILEVERSION=1.1\n", False),
        (b"1)  17535.4  Rx   0123  2 00 01\n", False),
        (b"timestamp,arbitration_id,extended,remote,error,dlc,data\n", False),
        (b"Time Stamp,ID,Extended,Dir,Bus,LEN,D1\n", False),
        (b"date,speed\n2017-09-30,1\n", False),
        (b"0.5 1.0 2.0\n", False),
        (b"LOGG" + bytes(100), False),
        (b"\xe7" * 72, False),
        (b"$GPRMC,123519,A,4807.038,N\n", False),
        (b" \n" * 30_000, False),
        (b"//" * 30_000, False),
        (b"", False),
    ],
)
def test_sniff(head: bytes, claimed: bool) -> None:
    assert Asc.sniff(head) is claimed


def test_a_byte_order_mark_is_passed_over(tmp_path: Path) -> None:
    frames, account = read(tmp_path, b"\xef\xbb\xbf" + LOG)
    assert (frames, account) == (FRAMES, Account(accepted=len(FRAMES)))


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        list(Asc(tmp_path / "can.asc").batches(Account()))
    assert caught.value.reason == "no such file; check the path, or whether the disk is mounted"
