"""Lines, fields and numbers of text logs, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from .text_log import CHANNELS, FRAMES, LINES, LONGEST

Text = npt.NDArray[np.uint8]
Numbers = npt.NDArray[np.int64]
Words = npt.NDArray[np.uint64]

NEWLINE, RETURN, TAB, BLANK = 10, 13, 9, 32
COMMA, DASH, PLUS, POINT, ZERO = 44, 45, 43, 46, 48
MOST_FIELDS = 96

NOT_HEX = 16
HEX = np.full(256, NOT_HEX, np.uint8)
for _digits in (b"0123456789abcdef", b"0123456789ABCDEF"):
    HEX[np.frombuffer(_digits, np.uint8)] = np.arange(16)
FD_LENGTHS = np.array([*range(9), 12, 16, 20, 24, 32, 48, 64])
"""Payload bytes by length code."""
IS_FD_LENGTH = np.isin(np.arange(65), FD_LENGTHS)

SECOND = 1_000_000_000
LAST_SECOND = 9_223_372_035
"""The last whole second that 64-bit nanoseconds hold (in the year 2262)."""
STANDARD_MASK, EXTENDED_MASK = 0x7FF, 0x1FFFFFFF

GOOD, MALFORMED, OUT_OF_RANGE = range(3)
"""What `decimal` says."""
_POWERS = 10 ** np.arange(10)
_LAST_MANTISSA = 10**17
_LIMIT = 1 << 62


def word(letters: bytes) -> Text:
    """Return a word in small letters as `is_word` takes it."""
    return np.frombuffer(letters, np.uint8)


RX, TX = word(b"rx"), word(b"tx")


@njit(cache=True, nogil=True)
def has_room(times: Numbers, lines: Numbers, counts: Numbers) -> bool:
    """Tell whether one more line, whatever it is, can be entered."""
    return bool(counts[FRAMES] < len(times) and counts[LINES] < len(lines))


@njit(cache=True, nogil=True)
def enter_payload(payload: Words, size: int, data: Words, long_data: Words, counts: Numbers) -> None:
    """Enter a payload, 64 bytes with zeros behind the first `size`, as the next frame's, which so is entered whole."""
    row = counts[FRAMES]
    data[row] = payload[0]
    if size > 8:
        counts[LONGEST] = max(counts[LONGEST], size)
        for k in range(8):
            long_data[row, k] = payload[k]
    counts[FRAMES] = row + 1


@njit(cache=True, nogil=True)
def clear(payload: Words) -> None:
    """Make 64 bytes of payload zeros."""
    for k in range(8):
        payload[k] = 0


@njit(cache=True, nogil=True)
def set_aside(lines: Numbers, counts: Numbers, number: int, code: int, start: int, stop: int, reached: int) -> None:
    """Enter a line that is no frame; see `Found.lines`."""
    row = counts[LINES]
    lines[row, 0], lines[row, 1] = number, code
    lines[row, 2], lines[row, 3], lines[row, 4] = start, stop, reached
    counts[LINES] = row + 1


@njit(cache=True, nogil=True)
def channel_of(text: Text, start: int, stop: int, names: Text, counts: Numbers) -> int:
    """Return the number of the channel named `text[start:stop]`, entered if it is new, or -1: one too many."""
    known, size = counts[CHANNELS], stop - start
    for number in range(known):
        if names[number, 0] == size:
            k = 0
            while k < size and names[number, 1 + k] == text[start + k]:
                k += 1
            if k == size:
                return number
    if known == len(names):
        return -1
    names[known, 0] = size
    for k in range(size):
        names[known, 1 + k] = text[start + k]
    counts[CHANNELS] = known + 1
    return int(known)


@njit(cache=True, nogil=True)
def bus_of(text: Text, start: int, stop: int, names: Text, counts: Numbers) -> int:
    """Return the number of the channel that is named by the number `text[start:stop]`, zeros before it left out."""
    while start < stop - 1 and text[start] == ZERO:
        start += 1
    number: int = channel_of(text, start, stop, names, counts)
    return number


@njit(cache=True, nogil=True)
def is_blank(character: int) -> bool:
    """Tell whether a character parts fields."""
    return character in (BLANK, TAB, RETURN)


@njit(cache=True, nogil=True)
def line_at(text: Text, ends: Numbers, number: int) -> tuple[int, int, int]:
    """Return where line `number` starts and stops without blanks, and how many bytes it has with them."""
    start, stop = ends[number - 1] + 1 if number else 0, ends[number]
    size = stop - start
    while stop > start and is_blank(text[stop - 1]):
        stop -= 1
    while start < stop and is_blank(text[start]):
        start += 1
    return start, stop, size


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
def split_blanks(text: Text, start: int, stop: int, most: int, bounds: Numbers) -> tuple[int, int]:
    """Fill `bounds` (n, 2) with the first fields between blanks, up to `most`; return how many, and where they end."""
    count, p = 0, start
    while count < most:
        first, p = token_at(text, p, stop)
        if first == p:
            break
        bounds[count, 0], bounds[count, 1] = first, p
        count += 1
    return count, p


