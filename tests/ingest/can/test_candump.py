from __future__ import annotations

import gzip
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.ingest.can.plain_frames import Frame, frames_of
from wheelprint.ingest.account import Account
from wheelprint.ingest.can import candump, text_log
from wheelprint.ingest.can.candump import Candump
from wheelprint.ingest.can.candump_writer import write_candump
from wheelprint.ingest.can.frames import DATA, ERROR, REMOTE, FrameBatch
from wheelprint.schemas.errors import InputError

HALF = 1_500_000_000
GOOD = b"(1436509052.249713) can0 044#2A366C2BBA\n"


def read(folder: Path, content: bytes, name: str = "can.log") -> tuple[list[Frame], Account]:
    path = folder / name
    path.write_bytes(content)
    account = Account()
    frames = [frame for batch in Candump(path).batches(account) for frame in frames_of(batch)]
    assert account.accepted == len(frames)
    return frames, account


@pytest.mark.parametrize(
    ("line", "frame"),
    [
        (GOOD[:-1].decode(), (1436509052_249713000, "can0", 0x44, False, False, "data", "2A366C2BBA")),
        ("(0.0) vcan1 7FF#", (0, "vcan1", 0x7FF, False, False, "data", "")),
        ("(1.000000001) can0 000#00", (1_000_000_001, "can0", 0, False, False, "data", "00")),
        ("(9223372035.999999999) c 001#", (9223372035_999999999, "c", 1, False, False, "data", "")),
        ("(1.5) can0 1FFFFFFF#ffeeddccbbaa9988", (HALF, "can0", 0x1FFFFFFF, True, False, "data", "FFEEDDCCBBAA9988")),
        ("(1.5) can0 00000123#1122334455667788_9", (HALF, "can0", 0x123, True, False, "data", "1122334455667788")),
        ("(1.5) can0 123##1", (HALF, "can0", 0x123, False, True, "data", "")),
        ("(1.5) can0 123##5" + "5A" * 64, (HALF, "can0", 0x123, False, True, "data", "5A" * 64)),
        ("(1.5) can0 123#R", (HALF, "can0", 0x123, False, False, "remote", "")),
        ("(1.5) can0 00000123#R8", (HALF, "can0", 0x123, True, False, "remote", "")),
        ("(1.5) can0 20000080#0000000000000001", (HALF, "can0", 0x80, True, False, "error", "0000000000000001")),
        ("(1.5) can0 123#11 R", (HALF, "can0", 0x123, False, False, "data", "11")),
        ("(1.5) can0 123#R2 T", (HALF, "can0", 0x123, False, False, "remote", "")),
        ("  (1.5)\tcan0   123##011  T \r", (HALF, "can0", 0x123, False, True, "data", "11")),
    ],
)  # fmt: skip
def test_reads_every_kind_of_line(tmp_path: Path, line: str, frame: Frame) -> None:
    frames, account = read(tmp_path, line.encode() + b"\n")
    assert frames == [frame]
    assert account == Account(accepted=1)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("hello", candump.REASONS[1]),
        ("can0 044#2A", candump.REASONS[1]),
        ("(nan) can0 044#2A", candump.REASONS[1]),
        ("(inf) can0 044#2A", candump.REASONS[1]),
        ("() can0 044#2A", candump.REASONS[1]),
        ("(12) can0 044#2A", candump.REASONS[1]),
        ("(-1.5) can0 044#2A", candump.REASONS[1]),
        ("(1.) can0 044#2A", candump.REASONS[1]),
        ("(.5) can0 044#2A", candump.REASONS[1]),
        ("(1.0123456789) can0 044#2A", candump.REASONS[1]),
        ("(9223372036.0) can0 044#2A", candump.REASONS[2]),
        ("(92233720360000000000000000.0) can0 044#2A", candump.REASONS[2]),
        ("(1.5)can0 044#2A", candump.REASONS[3]),
        ("(1.5) " + "x" * 33 + " 044#2A", candump.REASONS[3]),
        ("(1.5) 044#2A ", candump.REASONS[3]),
        ("(1.5) can0 44#2A", candump.REASONS[4]),
        ("(1.5) can0 0044#2A", candump.REASONS[4]),
        ("(1.5) can0 000000044#2A", candump.REASONS[4]),
        ("(1.5) can0 #2A", candump.REASONS[4]),
        ("(1.5) can0 044 2A", candump.REASONS[4]),
        ("(1.5) can0  044  [1]  2A", candump.REASONS[4]),
        ("(1.5) can0 800#2A", candump.REASONS[5]),
        ("(1.5) can0 40000000#2A", candump.REASONS[6]),
        ("(1.5) can0 A0000080#2A", candump.REASONS[6]),
        ("(1.5) can0 123#001", candump.REASONS[7]),
        ("(1.5) can0 123#001 R", candump.REASONS[7]),
        ("(1.5) can0 123#0G", candump.REASONS[8]),
        ("(1.5) can0 123#00-11", candump.REASONS[8]),
        ("(1.5) can0 123#1122_9", candump.REASONS[8]),
        ("(1.5) can0 123#1122334455667788_8", candump.REASONS[8]),
        ("(1.5) can0 20000080#R", candump.REASONS[8]),
        ("(1.5) can0 123#" + "11" * 12, candump.REASONS[9]),
        ("(1.5) can0 123##G", candump.REASONS[10]),
        ("(1.5) can0 123## 11", candump.REASONS[10]),
        ("(1.5) can0 123##1" + "11" * 9, candump.REASONS[11]),
        ("(1.5) can0 123##1" + "11" * 65, candump.REASONS[11]),
        ("(1.5) can0 123#R9", candump.REASONS[12]),
        ("(1.5) can0 123#R88", candump.REASONS[12]),
        ("(1.5) can0 123#11 X", candump.REASONS[13]),
        ("(1.5) can0 123#11 R T", candump.REASONS[13]),
        ("(1.5) can0 123#11 22", candump.REASONS[13]),
    ],
)
def test_rejects_with_line_and_reason(tmp_path: Path, line: str, reason: str) -> None:
    frames, account = read(tmp_path, GOOD + b"\n" + line.encode() + b"\n" + GOOD)
    assert len(frames) == 2
    line = line.strip()
    found = f"{line!r}" if len(line) <= 80 else f"{line[:80]!r} and more"
    assert account == Account(accepted=2, rejected=1, rejections=[("line 3", f"{reason}; found {found}")])


