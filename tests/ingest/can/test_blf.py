from __future__ import annotations

import gzip
import random
import struct
import time
import zlib
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.ingest.can import plain_frames
from wheelprint.ingest.account import Account
from wheelprint.ingest.can.blf import Blf
from wheelprint.ingest.can.frames import FrameBatch
from wheelprint.schemas.errors import InputError

START = 1_700_000_000_250_000_000
"""2023-11-14 22:13:20.250 UTC, a Tuesday."""
DATE = (2023, 11, 2, 14, 22, 13, 20, 250)
EIGHT = bytes(range(1, 9))
RESUMED = "went on at the next LOBJ"

Frame = tuple[int, str, int, bool, bool, str, bytes]


def header(date: tuple[int, ...] = DATE, size: int = 0) -> bytes:
    return struct.pack("<4sI8BQQII8H8H", b"LOGG", 144, *[0] * 8, size, 0, 0, 0, *date, *[0] * 8).ljust(144, b"\0")


def thing(kind: int, body: bytes, stamp: int = 0, flags: int = 2, version: int = 1) -> bytes:
    """Build an object with header and padding."""
    rest = struct.pack("<IHHQ", flags, 0, 0, stamp) + bytes(8 if version == 2 else 0)
    size = 16 + len(rest) + len(body)
    return struct.pack("<4sHHII", b"LOBJ", 16 + len(rest), version, size, kind) + rest + body + bytes(size % 4)


def container(content: bytes, method: int = 2) -> bytes:
    packed = zlib.compress(content) if method == 2 else content
    size = 32 + len(packed)
    base = struct.pack("<4sHHIIH6xI4x", b"LOBJ", 16, 1, size, 10, method, len(content))
    return base + packed + bytes(size % 4)


def classic(stamp: int, number: int = 0x123, data: bytes = EIGHT, **header_fields: int) -> bytes:
    return thing(1, struct.pack("<HBBI8s", 1, 0, len(data), number, data), stamp, **header_fields)


def frames_of(batch: FrameBatch) -> list[Frame]:
    return [(*frame, bytes.fromhex(payload)) for *frame, payload in plain_frames.frames_of(batch)]  # type: ignore[misc]


def read(folder: Path, content: bytes, name: str = "can.blf") -> tuple[list[Frame], Account]:
    path = folder / name
    path.write_bytes(content)
    account = Account()
    frames = [frame for batch in Blf(path).batches(account) for frame in frames_of(batch)]
    assert account.accepted == len(frames)
    return frames, account


def expected(*stamps: int) -> list[Frame]:
    return [(START + stamp, "1", 0x123, False, False, "data", EIGHT) for stamp in stamps]


