"""The checksum of Ogg pages; apart from its users because numba is slow to import."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit


def _remainders() -> npt.NDArray[np.uint32]:
    table = []
    for octet in range(256):
        remainder = octet << 24
        for _ in range(8):
            remainder = (remainder << 1) ^ (0x04C11DB7 if remainder & 0x8000_0000 else 0)
        table.append(remainder & 0xFFFF_FFFF)
    return np.array(table, np.uint32)


REMAINDERS = _remainders()
"""Of every byte's division by the polynomial 0x04C11DB7."""


@njit(cache=True)
def checksum(page: npt.NDArray[np.uint8]) -> int:
    """Return the CRC of a page (n_bytes,) whose own checksum is zeroed (RFC 3533: not reflected, from 0)."""
    remainder = np.uint32(0)
    for octet in page:
        remainder = np.uint32(remainder << np.uint32(8)) ^ REMAINDERS[(remainder >> np.uint32(24)) ^ np.uint32(octet)]
    return int(remainder)
