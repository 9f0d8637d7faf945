"""Eight characters of a text at a time, and its lines, compiled: import it where it is used, numba is heavy.

Eight are the bytes of a word, the first one the lowest, and worked on all at once ("SIMD within a register"): no byte's
result ever carries into the next one.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from .text_lanes import LANES, first_place, newlines_at

Text = npt.NDArray[np.uint8]

NEWLINE = 10
WORD = 8
"""Characters."""

_ONES = np.uint64(0x0101010101010101)
_ZEROS = np.uint64(0x3030303030303030)


@njit(cache=True, nogil=True)
def first_of(word: np.uint64, count: int) -> np.uint64:
    """Return a word of which only the first `count` characters, up to 8, are left; the others are no characters: 0."""
    return word if count >= WORD else word & ((np.uint64(1) << np.uint64(8 * count)) - np.uint64(1))


@njit(cache=True, nogil=True)
def decimal_word(word: np.uint64) -> tuple[np.uint64, bool]:
    """Return the number that eight decimal digits are, and whether one is none."""
    digits = word ^ _ZEROS
    bad = (digits | digits + np.uint64(6) * _ONES) & np.uint64(0xF0F0F0F0F0F0F0F0) != np.uint64(0)
    pairs = digits * np.uint64(10) + (digits >> np.uint64(8))
    odd, even = pairs & np.uint64(0x000000FF000000FF), pairs >> np.uint64(16) & np.uint64(0x000000FF000000FF)
    return (odd * np.uint64(0x000F424000000064) + even * np.uint64(0x0000271000000001)) >> np.uint64(32), bad


@njit(cache=True, nogil=True)
def line_ends(text: Text) -> npt.NDArray[np.int64]:
    """Return the places of all line ends (LF)."""
    ends, count, whole = np.empty(len(text), np.int64), 0, len(text) // LANES * LANES
    for p in range(0, whole, LANES):
        here = newlines_at(text, np.uint64(p))
        while here:
            ends[count] = p + np.int64(first_place(here))
            count += 1
            here &= here - np.uint64(1)
    for p in range(whole, len(text)):
        ends[count] = p
        count += text[p] == NEWLINE
    return ends[:count]
