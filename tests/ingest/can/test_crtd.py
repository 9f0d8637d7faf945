from __future__ import annotations

import gzip
import random
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.ingest.can.plain_frames import Frame, frames_of
from wheelprint.ingest.account import Account
from wheelprint.ingest.can import crtd, text_log
from wheelprint.ingest.can.crtd import Crtd
from wheelprint.schemas.errors import InputError


def read(folder: Path, content: bytes | str) -> tuple[list[Frame], Account]:
    path = folder / "can.crtd"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    account = Account()
    frames = [frame for batch in Crtd(path).batches(account) for frame in frames_of(batch)]
    assert account.accepted == len(frames)
    return frames, account


SAMPLE = """\
1524311386.811100 CXX OVMS CRTD
1524311386.811100 1R11 7EC 03 41 05 7B
1524311386.811101 2T29 18DB33F1 02 01 0c 00 00 00 00 00
1524311386.811102 2CEV vehicle.on
1524311386.811103 R29 7ec
1524311386.9 T11 1 FF
0.5 12R11 7FF 00 11 22 33 44 55 66 77
1524311387.000000 CST intr=1 rxpkt=2
"""
FRAMES: list[Frame] = [
    (1_524_311_386_811_100_000, "1", 0x7EC, False, False, "data", "0341057B"),
    (1_524_311_386_811_101_000, "2", 0x18DB33F1, True, False, "data", "02010C0000000000"),
    (1_524_311_386_811_103_000, "1", 0x7EC, True, False, "data", ""),
    (1_524_311_386_900_000_000, "1", 0x1, False, False, "data", "FF"),
    (500_000_000, "12", 0x7FF, False, False, "data", "0011223344556677"),
]


def test_reads_every_kind_of_line(tmp_path: Path) -> None:
    assert read(tmp_path, SAMPLE) == (FRAMES, Account(accepted=5))
    assert read(tmp_path, SAMPLE.replace("\n", "  \r\n").replace(" ", "\t ")) == (FRAMES, Account(accepted=5))
    assert read(tmp_path, gzip.compress(SAMPLE.encode())) == (FRAMES, Account(accepted=5))


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("hello", crtd.REASONS[2]),
        ("nan 1R11 7EC 03", crtd.REASONS[2]),
        ("9999999999.0 1R11 7EC 03", crtd.REASONS[3]),
        ("1.5", crtd.REASONS[1]),
        ("1.5 1R11", crtd.REASONS[1]),
        ("1.5 1R12 7EC 03", crtd.REASONS[4]),
        ("1.5 256R11 7EC 03", crtd.REASONS[4]),
        ("1.5 X11 7EC 03", crtd.REASONS[4]),
        ("1.5 CxX 7EC 03", crtd.REASONS[4]),
        ("1.5 1R11 7EX 03", crtd.REASONS[5]),
        ("1.5 1R11 800 03", crtd.REASONS[6]),
        ("1.5 1R29 20000000 03", crtd.REASONS[7]),
        ("1.5 1R11 7EC 3", crtd.REASONS[8]),
        ("1.5 1R11 7EC 0341", crtd.REASONS[8]),
        ("1.5 1R11 7EC 01 02 03 04 05 06 07 08 09", crtd.REASONS[9]),
    ],
)
def test_rejects_with_line_and_reason(tmp_path: Path, line: str, reason: str) -> None:
    frames, account = read(tmp_path, f"{SAMPLE}\n{line}\n1524311386.9 T11 1 FF\n")
    assert frames == [*FRAMES, FRAMES[3]]
    assert account == Account(accepted=6, rejected=1, rejections=[("line 10", f"{reason}; found {line!r}")])


def test_a_rejection_reads_like_this(tmp_path: Path) -> None:
    _, account = read(tmp_path, "1.5 1R11 800 03\n1.5 1R11 7EC 0")
    assert account.rejections == [
        ("line 1", "the identifier is beyond 11 bits (7FF), and the type is R11 or T11; found '1.5 1R11 800 03'"),
        (
            "line 2",
            (
                "the file ends within this line: expected bytes of two hex digits as payload; "
                "found '1.5 1R11 7EC 0'"
            ),
        ),
    ]  # fmt: skip
    assert account.truncated