FD = bytes(range(64))
OBJECTS: list[tuple[str, bytes, Frame]] = [
    ("data", classic(5), (START + 5, "1", 0x123, False, False, "data", EIGHT)),
    ("10 µs", classic(5, flags=1), (START + 50_000, "1", 0x123, False, False, "data", EIGHT)),
    ("header 2", classic(5, version=2), (START + 5, "1", 0x123, False, False, "data", EIGHT)),
    (
        "extended",
        classic(0, 0x80000000 | 0x1FFFFFFF, b"\xff"),
        (START, "1", 0x1FFFFFFF, True, False, "data", b"\xff"),
    ),
    (
        "transmitted, length code 15",
        thing(1, struct.pack("<HBBI8s", 3, 1, 15, 0x7FF, EIGHT)),
        (START, "3", 0x7FF, False, False, "data", EIGHT),
    ),
    (
        "remote",
        thing(1, struct.pack("<HBBI8s", 2, 0x80, 8, 0x10, EIGHT)),
        (START, "2", 0x10, False, False, "remote", b""),
    ),
    (
        "message 2",
        thing(86, struct.pack("<HBBI8sIBBH", 2, 0, 3, 0x80000010, EIGHT, 1, 2, 0, 0), 7),
        (START + 7, "2", 0x10, True, False, "data", EIGHT[:3]),
    ),
    (
        "FD",
        thing(100, struct.pack("<HBBIIBBB5x64s", 4, 0, 15, 0x80000001, 0, 0, 3, 64, FD)),
        (START, "4", 1, True, True, "data", FD),
    ),
    (
        "classic in an FD object",
        thing(100, struct.pack("<HBBIIBBB5x64s", 4, 0, 2, 1, 0, 0, 0, 2, b"ab")),
        (START, "4", 1, False, False, "data", b"ab"),
    ),
    (
        "FD-64",
        thing(
            101, struct.pack("<BBBBIIIIIIIHBBI", 5, 9, 12, 0, 0x80000002, 0, 0x3000, 0, 0, 0, 0, 0, 0, 0, 0) + FD[:12]
        ),
        (START, "5", 2, True, True, "data", FD[:12]),
    ),
    (
        "FD-64 with bit rates behind its payload",
        thing(
            101,
            struct.pack("<BBBBIIIIIIIHBBI", 5, 9, 12, 0, 2, 0, 0x1000, 0, 0, 0, 0, 0, 0, 32 + 40 + 12, 0)
            + FD[:12]
            + b"\xee" * 16,
        ),
        (START, "5", 2, False, True, "data", FD[:12]),
    ),
    (
        "FD-64 without the last bytes of its payload",
        thing(101, struct.pack("<BBBBIIIIIIIHBBI", 5, 15, 64, 0, 2, 0, 0x1000, 0, 0, 0, 0, 0, 0, 0, 0) + FD[:20]),
        (START, "5", 2, False, True, "data", FD[:20].ljust(64, b"\0")),
    ),
    (
        "remote FD-64",
        thing(101, struct.pack("<BBBBIIIIIIIHBBI", 5, 8, 8, 0, 2, 0, 0x10, 0, 0, 0, 0, 0, 0, 0, 0)),
        (START, "5", 2, False, False, "remote", b""),
    ),
    ("error", thing(2, struct.pack("<HHI", 6, 6, 0), 9), (START + 9, "6", 0, False, False, "error", b"")),
    ("overload", thing(3, struct.pack("<HHI", 6, 0, 0), 9), (START + 9, "6", 0, False, False, "error", b"")),
    (
        "extended error",
        thing(73, struct.pack("<HHIBBBBIIHH8s", 7, 0, 0, 1, 2, 2, 0, 0, 0x80012345, 0, 0, b"xy"), 9),
        (START + 9, "7", 0x12345, True, False, "error", b"xy"),
    ),
    (
        "error of CAN FD",
        thing(104, struct.pack("<BBBBHHHBBII5IHH", 8, 9, 12, 0, 0, 0, 0, 0, 0, 0x80000777, *[0] * 8), 9),
        (START + 9, "8", 0x777, True, False, "error", b""),
    ),
]


@pytest.mark.parametrize(("name", "content", "frame"), OBJECTS, ids=[name for name, _, _ in OBJECTS])
def test_object_becomes_frame(tmp_path: Path, name: str, content: bytes, frame: Frame) -> None:
    assert name
    frames, account = read(tmp_path, header() + container(content + classic(1)))
    assert frames == [frame, *expected(1)]
    assert (account.rejected, account.truncated) == (0, False)


@pytest.mark.parametrize("method", [0, 2])
@pytest.mark.parametrize("size", [1, 7, 16, 33, 50, 100, 1000])
def test_objects_straddle_containers(tmp_path: Path, method: int, size: int) -> None:
    marker = thing(96, b"a marker" * 9 + b"xyz")
    content = b"".join(piece for _, piece, _ in OBJECTS) + marker + classic(3) + thing(65, b"comment") + classic(4)
    pieces = [content[k : k + size] for k in range(0, len(content), size)]
    frames, account = read(tmp_path, header() + b"".join(container(piece, method) for piece in pieces))
    assert frames == [frame for _, _, frame in OBJECTS] + expected(3, 4)
    assert (account.rejected, account.truncated) == (0, False)


def test_objects_outside_of_containers(tmp_path: Path) -> None:
    frames, account = read(tmp_path, header() + classic(1) + thing(96, b"abc") + container(classic(2)) + classic(3))
    assert frames == expected(1, 2, 3)
    assert (account.rejected, account.truncated) == (0, False)


