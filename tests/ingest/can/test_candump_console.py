from __future__ import annotations

import gzip
import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.ingest.can.plain_frames import Frame, frames_of
from wheelprint.ingest.account import Account
from wheelprint.ingest.can import candump_console, text_log
from wheelprint.ingest.can.candump_console import CandumpConsole
from wheelprint.schemas.errors import InputError

GOOD = b" (1436509052.249713)  can0  044   [5]  2A 36 6C 2B BA\n"
TIME = 1436509052_249713000
STAMP = "(1436509052.249713)  "

LOG = b""" (1436509052.249713)  can0  123   [8]  11 22 33 44 55 66 77 88
 (1436509052.249713)  can0       123   [3]  11 22 33
 (1436509052.249713)   can0  TX - -  123   [2]  11 27   '.''
 (1436509052.249713)  vcan1  RX B E  12345678  [12]  11 22 33 44 55 66 77 88 99 AA BB CC   '."3DUfw.....'
 (1436509052.249713)  can0  7FF  [00]
 (1436509052.249713)  can0  123   [0]\x20
 (1436509052.249713)  can0  00000123   [8]  remote request
 (1436509052.249713)  can0  123   {F}  11 22 33 44 55 66 77 88
 (1436509052.249713)  can0  123   {2}  remote request
 (1436509052.249713)  can0  20000084   [8]  00 04 00 00 00 00 00 00   ERRORFRAME
\tcontroller-problem{rx-error-warning}
\tbus-error
 (2016-02-29 23:59:59.000001)  can0  123   [1]  FF
(1436509052.1) c 1FFFFFFF [1] 0f
"""
ODDS = ("can0", 0x123, False, False)
FRAMES: list[Frame] = [
    (TIME, *ODDS, "data", "1122334455667788"),
    (TIME, *ODDS, "data", "112233"),
    (TIME, *ODDS, "data", "1127"),
    (TIME, "vcan1", 0x12345678, True, True, "data", "112233445566778899AABBCC"),
    (TIME, "can0", 0x7FF, False, True, "data", ""),
    (TIME, *ODDS, "data", ""),
    (TIME, "can0", 0x123, True, False, "remote", ""),
    (TIME, *ODDS, "data", "1122334455667788"),
    (TIME, *ODDS, "remote", ""),
    (TIME, "can0", 0x84, True, False, "error", "0004000000000000"),
    (1456790399_000001000, *ODDS, "data", "FF"),
    (1436509052_100000000, "c", 0x1FFFFFFF, True, False, "data", "0F"),
]


def read(folder: Path, content: bytes, name: str = "can.txt") -> tuple[list[Frame], Account]:
    path = folder / name
    path.write_bytes(content)
    account = Account()
    frames: list[Frame] = []
    for batch in CandumpConsole(path).batches(account):
        frames += frames_of(batch)
    assert account.accepted == len(frames)
    return frames, account


@pytest.mark.parametrize("pack", [bytes, lambda log: log.replace(b"\n", b"\r\n"), gzip.compress])
def test_reads_every_kind_of_line(tmp_path: Path, pack: type[bytes]) -> None:
    assert read(tmp_path, pack(LOG)) == (FRAMES, Account(accepted=len(FRAMES)))


@pytest.mark.parametrize(("block", "capacity"), [(1, 1000), (7, 4), (300, 1), (1000, 5)])
def test_blocks_and_batches_cut_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int, capacity: int
) -> None:
    monkeypatch.setattr(text_log, "BLOCK", block)
    monkeypatch.setattr(text_log, "BATCH", capacity)
    assert read(tmp_path, LOG) == (FRAMES, Account(accepted=len(FRAMES)))


def times(folder: Path, stamps: list[str]) -> list[int]:
    log = "".join(f" ({stamp})  can0  123   [0]\n" for stamp in stamps)
    return [frame[0] for frame in read(folder, log.encode())[0]]


def test_stamps_from_the_first_frame(tmp_path: Path) -> None:
    stamps = ["000.000000", "000.250000", "000.250001", "001.000000"]
    assert times(tmp_path, stamps) == [0, 250_000_000, 250_001_000, 1_000_000_000]


