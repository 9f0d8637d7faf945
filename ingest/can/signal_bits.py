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

_STRETCH = 1024
"""Rows at a time: all that is known of them stays in the nearest cache."""


@njit(cache=True, nogil=True)
def _reversed(word: np.uint64) -> np.uint64:
    """Return a word with its bytes in the other order."""
    word = (word & np.uint64(0x00FF00FF00FF00FF)) << np.uint64(8) | word >> np.uint64(8) & np.uint64(0x00FF00FF00FF00FF)
    word = (word & np.uint64(0x0000FFFF0000FFFF)) << np.uint64(16) | (
        word >> np.uint64(16) & np.uint64(0x0000FFFF0000FFFF)
    )
    return word << np.uint64(32) | word >> np.uint64(32)


@njit(cache=True, nogil=True)
def _align(little: Words, big: Words, place: npt.NDArray[np.int64], left: Words) -> None:
    """Fill `left` with words whose most significant bits are a signal; what follows them may be anything."""
    first, length, n = place[FIRST], place[LENGTH], len(left)
    word, shift = first // 64, first % 64
    beyond = shift + length - 64
    if first + length > 64 * len(little):
        left[:] = 0
    elif place[BIG_ENDIAN]:
        up = np.uint64(shift)
        for k in range(n):
            left[k] = big[word, k] << up
        for k in range(n if beyond > 0 else 0):
            left[k] |= big[word + 1, k] >> np.uint64(64 - shift)
    elif beyond > 0:
        for k in range(n):
            joined = little[word, k] >> np.uint64(shift) | little[word + 1, k] << np.uint64(64 - shift)
            left[k] = joined << np.uint64(64 - length)
    else:
        up = np.uint64(-beyond)
        for k in range(n):
            left[k] = little[word, k] << up


@njit(cache=True, nogil=True)
def _convert(
    left: Words, place: npt.NDArray[np.int64], number: npt.NDArray[np.float64], integer: Words, values: Words
) -> None:
    """Fill `values` with those of a signal that stands at the most significant bits of `left`."""
    signed, kind, n, spare = place[SIGNED], place[KIND], len(left), 64 - place[LENGTH]
    floats, scale, offset = values.view(np.float64), number[0], number[1]
    if kind == NUMBER and signed:
        for k in range(n):
            floats[k] = np.float64(np.int64(left[k]) >> np.int64(spare)) * scale + offset
    elif kind == NUMBER and spare > 0:
        # Without its sign a number of less than 64 bits is one with a sign, too, and that is converted faster.
        for k in range(n):
            floats[k] = np.float64(np.int64(left[k] >> np.uint64(spare))) * scale + offset
    elif kind == NUMBER:
        for k in range(n):
            floats[k] = np.float64(left[k]) * scale + offset
    elif signed and kind == INTEGER:
        for k in range(n):
            values[k] = np.uint64(np.int64(left[k]) >> np.int64(spare)) * integer[0] + integer[1]
    elif kind == INTEGER:
        for k in range(n):
            values[k] = (left[k] >> np.uint64(spare)) * integer[0] + integer[1]
    else:
        for k in range(n):
            values[k] = left[k] >> np.uint64(spare)


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
    values = np.empty((len(places), n), np.uint64)
    little, big = np.empty((width, _STRETCH), np.uint64), np.empty((width, _STRETCH), np.uint64)
    left = np.empty(_STRETCH, np.uint64)
    for begin in range(0, n, _STRETCH):
        size = min(_STRETCH, n - begin)
        for k in range(size):
            for word in range(width):
                little[word, k] = payloads[begin + k, word]
                big[word, k] = _reversed(little[word, k])
        for s in range(len(places)):
            place = places[s]
            _align(little, big, place, left[:size])
            _convert(left[:size], place, numbers[s], integers[s], values[s, begin : begin + size])
    return values
