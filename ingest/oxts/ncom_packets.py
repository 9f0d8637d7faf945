"""The packets of an NCOM file: found, counted, stamped and decoded, still with the unit's own axes and units."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from mmap import ACCESS_READ, MADV_DONTNEED, mmap
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ...schemas.errors import InputError
from ..account import Account
from ..content import blocks, head
from . import ncom_layout as layout
from .ncom_time import Notices, Stamps, stamp_packets

if TYPE_CHECKING:
    from .ncom_sync import Found

BATCH = 65_536
"""Packets decoded at once; about 11 MB."""
BLOCK = 1 << 22
"""Bytes searched at once."""


@dataclass(frozen=True, slots=True)
class NcomPackets:
    """Packets in the order of the file, with the unit's own axes and units.

    What a packet's navigation status says is not applied here: every field is what the bytes hold.

    Attributes:
        offset: int64 (n,), byte of the (decompressed) file where the packet begins.
        time: int64 (n,), ns since 1970, UTC; 0 where not known.
        time_known: bool (n,).
        status: uint8 (n,), navigation status.
        channel: uint8 (n,), status channel.
        raw: uint8 (n, 72), the packets themselves.
    """

    offset: npt.NDArray[np.int64]
    time: npt.NDArray[np.int64]
    time_known: npt.NDArray[np.bool_]
    status: npt.NDArray[np.uint8]
    channel: npt.NDArray[np.uint8]
    raw: npt.NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.offset)

    @property
    def milliseconds(self) -> npt.NDArray[np.uint16]:
        """Into the GPS minute, uint16 (n,); like all properties decoded anew when it is asked for."""
        low, high = self.raw[:, 1].astype(np.uint16), self.raw[:, 2].astype(np.uint16)
        return low | high << np.uint16(8)

    @property
    def batch(self) -> npt.NDArray[np.uint8]:
        """The status channel's content ("batch S"), uint8 (n, 8)."""
        return self.raw[:, 63:71]

    @property
    def latitude(self) -> npt.NDArray[np.float64]:
        """rad, (n,), WGS 84."""
        return self._position(0)

    @property
    def longitude(self) -> npt.NDArray[np.float64]:
        """rad, (n,)."""
        return self._position(1)

    @property
    def altitude(self) -> npt.NDArray[np.float64]:
        """m, (n,)."""
        return self._position(2)

    def _position(self, number: int) -> npt.NDArray[np.float64]:
        from .ncom_fields import positions

        position: npt.NDArray[np.float64] = positions(self.raw)[number]
        return position

    @property
    def acceleration(self) -> npt.NDArray[np.float64]:
        """m/s², (n, 3), x, y, z of the vehicle: forward, right, down; gravity included (level: z ≈ -9.8)."""
        return self._vector(0)

    @property
    def angular_rate(self) -> npt.NDArray[np.float64]:
        """rad/s about the vehicle's axes, (n, 3)."""
        return self._vector(1)

    @property
    def velocity(self) -> npt.NDArray[np.float64]:
        """m/s, (n, 3), north, east, down."""
        return self._vector(2)

    @property
    def orientation(self) -> npt.NDArray[np.float64]:
        """rad, (n, 3), heading (clockwise from north), pitch (nose up), roll (right side down)."""
        return self._vector(3)

    def _vector(self, number: int) -> npt.NDArray[np.float64]:
        from .ncom_fields import components

        vector: npt.NDArray[np.float64] = components(self.raw, np.arange(3 * number, 3 * number + 3)).T
        return vector

    @property
    def checksum1(self) -> npt.NDArray[np.bool_]:
        """Whether checksum 1 (of bytes 1 to 21) is right, (n,). Checksum 3 of all of them is."""
        return np.equal(layout.checksum(self.raw, 22), self.raw[:, 22])

    @property
    def checksum2(self) -> npt.NDArray[np.bool_]:
        """Whether checksum 2 (of bytes 1 to 60) is right, (n,)."""
        return np.equal(layout.checksum(self.raw, 61), self.raw[:, 61])


@dataclass(frozen=True, slots=True)
class Scan:
    """A file's packets, found and stamped but not yet decoded.

    Attributes:
        data: uint8 (n_bytes,), the file.
        mapped: What `data` is a view of; None where the file is compressed, and so had to be loaded.
        offset: int64 (n,), where packets begin.
        status: uint8 (n,), their navigation status.
        channel: uint8 (n,), their status channel.
        stamps: Their times.
    """

    data: npt.NDArray[np.uint8]
    mapped: mmap | None
    offset: npt.NDArray[np.int64]
    status: npt.NDArray[np.uint8]
    channel: npt.NDArray[np.uint8]
    stamps: Stamps

    def __iter__(self) -> Iterator[tuple[int, NcomPackets]]:
        """Yield batches of decoded packets, each with the number of its first packet."""
        for first in range(0, len(self.offset), BATCH):
            chosen = slice(first, first + BATCH)
            offset, stamps = self.offset[chosen], self.stamps
            if int(offset[-1] - offset[0]) == layout.LENGTH * (len(offset) - 1):
                raw = self.data[offset[0] : offset[-1] + layout.LENGTH].reshape(-1, layout.LENGTH)
            else:
                raw = self.data[offset[:, None] + np.arange(layout.LENGTH)]
            time, known, status, channel = stamps.time[chosen], stamps.known[chosen], self.status, self.channel
            yield first, NcomPackets(offset, time, known, status[chosen], channel[chosen], raw)
            _forget(self.mapped)


