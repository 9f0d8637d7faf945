"""NCOM: every byte accounted for, every packet stamped, every status obeyed.

Packets are built here with `struct` from the description of the format, not with the writer that is tested with it.
"""

from __future__ import annotations

import gzip
import json
import pickle
import re
import struct
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import zstandard
from hypothesis import assume, given
from hypothesis import strategies as st

from wheelprint.ingest.account import Account
from wheelprint.ingest.oxts.ncom import Ncom
from wheelprint.ingest.oxts.ncom_packets import NcomPackets, scan_packets
from wheelprint.schemas.errors import InputError
from wheelprint.schemas.tables import NAVIGATION

MINUTE = 23_000_000
"""A GPS minute of 2023-09-29."""
GARBAGE = re.compile(
    r"(\d+) bytes that are no packet \(72 bytes from 0xE7 to a matching checksum\): damaged or lost in recording, "
    r"or of another stream"
)


def int24(value: float | None, scale: float) -> bytes:
    return (-(1 << 23) if value is None else round(value / scale)).to_bytes(3, "little", signed=True)


def packet(
    milliseconds: int,
    *,
    status: int = 4,
    channel: int = 7,
    batch: bytes = bytes(8),
    acceleration: tuple[float | None, ...] = (0.1, 0.2, -9.8),
    rates: tuple[float | None, ...] = (0.01, 0.02, 0.03),
    position: tuple[float, float, float] = (0.84, 0.2, 500.0),
    velocity: tuple[float | None, ...] = (3.0, 4.0, 0.0),
    angles: tuple[float | None, ...] = (0.5, 0.0, 0.0),
) -> bytes:
    body = struct.pack("<H", milliseconds)
    body += b"".join(int24(value, 1e-4) for value in acceleration) + b"".join(int24(value, 1e-5) for value in rates)
    body += bytes([status])
    body += bytes([sum(body) & 0xFF])
    body += struct.pack("<ddf", *position)
    body += b"".join(int24(value, 1e-4) for value in velocity) + b"".join(int24(value, 1e-6) for value in angles)
    body += bytes([sum(body) & 0xFF])
    body += bytes([channel]) + batch
    return b"\xe7" + body + bytes([sum(body) & 0xFF])


def minute_batch(minute: int) -> bytes:
    return struct.pack("<i4B", minute, 12, 6, 6, 6)


def clock(milliseconds: int, minute: int = MINUTE, **fields: Any) -> bytes:
    """A packet that tells the minute."""
    return packet(milliseconds, channel=0, batch=minute_batch(minute), **fields)


def utc(milliseconds: int, seconds: int = -18, valid: int = 1, **fields: Any) -> bytes:
    """A packet that tells UTC - GPS."""
    return packet(milliseconds, channel=16, batch=bytes(7) + struct.pack("<b", seconds << 1 | valid), **fields)


def accuracy(milliseconds: int, north: int, east: int, age: int = 0, **fields: Any) -> bytes:
    """A packet that tells the position accuracy, mm."""
    return packet(milliseconds, channel=3, batch=struct.pack("<3HBB", north, east, 9, age, 0), **fields)


def stamp(minute: int, milliseconds: int, offset: int = -18) -> int:
    return (minute * 60_000 + milliseconds) * 1_000_000 + (315_964_800 + offset) * 1_000_000_000


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "nav.ncom"


def read_packets(path: Path) -> tuple[list[NcomPackets], Account]:
    account = Account()
    return list(Ncom(path).packets(account)), account


def read_samples(path: Path, packets: Iterable[bytes] | None = None) -> tuple[pa.Table, Account]:
    if packets is not None:
        path.write_bytes(b"".join(packets))
    account = Account()
    batches = list(Ncom(path).batches(account))
    return pa.Table.from_batches(batches, NAVIGATION if not batches else batches[0].schema), account


def times(table: pa.Table) -> list[int]:
    stamps: list[int] = table["time"].cast(pa.int64()).to_pylist()
    return stamps


def walk(content: bytes) -> list[int]:
    """Find the packets one byte after another."""
    offsets, place = [], 0
    while place + 72 <= len(content):
        body = content[place : place + 72]
        if body[0] == 0xE7 and sum(body[1:71]) % 256 == body[71]:
            offsets.append(place)
            place += 72
        else:
            place += 1
    return offsets


