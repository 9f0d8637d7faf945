"""Lines, fields and numbers of text logs, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

MOST_FIELDS = 96

# What `decimal` says.
GOOD, MALFORMED, OUT_OF_RANGE = range(3)

NOT_HEX = 16
HEX = np.full(256, NOT_HEX, np.uint8)
for _digits in (b"0123456789abcdef", b"0123456789ABCDEF"):
    HEX[np.frombuffer(_digits, np.uint8)] = np.arange(16)
FD_LENGTHS = np.isin(np.arange(65), (*range(9), 12, 16, 20, 24, 32, 48, 64))

_NEWLINE, _RETURN, _TAB, _BLANK = 10, 13, 9, 32
_COMMA, _MINUS, _PLUS, _POINT, _ZERO = 44, 45, 43, 46, 48
_MOST_DIGITS = 18
_LIMIT = 1 << 62


@njit(cache=True, nogil=True)
def is_blank(character: int) -> bool:
    """Tell whether a byte is a blank, a tabulator or a carriage return."""
    return character in (_BLANK, _TAB, _RETURN)


@njit(cache=True, nogil=True)
def line_at(text: npt.NDArray[np.uint8], position: int) -> tuple[int, int, int]:
    """Return where the line at `position` starts and stops without blanks, and where the next line starts."""
    end = position
    while end < len(text) and text[end] != _NEWLINE:
        end += 1
    start, stop = position, end
    while stop > start and is_blank(text[stop - 1]):
        stop -= 1
    while start < stop and is_blank(text[start]):
        start += 1
    return start, stop, end + 1


@njit(cache=True, nogil=True)
def split_blanks(text: npt.NDArray[np.uint8], start: int, stop: int, bounds: npt.NDArray[np.int64]) -> int:
    """Fill `bounds` (`MOST_FIELDS`, 2) with the fields between blanks; return how many, at most `MOST_FIELDS`."""
    count, p = 0, start
    while p < stop and count < MOST_FIELDS:
        bounds[count, 0] = p
        while p < stop and not is_blank(text[p]):
            p += 1
        bounds[count, 1] = p
        count += 1
        while p < stop and is_blank(text[p]):
            p += 1
    return count


@njit(cache=True, nogil=True)
def split_commas(text: npt.NDArray[np.uint8], start: int, stop: int, bounds: npt.NDArray[np.int64]) -> int:
    """Fill `bounds` (`MOST_FIELDS`, 2) with the fields between commas, their blanks taken off; return how many."""
    count, p = 0, start
    while count < MOST_FIELDS:
        while p < stop and is_blank(text[p]):
            p += 1
        bounds[count, 0] = p
        while p < stop and text[p] != _COMMA:
            p += 1
        end = p
        while end > bounds[count, 0] and is_blank(text[end - 1]):
            end -= 1
        bounds[count, 1] = end
        count += 1
        if p >= stop:
            break
        p += 1
    return count


@njit(cache=True, nogil=True)
def hexadecimal(text: npt.NDArray[np.uint8], start: int, stop: int) -> int:
    """Return the value of 1 to 8 hex digits; -1 if they are not."""
    if not 0 < stop - start <= 8:
        return -1
    value = 0
    for p in range(start, stop):
        digit = int(np.int64(HEX[text[p]]))
        if digit == NOT_HEX:
            return -1
        value = (value << 4) | digit
    return value


@njit(cache=True, nogil=True)
def natural(text: npt.NDArray[np.uint8], start: int, stop: int) -> int:
    """Return the value of 1 to 9 decimal digits; -1 if they are not."""
    if not 0 < stop - start <= 9:
        return -1
    value = 0
    for p in range(start, stop):
        digit = int(np.int64(text[p])) - _ZERO
        if not 0 <= digit <= 9:
            return -1
        value = 10 * value + digit
    return value


@njit(cache=True, nogil=True)
def is_word(text: npt.NDArray[np.uint8], start: int, stop: int, word: bytes) -> bool:
    """Tell whether a field is a word (given in lower case), in upper or lower case."""
    if stop - start != len(word):
        return False
    for k in range(len(word)):
        character = text[start + k]
        if (character | 32 if 65 <= character <= 90 else character) != word[k]:
            return False
    return True


@njit(cache=True, nogil=True)
def decimal(text: npt.NDArray[np.uint8], start: int, stop: int, places: int) -> tuple[int, int]:
    """Return code and value × 10^places of a number such as `-12`, `0.25` or `5e-07`, rounded to an integer.

    No float is involved; digits beyond the eighteenth count as 0. |value × 10^places| is below 2^62.
    """
    p, negative = start, False
    if p < stop and text[p] in (_MINUS, _PLUS):
        negative = text[p] == _MINUS
        p += 1
    mantissa, digits, shift, point = 0, 0, places, False
    while p < stop:
        digit = int(np.int64(text[p])) - _ZERO
        if text[p] == _POINT and not point:
            point = True
        elif 0 <= digit <= 9:
            if mantissa < 10 ** (_MOST_DIGITS - 1):
                mantissa = 10 * mantissa + digit
                shift -= point
            else:
                shift += not point
            digits += 1
        else:
            break
        p += 1
    if digits == 0:
        return MALFORMED, 0
    if p < stop:
        if text[p] | 32 != 101 or stop - p < 2:
            return MALFORMED, 0
        sign = -1 if text[p + 1] == _MINUS else 1
        exponent = natural(text, p + 1 + (text[p + 1] in (_MINUS, _PLUS)), stop)
        if exponent < 0:
            return MALFORMED, 0
        shift += sign * min(exponent, 1000)
    if mantissa == 0:
        return GOOD, 0
    while shift > 0:
        if mantissa >= _LIMIT // 10:
            return OUT_OF_RANGE, 0
        mantissa *= 10
        shift -= 1
    if shift < -_MOST_DIGITS:
        return GOOD, 0
    if shift < 0:
        unit = 10**-shift
        mantissa = mantissa // unit + (2 * (mantissa % unit) >= unit)
    return GOOD, -mantissa if negative else mantissa