def test_stamps_from_the_frame_before(tmp_path: Path) -> None:
    stamps = ["000.000000", "000.250000", "000.000001", "001.000000", "000.5"]
    assert times(tmp_path, stamps) == [0, 250_000_000, 250_001_000, 1_250_001_000, 1_750_001_000]


def test_times_of_day_are_never_relative(tmp_path: Path) -> None:
    stamps = ["1436509052.5", "1436509052.25", "1436509052.125"]
    assert times(tmp_path, stamps) == [1436509052_500000000, 1436509052_250000000, 1436509052_125000000]


@given(st.datetimes(datetime(1970, 1, 1), datetime(2261, 12, 31)))  # noqa: DTZ001  candump -tA has no zone
def test_dates(tmp_path_factory: pytest.TempPathFactory, date: datetime) -> None:
    since = date.replace(tzinfo=UTC) - datetime(1970, 1, 1, tzinfo=UTC)
    expected = ((since.days * 86_400 + since.seconds) * 10**6 + since.microseconds) * 1000
    assert times(tmp_path_factory.mktemp("console"), [f"{date:%Y-%m-%d %H:%M:%S.%f}"]) == [expected]


def test_frames_without_time_are_rejected(tmp_path: Path) -> None:
    frames, account = read(tmp_path, b"  can0  123   [2]  11 22\n  can0  RX - -  123   [0] \n")
    assert frames == []
    reason = (
        "no time: candump was started without one of -ta, -tA, -tz, -td; frames without time cannot be used, "
        "record again; found "
    )
    assert account == Account(
        rejected=2,
        rejections=[
            ("line 1", reason + "'can0  123   [2]  11 22'"),
            ("line 2", reason + "'can0  RX - -  123   [0]'"),
        ],
    )


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("hello", 1),
        ("(nan)  can0  123   [0]", 1),
        ("(1.)  can0  123   [0]", 1),
        ("(-1.5)  can0  123   [0]", 1),
        ("(1.5)can0  123   [0]", 1),
        ("(1.5)", 1),
        ("(1436509052.249713) can0 044#2A366C2BBA", 6),
        ("(2015-02-29 06:17:32.249713)  can0  123   [0]", 1),
        ("(2015-13-01 06:17:32.249713)  can0  123   [0]", 1),
        ("(2015-12-00 06:17:32.249713)  can0  123   [0]", 1),
        ("(2015-12-01 24:17:32.249713)  can0  123   [0]", 1),
        ("(2015-12-01 06:17:60.249713)  can0  123   [0]", 1),
        ("(2262-12-01 06:17:32.249713)  can0  123   [0]", 1),
        ("can0  123   [2]  11", 1),
        ("(9223372036.5)  can0  123   [0]", 3),
        ("(9999999999.5)  can0  123   [0]", 3),
        (STAMP + "x" * 33 + " 123 [0]", 4),
        (STAMP + "can0", 4),
        (STAMP + "can0  RX B B  123   [0]", 5),
        (STAMP + "can0  TX E -  123   [0]", 5),
        (STAMP + "can0  12   [0]", 6),
        (STAMP + "can0  12G   [0]", 6),
        (STAMP + "can0  123#   [0]", 6),
        (STAMP + "can0  XX - -  123   [0]", 6),
        (STAMP + "can0  800   [0]", 7),
        (STAMP + "can0  40000000   [0]", 8),
        (STAMP + "can0  123", 9),
        (STAMP + "can0  123   []", 9),
        (STAMP + "can0  123   [9]  11 22 33 44 55 66 77 88 99", 9),
        (STAMP + "can0  123   [A]", 9),
        (STAMP + "can0  123   {G}", 9),
        (STAMP + "can0  123   [064]", 9),
        (STAMP + "can0  123  [09]  11 22 33 44 55 66 77 88 99", 10),
        (STAMP + "can0  123   [2]  11", 11),
        (STAMP + "can0  123   [2]  11   '.'", 12),
        (STAMP + "can0  123   [2]  11 2", 12),
        (STAMP + "can0  123   [2]  11 222", 12),
        (STAMP + "can0  123   [2]  00010001 00010001", 12),
        (STAMP + "can0  123   [2]  22`11", 12),
        (STAMP + "can0  123  [02]  remote request", 12),
        (STAMP + "can0  123   [2]  11 22 33", 13),
        (STAMP + "can0  123   [2]  11 22   '.", 13),
        (STAMP + "can0  123   [2]  11 22   ERRORFRAME", 13),
        (STAMP + "can0  123   [2]  remote", 13),
        (STAMP + "can0  123   [2]  remote request now", 13),
        (STAMP + "can0  20000004   [1]  00   ERRORFRAME x", 13),
    ],
)
def test_rejects_with_line_and_reason(tmp_path: Path, line: str, code: int) -> None:
    frames, account = read(tmp_path, GOOD + b"\n" + line.encode() + b"\n" + GOOD)
    assert [frame[6] for frame in frames] == ["2A366C2BBA"] * 2
    reason = f"{candump_console.REASONS[code]}; found {line!r}"
    assert account == Account(accepted=2, rejected=1, rejections=[("line 3", reason)])