def scan_packets(path: Path, account: Account) -> Scan:
    """Find and stamp the packets of a file.

    Args:
        path: NCOM, plain or compressed.
        account: Every stretch of bytes between packets is counted as one rejection, with its first byte. A packet
            that the file ends within makes it truncated and is counted as nothing else.

    Raises:
        InputError: The file is missing, unreadable, empty, or holds no packet.
    """
    data, mapped = _content(path, account)
    found = _find(data, mapped)
    if len(found.offset) == 0:
        reason = (
            f"holds no NCOM packet in {len(data)} bytes; one is 72 bytes from 0xE7 to a matching checksum. "
            "It may be of another format: export the unit's recording as NCOM"
        )
        raise InputError(path, "", reason)
    _account_for_the_rest(data, found.offset, account)
    minutes, utc_offsets = Notices(found.minute_at, found.minute), Notices(found.utc_at, found.utc_offset)
    stamps = stamp_packets(found.status, found.milliseconds, minutes, utc_offsets)
    return Scan(data, mapped, found.offset, found.status, found.channel, stamps)


def _content(path: Path, account: Account) -> tuple[npt.NDArray[np.uint8], mmap | None]:
    start = head(path)
    if not start:
        reason = "holds nothing: empty, or compressed and damaged from its start; the unit may have been off too early"
        raise InputError(path, "", reason)
    try:
        with path.open("rb") as file:
            mapped = mmap(file.fileno(), 0, access=ACCESS_READ)
    except OSError as error:
        raise InputError(path, "", f"cannot be read: {error.strerror or error}") from None
    if mapped[: len(start)] == start:
        return np.frombuffer(mapped, np.uint8), mapped
    return np.frombuffer(b"".join(blocks(path, account)), np.uint8), None


def _forget(mapped: mmap | None) -> None:
    """Give the pages of a file that were read back to the system, or they count as memory of this process."""
    if mapped is not None:
        mapped.madvise(MADV_DONTNEED)


def _find(data: npt.NDArray[np.uint8], mapped: mmap | None) -> Found:
    from .ncom_sync import Found, find_packets

    most = len(data) // layout.LENGTH
    found = Found(
        offset=np.empty(most, np.int64),
        milliseconds=np.empty(most, np.uint16),
        status=np.empty(most, np.uint8),
        channel=np.empty(most, np.uint8),
        minute_at=np.empty(most, np.int64),
        minute=np.empty(most, np.int64),
        utc_at=np.empty(most, np.int64),
        utc_offset=np.empty(most, np.int64),
    )
    place, searched, counts = 0, 0, (0, 0, 0)
    while searched < len(data):
        searched = min(place + BLOCK, len(data))
        place, counts = find_packets(data, place, searched, found, counts)
        _forget(mapped)
    packets, minutes, utc_offsets = (slice(count) for count in counts)
    return Found(
        found.offset[packets],
        found.milliseconds[packets],
        found.status[packets],
        found.channel[packets],
        found.minute_at[minutes],
        found.minute[minutes],
        found.utc_at[utc_offsets],
        found.utc_offset[utc_offsets],
    )


def _account_for_the_rest(data: npt.NDArray[np.uint8], offset: npt.NDArray[np.int64], account: Account) -> None:
    """Account for every byte that is in no packet."""
    last = int(offset[-1]) + layout.LENGTH
    tail = max(last, len(data) - layout.LENGTH + 1)
    syncs = np.flatnonzero(data[tail:] == layout.SYNC)
    end = tail + int(syncs[0]) if len(syncs) else len(data)
    account.truncated |= end < len(data)
    broken: npt.NDArray[np.intp] = np.flatnonzero(np.diff(offset) != layout.LENGTH)
    begins = [0, *(offset[broken] + layout.LENGTH).tolist(), last]
    ends = [int(offset[0]), *offset[broken + 1].tolist(), end]
    for begin, size in ((begin, end - begin) for begin, end in zip(begins, ends, strict=True) if end > begin):
        reason = (
            f"{size} bytes that are no packet (72 bytes from 0xE7 to a matching checksum): damaged or lost in "
            "recording, or of another stream"
        )
        account.reject(f"byte {begin}", reason)
