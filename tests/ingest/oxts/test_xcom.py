"""XCOM: Ogg pages, continued packets, damage; NCOM packets stamped by their own GPS time.

Pages are built here from RFC 3533, with its checksum bit by bit, and packets with `struct`.
"""

from __future__ import annotations

import gzip
import pickle
import struct
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from wheelprint.ingest.account import Account
from wheelprint.ingest.oxts.ncom import Ncom
from wheelprint.ingest.oxts.xcom import Xcom
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.tables import NAVIGATION

TEXT = b"[OxTS-NCom]headers=1\nserial=12345\n"
GPS = 1_380_000_000_123_456_789
"""ns since 1980: 2023-09-29, 18 s ahead of UTC."""
UTC = GPS + (315_964_800 - 18) * 1_000_000_000


def crc(content: bytes) -> int:
    remainder = 0
    for octet in content:
        remainder ^= octet << 24
        for _ in range(8):
            remainder = (remainder << 1) ^ (0x104C11DB7 if remainder & 0x80000000 else 0)
    return remainder


def page(number: int, lacing: Iterable[int], body: bytes, *, flags: int = 0, serial: int = 7) -> bytes:
    table = bytes(lacing)
    head = struct.pack("<4sBBqII", b"OggS", 0, flags, 0, serial, number)
    rest = bytes([len(table)]) + table + body
    return head + struct.pack("<I", crc(head + bytes(4) + rest)) + rest


