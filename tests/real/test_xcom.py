"""A real NCOM log wrapped as XCOM: the same samples, with the stamps of the container."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import pyarrow as pa

from wheelprint.ingest.account import Account
from wheelprint.ingest.oxts.leap_seconds import utc_to_gps
from wheelprint.ingest.oxts.ncom import Ncom
from wheelprint.ingest.oxts.xcom import Xcom

REVERSED = bytes(int(f"{octet:08b}"[::-1], 2) for octet in range(256))


def ogg_checksum(content: bytes) -> int:
    """Ogg's CRC by way of zlib's, which takes the bits of a byte the other way round and begins and ends inverted."""
    mirrored = zlib.crc32(content.translate(REVERSED), 0xFFFFFFFF) ^ 0xFFFFFFFF
    return int(f"{mirrored:032b}"[::-1], 2)


def page(number: int, packets: list[bytes]) -> bytes:
    head = struct.pack("<4sBBqII", b"OggS", 0, 0, 0, 1, number)
    rest = bytes([len(packets), *map(len, packets)]) + b"".join(packets)
    return head + struct.pack("<I", ogg_checksum(head + bytes(4) + rest)) + rest


def test_a_real_log_as_xcom_gives_the_same_samples(shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "oxts" / "NAVsdk_example2.ncom"
    raw = source.read_bytes()
    (packets,) = Ncom(source).packets(Account())
    expected = pa.Table.from_batches(list(Ncom(source).batches(Account())))
    data = [
        struct.pack("<Q", stamp) + raw[72 * number : 72 * number + 72]
        for number, stamp in enumerate(utc_to_gps(packets.time).tolist())
    ]
    pages = [[b"[OxTS-NCom]headers=1\n"], *(data[first : first + 50] for first in range(0, len(data), 50))]
    path = tmp_path / "nav.xcom"
    path.write_bytes(b"".join(page(number, content) for number, content in enumerate(pages)))
    assert Xcom.sniff(path.read_bytes()[:65_536])
    assert not Ncom.sniff(path.read_bytes()[:65_536])
    account = Account()
    table = pa.Table.from_batches(list(Xcom(path).batches(account)))
    assert account == Account(accepted=len(data) + 1)
    assert table.equals(expected, check_metadata=True)