def test_a_rejection_reads_like_this(tmp_path: Path) -> None:
    _, account = read(tmp_path, b"(1.5) can0 123#001\n(1.5) can0 800#\n\xff\x00\n")
    assert account.rejections == [
        ("line 1", "odd number of hex digits: half a byte of the payload is lost; found '(1.5) can0 123#001'"),
        (
            "line 2",
            "the identifier is beyond 11 bits (7FF); identifiers of 29 bits have 8 digits; found '(1.5) can0 800#'",
        ),
        (
            "line 3",
            (
                "expected a time such as (1436509052.249713) at the start: seconds, a point, 1 to 9 digits; "
                "found '\\\\xff\\x00'"
            ),
        ),
    ]


BYTE, BLANK = "[0-9A-F]{2}", r"[ \t\r]"
CLASSIC = f"({BYTE}){{0,7}}|({BYTE}){{8}}(_[9A-F])?"
FD = "|".join(f"({BYTE}){{{size}}}" for size in ("0,8", "12", "16", "20", "24", "32", "48", "64"))
DATA_FRAME = f"([0-7][0-9A-F]{{2}}|[01][0-9A-F]{{7}})#(R([0-8](_[9A-F])?)?|{CLASSIC}|#[0-9A-F]({FD}))"
ERROR_FRAME = f"[23][0-9A-F]{{7}}#({CLASSIC})"
SHAPE = re.compile(
    (
        rf"{BLANK}*\((\d+)\.\d{{1,9}}\){BLANK}+[^\x00- ]{{1,32}}{BLANK}+({DATA_FRAME}|{ERROR_FRAME})"
        rf"({BLANK}+[RT])?{BLANK}*"
    ).encode(),
    re.IGNORECASE,
)
SAMPLES = (
    b"(1436509052.249713) can0 044#2A366C2BBA",
    b"(1.5) can0 1FFFFFFF#1122334455667788_9 R",
    b"(1.5) can12 123##5" + b"5A" * 12,
    b"(1.5) can0 123#R8 T",
    b"(1.5) can0 20000080#0000000000000001",
)


@given(
    st.sampled_from(SAMPLES),
    st.lists(
        st.tuples(
            st.integers(0, 60), st.sampled_from(["delete", "double", "digit", "any"]), st.binary(min_size=1, max_size=1)
        )
    ),
)
def test_agrees_with_a_regular_expression(
    tmp_path_factory: pytest.TempPathFactory, line: bytes, edits: list[tuple[int, str, bytes]]
) -> None:
    for place, edit, byte in edits[:4]:
        k = place % max(1, len(line))
        replacement = {"delete": b"", "double": line[k : k + 1] * 2, "digit": b"7", "any": byte}[edit]
        line = line[:k] + replacement + line[k + 1 :]
    line = line.replace(b"\n", b"#")
    frames, account = read(tmp_path_factory.mktemp("candump"), line + b"\n")
    match = SHAPE.fullmatch(line)
    expected = match is not None and int(match[1]) <= 9223372035
    assert len(frames) == expected
    assert account.rejected == (not expected and line.strip(b" \t\r") != b"")


