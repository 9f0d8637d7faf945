"""Stamps, tokens and numbers in the lines of a text log, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

NEWLINE, RETURN, TAB, BLANK, POINT, ZERO = 10, 13, 9, 32, 46, 48
NOT_HEX = 16
HEX = np.full(256, NOT_HEX, np.uint8)
for _digits in (b"0123456789abcdef", b"0123456789ABCDEF"):
    HEX[np.frombuffer(_digits, np.uint8)] = np.arange(16)
FD_LENGTHS = np.array([*range(9), 12, 16, 20, 24, 32, 48, 64])
"""Payload bytes by length code."""

SECOND = 1_000_000_000
LAST_SECOND = 9_223_372_035
"""The last whole second that 64-bit nanoseconds hold (in the year 2262)."""

Text = npt.NDArray[np.uint8]


@njit(cache=True, nogil=True)
def is_blank(character: int) -> bool:
    """Tell whether a character parts tokens."""
    return character in (BLANK, TAB, RETURN)


@njit(cache=True, nogil=True)
def line_at(text: Text, position: int) -> tuple[int, int, int]:
    """Return where the line at `position` ends (-1: not in `text`), and where it starts and stops without blanks."""
    end = position
    while end < len(text) and text[end] != NEWLINE:
        end += 1
    if end == len(text):
        return -1, 0, 0
    start, stop = position, end
    while stop > start and is_blank(text[stop - 1]):
        stop -= 1
    while start < stop and is_blank(text[start]):
        start += 1
    return end, start, stop


@njit(cache=True, nogil=True)
def token_at(text: Text, p: int, stop: int) -> tuple[int, int]:
    """Return where the first token from `p` on starts and stops; it is empty at the end of the line."""
    while p < stop and is_blank(text[p]):
        p += 1
    start = p
    while p < stop and not is_blank(text[p]):
        p += 1
    return start, p


@njit(cache=True, nogil=True)
def is_word(text: Text, start: int, stop: int, word: Text) -> bool:
    """Tell whether `text[start:stop]` is a word of small letters, written in small or capital ones."""
    if stop - start != len(word):
        return False
    for k in range(len(word)):
        character = text[start + k]
        if character != word[k] and not (65 <= character <= 90 and character + 32 == word[k]):
            return False
    return True


@njit(cache=True, nogil=True)
def number_at(text: Text, start: int, stop: int, base: int) -> int:
    """Return the number that `text[start:stop]` is, 1 to 10 digits in base 10 or 16, or -1."""
    if not 0 < stop - start <= 10:
        return -1
    number = 0
    for k in range(start, stop):
        digit = HEX[text[k]]
        if digit >= base:
            return -1
        number = base * number + int(digit)
    return number


@njit(cache=True, nogil=True)
def seconds_at(text: Text, start: int, stop: int) -> tuple[int, int]:
    """Return the ns that seconds with 1 to 9 decimals at `start` are, and where they end; -1: none, -2: too many."""
    p, seconds, digits = start, 0, 0
    while p < stop and 0 <= text[p] - ZERO <= 9:
        if digits < 12:
            seconds = 10 * seconds + (text[p] - ZERO)
        digits += 1
        p += 1
    if p >= stop or digits == 0 or text[p] != POINT:
        return -1, p
    p += 1
    fraction, unit = 0, SECOND
    while p < stop and 0 <= text[p] - ZERO <= 9 and unit > 1:
        fraction = 10 * fraction + (text[p] - ZERO)
        unit //= 10
        p += 1
    if unit == SECOND:
        return -1, p
    if digits > 12 or seconds > LAST_SECOND:
        return -2, p
    return seconds * SECOND + fraction * unit, p


@njit(cache=True, nogil=True)
def bytes_at(text: Text, p: int, stop: int, base: int, count: int, row: Text) -> tuple[int, int]:
    """Parse `count` bytes at `p`, each a token (2 hex digits, or up to 3 decimal ones), into `row`.

    Returns:
        How many there are, and where they end; where there are fewer than `count`, what is in the way starts there.
    """
    for k in range(count):
        start, end = token_at(text, p, stop)
        number = number_at(text, start, end, base)
        if not 0 <= number <= 255 or (end - start != 2 if base == 16 else end - start > 3):
            return k, start
        row[k] = number
        p = end
    return count, p


@njit(cache=True, nogil=True)
def channel_of(text: Text, start: int, stop: int, names: Text, known: int) -> tuple[int, int]:
    """Return the number of the channel `text[start:stop]`, entered if it is new, or -1; and how many are known."""
    for number in range(known):
        if names[number, 0] == stop - start:
            k = 0
            while k < stop - start and names[number, 1 + k] == text[start + k]:
                k += 1
            if k == stop - start:
                return number, known
    if known == len(names):
        return -1, known
    names[known, 0] = stop - start
    for k in range(stop - start):
        names[known, 1 + k] = text[start + k]
    return known, known + 1
