"""The packets of an NCOM file: found, counted, stamped and decoded, still with the unit's own axes and units."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ...schemas.errors import InputError
from ..account import Account
from ..content import blocks, joined
from . import ncom_layout as layout
from .ncom_time import Notices, Stamps, stamp_packets

if TYPE_CHECKING:
    from .ncom_sync import Found

BATCH = 65_536
"""Packets decoded at once; about 11 MB."""
BLOCK = 8_192
"""Packets searched for at once; about half the second cache."""


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
        path: The file.
        offset: int64 (n,), where packets begin.
        status: uint8 (n,), their navigation status.
        channel: uint8 (n,), their status channel.
        stamps: Their times.
    """

    path: Path
    offset: npt.NDArray[np.int64]
    status: npt.NDArray[np.uint8]
    channel: npt.NDArray[np.uint8]
    stamps: Stamps

    def batches(self, account: Account) -> Iterator[tuple[int, NcomPackets]]:
        """Read the file again, and yield batches of its packets, each with the number of its first packet.

        Args:
            account: Told how far the file is read; all else is counted already.

        Raises:
            InputError: The file cannot be read any more, or not all of it.
        """
        again = Account()
        first, begin, rest = 0, 0, b""
        for block in joined(blocks(self.path, again, BATCH * layout.LENGTH), BATCH * layout.LENGTH):
            account.bytes_read = again.bytes_read
            content = rest + block
            stop = int(np.searchsorted(self.offset, begin + len(content) - layout.LENGTH, "right"))
            if first < stop:
                yield first, self._packets(slice(first, stop), content, begin)
            used = int(self.offset[stop]) - begin if stop < len(self.offset) else len(content)
            first, begin, rest = stop, begin + min(used, len(content)), content[used:]
        if first < len(self.offset):
            reason = (
                f"ended before its packet {first + 1} of {len(self.offset)} when it was read again, so something wrote "
                "to it meanwhile; convert it when it is complete"
            )
            raise InputError(self.path, f"byte {begin}", reason)

    def _packets(self, chosen: slice, content: bytes, begin: int) -> NcomPackets:
        """Return packets that stand in `content`, which begins at a byte of the file."""
        octets, offset, stamps = np.frombuffer(content, np.uint8), self.offset[chosen], self.stamps
        places = offset - begin
        if int(places[-1] - places[0]) == layout.LENGTH * (len(places) - 1):
            raw = octets[places[0] : places[-1] + layout.LENGTH].reshape(-1, layout.LENGTH)
        else:
            raw = octets[places[:, None] + np.arange(layout.LENGTH)]
        time, known, status, channel = stamps.time[chosen], stamps.known[chosen], self.status, self.channel
        return NcomPackets(offset, time, known, status[chosen], channel[chosen], raw)


def scan_packets(path: Path, account: Account) -> Scan:
    """Find and stamp the packets of a file.

    Args:
        path: NCOM, plain or compressed.
        account: Every stretch of bytes between packets is counted as one rejection, with its first byte. A packet
            that the file ends within makes it truncated and is counted as nothing else.

    Raises:
        InputError: The file is missing, unreadable, empty, or holds no packet.
    """
    found, size, rest = _find(path, account)
    if size == 0:
        reason = "holds nothing: empty, or compressed and damaged from its start; the unit may have been off too early"
        raise InputError(path, "", reason)
    if len(found.offset) == 0:
        reason = (
            f"holds no NCOM packet in {size} bytes; one is 72 bytes from 0xE7 to a matching checksum. "
            "It may be of another format: export the unit's recording as NCOM"
        )
        raise InputError(path, "", reason)
    _account_for_the_rest(found.offset, size, rest, account)
    minutes, utc_offsets = Notices(found.minute_at, found.minute), Notices(found.utc_at, found.utc_offset)
    stamps = stamp_packets(found.status, found.milliseconds, minutes, utc_offsets)
    return Scan(path, found.offset, found.status, found.channel, stamps)


def _find(path: Path, account: Account) -> tuple[Found, int, bytes]:
    """Return what is found in a file, how many bytes it has decompressed, and the last ones, too few for a packet."""
    from .ncom_sync import Found, find_packets

    found, counts, begin, rest = Found.room_for(0), (0, 0, 0), 0, b""
    for block in blocks(path, account, BLOCK * layout.LENGTH):
        content = rest + block
        if (most := counts[0] + len(content) // layout.LENGTH) > len(found.offset):
            # Of a compressed file nobody knows how much is to come.
            found = found.first(counts).moved_to(Found.room_for(max(2 * most, path.stat().st_size // layout.LENGTH)))
        place, counts = find_packets(np.frombuffer(content, np.uint8), begin, found, counts)
        begin, rest = begin + place, content[place:]
    account.bytes_read = 0
    return found.first(counts), begin + len(rest), rest


def _account_for_the_rest(offset: npt.NDArray[np.int64], size: int, rest: bytes, account: Account) -> None:
    """Account for every byte that is in no packet of a file of so many bytes, the last of which are `rest`."""
    sync = rest.find(layout.SYNC)
    end = size if sync < 0 else size - len(rest) + sync
    account.truncated |= end < size
    broken: npt.NDArray[np.intp] = np.flatnonzero(np.diff(offset) != layout.LENGTH)
    begins = [0, *(offset[broken] + layout.LENGTH).tolist(), int(offset[-1]) + layout.LENGTH]
    ends = [int(offset[0]), *offset[broken + 1].tolist(), end]
    for begin, length in ((begin, end - begin) for begin, end in zip(begins, ends, strict=True) if end > begin):
        reason = (
            f"{length} bytes that are no packet (72 bytes from 0xE7 to a matching checksum): damaged or lost in "
            "recording, or of another stream"
        )
        account.reject(f"byte {begin}", reason)