@pytest.mark.parametrize("compressed", [False, True])
def test_compressed_file_is_read_alike(tmp_path: Path, compressed: bool) -> None:
    content = header() + container(classic(1))
    frames, account = read(tmp_path, gzip.compress(content) if compressed else content)
    assert frames == expected(1)
    assert account.rejected == 0


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (classic(0, flags=0), "this frame of type 1 does not say whether its time is in 10 µs or in ns"),
        (
            classic(2**63 - START),
            "the time of this frame of type 1 is beyond the year 2262, the last that 64-bit nanoseconds can hold",
        ),
        (
            classic(0, 0x800),
            "the identifier of this frame of type 1 is beyond 11 bits (7FF) and not marked as one of 29 bits",
        ),
        (
            thing(1, struct.pack("<HBBI8s", 1, 0, 16, 1, EIGHT)),
            "more than 8 bytes, or a length code above 15, on this classic frame of type 1",
        ),
        (
            thing(100, struct.pack("<HBBIIBBB5x64s", 4, 0, 15, 1, 0, 0, 1, 65, FD)),
            "more than 64 bytes on this CAN FD frame of type 100",
        ),
        (
            thing(1, struct.pack("<HBBI4s", 1, 0, 8, 1, EIGHT)),
            "this frame of type 1 is shorter than its header and payload",
        ),
        (
            classic(0)[:6] + b"\x03\0" + classic(0)[8:],
            "expected an object header of version 1 or 2 on this frame of type 1",
        ),
        (
            thing(101, struct.pack("<BBBBIIIIIIIHBBI", 5, 9, 12, 0, 2, 0, 0x1000, 0, 0, 0, 0, 0, 0, 255, 0) + FD[:12]),
            "the payload of this frame of type 101 does not end within it",
        ),
    ],
)
def test_impossible_frame_is_rejected(tmp_path: Path, content: bytes, reason: str) -> None:
    frames, account = read(tmp_path, header() + container(classic(1) + content + classic(2)))
    assert frames == expected(1, 2)
    assert (account.rejected, account.truncated) == (1, False)
    assert account.rejections == [("byte 144, byte 48 of the unpacked objects", reason)]


@pytest.mark.parametrize(
    ("size", "reason"),
    [
        (0, f"the size of this object of type 1 is impossible; {RESUMED}"),
        (15, f"the size of this object of type 1 is impossible; {RESUMED}"),
        (2**32 - 1, f"the size of this object of type 1 is impossible; {RESUMED}"),
        (40, f"the size of this object of type 1 does not lead to the next one; {RESUMED}"),
        (50, f"the size of this object of type 1 does not lead to the next one; {RESUMED}"),
        (
            4096,
            "this object breaks off: its rest is beyond the end of the file or in a damaged part of it",
        ),
    ],
)
def test_size_of_an_object_is_wrong(tmp_path: Path, size: int, reason: str) -> None:
    damaged = classic(2)[:8] + struct.pack("<I", size) + classic(2)[12:]
    frames, account = read(tmp_path, header() + container(classic(1) + damaged + classic(3) + classic(4)))
    assert frames == expected(1, 3, 4)
    # Whether an object of 4096 bytes is whole is known only at the end.
    place = len(header() + container(classic(1) + damaged + classic(3) + classic(4)))
    place = place if size == 4096 else 144
    assert account.rejections == [(f"byte {place}, byte 48 of the unpacked objects", reason)]


def test_size_0_outside_of_containers(tmp_path: Path) -> None:
    damaged = classic(2)[:8] + bytes(4) + classic(2)[12:]
    frames, account = read(tmp_path, header() + damaged + container(classic(3)))
    assert frames == expected(3)
    reason = "the size of this object of type 1, 0 bytes, does not lead to the next one; went on at the next LOBJ"
    assert account.rejections == [("byte 144", reason)]


def test_damaged_container_is_left_out_and_reading_goes_on(tmp_path: Path) -> None:
    content = b"".join(classic(k) for k in range(9))
    # The third and the sixth object straddle; the middle container is damaged.
    one, two, three = (container(content[a:b]) for a, b in ((0, 120), (120, 264), (264, 432)))
    damaged = bytearray(two)
    damaged[40] ^= 0xFF
    frames, account = read(tmp_path, header() + one + damaged + three)
    assert frames == expected(0, 1, 6, 7, 8)
    assert (account.rejected, account.truncated) == (2, False)
    (where, reason), other = account.rejections
    assert where == f"byte {144 + len(one)}"
    assert reason.startswith("this container is damaged (Error -3 while decompressing data: ")
    assert reason.endswith(") and nothing was taken from it; went on at the next LOBJ")
    assert other == (
        f"byte {144 + len(one)}, byte 96 of the unpacked objects",
        "this object breaks off: its rest is beyond the end of the file or in a damaged part of it",
    )


@pytest.mark.parametrize("method", [0, 2])
@pytest.mark.parametrize("size", [0, 31, 60, 5000, 2**32 - 1])
def test_size_of_a_container_is_wrong(tmp_path: Path, method: int, size: int) -> None:
    one = container(classic(1) + classic(2), method)
    damaged = one[:8] + struct.pack("<I", size) + one[12:]
    frames, account = read(tmp_path, header() + damaged + container(classic(3) + classic(4), method))
    assert frames[-2:] == expected(3, 4)
    assert frames[:-2] in (expected(1, 2), [])
    assert 1 <= account.rejected <= 2
    assert account.rejections[0][0] == "byte 144"
    assert account.rejections[0][1].endswith(RESUMED)
    assert not account.truncated


