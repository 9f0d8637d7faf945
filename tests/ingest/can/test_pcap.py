from __future__ import annotations

import random
import struct
from pathlib import Path

import pytest

from tests.ingest.can.plain_frames import frames_of
from wheelprint.ingest.account import Account
from wheelprint.ingest.can.pcap import Pcap
from wheelprint.schemas.errors import InputError

TIME = 1_700_000_000_123_456_789
SECONDS, FRACTION = divmod(TIME, 1_000_000_000)
EIGHT = bytes(range(1, 9))

Frame = tuple[int, str, int, bool, bool, str, bytes]


def pcap(packets: list[bytes], link: int = 227, order: str = "<", unit: int = 1000) -> bytes:
    magic = 0xA1B2C3D4 if unit == 1000 else 0xA1B23C4D
    head = struct.pack(f"{order}IHHiIII", magic, 2, 4, 0, 0, 65535, link)
    records = (struct.pack(f"{order}IIII", SECONDS, FRACTION // unit, len(one), len(one)) + one for one in packets)
    return head + b"".join(records)


def block(kind: int, body: bytes, order: str = "<") -> bytes:
    body += bytes(-len(body) % 4)
    size = 12 + len(body)
    return struct.pack(f"{order}II", kind, size) + body + struct.pack(f"{order}I", size)


def option(code: int, content: bytes, order: str = "<") -> bytes:
    return struct.pack(f"{order}HH", code, len(content)) + content + bytes(-len(content) % 4)


def section(order: str = "<") -> bytes:
    return block(0x0A0D0D0A, struct.pack(f"{order}IHHq", 0x1A2B3C4D, 1, 0, -1), order)


def interface(*options: bytes, link: int = 227, order: str = "<") -> bytes:
    return block(1, struct.pack(f"{order}HHI", link, 0, 0) + b"".join(options) + bytes(4 if options else 0), order)


def enhanced(packet: bytes, ticks: int, number: int = 0, order: str = "<") -> bytes:
    fields = struct.pack(f"{order}IIIII", number, ticks >> 32, ticks & 0xFFFFFFFF, len(packet), len(packet))
    return block(6, fields + packet, order)


def can(number: int, data: bytes = EIGHT, flags: int = 0, size: int = 16) -> bytes:
    return (struct.pack(">IBBxx", number, len(data), flags) + data).ljust(size, b"\0")


def read(folder: Path, content: bytes) -> tuple[list[Frame], Account]:
    path = folder / "can.pcap"
    path.write_bytes(content)
    account, frames = Account(), list[Frame]()
    for batch in Pcap(path).batches(account):
        frames += [(*odds, bytes.fromhex(payload)) for *odds, payload in frames_of(batch)]  # type: ignore[misc]
    assert account.accepted == len(frames)
    return frames, account


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("unit", [1, 1000])
def test_pcap(tmp_path: Path, order: str, unit: int) -> None:
    fd = bytes(range(64))
    packets = [
        can(0x123),
        can(0x9FFFFFFF, b"\xff"),
        can(0x40000010, EIGHT),
        can(0x20000004, EIGHT),
        can(0x7, fd, 4, 72),
        can(0x7, b"ab", 4),
        can(0x7, b"ab", 0, 72),
    ]
    frames, account = read(tmp_path, pcap(packets, order=order, unit=unit))
    time = TIME // unit * unit
    assert frames == [
        (time, "if0", 0x123, False, False, "data", EIGHT),
        (time, "if0", 0x1FFFFFFF, True, False, "data", b"\xff"),
        (time, "if0", 0x10, False, False, "remote", b""),
        (time, "if0", 4, True, False, "error", EIGHT),
        (time, "if0", 7, False, True, "data", fd),
        (time, "if0", 7, False, True, "data", b"ab"),
        (time, "if0", 7, False, True, "data", b"ab"),
    ]
    assert (account.rejected, account.truncated) == (0, False)


def test_cooked_captures(tmp_path: Path) -> None:
    cooked = struct.pack(">HHH8sH", 1, 280, 0, bytes(8), 0xC) + can(0x123)
    flexible = struct.pack(">HHH8sH", 1, 280, 0, bytes(8), 0xD) + can(0x123, bytes(12), 0, 72)
    time = TIME // 1000 * 1000
    assert read(tmp_path, pcap([cooked, flexible], 113))[0] == [
        (time, "if0", 0x123, False, False, "data", EIGHT),
        (time, "if0", 0x123, False, True, "data", bytes(12)),
    ]
    cooked_2 = struct.pack(">HHIHBB8s", 0xC, 0, 5, 280, 1, 0, bytes(8)) + can(0x80000123)
    assert read(tmp_path, pcap([cooked_2], 276))[0] == [(time, "if5", 0x123, True, False, "data", EIGHT)]


@pytest.mark.parametrize("order", ["<", ">"])
def test_pcapng(tmp_path: Path, order: str) -> None:
    content = (
        section(order)
        + interface(order=order)
        + interface(option(2, b"can1", order), option(9, b"\x09", order), order=order)
        + interface(option(9, b"\x94", order), option(14, struct.pack(f"{order}q", 1000), order), order=order)
        + enhanced(can(1), 1_700_000_000_123_456, 0, order)
        + block(5, bytes(12), order)
        + enhanced(can(2, b"x"), TIME, 1, order)
        + enhanced(can(3), 3 << 19, 2, order)
        + block(2, struct.pack(f"{order}HHIIII", 1, 0, TIME >> 32, TIME & 0xFFFFFFFF, 16, 16) + can(4), order)
        + section("<")
        + interface(option(2, b"vcan0"))
        + enhanced(can(5), 7)
    )
    frames, account = read(tmp_path, content)
    assert frames == [
        (TIME // 1000 * 1000, "if0", 1, False, False, "data", EIGHT),
        (TIME, "can1", 2, False, False, "data", b"x"),
        (1_001_500_000_000, "if2", 3, False, False, "data", EIGHT),
        (TIME, "can1", 4, False, False, "data", EIGHT),
        (7000, "vcan0", 5, False, False, "data", EIGHT),
    ]
    assert (account.rejected, account.truncated) == (0, False)


@pytest.mark.parametrize(
    ("content", "where", "reason"),
    [
        (
            pcap([b"\xff" * 60], 1),
            "byte 24",
            (
                "expected link type 227 (CAN_SOCKETCAN), 113 (LINUX_SLL) or 276 (LINUX_SLL2), found 1; "
                "this interface is no CAN bus"
            ),
        ),
        (
            pcap([struct.pack(">HHH8sH", 1, 1, 0, bytes(8), 0x800) + bytes(20)], 113),
            "byte 24",
            "expected protocol 0x000C (CAN) or 0x000D (CAN FD), found 0x0800",
        ),
        (pcap([b"1234567"]), "byte 24", "expected at least 8 bytes of a CAN frame, found 7"),
        (pcap([can(1, bytes(9))]), "byte 24", "9 bytes are more than a classic frame can have"),
        (
            pcap([can(1, bytes(9), 4)]),
            "byte 24",
            "no CAN FD frame has 9 bytes (only 0 to 8, 12, 16, 20, 24, 32, 48, 64)",
        ),
        (pcap([can(1)[:12]]), "byte 24", "the capture holds only 4 of the payload's 8 bytes"),
        (pcap([can(0x800)]), "byte 24", "the identifier is beyond 11 bits (7FF) and not marked as one of 29 bits"),
        (
            pcap([b"\0\0\0\1\x80" + bytes(20)]),
            "byte 24",
            "a frame of CAN XL, for which there is no place here",
        ),
        (
            section() + interface() + block(3, struct.pack("<I", 16) + can(1)),
            "byte 48",
            "a simple packet block has no time; capture with enhanced packet blocks",
        ),
        (
            section() + enhanced(can(1), 1),
            "byte 28",
            "interface 0 is described by no block of this section",
        ),
        (
            section() + block(0x77, b"")[:-4] + bytes(4),
            "byte 28",
            (
                "expected a block with its size at both ends, found type 119 and 12 bytes at the first; "
                "went on at the next section, if there is one"
            ),
        ),
        (
            pcap([])[:24] + struct.pack("<IIII", 1, 2, 1 << 20, 1 << 20) + bytes(50),
            "byte 24",
            (
                "expected a record of up to 262144 bytes and less than a second as fraction, found 1048576 bytes "
                "and 2000 ns; pcap has no marks to go on by, so the rest is lost"
            ),
        ),
    ],
)
def test_rejections(tmp_path: Path, content: bytes, where: str, reason: str) -> None:
    frames, account = read(tmp_path, content)
    assert frames == []
    assert account.rejections == [(where, reason)]
    assert not account.truncated


def test_damaged_block_is_left_at_the_next_section(tmp_path: Path) -> None:
    sound = section() + interface() + enhanced(can(1), 7)
    damaged = sound[:52] + b"\xff\xff\xff\xff" + sound[56:]
    frames, account = read(tmp_path, damaged + sound)
    assert frames == [(7000, "if0", 1, False, False, "data", EIGHT)]
    assert account.rejected == 1


def test_cut_anywhere(tmp_path: Path) -> None:
    for whole, ends in (
        (pcap([can(1), can(2)]), [24, 56, 88]),
        (section() + interface() + enhanced(can(1), 7) + enhanced(can(2), 7), [28, 48, 96, 144]),
    ):
        assert len(whole) == ends[-1]
        for cut in range(12, len(whole) + 1):
            frames, account = read(tmp_path, whole[:cut])
            assert len(frames) == sum(cut >= end for end in ends[-2:]), cut
            assert account.truncated == (cut not in ends), cut
            assert account.rejected == account.truncated


def test_mutations_end_as_a_result(tmp_path: Path) -> None:
    chance = random.Random(5)  # noqa: S311 - mutations, no secrets
    frames = [can(k) for k in range(12)]
    pcapng = section() + interface(option(2, b"can0"), option(9, b"\x09"))
    for whole in (pcap(frames), pcapng + b"".join(enhanced(one, TIME) for one in frames)):
        for _ in range(120):
            mutated = bytearray(whole)
            for _ in range(chance.randrange(1, 5)):
                mutated[chance.randrange(12, len(mutated))] = chance.randrange(256)
            assert len(read(tmp_path, bytes(mutated))[0]) <= 12


def test_another_file_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        read(tmp_path, b"LOGG and more")
    assert str(error.value) == (
        f"{tmp_path / 'can.pcap'}: byte 0: expected the magic number of pcap or pcapng; found b'LOGG'. "
        "Is it another format?"
    )


@pytest.mark.parametrize(
    ("head", "claimed"),
    [
        (pcap([]), True),
        (pcap([], order=">", unit=1), True),
        (section(), True),
        (section(">"), True),
        (b"\x0a\x0d\x0d\x0a text with odd line ends", False),
        (b"LOGG", False),
        (b"(1.0) can0 123#00\n", False),
        (b"", False),
    ],
)
def test_sniff(head: bytes, claimed: bool) -> None:
    assert Pcap.sniff(head) is claimed