ORDINARY = (
    b"(1436509052.249713) can0 044#2A366C2BBA",
    b"(9223372035.999999) vcan0 7FF#1122334455667788",
    b"(0000000000.000001) c 00000123#",
)


@given(
    st.lists(st.sampled_from(ORDINARY), min_size=1, max_size=4),
    st.lists(st.tuples(st.integers(0, 200), st.sampled_from(b"0123456789afAF()#._ \tR\r\nT/:@G`g\xe7")), max_size=3),
)
def test_an_ordinary_line_says_what_it_says_with_a_blank_before_it(
    tmp_path_factory: pytest.TempPathFactory, lines: list[bytes], edits: list[tuple[int, int]]
) -> None:
    content = bytearray(b"\n".join(lines) + b"\n")
    for place, byte in edits:
        content[place % (len(content) - 1)] = byte
    folder = tmp_path_factory.mktemp("candump")
    frames, account = read(folder, bytes(content))
    # No line that begins with a blank is an ordinary one; the exact walk, which reads those, is tested above.
    exact = read(folder, b"".join(b" " + line + b"\n" for line in content.split(b"\n")[:-1]), "blanks.log")
    assert (frames, account) == exact


batches = st.lists(
    st.tuples(
        st.integers(0, 9223372035_999999999) | st.integers(0, 9223372035_999999).map(lambda us: us * 1000),
        st.sampled_from(["can0", "can1", "vcan0", "x" * 32, "schnittstelle_ü"]),
        st.integers(0, 0x7FF) | st.integers(0x800, 0x1FFFFFFF),
        st.booleans(),
        st.sampled_from(["data", "remote", "error", "fd"]),
        st.binary(max_size=64),
    ),
    max_size=30,
)


def make_batch(rows: list[tuple[Any, ...]], width: int = 64) -> FrameBatch:
    n = len(rows)
    channels = tuple(dict.fromkeys(row[1] for row in rows))
    kinds = {"data": DATA, "fd": DATA, "remote": REMOTE, "error": ERROR}
    kind = np.array([kinds[row[4]] for row in rows], np.uint8)
    fd = np.array([row[4] == "fd" for row in rows], bool)
    lengths = [size for size in range(65) if size in (*range(9), 12, 16, 20, 24, 32, 48, 64)]
    payloads = [
        b""
        if row[4] == "remote"
        else row[5][: max(k for k in lengths if k <= len(row[5]))]
        if row[4] == "fd"
        else row[5][:8]
        for row in rows
    ]
    data = np.zeros((n, width), np.uint8)
    for line, payload in zip(data, payloads, strict=True):
        line[: len(payload)] = np.frombuffer(payload, np.uint8)
    return FrameBatch(
        time=np.array([row[0] for row in rows], np.int64),
        channel=np.array([channels.index(row[1]) for row in rows], np.int16),
        channels=channels,
        id=np.array([row[2] for row in rows], np.uint32),
        extended=np.array([row[2] > 0x7FF or row[3] or row[4] == "error" for row in rows], bool),
        fd=fd,
        kind=kind,
        length=np.array([len(payload) for payload in payloads], np.uint8),
        data=data,
    )


@given(batches, batches)
def test_what_is_written_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, first: list[tuple[Any, ...]], second: list[tuple[Any, ...]]
) -> None:
    path = tmp_path_factory.mktemp("candump") / "can.log"
    written = [make_batch(first), make_batch(second)]
    assert write_candump(path, written) == len(first) + len(second)
    account = Account()
    got = [frame for batch in Candump(path).batches(account) for frame in frames_of(batch)]
    assert got == [frame for batch in written for frame in frames_of(batch)]
    assert account == Account(accepted=len(got))


def test_written_lines(tmp_path: Path) -> None:
    rows = [
        (1436509052_249713000, "can0", 0x44, False, "data", b"\x2a\x36"),
        (1_000_000_001, "can1", 0x44, True, "data", b""),
        (0, "can1", 0x7FF, False, "remote", b""),
        (0, "can1", 0x80, True, "error", b"\x00" * 8),
        (0, "can1", 0x123, False, "fd", b"\x0f" * 12),
    ]
    write_candump(tmp_path / "can.log", [make_batch(rows)])
    assert (tmp_path / "can.log").read_text() == (
        "(1436509052.249713) can0 044#2A36\n"
        "(1.000000001) can1 00000044#\n"
        "(0.000000) can1 7FF#R\n"
        "(0.000000) can1 20000080#0000000000000000\n"
        "(0.000000) can1 123##00F0F0F0F0F0F0F0F0F0F0F0F\n"
    )