def test_unknown_compression(tmp_path: Path) -> None:
    one = container(classic(1))
    frames, account = read(tmp_path, header() + one[:16] + b"\x07" + one[17:] + container(classic(2)))
    assert frames == expected(2)
    reason = f"expected 0 (none) or 2 (zlib) as compression of this container, found 7; {RESUMED}"
    assert account.rejections == [("byte 144", reason)]


def test_bytes_between_containers(tmp_path: Path) -> None:
    frames, account = read(tmp_path, header() + b"garbage of any sort" + container(classic(2)))
    assert frames == expected(2)
    reason = f"expected a container or an object, which begin with LOBJ; found b'garbage of '; {RESUMED}"
    assert account.rejections == [("byte 144", reason)]


def test_bytes_between_objects(tmp_path: Path) -> None:
    content = classic(1) + container(thing(96, b"")) + classic(2)
    garbage = classic(1) + thing(96, b"abcd") + bytes(8) + classic(2)
    frames, account = read(tmp_path, header() + container(content) + container(garbage))
    assert frames == expected(1, 2, 1, 2)
    reason = f"the size of this object of type 96 does not lead to the next one; {RESUMED}"
    assert [reason] == [found for _, found in account.rejections]


@pytest.mark.parametrize(
    ("date", "start", "doubted"),
    [
        (DATE, START, []),
        ((0,) * 8, 0, []),
        ((2023, 13, 2, 14, 22, 13, 20, 250), 0, ["2023-13-14 22:13:20.250"]),
        ((2262, 1, 2, 14, 22, 13, 20, 1), 0, ["2262-1-14 22:13:20.1"]),
        ((1969, 1, 2, 14, 22, 13, 20, 1), 0, ["1969-1-14 22:13:20.1"]),
        ((2023, 1, 2, 14, 22, 13, 20, 1000), 0, ["2023-1-14 22:13:20.1000"]),
    ],
)
def test_start(tmp_path: Path, date: tuple[int, ...], start: int, doubted: list[str]) -> None:
    frames, account = read(tmp_path, header(date) + container(classic(7)))
    assert [frame[0] for frame in frames] == [start + 7]
    remarks = [
        ("byte 40", f"expected the date of the start, found {found}; times count from 1970-01-01") for found in doubted
    ]
    assert account == Account(accepted=1, remarks=remarks)


@pytest.mark.parametrize("method", [0, 2])
def test_cut_anywhere(tmp_path: Path, method: int) -> None:
    content = classic(0) + classic(1) + thing(96, b"abc") + classic(2) + classic(3)
    pieces = [container(content[:70], method), container(content[70:], method)]
    whole = header() + b"".join(pieces)
    # The last padding of a whole file is no part of its records.
    complete = {144, *(144 + len(pieces[0]) - k for k in range(4))}
    for cut in range(144, len(whole)):
        frames, account = read(tmp_path, whole[:cut])
        assert frames == expected(0, 1, 2, 3)[: len(frames)]
        if cut not in complete:
            assert account.truncated or len(frames) == 4, cut
        if cut >= 144 + len(pieces[0]):
            assert len(frames) >= 1
        if method == 0:
            # Bytes of the objects that are there, and how many of them are whole.
            here = max(0, min(cut - 144 - 32, 70)) + max(0, cut - 144 - len(pieces[0]) - 32)
            assert len(frames) == sum(here >= end for end in (48, 96, 182, 230)), cut
    assert read(tmp_path, whole)[1].truncated is False


@pytest.mark.parametrize("cut", [4, 40, 71])
def test_cut_within_the_header(tmp_path: Path, cut: int) -> None:
    frames, account = read(tmp_path, header()[:cut])
    assert frames == []
    assert account.truncated
    assert account.rejections == [("byte 0", f"the file ends within its header of 72 bytes; it has {cut}")]


def test_cut_between_containers_is_seen_in_the_header(tmp_path: Path) -> None:
    one = container(classic(1))
    content = header(size=144 + 2 * len(one)) + one
    frames, account = read(tmp_path, content)
    assert frames == expected(1)
    assert account.truncated
    reason = f"the file ends here, while its header speaks of {len(content) + len(one)} bytes"
    assert account.rejections == [(f"byte {len(content)}", f"{reason}; the rest was not copied or written")]