class TestPackets:
    def test_every_field_is_what_was_packed(self, log: Path) -> None:
        first = packet(
            59_999, status=3, channel=200, batch=bytes(range(8)), acceleration=(-838.8607, 0.0001, 838.8607),
            rates=(-1.5, 0.0, 2.25), position=(-1.2, 3.1, -12.5), velocity=(1.0, -2.0, 0.5), angles=(3.14, -0.1, 0.2),
        )  # fmt: skip
        log.write_bytes(first + clock(1, acceleration=(None, 1.0, None), rates=(None,) * 3, velocity=(None,) * 3))
        (packets,), account = read_packets(log)
        assert account == Account(accepted=2)
        assert len(packets) == 2
        assert packets.offset.tolist() == [0, 72]
        assert packets.milliseconds.tolist() == [59_999, 1]
        assert packets.acceleration[0].tolist() == [-838.8607, 0.0001, 838.8607]
        assert packets.angular_rate[0].tolist() == [-1.5, 0.0, 2.25]
        assert packets.status.tolist() == [3, 4]
        assert (packets.latitude[0], packets.longitude[0], packets.altitude[0]) == (-1.2, 3.1, -12.5)
        assert packets.velocity[0].tolist() == [1.0, -2.0, 0.5]
        assert packets.orientation[0].tolist() == [3.14, -0.1, 0.2]
        assert packets.channel.tolist() == [200, 0]
        assert packets.batch[0].tolist() == list(range(8))
        assert packets.checksum1.all()
        assert packets.checksum2.all()
        assert packets.time.tolist() == [stamp(MINUTE - 1, 59_999), stamp(MINUTE, 1)]
        assert packets.time_known.all()
        assert np.isnan(packets.acceleration[1]).tolist() == [True, False, True]
        assert np.isnan(packets.angular_rate[1]).all()
        assert np.isnan(packets.velocity[1]).all()

    def test_only_the_last_checksum_decides(self, log: Path) -> None:
        damaged = bytearray(clock(10))
        damaged[22] ^= 1
        damaged[71] = sum(damaged[1:71]) & 0xFF
        log.write_bytes(bytes(damaged) + clock(20))
        (packets,), account = read_packets(log)
        assert account == Account(accepted=2)
        assert packets.checksum1.tolist() == [False, True]
        assert packets.checksum2.tolist() == [False, True]
        assert len(read_samples(log)[0]) == 2

    @given(
        pieces=st.lists(st.one_of(st.just(b""), st.binary(max_size=90)), min_size=2, max_size=12),
        cut=st.integers(0, 71),
        seed=st.integers(0, 2**32 - 1),
    )
    def test_every_byte_is_accounted_for(
        self, tmp_path_factory: pytest.TempPathFactory, pieces: list[bytes], cut: int, seed: int
    ) -> None:
        path = tmp_path_factory.mktemp("garbage") / "nav.ncom"
        random = np.random.default_rng(seed)
        content = b""
        for number, garbage in enumerate(pieces):
            content += garbage + (clock(100 * number) if random.random() < 0.7 else packet(100 * number))
        content += clock(50_000)
        content = content[: len(content) - cut]
        assume(not content.startswith((b"\x1f\x8b", b"\x28\xb5\x2f\xfd")))  # Such a file is a compressed one.
        path.write_bytes(content)
        batches, account = read_packets(path)
        assert np.concatenate([batch.offset for batch in batches]).tolist() == walk(content)
        assert account.accepted == len(walk(content))
        matches = [(where, GARBAGE.fullmatch(reason)) for where, reason in account.rejections]
        garbage_bytes = sum(int(match[1]) for _, match in matches if match)
        assert account.rejected == len(matches)
        assert all(matches)
        rest = len(content) - 72 * account.accepted - garbage_bytes
        assert 0 <= rest < 72
        assert account.truncated == (rest > 0)
        if cut:
            assert account.truncated
            assert content[len(content) - rest] == 0xE7
        covered = set().union(*(range(o, o + 72) for o in walk(content)))
        for where, match in matches:
            assert match is not None
            begin = int(where.removeprefix("byte "))
            assert not covered & set(range(begin, begin + int(match[1])))

    def test_a_damaged_packet_and_a_cut_tail_are_named(self, log: Path) -> None:
        damaged = bytearray(packet(20))
        damaged[30] ^= 0xFF
        log.write_bytes(b"$GP" + clock(10) + bytes(damaged) + clock(30) + clock(40)[:71])
        batches, account = read_packets(log)
        assert [batch.offset.tolist() for batch in batches] == [[3, 147]]
        explanation = "that are no packet (72 bytes from 0xE7 to a matching checksum): damaged or lost in recording, "
        assert account == Account(
            accepted=2,
            rejected=2,
            truncated=True,
            rejections=[
                ("byte 0", f"3 bytes {explanation}or of another stream"),
                ("byte 75", f"72 bytes {explanation}or of another stream"),
            ],
        )

    def test_bytes_after_the_last_packet_are_cut_only_if_a_packet_could_begin_there(self, log: Path) -> None:
        log.write_bytes(clock(10) + b"\xe7" + b"\1" * 71)
        assert read_packets(log)[1].truncated is False
        assert read_packets(log)[1].rejections[0][0] == "byte 72"
        log.write_bytes(clock(10) + bytes(100) + b"\xe7" + b"\1" * 70)
        _, account = read_packets(log)
        assert (account.truncated, account.rejected) == (True, 1)
        assert account.rejections[0][1].startswith("100 bytes that are no packet")

    @given(
        pieces=st.lists(st.one_of(st.just(b""), st.binary(max_size=300)), min_size=1, max_size=12),
        sizes=st.tuples(st.integers(1, 4), st.integers(1, 4)),
        pack=st.sampled_from([bytes, gzip.compress, zstandard.compress]),
        seed=st.integers(0, 2**32 - 1),
    )
    def test_packets_are_found_whole_wherever_a_piece_of_the_file_ends(
        self,
        tmp_path_factory: pytest.TempPathFactory,
        pieces: list[bytes],
        sizes: tuple[int, int],
        pack: Callable[[bytes], bytes],
        seed: int,
    ) -> None:
        path = tmp_path_factory.mktemp("pieces") / "nav.ncom"
        random = np.random.default_rng(seed)
        content = clock(0) + b"".join(garbage + clock(10) * random.integers(1, 5) for garbage in pieces)
        path.write_bytes(pack(content))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("wheelprint.ingest.oxts.ncom_packets.BLOCK", sizes[0])
            patch.setattr("wheelprint.ingest.oxts.ncom_packets.BATCH", sizes[1])
            batches, account = read_packets(path)
        places = walk(content)
        assert np.concatenate([batch.offset for batch in batches]).tolist() == places
        assert b"".join(batch.raw.tobytes() for batch in batches) == b"".join(content[o : o + 72] for o in places)
        assert account == read_packets(path)[1]

    def test_batches_do_not_depend_on_their_size(self, log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        random = np.random.default_rng(3)
        content = [packet(10)]
        for number in range(2, 200):
            kind = random.integers(0, 6)
            make = (clock, utc, packet, packet, packet, packet)[kind]
            content.append(make(number * 10, status=int(random.choice([2, 3, 4, 4, 4, 10]))))
            if random.random() < 0.1:
                content.append(accuracy(number * 10 + 5, int(random.integers(1, 99)), 4, age=int(random.integers(200))))
            if random.random() < 0.1:
                content.append(bytes(int(random.integers(1, 9))))
        whole, account = read_samples(log, content)
        assert whole["position_accuracy"].null_count not in (0, len(whole))
        monkeypatch.setattr("wheelprint.ingest.oxts.ncom_packets.BATCH", 7)
        monkeypatch.setattr("wheelprint.ingest.oxts.ncom_packets.BLOCK", 2)
        small_account = Account()
        batches = list(Ncom(log).batches(small_account))
        assert len(batches) > 20
        assert all(batch.schema.equals(batches[0].schema, check_metadata=True) for batch in batches)
        assert pa.Table.from_batches(batches).equals(whole, check_metadata=True)
        assert small_account == account


class TestFile:
    def test_gzip_is_read_like_the_plain_file(self, log: Path, tmp_path: Path) -> None:
        content = [clock(10 * number) for number in range(1000)]
        plain, _ = read_samples(log, content)
        packed = tmp_path / "nav.ncom.gz"
        halves = gzip.compress(b"".join(content[:600])) + gzip.compress(b"".join(content[600:])) + bytes(10)
        packed.write_bytes(halves)
        table, account = read_samples(packed)
        assert table.equals(plain, check_metadata=True)
        assert account == Account(accepted=1000)

    def test_what_is_left_of_a_cut_gzip_is_read(self, tmp_path: Path) -> None:
        random = np.random.default_rng(5)
        content = [clock(10 * n, velocity=tuple(random.normal(size=3))) for n in range(1000)]
        packed = gzip.compress(b"".join(content))
        path = tmp_path / "nav.ncom.gz"
        path.write_bytes(packed[: len(packed) // 2])
        table, account = read_samples(path)
        assert 300 < len(table) < 700
        assert (account.accepted, account.rejected, account.truncated) == (len(table), 1, True)
        where, reason = account.rejections[0]
        assert where == f"byte {len(packed) // 2} of the compressed file"
        assert reason.startswith("the gzip stream ends without its end; ")

    def test_a_gzip_without_its_end_is_cut(self, tmp_path: Path) -> None:
        path = tmp_path / "nav.ncom.gz"
        path.write_bytes(gzip.compress(clock(10) + clock(20))[:-8])
        account = read_packets(path)[1]
        assert (account.accepted, account.rejected, account.truncated) == (2, 1, True)

    def test_of_a_damaged_gzip_what_stands_before_is_read(self, tmp_path: Path) -> None:
        packed = bytearray(gzip.compress(clock(10) * 10))
        packed[-6] ^= 0xFF
        path = tmp_path / "nav.ncom.gz"
        path.write_bytes(packed)
        account = read_packets(path)[1]
        assert (account.accepted, account.rejected, account.truncated) == (10, 1, False)
        assert "the gzip stream is damaged here" in account.rejections[0][1]

    @pytest.mark.parametrize("pack", [bytes, gzip.compress])
    def test_a_file_that_shrinks_while_it_is_read_is_an_error(self, log: Path, pack: Callable[[bytes], bytes]) -> None:
        content = b"".join(clock(10 * number) for number in range(1000))
        log.write_bytes(pack(content))
        scan = scan_packets(log, Account())
        log.write_bytes(pack(content[: 72 * 600 + 10]))
        delivered: list[int] = []
        with pytest.raises(InputError) as caught:
            delivered.extend(len(packets) for _, packets in scan.batches(Account()))
        assert sum(delivered) == 600
        assert str(caught.value) == (
            f"{log}: byte 43200: ended before its packet 601 of 1000 when it was read again, so something wrote to it "
            "meanwhile; convert it when it is complete"
        )

    def test_a_file_is_read_twice_and_tells_how_far(self, log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        log.write_bytes(clock(10) * 100)
        monkeypatch.setattr("wheelprint.ingest.oxts.ncom_packets.BATCH", 40)
        account = Account()
        scan = scan_packets(log, account)
        read = [account.bytes_read] + [account.bytes_read for _ in scan.batches(account)]
        assert read == [0, 40 * 72, 80 * 72, 100 * 72]

    def test_what_holds_no_packet_is_an_error(self, log: Path) -> None:
        log.write_bytes(b"(1.0) can0 123#00\n" * 10)
        with pytest.raises(InputError) as caught:
            read_packets(log)
        assert str(caught.value) == (
            f"{log}: holds no NCOM packet in 180 bytes; one is 72 bytes from 0xE7 to a matching checksum. "
            "It may be of another format: export the unit's recording as NCOM"
        )

    def test_an_empty_and_a_missing_file_are_errors(self, log: Path) -> None:
        with pytest.raises(InputError) as caught:
            read_packets(log)
        assert str(caught.value) == f"{log}: no such file; check the path, or whether the disk is mounted"
        log.write_bytes(b"")
        with pytest.raises(InputError) as caught:
            read_packets(log)
        assert (
            str(caught.value)
            == f"{log}: holds nothing: empty, or compressed and damaged from its start; the unit may have been off too "
            "early"
        )
        with pytest.raises(InputError) as caught:
            read_packets(log.parent)
        assert str(caught.value) == f"{log.parent}: cannot be read: Is a directory"

    def test_the_reader_pickles(self, log: Path) -> None:
        reader = pickle.loads(pickle.dumps(Ncom(log)))
        assert reader == Ncom(log)
        assert (reader.format, reader.kind) == ("ncom", "nav")

    @pytest.mark.parametrize(
        ("head", "expected"),
        [
            (clock(10) + clock(20), True),
            (clock(10), True),
            (b"\xe7 not" + clock(10) + clock(20)[:50], False),
            (b"\xe7 not yet" * 20 + clock(10) + clock(20), True),
            (b"", False),
            (clock(10)[:71], False),
            (b"".join(clock(n) + struct.pack("<Q", n) for n in range(10)), False),
            (b"(1436509052.249713) vcan0 044#2A366C2BBA\n" * 1000, False),
            (np.random.default_rng(0).bytes(65_536), False),
        ],
        ids=["two", "one", "one-after-garbage", "late", "empty", "cut", "xcom", "candump", "noise"],
    )
    def test_sniff(self, head: bytes, *, expected: bool) -> None:
        assert Ncom.sniff(head) is expected


class TestTime:
    def test_packets_before_the_first_minute_are_stamped_backwards(self, log: Path) -> None:
        table, account = read_samples(log, [packet(59_980), packet(59_990), packet(0), clock(10), packet(20)])
        expected = [stamp(MINUTE - 1, 59_980), stamp(MINUTE - 1, 59_990)]
        assert times(table) == expected + [stamp(MINUTE, ms) for ms in (0, 10, 20)]
        assert account == Account(accepted=5)

    @given(
        start=st.integers(0, 7 * 24 * 3600 * 1000),
        period=st.sampled_from([1, 4, 5, 10, 50, 100, 1000]),
        packets=st.integers(2, 400),
        every=st.integers(1, 60),
        lost=st.sets(st.integers(0, 399)),
        swapped=st.lists(st.integers(0, 398), max_size=10),
    )
    def test_every_packet_has_its_own_time(
        self,
        tmp_path_factory: pytest.TempPathFactory,
        start: int,
        period: int,
        packets: int,
        every: int,
        lost: set[int],
        swapped: list[int],
    ) -> None:
        """Minutes and weeks roll over, packets are lost and change places, the minute comes seldom or late."""
        truth = [MINUTE * 60_000 + start + number * period for number in range(packets)]
        stream = [
            clock(gps % 60_000, gps // 60_000) if number % every == every - 1 else packet(gps % 60_000)
            for number, gps in enumerate(truth)
        ]
        order = list(range(packets))
        if period < 1000:
            for place in swapped:
                if place + 1 < packets:
                    order[place], order[place + 1] = order[place + 1], order[place]
        order = [number for number in order if number not in lost] or [0]
        # No more than 58 s may be lost at once, or nobody can tell how many minutes they were.
        path = tmp_path_factory.mktemp("time") / "nav.ncom"
        path.write_bytes(b"".join(stream[number] for number in order))
        (found,), account = read_packets(path)
        assert account == Account(accepted=len(order))
        longest = max((abs(truth[b] - truth[a]) for a, b in pairwise(order)), default=0)
        if longest <= 58_000 and any(number % every == every - 1 for number in order):
            assert found.time_known.all()
            assert found.time.tolist() == [stamp(0, truth[number]) for number in order]

    def test_a_reordered_packet_does_not_add_a_minute(self, log: Path) -> None:
        order = [clock(59_980), packet(59_990), packet(10), packet(0), packet(59_995), packet(20), packet(30)]
        log.write_bytes(b"".join(order))
        (found,), _ = read_packets(log)
        expected = [(0, 59_980), (0, 59_990), (1, 10), (1, 0), (0, 59_995), (1, 20), (1, 30)]
        assert found.time.tolist() == [stamp(MINUTE + minute, ms) for minute, ms in expected]

    def test_weeks_roll_over(self, log: Path) -> None:
        last = 10_080 * 2300 - 1
        table, _ = read_samples(log, [clock(59_990, last), packet(0), clock(10, last + 1)])
        assert times(table) == [stamp(last, 59_990), stamp(last + 1, 0), stamp(last + 1, 10)]
        assert datetime.fromtimestamp(times(table)[1] / 1e9, UTC).isoformat() == "2024-02-03T23:59:42+00:00"

    @pytest.mark.parametrize("lost", [60_030, 125_000, 3_600_000 + 17])
    def test_after_a_long_gap_the_next_minute_counts_backwards(self, log: Path, lost: int) -> None:
        truth = [30_000 + 10 * number + (lost if number >= 15 else 0) for number in range(30)]
        stream = [
            clock(ms % 60_000, MINUTE + ms // 60_000) if number in {10, 20} else packet(ms % 60_000)
            for number, ms in enumerate(truth)
        ]
        table, account = read_samples(log, stream)
        assert times(table) == [stamp(MINUTE, ms) for ms in truth]
        assert account == Account(accepted=30)

    def test_where_lost_minutes_leave_no_trace_nothing_is_guessed(self, log: Path) -> None:
        stream = [packet(0), clock(10), packet(20), packet(30), clock(40, MINUTE + 7), packet(50)]
        table, account = read_samples(log, stream)
        assert times(table) == [stamp(MINUTE, 0), stamp(MINUTE, 10), stamp(MINUTE + 7, 40), stamp(MINUTE + 7, 50)]
        reason = (
            "the GPS minute changed somewhere between the channel 0 before and the one after it, without a step in the "
            "milliseconds; its minute cannot be known"
        )
        rejections = [("byte 144", reason), ("byte 216", reason)]
        assert account == Account(accepted=4, rejected=2, rejections=rejections)

    def test_a_minute_that_contradicts_its_neighbours_is_not_believed(self, log: Path) -> None:
        table, account = read_samples(log, [clock(10), packet(20), clock(30, 9_999_999), packet(40), clock(50)])
        assert times(table) == [stamp(MINUTE, ms) for ms in (10, 20, 40, 50)]
        reason = "GPS minute 9999999 contradicts the packets before and after it; the packet is damaged"
        assert account == Account(accepted=4, rejected=1, rejections=[("byte 144", reason)])

    def test_impossible_milliseconds_are_rejected(self, log: Path) -> None:
        table, account = read_samples(log, [clock(10), packet(60_000), packet(30)])
        assert times(table) == [stamp(MINUTE, 10), stamp(MINUTE, 30)]
        reason = "60000 ms into the minute, of 0 to 59999; the packet is damaged"
        assert account == Account(accepted=2, rejected=1, rejections=[("byte 72", reason)])

    def test_a_unit_that_does_not_know_the_minute_yet(self, log: Path) -> None:
        table, _ = read_samples(log, [clock(10, 999), clock(20, -1), clock(30, 2**31 - 1), clock(40, 1000)])
        assert times(table) == [stamp(1000, ms, offset=0) for ms in (10, 20, 30, 40)]

    def test_a_status_only_packet_tells_the_minute_of_the_packet_before(self, log: Path) -> None:
        table, account = read_samples(log, [packet(30_000), clock(77, status=10), packet(30_020)])
        assert times(table) == [stamp(MINUTE, 30_000), stamp(MINUTE, 30_020)]
        assert account == Account(accepted=3)
        with pytest.raises(InputError):
            read_samples(log, [packet(59_990), clock(77, status=10), packet(20)])
        changed = [clock(0, status=10), clock(0, MINUTE + 7, status=10), clock(30_010, MINUTE + 7)]
        table, account = read_samples(log, [packet(30_000), *changed])
        assert times(table) == [stamp(MINUTE + 7, 30_000), stamp(MINUTE + 7, 30_010)]
        assert account == Account(accepted=4)

    def test_no_minute_at_all_is_an_error(self, log: Path) -> None:
        with pytest.raises(InputError) as caught:
            read_samples(log, [packet(10), clock(20, 999), clock(30, status=5)])
        assert str(caught.value) == (
            f"{log}: the time of its 3 packets cannot be known: none tells the GPS minute (status channel 0 with at "
            "least 1000 minutes). The unit had no GNSS time while this was recorded, or its output leaves that channel "
            "out; record with reception and all status channels"
        )
        (found,), _ = read_packets(log)
        assert not found.time_known.any()

    def test_no_packet_with_time_is_an_error(self, log: Path) -> None:
        with pytest.raises(InputError) as caught:
            read_samples(log, [packet(10, status=0), clock(20, status=1), packet(30, status=1)])
        assert str(caught.value) == (
            f"{log}: none of its 3 packets carries time: their navigation status is 0, 1, and only 2, 3 and 4 do. "
            "The unit was not initialised while this was recorded; wait for that before driving"
        )

    def test_utc_comes_from_channel_16_where_it_is_valid(self, log: Path) -> None:
        stream = [clock(10), utc(20, -3, valid=0), utc(30, -17), packet(40), utc(50, -18), packet(2000)]
        table, _ = read_samples(log, stream)
        expected = [(10, -17), (20, -17), (30, -17), (40, -17), (2000, -18)]
        assert times(table) == [stamp(MINUTE, ms, offset) for ms, offset in expected]
        assert table.schema.metadata[b"utc_from"] == b"status channel 16"

    @pytest.mark.parametrize(("minute", "offset"), [(15_669_160, -15), (19_454_399, -17), (23_000_000, -18)])
    def test_utc_comes_from_the_table_where_channel_16_is_silent(self, log: Path, minute: int, offset: int) -> None:
        table, account = read_samples(log, [clock(10, minute), utc(20, -1, valid=0)])
        assert times(table) == [stamp(minute, 10, offset), stamp(minute, 20, offset)]
        assert table.schema.metadata[b"utc_from"] == b"leap second table"
        assert account.rejected == 0

    def test_beyond_the_table_it_is_said(self, log: Path) -> None:
        later = 25_000_000
        table, account = read_samples(log, [clock(10, later)])
        assert times(table) == [stamp(later, 10)]
        reason = (
            "the log never tells UTC from GPS time (status channel 16), and the table of leap seconds ends on "
            "2027-06-28: its times may be a second off. Update Wheelprint"
        )
        assert account == Account(accepted=1, remarks=[("", reason)])
        assert read_samples(log, [clock(10, later), utc(20)])[1] == Account(accepted=2)


class TestOrder:
    def test_repeated_packets_are_rejected(self, log: Path) -> None:
        table, account = read_samples(log, [clock(10), packet(20), packet(20, velocity=(9.0, 9.0, 9.0)), packet(30)])
        assert times(table) == [stamp(MINUTE, ms) for ms in (10, 20, 30)]
        assert table["nav_speed"].to_pylist() == [5.0, 5.0, 5.0]
        reason = (
            "its time 2023-09-29T05:19:42.020Z is that of another packet; repeated in recording, the first one is kept"
        )
        assert account == Account(accepted=3, rejected=1, rejections=[("byte 144", reason)])

    def test_packets_out_of_order_are_rejected(self, log: Path) -> None:
        table, account = read_samples(log, [clock(10), packet(30), packet(20), packet(40), packet(15), packet(50)])
        assert times(table) == [stamp(MINUTE, ms) for ms in (10, 20, 40, 50)]
        explanation = "is out of order with the packets around it; they changed places, or the clock was set"
        assert account == Account(
            accepted=4,
            rejected=2,
            rejections=[
                ("byte 72", f"its time 2023-09-29T05:19:42.030Z {explanation}"),
                ("byte 288", f"its time 2023-09-29T05:19:42.015Z {explanation}"),
            ],
        )

    def test_one_packet_from_the_future_does_not_hide_the_rest(self, log: Path) -> None:
        stream = [clock(10), packet(20), packet(20_000), *(clock(ms) for ms in range(30, 1000, 10))]
        table, account = read_samples(log, stream)
        assert times(table) == [stamp(MINUTE, ms) for ms in range(10, 1000, 10)]
        assert (account.accepted, account.rejected) == (99, 1)

    def test_order_is_kept_from_batch_to_batch(self, log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("wheelprint.ingest.oxts.ncom_packets.BATCH", 2)
        table, account = read_samples(log, [clock(10), clock(20), clock(20), clock(15), clock(30), clock(30)])
        assert times(table) == [stamp(MINUTE, ms) for ms in (10, 20, 30)]
        assert [where for where, _ in account.rejections] == ["byte 144", "byte 216", "byte 360"]
        assert [reason.split(";")[0] for _, reason in account.rejections] == [
            "its time 2023-09-29T05:19:42.020Z is that of another packet",
            "its time 2023-09-29T05:19:42.015Z is out of order with the packets around it",
            "its time 2023-09-29T05:19:42.030Z is that of another packet",
        ]


class TestSamples:
    @pytest.mark.parametrize("status", [0, 1, 5, 6, 7, 8, 10, 11, 20, 21, 22, 255])
    def test_other_statuses_give_no_sample(self, log: Path, status: int) -> None:
        table, account = read_samples(log, [clock(10), packet(20, status=status), packet(30)])
        assert times(table) == [stamp(MINUTE, 10), stamp(MINUTE, 30)]
        assert account == Account(accepted=3)

    @pytest.mark.parametrize("status", [0, 5, 6, 7, 11, 20, 255])
    def test_what_is_ignored_tells_neither_time_nor_accuracy(self, log: Path, status: int) -> None:
        stream = [
            clock(10), accuracy(20, 3, 4), clock(25, 7_000_000, status=status), utc(30, -1, status=status),
            accuracy(40, 90, 90, status=status), packet(50),
        ]  # fmt: skip
        table, account = read_samples(log, stream)
        assert times(table) == [stamp(MINUTE, ms) for ms in (10, 20, 50)]
        assert table["position_accuracy"].to_pylist() == [None, 0.005, 0.005]
        assert account == Account(accepted=6)

    def test_initialising_gives_inertial_values_alone(self, log: Path) -> None:
        wild = (1e308, float("nan"), float("inf"))
        table, account = read_samples(log, [clock(10, status=2, position=wild), packet(20)])
        assert account == Account(accepted=2)
        present = {name for name in table.column_names if table[name][0].is_valid}
        assert present == {
            "time", "nav_yaw_rate", "nav_longitudinal_acceleration", "nav_lateral_acceleration", "nav_status",
        }  # fmt: skip
        assert table["nav_status"].to_pylist() == [2, 4]
        # The origin is the first valid position.
        assert (table["x"][1].as_py(), table["y"][1].as_py()) == (0.0, 0.0)

    def test_axes_and_units(self, log: Path) -> None:
        fields: dict[str, Any] = {
            "acceleration": (1.5, 0.5, -9.8), "rates": (0.1, 0.2, 0.25), "velocity": (3.0, -4.0, 1.0),
            "angles": (np.pi / 2 + 0.1, 0.02, -0.03), "position": (0.84, 0.2, 500.0),
        }  # fmt: skip
        table, _ = read_samples(
            log, [clock(10, **fields), packet(20, **{**fields, "position": (0.840001, 0.2, 500.0)})]
        )
        (row,) = table.slice(0, 1).to_pylist()
        heading = round((np.pi / 2 + 0.1) * 1e6) / 1e6
        assert row["latitude"] == pytest.approx(np.degrees(0.84), rel=1e-15)
        assert row["longitude"] == pytest.approx(np.degrees(0.2), rel=1e-15)
        assert row["altitude"] == 500.0
        assert row["course"] == pytest.approx(143.13010235415598, abs=1e-12)
        assert row["heading"] == pytest.approx(90 - np.degrees(heading), abs=1e-12)
        assert row["nav_speed"] == 5.0
        assert row["nav_yaw_rate"] == pytest.approx(-np.degrees(0.25), rel=1e-14)
        assert row["nav_longitudinal_acceleration"] == pytest.approx(1.5 - 9.80665 * np.sin(0.02), rel=1e-12)
        lateral = -(0.5 + 9.80665 * np.cos(0.02) * np.sin(-0.03))
        assert row["nav_lateral_acceleration"] == pytest.approx(lateral, rel=1e-12)
        assert row["position_accuracy"] is None
        assert row["nav_status"] == 4
        origin = json.loads(table.schema.metadata[b"origin"])
        assert origin == {"latitude": row["latitude"], "longitude": row["longitude"], "altitude": 500.0}
        assert table["x"].to_pylist() == [0.0, pytest.approx(0.0, abs=1e-9)]
        # A microradian to the north at this latitude is 6.37 m.
        assert table["y"].to_pylist() == [0.0, pytest.approx(6.372, abs=1e-3)]
        assert table.schema.equals(NAVIGATION)

    def test_invalid_fields_become_null(self, log: Path) -> None:
        fields: dict[str, Any] = {
            "acceleration": (None, 0.0, -9.8),
            "velocity": (None, 1.0, 0.0),
            "angles": (0.1, None, 0.2),
        }
        table, _ = read_samples(log, [clock(10, rates=(0.0, 0.0, None), **fields)])
        (row,) = table.to_pylist()
        missing = {name for name, value in row.items() if value is None}
        assert missing == {
            "course", "nav_speed", "nav_yaw_rate", "nav_longitudinal_acceleration", "position_accuracy",
        }  # fmt: skip
        # Without pitch gravity is not removed.
        assert row["nav_lateral_acceleration"] == 0.0

    def test_a_log_without_any_position_has_no_origin(self, log: Path) -> None:
        table, account = read_samples(log, [clock(10, status=2), packet(20, status=2)])
        assert account == Account(accepted=2)
        assert json.loads(table.schema.metadata[b"origin"]) is None
        assert table["x"].null_count == 2

    @pytest.mark.parametrize(
        ("position", "found"),
        [
            ((1.6, 0.2, 0.0), "latitude 1.6 rad, longitude 0.2 rad, altitude 0 m"),
            ((0.8, -3.2, 0.0), "latitude 0.8 rad, longitude -3.2 rad, altitude 0 m"),
            ((0.8, 0.2, 1e30), "latitude 0.8 rad, longitude 0.2 rad, altitude 1.00000002e+30 m"),
            ((float("nan"), 0.2, 0.0), "latitude nan rad, longitude 0.2 rad, altitude 0 m"),
        ],
    )
    def test_positions_nowhere_on_earth_are_rejected(
        self, log: Path, position: tuple[float, float, float], found: str
    ) -> None:
        table, account = read_samples(log, [clock(10, position=position), packet(20)])
        assert times(table) == [stamp(MINUTE, 20)]
        reason = f"{found} is nowhere on earth; the packet is damaged"
        assert account == Account(accepted=1, rejected=1, rejections=[("byte 0", reason)])

    def test_position_accuracy_is_held_until_the_next(self, log: Path) -> None:
        stream = [
            clock(10), accuracy(20, 30, 40), packet(30), accuracy(40, 6, 8, age=149), packet(50),
            accuracy(60, 6, 8, age=150), packet(70), accuracy(80, 5, 12, status=10), packet(90),
        ]  # fmt: skip
        table, _ = read_samples(log, stream)
        assert table["position_accuracy"].to_pylist() == pytest.approx(
            [None, 0.05, 0.05, 0.01, 0.01, None, None, 0.013], abs=1e-15
        )