def test_refuses_to_write_what_cannot_be_read(tmp_path: Path) -> None:
    rows = [(-1, "can 0", 0x44, False, "data", b"")]
    with pytest.raises(ValueError, match="candump has no line") as caught:
        write_candump(tmp_path / "can.log", [make_batch(rows)])
    assert str(caught.value) == (
        "candump has no line for a time before 1970; "
        "an interface whose name is empty, has blanks or is longer than 32 bytes"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("block", [1, 7, 40, 1000])
@pytest.mark.parametrize("capacity", [1, 3, 1000])
def test_blocks_and_batches_cut_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int, capacity: int
) -> None:
    lines = [
        b"(1.5) can0 001#11",
        b"(1.5) can1 002#22\r",
        b"",
        b"(1.5) can0 003#333",
        b"(1.5) can1 004##1" + b"44" * 48,
        b"(1.5) can2 005#R",
        b"(1.5) can0 006##1" + b"66" * 9,
        b"(1.5) can0 007#1122334455667788",
    ]
    monkeypatch.setattr(text_log, "BLOCK", block)
    monkeypatch.setattr(text_log, "BATCH", capacity)
    path = tmp_path / "can.log"
    path.write_bytes(b"\n".join(lines))
    account = Account()
    got = list(Candump(path).batches(account))
    assert [frame[1:3] + frame[6:] for batch in got for frame in frames_of(batch)] == [
        ("can0", 1, "11"),
        ("can1", 2, "22"),
        ("can1", 4, "44" * 48),
        ("can2", 5, ""),
        ("can0", 7, "1122334455667788"),
    ]
    assert all(0 < len(batch) <= capacity for batch in got)
    assert [batch.data.shape[1] for batch in got] == {1: [8, 8, 64, 8, 64], 3: [64, 64], 1000: [64]}[capacity]
    assert [where for where, _ in account.rejections] == ["line 4", "line 7"]
    assert (account.accepted, account.rejected, account.truncated) == (5, 2, False)


@pytest.mark.parametrize(
    ("last", "accepted", "rejected", "truncated"),
    [
        (b"(1.5) can0 123#1122", 2, 0, False),
        (b"(1.5) can0 123#1122 R", 2, 0, False),
        (b"(1.5) can0 123#112", 1, 1, True),
        (b"(1.5) can0 123##1" + b"11" * 9, 1, 1, True),
        (b"(1.5) can0 123", 1, 1, True),
        (b"(1.5) can0 ", 1, 1, True),
        (b"(1.5", 1, 1, True),
        (b"(", 1, 1, True),
        (b"(nan", 1, 1, False),
        (b"(1.5) can0 800#", 1, 1, False),
        (b"  \r", 1, 0, False),
    ],
)
def test_last_line_without_line_end(tmp_path: Path, last: bytes, accepted: int, rejected: int, truncated: bool) -> None:
    _, account = read(tmp_path, GOOD + last)
    assert (account.accepted, account.rejected, account.truncated) == (accepted, rejected, truncated)


def test_says_that_the_file_ends_within_a_line(tmp_path: Path) -> None:
    _, account = read(tmp_path, GOOD + b"(1.5) can0 12")
    assert account.rejections == [
        (
            "line 2",
            (
                "the file ends within this line: expected an identifier of 3 hex digits (11 bits) or 8 hex digits "
                "(29 bits), then #; found '(1.5) can0 12'"
            ),
        )
    ]


def test_a_tail_of_zeros_takes_no_memory_and_is_one_rejection(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text_log, "BLOCK", 1000)
    frames, account = read(tmp_path, GOOD + bytes(50_000) + b"\n" + GOOD + bytes(50_000))
    assert len(frames) == 2
    found = repr("\0" * 80)
    assert account.rejections == [
        ("line 2", f"too long for a line of candump; found {found} and more"),
        ("line 4", f"too long for a line of candump; found {found} and more"),
    ]
    assert not account.truncated


def test_counts_thousands_of_rejections(tmp_path: Path) -> None:
    frames, account = read(tmp_path, (b"x\n" * 3 + GOOD) * 1000)
    assert len(frames) == 1000
    assert (account.accepted, account.rejected, len(account.rejections)) == (1000, 3000, 100)


