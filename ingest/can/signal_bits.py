"""From payloads to columns of raw and physical values, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

Words = npt.NDArray[np.uint64]

BITS, INTEGER, NUMBER = range(3)
"""What a column is to hold: the bits as they are; raw × scale + offset modulo 2^64; the same in float64."""

FIRST, LENGTH, BIG_ENDIAN, SIGNED, KIND = range(5)
"""The columns of `places`."""


@njit(cache=True, nogil=True)
def rows_by_group(group: npt.NDArray[np.uint16], groups: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the rows ordered by their group, ascending within each, and where each group begins among them.

    Args:
        group: (n,), below `groups`.
        groups: How many there are.

    Returns:
        (n,) and (`groups` + 1,).
    """
    begins = np.zeros(groups + 1, np.intp)
    for k in range(len(group)):
        begins[np.intp(group[k]) + 1] += 1
    for number in range(groups):
        begins[number + 1] += begins[number]
    rows, place = np.empty(len(group), np.intp), begins.copy()
    for k in range(len(group)):
        own = np.intp(group[k])
        rows[place[own]] = k
        place[own] += 1
    return rows, begins


@njit(cache=True, nogil=True)
def _reversed(word: np.uint64) -> np.uint64:
    """Return a word with its bytes in the other order."""
    word = (word & np.uint64(0x00FF00FF00FF00FF)) << np.uint64(8) | word >> np.uint64(8) & np.uint64(0x00FF00FF00FF00FF)
    word = (word & np.uint64(0x0000FFFF0000FFFF)) << np.uint64(16) | (
        word >> np.uint64(16) & np.uint64(0x0000FFFF0000FFFF)
    )
    return word << np.uint64(32) | word >> np.uint64(32)


@njit(cache=True, nogil=True)
def columns(
    payloads: Words,
    places: npt.NDArray[np.int64],
    numbers: npt.NDArray[np.float64],
    integers: Words,
) -> Words:
    """Return the values of signals of up to 64 bits; those that are outside of all payloads have 0 as raw value.

    Args:
        payloads: (n, 1 or 8), little-endian words.
        places: (signals, 5): first bit, counted from the least (big-endian: most) significant bit of each byte; length;
            whether big-endian; whether signed; and `BITS`, `INTEGER` or `NUMBER`.
        numbers: (signals, 2), scale and offset for `NUMBER`.
        integers: (signals, 2), scale and offset modulo 2^64 for `INTEGER`.

    Returns:
        (signals, n): of `NUMBER` the bits of float64, of `INTEGER` those of int64 or uint64.
    """
    n, width = payloads.shape
    little, big = np.empty((width, n), np.uint64), np.empty((width, n), np.uint64)
    for word in range(width):
        for k in range(n):
            little[word, k] = payloads[k, word]
            big[word, k] = _reversed(little[word, k])
    values = np.empty((len(places), n), np.uint64)
    floats = values.view(np.float64)
    left = np.empty(n, np.uint64)
    for s in range(len(places)):
        first, length, signed, kind = places[s, FIRST], places[s, LENGTH], places[s, SIGNED], places[s, KIND]
        word, shift = first // 64, first % 64
        up, beyond = np.uint64(shift if places[s, BIG_ENDIAN] else 64 - shift - length), shift + length - 64
        # Every signal begins at the most significant bit of `left`.
        if first + length > 64 * width:
            left[:] = 0
        elif places[s, BIG_ENDIAN] and beyond > 0:
            for k in range(n):
                left[k] = big[word, k] << up | big[word + 1, k] >> np.uint64(64 - shift)
        elif places[s, BIG_ENDIAN]:
            for k in range(n):
                left[k] = big[word, k] << up
        elif beyond > 0:
            for k in range(n):
                joined = little[word, k] >> np.uint64(shift) | little[word + 1, k] << np.uint64(64 - shift)
                left[k] = joined << np.uint64(64 - length)
        else:
            for k in range(n):
                left[k] = little[word, k] << up
        spare, scale, offset = 64 - length, numbers[s, 0], numbers[s, 1]
        if kind == NUMBER and (signed or spare > 0):
            # Without its sign a number of less than 64 bits is one with a sign, too, and that is converted faster.
            for k in range(n):
                raw = np.int64(left[k]) >> np.int64(spare) if signed else np.int64(left[k] >> np.uint64(spare))
                floats[s, k] = np.float64(raw) * scale + offset
        elif kind == NUMBER:
            for k in range(n):
                floats[s, k] = np.float64(left[k]) * scale + offset
        elif signed and kind == INTEGER:
            for k in range(n):
                modulo = np.uint64(np.int64(left[k]) >> np.int64(spare))
                values[s, k] = modulo * integers[s, 0] + integers[s, 1]
        elif kind == INTEGER:
            for k in range(n):
                values[s, k] = (left[k] >> np.uint64(spare)) * integers[s, 0] + integers[s, 1]
        else:
            for k in range(n):
                values[s, k] = left[k] >> np.uint64(spare)
    return values