@njit(cache=True, nogil=True)
def split_commas(text: Text, start: int, stop: int, bounds: Numbers) -> int:
    """Fill `bounds` (`MOST_FIELDS`, 2) with the fields between commas, their blanks taken off; return how many."""
    count, p = 0, start
    while count < MOST_FIELDS:
        while p < stop and is_blank(text[p]):
            p += 1
        first = p
        while p < stop and text[p] != COMMA:
            p += 1
        last = p
        while last > first and is_blank(text[last - 1]):
            last -= 1
        bounds[count, 0], bounds[count, 1] = first, last
        count += 1
        if p >= stop:
            break
        p += 1
    return count


@njit(cache=True, nogil=True)
def is_word(text: Text, start: int, stop: int, letters: Text) -> bool:
    """Tell whether a field is a `word`, in small or capital letters."""
    if stop - start != len(letters):
        return False
    for k in range(len(letters)):
        character = text[start + k]
        if character != letters[k] and not (65 <= character <= 90 and character + 32 == letters[k]):
            return False
    return True


@njit(cache=True, nogil=True)
def is_direction(text: Text, start: int, stop: int) -> bool:
    """Tell whether a field is Rx or Tx."""
    return bool(is_word(text, start, stop, RX) or is_word(text, start, stop, TX))


@njit(cache=True, nogil=True)
def number_at(text: Text, start: int, stop: int, base: int) -> int:
    """Return the number that a field is, 1 to 10 decimal or 1 to 8 hex digits, or -1."""
    if not 0 < stop - start <= (10 if base == 10 else 8):
        return -1
    number = 0
    for p in range(start, stop):
        digit = int(np.int64(HEX[text[p]]))
        if digit >= base:
            return -1
        number = base * number + digit
    return number


@njit(cache=True, nogil=True)
def byte_at(text: Text, start: int, stop: int) -> int:
    """Return the value of a field of two hex digits; -1 if it is not."""
    if stop - start != 2:
        return -1
    high, low = int(np.int64(HEX[text[start]])), int(np.int64(HEX[text[start + 1]]))
    return -1 if (high | low) >= NOT_HEX else high << 4 | low


@njit(cache=True, nogil=True)
def bytes_at(text: Text, p: int, stop: int, base: int, count: int, payload: Text) -> tuple[int, int]:
    """Parse up to `count` bytes at `p`, each a token (2 hex digits, or up to 3 decimal ones), into `payload`.

    Returns:
        How many there are, and where they end; where there are fewer than `count`, what is in the way starts there.
    """
    for k in range(count):
        start, end = token_at(text, p, stop)
        value = byte_at(text, start, end) if base == 16 else number_at(text, start, min(end, start + 4), base)
        if not 0 <= value <= 255 or end - start > 3:
            return k, start
        payload[k] = value
        p = end
    return count, p


@njit(cache=True, nogil=True)
def seconds_at(text: Text, p: int, stop: int) -> tuple[int, int]:
    """Return the ns of seconds such as 12.345678 at `p` (1 to 9 digits behind the point), and where they end.

    -1 stands for none, -2 for more than 64 bits hold.
    """
    seconds, digits = 0, 0
    while p < stop and 0 <= text[p] - ZERO <= 9:
        if digits < 12:
            seconds = 10 * seconds + (text[p] - ZERO)
        digits += 1
        p += 1
    if p >= stop or digits == 0 or text[p] != POINT:
        return -1, p
    p += 1
    fraction, places = 0, 0
    while p < stop and 0 <= text[p] - ZERO <= 9 and places < 9:
        fraction = 10 * fraction + (text[p] - ZERO)
        places += 1
        p += 1
    if places == 0:
        return -1, p
    if digits > 12 or seconds > LAST_SECOND:
        return -2, p
    return seconds * SECOND + fraction * _POWERS[9 - places], p


@njit(cache=True, nogil=True)
def decimal(text: Text, start: int, stop: int, places: int) -> tuple[int, int]:
    """Return code and value × 10^places of a number such as `-12`, `0.25` or `5e-07`, rounded to an integer.

    No float is involved; digits beyond the eighteenth count as 0. |value × 10^places| is below 2^62.
    """
    p, negative = start, False
    if p < stop and text[p] in (DASH, PLUS):
        negative = text[p] == DASH
        p += 1
    mantissa, digits, shift, point = 0, 0, places, False
    while p < stop:
        digit = int(np.int64(text[p])) - ZERO
        if 0 <= digit <= 9:
            if mantissa < _LAST_MANTISSA:
                mantissa = 10 * mantissa + digit
                shift -= point
            else:
                shift += not point
            digits += 1
        elif text[p] == POINT and not point:
            point = True
        else:
            break
        p += 1
    if digits == 0:
        return MALFORMED, 0
    if p < stop:
        if text[p] | 32 != 101 or stop - p < 2:
            return MALFORMED, 0
        sign = -1 if text[p + 1] == DASH else 1
        exponent = number_at(text, p + 1 + (text[p + 1] in (DASH, PLUS)), stop, 10)
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
    if shift < -18:
        return GOOD, 0
    if shift < 0:
        unit = 10**-shift
        mantissa = mantissa // unit + (2 * (mantissa % unit) >= unit)
    return GOOD, -mantissa if negative else mantissa