def test_cut_anywhere_gives_the_whole_frames_before_the_cut(tmp_path: Path) -> None:
    def needed(line: str) -> int:
        if " C" in line or "2CEV" in line:
            return line.index("C") + 3
        return len(line) + (len(line.split()) < 3 + 8)

    for size in range(len(SAMPLE)):
        got, account = read(tmp_path, SAMPLE[:size])
        whole, within, start = 0, False, 0
        for line in SAMPLE.splitlines():
            whole += "C" not in line.split()[1] and size >= start + needed(line)
            within |= start < size < start + needed(line)
            start += len(line) + 1
        assert (got, account.rejected, account.truncated) == (FRAMES[:whole], within, within)


@pytest.mark.parametrize("block", [1, 7, 40, 1000])
@pytest.mark.parametrize("lines", [1, 3, 1000])
def test_blocks_and_batches_cut_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int, lines: int
) -> None:
    monkeypatch.setattr(text_log, "BLOCK", block)
    monkeypatch.setattr(text_log, "BATCH", lines)
    frames, account = read(tmp_path, SAMPLE + "\n???\n" + SAMPLE)
    assert frames == FRAMES * 2
    ((where, _),) = account.rejections
    assert where == "line 10"


def test_damaged_gzip_gives_the_frames_before_the_damage(tmp_path: Path) -> None:
    compressed = gzip.compress((SAMPLE * 500).encode(), mtime=0)
    frames, account = read(tmp_path, compressed[: len(compressed) // 2])
    assert frames == (FRAMES * 500)[: len(frames)]
    assert 500 < len(frames) < 2500
    assert account.truncated
    assert account.rejections[0][0] == f"byte {len(compressed) // 2} of the compressed file"


def test_mutations_end_as_a_result(tmp_path: Path) -> None:
    source = random.Random(9)  # noqa: S311 - mutations, no secrets
    for _ in range(200):
        text = bytearray(SAMPLE.encode())
        for _ in range(source.randint(1, 6)):
            k = source.randrange(len(text))
            match source.randrange(3):
                case 0:
                    text[k] = source.randrange(256)
                case 1:
                    del text[k : k + source.randint(1, 40)]
                case _:
                    text[k:k] = source.randbytes(source.randint(1, 10))
        frames, account = read(tmp_path, bytes(text))
        lines = [line for line in bytes(text).split(b"\n") if line.strip(b" \t\r")]
        assert len(lines) - 6 <= len(frames) + account.rejected <= len(lines)


rows = st.lists(
    st.tuples(
        st.integers(0, 4 * 10**15),
        st.integers(0, 255),
        st.tuples(st.integers(0, 0x7FF), st.just(False)) | st.tuples(st.integers(0, 0x1FFFFFFF), st.just(True)),
        st.sampled_from("RT"),
        st.binary(max_size=8),
    )
)  # fmt: skip


@given(rows)
def test_what_is_written_by_the_format_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, written: list[tuple[Any, ...]]
) -> None:
    lines = [
        f"{us // 10**6}.{us % 10**6:06} {bus}{direction}{29 if extended else 11} {number:03X} {payload.hex(' ')}\n"
        for us, bus, (number, extended), direction, payload in written
    ]
    frames, account = read(tmp_path_factory.mktemp("crtd"), "".join(lines))
    assert frames == [
        (us * 1000, str(bus), number, extended, False, "data", payload.hex().upper())
        for us, bus, (number, extended), _, payload in written
    ]
    assert account == Account(accepted=len(written))


def test_recognises_its_files() -> None:
    for line in SAMPLE.splitlines(keepends=True):
        assert Crtd.sniff(line.encode())
    assert Crtd.sniff(b"\r\n1.5 1CXX\n")


@pytest.mark.parametrize(
    "head",
    [
        b"",
        b"\xe7" * 72,
        b"(1436509052.249713) can0 044#2A366C2BBA\n",
        b"1436509052.249713,0x44,0,0,0,5,KjZsK7o=\n",
        b"   1.059900 1  300             Rx   d 8 00 01\n",
        b"     1)      1059.9  Rx         0300  7  00\n",
        b"1524311386.811100 1R13 7EC 03 41\n",
        b"49.015003 8.434297 116.43 0.03\n",
    ],
)
def test_refuses_others(head: bytes) -> None:
    assert not Crtd.sniff(head)


def test_missing_and_empty_files(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        list(Crtd(tmp_path / "no.crtd").batches(Account()))
    assert str(caught.value) == f"{tmp_path / 'no.crtd'}: no such file; check the path, or whether the disk is mounted"
    for content in (b"", b"\n\n \n"):
        assert read(tmp_path, content) == ([], Account())