def test_cut_container_delivers_what_unpacks(tmp_path: Path) -> None:
    data = np.random.default_rng(1).integers(0, 256, (2000, 8), np.uint8)
    content = header() + container(b"".join(classic(k, data=row.tobytes()) for k, row in enumerate(data)))
    frames, account = read(tmp_path, content[: len(content) // 2])
    assert 800 < len(frames) < 1200
    assert [frame[0] - START for frame in frames] == list(range(len(frames)))
    assert account.truncated
    reason = "the file ends within this container; what could be unpacked was taken"
    assert account.rejections[0] == ("byte 144", reason)


def test_another_file_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        read(tmp_path, b"(1436509052.249713) can0 044#2A")
    assert str(error.value) == (
        f"{tmp_path / 'can.blf'}: byte 0: expected LOGG, with which every BLF file begins; found b'(1436509'. "
        "Is it another format?"
    )


def test_mutations_end_as_a_result(tmp_path: Path) -> None:
    chance = random.Random(3)  # noqa: S311 - mutations, no secrets
    content = b"".join(piece for _, piece, _ in OBJECTS) * 3
    for method in (0, 2):
        pieces = [container(content[k : k + 300], method) for k in range(0, len(content), 300)]
        whole = header() + b"".join(pieces)
        count = len(read(tmp_path, whole)[0])
        for _ in range(150):
            mutated = bytearray(whole)
            for _ in range(chance.randrange(1, 6)):
                mutated[chance.randrange(4, len(mutated))] = chance.choice(
                    [0, 1, 0x7F, 0x80, 0xFF, chance.randrange(256)]
                )
            begun = time.monotonic()
            frames, account = read(tmp_path, bytes(mutated))
            assert time.monotonic() - begun < 5
            assert len(frames) <= count
            assert len(frames) == count or account.rejected > 0 or method == 0


def message(draw: Any) -> can.Message:
    is_fd, is_error, extended = draw(st.booleans()), draw(st.booleans()), draw(st.booleans())
    is_remote = draw(st.booleans()) and not is_fd and not is_error
    size = draw(st.sampled_from([*range(9), *((12, 16, 20, 24, 32, 48, 64) if is_fd and not is_error else ())]))
    return can.Message(
        timestamp=START / 1e9 + draw(st.integers(0, 10_000)) / 1000,
        arbitration_id=draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF)),
        is_extended_id=extended,
        is_remote_frame=is_remote,
        is_error_frame=is_error,
        is_fd=is_fd and not is_error,
        channel=draw(st.integers(0, 5)),
        dlc=size,
        data=None if is_remote else draw(st.binary(min_size=size, max_size=size)),
    )


@st.composite
def traffic(draw: Any) -> list[can.Message]:
    messages = [message(draw) for _ in range(draw(st.integers(1, 30)))]
    return sorted(messages, key=lambda one: one.timestamp)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(messages=traffic(), level=st.sampled_from([0, 6]), size=st.sampled_from([100, 1000, 131072]))
def test_what_python_can_wrote(tmp_path: Path, messages: list[can.Message], level: int, size: int) -> None:
    path = tmp_path / "written.blf"
    writer = can.BLFWriter(str(path), compression_level=level, max_container_size=size)
    for one in messages:
        writer.on_message_received(one)
    # Its last containers are written one by one, each of at most `size` bytes.
    while writer._buffer_size:
        writer._flush()
    writer.stop()
    frames, account = read(tmp_path, path.read_bytes())
    assert [frame[1:] for frame in frames] == [
        (
            str(one.channel + 1),
            one.arbitration_id,
            one.is_extended_id,
            one.is_fd,
            "error" if one.is_error_frame else "remote" if one.is_remote_frame else "data",
            bytes(one.data),
        )
        for one in messages
    ]
    # python-can's stamps are floating point numbers of seconds.
    assert all(abs(frame[0] - one.timestamp * 1e9) < 1000 for frame, one in zip(frames, messages, strict=True))
    assert (account.rejected, account.truncated) == (0, False)


def test_batches_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wheelprint.ingest.can.pending.BATCH", 1 << 18)
    path = tmp_path / "long.blf"
    path.write_bytes(header() + container(b"".join(map(classic, range(3000)))) * 100)
    lengths = [len(batch) for batch in Blf(path).batches(Account())]
    assert lengths == [1 << 18, 300_000 - (1 << 18)]


@pytest.mark.parametrize(
    ("head", "claimed"),
    [
        (header(), True),
        (header()[:4], True),
        (b"LOBJ", False),
        (b"(1.0) can0 123#00\n", False),
        (b"\xd4\xc3\xb2\xa1", False),
        (b"MDF     4.10", False),
        (b"", False),
    ],
)
def test_sniff(head: bytes, claimed: bool) -> None:
    assert Blf.sniff(head) is claimed