def whole(number: int, *packets: bytes, **options: int) -> bytes:
    """A page of whole packets."""
    lacing = [part for packet in packets for part in (*[255] * (len(packet) // 255), len(packet) % 255)]
    return page(number, lacing, b"".join(packets), **options)


def ncom(*, status: int = 4, channel: int = 7, batch: bytes = bytes(8), north: float = 3.0) -> bytes:
    def int24(*values: float) -> bytes:
        return b"".join(round(value).to_bytes(3, "little", signed=True) for value in values)

    body = struct.pack("<H", 123) + int24(5000, -2500, -98066) + int24(0, 0, -10_000) + bytes([status])
    body += bytes([sum(body) & 0xFF]) + struct.pack("<ddf", 0.84, 0.2, 500.0)
    body += int24(north * 1e4, 40_000, 0) + int24(500_000, 0, 0)
    body += bytes([sum(body) & 0xFF]) + bytes([channel]) + batch
    return b"\xe7" + body + bytes([sum(body) & 0xFF])


def data(milliseconds: int = 0, **fields: float | bytes) -> bytes:
    return struct.pack("<Q", GPS + milliseconds * 1_000_000) + ncom(**fields)  # type: ignore[arg-type]  # a short way


def read(folder: Path, content: bytes) -> tuple[pa.Table, Account]:
    path = folder / "nav.xcom"
    path.write_bytes(content)
    account = Account()
    batches = list(Xcom(path).batches(account))
    return pa.Table.from_batches(batches, batches[0].schema if batches else NAVIGATION), account


def times(table: pa.Table) -> list[int]:
    return [(time - UTC) // 1_000_000 for time in table["time"].cast(pa.int64()).to_pylist()]


def no_page(size: int) -> str:
    damaged = "that are no page of an Ogg stream (from OggS to a matching checksum): damaged or lost in recording"
    return f"{size} bytes {damaged}"


FIRST = whole(0, TEXT, flags=2)


def test_packets_are_stamped_by_their_gps_time(tmp_path: Path) -> None:
    accuracy = struct.pack("<3HBB", 30, 40, 9, 0, 0)
    content = FIRST + whole(1, data(0), data(10, channel=3, batch=accuracy)) + whole(2, data(20), flags=4)
    table, account = read(tmp_path, content)
    assert account == Account(accepted=4)
    assert table.schema.equals(NAVIGATION, check_metadata=False)
    assert table["time"].cast(pa.int64()).to_pylist() == [UTC, UTC + 10_000_000, UTC + 20_000_000]
    first = table.to_pylist()[0]
    del first["time"]
    assert first == pytest.approx({
        "latitude": np.degrees(0.84), "longitude": np.degrees(0.2), "altitude": 500.0, "x": 0.0, "y": 0.0,
        "course": np.degrees(np.arctan2(3, 4)), "heading": 90 - np.degrees(0.5), "nav_speed": 5.0,
        "nav_yaw_rate": np.degrees(0.1), "nav_longitudinal_acceleration": 0.5, "nav_lateral_acceleration": 0.25,
        "position_accuracy": None, "nav_status": 4,
    })  # fmt: skip
    assert table["position_accuracy"].to_pylist() == [None, pytest.approx(0.05), pytest.approx(0.05)]
    assert table.schema.metadata[b"utc_from"] == b"leap second table"


def test_a_packet_over_three_pages_and_long_text(tmp_path: Path) -> None:
    text = TEXT + b"x" * 600
    packet = data(10)
    content = (
        page(0, [255], text[:255], flags=2)
        + page(1, [255], text[255:510], flags=1)
        + page(2, [len(text) - 510, 80], text[510:] + data(0), flags=1)
        + whole(3, packet)
    )
    table, account = read(tmp_path, content)
    assert account == Account(accepted=3)
    assert times(table) == [0, 10]


def test_text_of_a_multiple_of_255_bytes_ends_with_an_empty_piece(tmp_path: Path) -> None:
    text = TEXT.ljust(510, b"x")
    _, account = read(tmp_path, page(0, [255, 255], text) + page(1, [0, 80], data(0), flags=1))
    assert account == Account(accepted=2)


def test_two_streams_side_by_side(tmp_path: Path) -> None:
    text = TEXT.ljust(300, b"x")
    content = page(0, [255], text[:255]) + whole(0, data(0), serial=8) + page(1, [45], text[255:], flags=1)
    _, account = read(tmp_path, content)
    assert account == Account(accepted=2)


def test_a_damaged_page_is_one_rejection_and_the_next_one_is_found(tmp_path: Path) -> None:
    pages = [FIRST, *(whole(number, data(10 * number)) for number in range(1, 5))]
    damaged = bytearray(pages[2])
    damaged[60] ^= 1
    table, account = read(tmp_path, b"".join([*pages[:2], bytes(damaged), *pages[3:]]))
    assert times(table) == [10, 30, 40]
    place = len(pages[0] + pages[1])
    after = place + len(pages[2])
    assert account == Account(
        accepted=4,
        rejected=2,
        rejections=[
            (f"byte {place}", no_page(len(damaged))),
            (f"byte {after}", "expected Ogg page 2; found 3: pages were lost or changed places"),
        ],
    )


def test_rubbish_before_between_and_after_pages(tmp_path: Path) -> None:
    pages = [FIRST, whole(1, data(0))]
    _, account = read(tmp_path, b"abc" + pages[0] + b"OggSxyz" + pages[1] + b"....")
    places = [0, 3 + len(pages[0]), 10 + len(pages[0] + pages[1])]
    assert account == Account(
        accepted=2,
        rejected=3,
        rejections=[(f"byte {place}", no_page(size)) for place, size in zip(places, (3, 7, 4), strict=True)],
    )


def test_halves_of_packets_are_said(tmp_path: Path) -> None:
    content = whole(0, data(0)) + page(1, [80, 255], data(10) + bytes(255)) + whole(2, data(20))
    _, account = read(tmp_path, content)
    assert account.rejections == [(f"byte {len(whole(0, data(0)))}", "the packet that begins on this page has no end")]
    _, account = read(tmp_path, page(0, [20, 80], bytes(20) + data(0), flags=1))
    assert account == Account(
        accepted=1, rejected=1, rejections=[("byte 0", "the packet that ends on this page has no beginning")]
    )


def test_damaged_packets_are_rejected(tmp_path: Path) -> None:
    broken = bytearray(data(0))
    broken[30] ^= 1
    unknown = struct.pack("<Q", 5) + ncom()
    endless = struct.pack("<Q", (1 << 64) - 1) + ncom()
    packets = [bytes(broken), b"12345", unknown, endless, data(5), data(5), data(7), data(3), data(9)]
    _, account = read(tmp_path, b"".join(whole(number, packet) for number, packet in enumerate(packets)))
    reasons = [reason for _, reason in account.rejections]
    assert reasons == [
        "expected an NCOM packet (from 0xE7 to a matching checksum) after the time; it is damaged",
        "expected 80 bytes (time and an NCOM packet) or text; found 5: '12345'",
        "its time, 5 ns since GPS began, is none that a unit with GNSS time can tell",
        "its time, 18446744073709551615 ns since GPS began, is none that a unit with GNSS time can tell",
        "its time 2023-09-29T05:19:42.128Z is that of another packet; repeated in recording, the first one is kept",
        (
            "its time 2023-09-29T05:19:42.126Z is out of order with the packets around it; they changed places, or the "
            "clock was set"
        ),
    ]
    assert (account.accepted, account.rejected) == (3, 6)


def test_packets_without_time_are_accepted_but_no_samples(tmp_path: Path) -> None:
    packets = [struct.pack("<Q", 0) + ncom(status=1), data(0), data(5, status=10), data(10, status=2)]
    table, account = read(tmp_path, b"".join(whole(number, packet) for number, packet in enumerate(packets)))
    assert account == Account(accepted=4)
    assert times(table) == [0, 10]
    assert table["latitude"].null_count == 1


def test_cut_anywhere(tmp_path: Path) -> None:
    pages = [FIRST, whole(1, data(0)), whole(2, data(10)), whole(3, data(20))]
    content = b"".join(pages)
    ends = np.cumsum([len(page) for page in pages])
    for size in range(int(ends[1]), len(content) + 1):
        table, account = read(tmp_path, content[:size])
        assert len(table) == (ends[1:] <= size).sum()
        assert account == Account(accepted=1 + len(table), truncated=size not in ends)


def test_cut_within_a_continued_packet(tmp_path: Path) -> None:
    table, account = read(tmp_path, whole(0, data(0)) + page(1, [255], TEXT.ljust(255)))
    assert len(table) == 1
    assert account == Account(accepted=1, truncated=True)


def test_no_data_at_all(tmp_path: Path) -> None:
    for content in (b"", FIRST):
        with pytest.raises(InputError) as error:
            read(tmp_path, content)
        assert str(error.value) == (
            f"{tmp_path / 'nav.xcom'}: holds no packet of data (8 bytes of time and 72 of NCOM) in its Ogg stream; the "
            "unit may have been switched off before it wrote any, or the file is damaged"
        )


def test_compressed_in_small_blocks_and_batches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Wherever a block ends, the pages are the same."""
    monkeypatch.setattr("wheelprint.ingest.oxts.xcom.BATCH", 3)
    content = b"ab" + FIRST + b"".join(whole(number, data(number)) for number in range(1, 6)) + b"OggSxyz" + b"cd"
    path = tmp_path / "nav.xcom.gz"
    path.write_bytes(gzip.compress(content))
    reader = pickle.loads(pickle.dumps(Xcom(path)))
    expected = Account()
    assert [len(batch) for batch in reader.batches(expected)] == [2, 3]
    for size in (1, 7, 100):
        pieces = [content[place : place + size] for place in range(0, len(content), size)]
        monkeypatch.setattr("wheelprint.ingest.ogg.blocks", lambda *_, pieces=pieces: iter(pieces))
        account = Account()
        assert sum(len(batch) for batch in reader.batches(account)) == 5
        assert account == expected


def test_random_damage_ends_as_a_result(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    content = np.frombuffer(FIRST + b"".join(whole(n, data(n), data(n + 20)) for n in range(1, 5)), np.uint8)
    for _ in range(200):
        damaged = content.copy()
        damaged[rng.integers(len(content), size=3)] = rng.integers(256, size=3)
        try:
            table, account = read(tmp_path, damaged.tobytes())
        except InputError:
            continue
        assert len(table) <= account.accepted


def test_sniff() -> None:
    content = FIRST + whole(1, data(0))
    assert Xcom.sniff(content)
    assert not Ncom.sniff(content)
    for other in (b"", b"OggS" + b"\0" * 100 + b"\x01vorbis", ncom() * 3, b"(1436509052.249713) can0 044#2A\n"):
        assert not Xcom.sniff(other)
