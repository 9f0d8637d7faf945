"""Finding packets in a stream of bytes and counting through them, compiled: import it where it is used."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from ..words import SUMMED, sum_at, word_at
from .ncom_layout import FIRST_VALID_MINUTE, HOLDS_CHANNEL, LAST_VALID_MINUTE, TIME_CHANNEL, UTC_CHANNEL
from .ncom_time import MINUTE, REORDERED


@njit(cache=True, nogil=True)
def _has_checksum3(data: npt.NDArray[np.uint8], place: int) -> bool:
    """Tell whether the last byte of the packet at `place` is the sum of those between it and the first."""
    last = word_at(data, np.uint64(place + SUMMED))
    pairs = (last & np.uint64(0x00FF00FF00FF00FF)) + (last >> np.uint64(8) & np.uint64(0x00FF00FF00FF00FF))
    rest = pairs * np.uint64(0x0001000100010001) >> np.uint64(48)
    total = np.uint64(sum_at(data, np.uint64(place))) + rest
    # The total has the first byte, 0xE7, and the last one, too.
    return bool((total - np.uint64(0xE7) - np.uint64(2) * (last >> np.uint64(56))) & np.uint64(0xFF) == np.uint64(0))


class Found(NamedTuple):
    """What is found in the packets of a file, before they are decoded.

    Attributes:
        offset: int64 (n,), where they begin, in order.
        milliseconds: uint16 (n,), within the minute.
        status: uint8 (n,), navigation status.
        channel: uint8 (n,), status channel.
        minute_at: int64 (m,), numbers of those that tell a valid GPS minute (status channel 0), and
        minute: int64 (m,), which.
        utc_at: int64 (k,), numbers of those that tell UTC - GPS (status channel 16), and
        utc_offset: int64 (k,), s.
    """

    offset: npt.NDArray[np.int64]
    milliseconds: npt.NDArray[np.uint16]
    status: npt.NDArray[np.uint8]
    channel: npt.NDArray[np.uint8]
    minute_at: npt.NDArray[np.int64]
    minute: npt.NDArray[np.int64]
    utc_at: npt.NDArray[np.int64]
    utc_offset: npt.NDArray[np.int64]

    @staticmethod
    def room_for(count: int) -> Found:
        """Return what so many packets fill."""
        return Found(
            np.empty(count, np.int64),
            np.empty(count, np.uint16),
            np.empty(count, np.uint8),
            np.empty(count, np.uint8),
            np.empty(count, np.int64),
            np.empty(count, np.int64),
            np.empty(count, np.int64),
            np.empty(count, np.int64),
        )

    def first(self, counts: tuple[int, int, int]) -> Found:
        """Return what is filled of packets, of minutes and of UTC - GPS."""
        packets, minutes, utc_offsets = (slice(count) for count in counts)
        return Found(
            self.offset[packets],
            self.milliseconds[packets],
            self.status[packets],
            self.channel[packets],
            self.minute_at[minutes],
            self.minute[minutes],
            self.utc_at[utc_offsets],
            self.utc_offset[utc_offsets],
        )

    def moved_to(self, room: Found) -> Found:
        """Return larger arrays, with the content of these at their start."""
        filled: tuple[npt.NDArray[Any], ...] = self
        larger: tuple[npt.NDArray[Any], ...] = room
        for old, new in zip(filled, larger, strict=True):
            new[: len(old)] = old
        return room


@njit(cache=True, nogil=True)
def find_packets(
    data: npt.NDArray[np.uint8], begin: int, found: Found, counts: tuple[int, int, int]
) -> tuple[int, tuple[int, int, int]]:
    """Find the NCOM packets in a piece of a file.

    A packet is 72 bytes that begin with 0xE7 and end in the sum of the bytes between, modulo 256 (checksum 3);
    where there is none, the search goes on one byte further, as OxTS's own decoder does. It ends less than 72 bytes
    before the end.

    Args:
        data: uint8 (n_bytes,), the piece.
        begin: The byte of the file where it begins.
        found: Long enough, with what was found before; what is found now is added.
        counts: Packets that were found before, and how many of them tell minutes, and UTC - GPS.

    Returns:
        Where in the piece the search ended, and what is counted now.
    """
    packets, minutes, utc_offsets = counts
    place = 0
    while place + 72 <= len(data):
        if data[place] != 0xE7 or not _has_checksum3(data, place):
            place += 1
            continue
        status, channel = data[place + 21], data[place + 62]
        found.offset[packets] = begin + place
        found.milliseconds[packets] = np.uint16(data[place + 1]) | np.uint16(data[place + 2]) << 8
        found.status[packets], found.channel[packets] = status, channel
        if channel == TIME_CHANNEL and HOLDS_CHANNEL[status]:
            minute = np.int64(np.int32(word_at(data, np.uint64(place + 63)) & np.uint64(0xFFFFFFFF)))
            if FIRST_VALID_MINUTE <= minute <= LAST_VALID_MINUTE:
                found.minute_at[minutes], found.minute[minutes] = packets, minute
                minutes += 1
        elif channel == UTC_CHANNEL and HOLDS_CHANNEL[status]:
            coded = np.int64(np.int8(data[place + 70]))
            if coded & 1:
                found.utc_at[utc_offsets], found.utc_offset[utc_offsets] = packets, coded >> 1
                utc_offsets += 1
        packets += 1
        place += 72
    return place, (packets, minutes, utc_offsets)


@njit(cache=True, nogil=True)
def count_through(within: npt.NDArray[np.uint16]) -> npt.NDArray[np.int64]:
    """Return the milliseconds of packets, (n,) within the minute, counted on over the minutes from the first packet's.

    A step back of less than `REORDERED` is one; any other leads into a later minute.
    """
    count = np.empty(len(within), np.int64)
    total = last = np.int64(within[0])
    for k in range(len(within)):
        step = np.int64(within[k]) - last
        if step <= -REORDERED or step > MINUTE - REORDERED:
            step += MINUTE if step < 0 else -MINUTE
        last = np.int64(within[k])
        total += step
        count[k] = total
    return count
