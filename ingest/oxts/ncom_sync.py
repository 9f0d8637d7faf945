"""Finding packets in a stream of bytes and counting through them, compiled: import it where it is used."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from ..words import word_at
from .ncom_time import MINUTE, REORDERED

HEAD = (1, 2, 21, 62, 63, 64, 65, 66, 70)
"""The bytes of a packet that tell its time and those of its neighbours."""


_EVERY_SECOND = np.uint64(0x00FF00FF00FF00FF)


@njit(cache=True, nogil=True)
def _checksum3(data: npt.NDArray[np.uint8], place: np.uint64) -> np.uint64:
    """Return the sum modulo 256 of bytes 1 to 70 of the packet at `place`, a word at a time."""
    word = word_at(data, place + np.uint64(64)) & np.uint64(0x00FFFFFFFFFFFFFF)  # The last byte is the sum itself.
    sums = (word & _EVERY_SECOND) + (word >> np.uint64(8) & _EVERY_SECOND)
    for k in range(8):
        word = word_at(data, place + np.uint64(8 * k))
        sums += (word & _EVERY_SECOND) + (word >> np.uint64(8) & _EVERY_SECOND)
    total = sums * np.uint64(0x0001000100010001) >> np.uint64(48)
    return np.uint64(total - np.uint64(0xE7) & np.uint64(0xFF))


@njit(cache=True, nogil=True)
def find_packets(
    data: npt.NDArray[np.uint8],
    place: int,
    stop: int,
    offsets: npt.NDArray[np.int64],
    heads: npt.NDArray[np.uint8],
    count: int,
) -> tuple[int, int]:
    """Find the NCOM packets that lie between two places of a file.

    A packet is 72 bytes that begin with 0xE7 and end in the sum of the bytes between, modulo 256 (checksum 3);
    where there is none, the search goes on one byte further, as OxTS's own decoder does. It ends less than 72 bytes
    before the end.

    Args:
        data: uint8 (n_bytes,), the file.
        place: Where the search begins.
        stop: Where it ends.
        offsets: (most,), filled from `count` on with where packets begin, in order.
        heads: (9, most), filled with their bytes `HEAD`.
        count: Packets that were found before.

    Returns:
        How many are found now, and where the search ended.
    """
    while place + 72 <= stop:
        if data[place] == 0xE7 and _checksum3(data, np.uint64(place)) == data[place + 71]:
            offsets[count] = place
            for k in range(len(HEAD)):
                heads[k, count] = data[place + HEAD[k]]
            count += 1
            place += 72
            continue
        place += 1
    return count, place


@njit(cache=True, nogil=True)
def count_through(within: npt.NDArray[np.int32]) -> npt.NDArray[np.int64]:
    """Return the milliseconds of packets, (n,) within the minute, counted on over the minutes from the first packet's.

    A step back of less than `REORDERED` is one; any other leads into a later minute.
    """
    count = np.empty(len(within), np.int64)
    total = last = np.int64(within[0])
    for k in range(len(within)):
        step = within[k] - last
        if step <= -REORDERED or step > MINUTE - REORDERED:
            step += MINUTE if step < 0 else -MINUTE
        last = np.int64(within[k])
        total += step
        count[k] = total
    return count
