"""Finding the packets in a stream of bytes; apart from its users because numba is slow to import."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit


@njit(cache=True)
def find_packets(data: npt.NDArray[np.uint8]) -> tuple[npt.NDArray[np.int64], int]:
    """Return the offset of every NCOM packet, in order, and where the search ended, less than 72 bytes before the end.

    A packet is 72 bytes that begin with 0xE7 and end in the sum of the bytes between, modulo 256 (checksum 3);
    where there is none, the search goes on one byte further, as OxTS's own decoder does.

    Args:
        data: uint8 (n_bytes,).
    """
    offsets = np.empty(len(data) // 72, np.int64)
    count = 0
    place = 0
    while place + 72 <= len(data):
        if data[place] == 0xE7:
            total = 0
            for octet in data[place + 1 : place + 71]:
                total += octet
            if total & 0xFF == data[place + 71]:
                offsets[count] = place
                count += 1
                place += 72
                continue
        place += 1
    return offsets[:count], place