def test_indented_lines_are_explanations_only_below_an_error_frame(tmp_path: Path) -> None:
    log = b"\tbus-error\n" + GOOD + b"\tbus-error\n" + LOG.splitlines()[9] + b"\n\t" + GOOD
    frames, account = read(tmp_path, log)
    assert [frame[5] for frame in frames] == ["data", "error", "data"]
    reason = (
        "expected a time at the start: (1436509052.249713) as of candump -ta, or (2015-07-10 06:17:32.249713) "
        "as of -tA; found 'bus-error'"
    )
    assert account.rejections == [("line 1", reason), ("line 3", reason)]


def test_relative_stamps_beyond_what_time_can_hold(tmp_path: Path) -> None:
    stamps = ["9.0", "8.0"] * 3
    log = "".join(f" ({stamp})  can0  123   [0]\n" for stamp in [*stamps, "9223372035.0", "2.0"])
    frames, account = read(tmp_path, log.encode())
    assert frames[-1][0] == 9223372035 * 10**9
    assert [where for where, _ in account.rejections] == ["line 8"]


def test_more_interfaces_than_there_are(tmp_path: Path) -> None:
    lines = b"".join(b" (1.5)  can%d  123   [0]\n" % k for k in (*range(257), 0))
    frames, account = read(tmp_path, lines)
    assert [frame[1] for frame in frames] == [f"can{k}" for k in (*range(256), 0)]
    assert account.rejections == [
        ("line 257", "one channel more than the 256 that a log may have; found '(1.5)  can256  123   [0]'")
    ]


def test_cut_at_every_byte(tmp_path: Path) -> None:
    ends = [k + 1 for k, byte in enumerate(LOG) if byte == 10]
    whole = [len(read(tmp_path, LOG[:end])[0]) for end in [0, *ends]]
    assert whole[-1] == len(FRAMES)
    for cut in range(len(LOG)):
        frames, account = read(tmp_path, LOG[:cut])
        line = sum(end <= cut for end in ends)
        assert len(frames) in (whole[line], whole[line + 1])
        assert frames == FRAMES[: len(frames)], "a frame that is cut is not taken for another one"
        assert account.truncated == (account.rejected == 1)
        if whole[line + 1] > len(frames) and LOG[[0, *ends][line] : cut].strip():
            assert account.truncated
            assert account.rejections[0][1].startswith("the file ends within this line: ")


def test_an_empty_frame_at_the_cut_may_be_a_remote_one(tmp_path: Path) -> None:
    _, account = read(tmp_path, b"(1.5)  can0  123   [0]")
    assert account == Account(
        rejected=1,
        truncated=True,
        rejections=[
            (
                "line 1",
                ("the file ends within this line: what follows the length may be cut; found '(1.5)  can0  123   [0]'"),
            )
        ],
    )


def test_cut_gzip_gives_what_stands_before(tmp_path: Path) -> None:
    frames, account = read(tmp_path, gzip.compress(LOG, mtime=0)[:-40])
    assert 0 < len(frames) < len(FRAMES)
    assert frames == FRAMES[: len(frames)]
    assert account.truncated