def test_more_interfaces_than_there_are(tmp_path: Path) -> None:
    lines = b"".join(b"(1.5) can%d 123#\n" % k for k in (*range(257), 0, 255))
    frames, account = read(tmp_path, lines)
    assert [frame[1] for frame in frames] == [f"can{k}" for k in (*range(256), 0, 255)]
    assert account.rejections == [
        ("line 257", "one interface more than the 256 that a log may have; found '(1.5) can256 123#'")
    ]


def log_of(n: int) -> bytes:
    payloads = np.random.default_rng(7).integers(0, 256, (n, 8), dtype=np.uint8)
    return b"".join(
        b"(%d.%06d) can0 %03X#%s\n" % (k // 100, k % 100, k % 0x800, row.tobytes().hex().upper().encode())
        for k, row in enumerate(payloads)
    )


def test_gzip_is_read_whole(tmp_path: Path) -> None:
    log = log_of(2000)
    plain, _ = read(tmp_path, log)
    one, account = read(tmp_path, gzip.compress(log, mtime=0), "can.log.gz")
    assert one == plain
    assert account == Account(accepted=2000)
    several, account = read(
        tmp_path, gzip.compress(log[:12345], mtime=0) + gzip.compress(log[12345:], mtime=0) + bytes(512)
    )
    assert several == plain
    assert account == Account(accepted=2000)


def test_gzip_cut_anywhere_gives_every_whole_frame_before_the_cut(tmp_path: Path) -> None:
    log = log_of(300)
    compressed = gzip.compress(log, mtime=0)
    plain, _ = read(tmp_path, log)
    for size in range(2, len(compressed), 37):
        frames, account = read(tmp_path, compressed[:size])
        assert frames == plain[: len(frames)]
        assert account.truncated
        assert account.rejections[0] == (
            f"byte {size} of the compressed file",
            (
                "the gzip stream ends without its end; the recording was cut off or the copy is incomplete. "
                "What stands before it was read"
            ),
        )
    assert len(frames) >= 299


def test_damaged_gzip_gives_the_frames_before_the_damage(tmp_path: Path) -> None:
    log = log_of(20_000)
    compressed = bytearray(gzip.compress(log, mtime=0))
    plain, _ = read(tmp_path, log)
    # The rest of the stream cannot be decoded: a block of the reserved type 3 is sure to be found.
    half = len(compressed) // 2
    compressed[half : half + 3000] = b"\xff" * 3000
    frames, account = read(tmp_path, bytes(compressed))
    share = len(frames) / len(plain)
    assert 0.45 < share < 0.6
    assert frames[: int(0.45 * len(plain))] == plain[: int(0.45 * len(plain))]
    ((where, reason),) = [(where, reason) for where, reason in account.rejections if "gzip" in reason]
    assert re.fullmatch(r"byte \d+ of the compressed file", where)
    assert half <= int(where.split()[1]) <= half + 3200
    assert reason.startswith("the gzip stream is damaged here (Error -3 while decompressing data: ")


def test_gzip_with_a_wrong_checksum_says_so(tmp_path: Path) -> None:
    compressed = bytearray(gzip.compress(log_of(100), mtime=0))
    compressed[-8] ^= 1
    frames, account = read(tmp_path, bytes(compressed))
    assert len(frames) == 100
    assert account.rejections == [
        (
            f"byte {len(compressed) - 5} of the compressed file",
            (
                "the gzip stream is damaged here (Error -3 while decompressing data: incorrect data check); "
                "what stands before it was read, but gzip's checksum could not confirm it. "
                "Copy the file again from where it was recorded"
            ),
        )
    ]


@pytest.mark.parametrize("head", [GOOD, b"\n \r\n" + GOOD])
def test_recognises_its_files(head: bytes) -> None:
    assert Candump.sniff(head)


@pytest.mark.parametrize(
    "head",
    [
        b"",
        b"\xe7" * 72,
        b"hello\n" + GOOD,
        b"base hex timestamps absolute\n",
        b"  can0  044   [5]  2A 36 6C 2B BA\n",
        b" (1436509052.249713)  can0  044   [5]  2A 36 6C 2B BA\n",
        b"\x1f\x8bnothing",
    ],
)
def test_refuses_others(head: bytes) -> None:
    assert not Candump.sniff(head)


def test_empty_log(tmp_path: Path) -> None:
    for content in (b"", b"\n\n \n", gzip.compress(b"", mtime=0)):
        assert read(tmp_path, content) == ([], Account())


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        list(Candump(tmp_path / "no.log").batches(Account()))
    assert str(caught.value) == f"{tmp_path / 'no.log'}: no such file; check the path, or whether the disk is mounted"