BYTES = "( +[0-9A-F]{2})"
SIZES = "|".join(
    rf"\[{n}\]{BYTES}{{{n}}}|\[{n:02}\]{BYTES}{{{n}}}" if n < 9 else rf"\[{n}\]{BYTES}{{{n}}}"
    for n in (*range(9), 12, 16, 20, 24, 32, 48, 64)
)
SHAPE = re.compile(
    (
        r"[ \t\r]*\(\d{1,9}\.\d{1,9}\) +[^\x00- ]{1,32} +([RT]X +[-B] +[-E] +)?([0-7][0-9A-F]{2}|[01][0-9A-F]{7}) +"
        rf"({SIZES}|\[[0-8]\] +remote +request)( +'.*')?[ \t\r]*"
    ).encode(),
    re.DOTALL,
)


@given(
    st.sampled_from(
        [b"(1.5)  can0  123   [2]  11 22", b"(1.5)  can0  RX B E  123   [1]  11  '.'", LOG.splitlines()[3]]
    ),
    st.lists(
        st.tuples(st.integers(0, 60), st.sampled_from([b"", b"1", b" ", b"[", b"]", b"'", b"3F", b"R"])), max_size=3
    ),
)
def test_agrees_with_a_regular_expression(
    tmp_path_factory: pytest.TempPathFactory, line: bytes, edits: list[tuple[int, bytes]]
) -> None:
    for place, replacement in edits:
        k = place % len(line)
        line = line[:k] + replacement + line[k + 1 :]
    line = line.replace(b"(1436509052.", b"(1.")
    frames, account = read(tmp_path_factory.mktemp("console"), line + b"\n")
    remark = re.search(rb"remote.*'", line)
    assert len(frames) == (SHAPE.fullmatch(line) is not None and not remark)
    assert len(frames) + account.rejected == 1


def test_mutations_end_as_a_result(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        log = bytearray(LOG)
        for place in rng.integers(0, len(log), rng.integers(1, 9)):
            log[place] = rng.integers(0, 256)
        frames, account = read(tmp_path, bytes(log))
        assert len(FRAMES) - 9 <= len(frames) + account.rejected <= log.count(b"\n") + 1


def test_noise_ends_as_a_result(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    for alphabet in (np.frombuffer(b"0123456789ABCDEF(.)[]{}'  \n\ncanRTX-", np.uint8), np.arange(256, dtype=np.uint8)):
        noise = rng.choice(alphabet, 100_000).tobytes()
        frames, account = read(tmp_path, noise)
        lines = sum(bool(line.strip(b" \t\r")) for line in noise.split(b"\n"))
        assert len(frames) + account.rejected == lines


@pytest.mark.parametrize(
    ("head", "claimed"),
    [
        (LOG, True),
        (b"\n\n" + GOOD, True),
        (b" (2015-07-10 06:17:32.249713)  can0  123   [1]  FF\n", True),
        (b" (000.000000)  can0  TX - -  12345678  [12]  11 22\n", True),
        (b"  can0  123   [2]  11 22\n", True),
        (b"  can0  123   [0]", True),
        (b"(1436509052.249713) can0 044#2A366C2BBA\n", False),
        (b"0.5 1 123 Rx d 1 00\n", False),
        (b"date Sat Sep 30 15:06:13.191 2017\n", False),
        (b";$FILEVERSION=1.1\n", False),
        (b"1)  17535.4  Rx   0123  2 00 01\n", False),
        (b"timestamp,arbitration_id,extended,remote,error,dlc,data\n", False),
        (b"LOGG" + bytes(100), False),
        (b"\xe7" * 72, False),
        (b"$GPRMC,123519,A,4807.038,N\n", False),
        (b"49.015 8.43 112.8 0.03 0.01 -2.1\n", False),
        (b" " * 65_536, False),
        (b"(1.5) " * 10_000, False),
        (b"", False),
    ],
)
def test_sniff(head: bytes, claimed: bool) -> None:
    assert CandumpConsole.sniff(head) is claimed


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        list(CandumpConsole(tmp_path / "can.txt").batches(Account()))
    assert caught.value.reason == "no such file; check the path, or whether the disk is mounted"
