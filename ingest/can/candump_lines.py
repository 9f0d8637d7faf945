"""The line of a candump log in both directions, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from ..words import word_at
from .frames import DATA, ERROR, REMOTE
from .text_fields import (
    BLANK,
    EXTENDED_MASK,
    HEX,
    IS_FD_LENGTH,
    LAST_SECOND,
    NOT_HEX,
    POINT,
    RETURN,
    STANDARD_MASK,
    ZERO,
    Numbers,
    Text,
    channel_of,
    clear,
    enter_payload,
    has_room,
    is_blank,
    line_at,
    seconds_at,
    set_aside,
)
from .text_lanes import HEX_LANES, LANES, blanks_at, first_place, hex_at
from .text_log import FRAME, FRAMES, LONGEST, LONGEST_NAME, Found
from .text_words import WORD, decimal_word, first_of

LONGEST_LINE = 4096
LONGEST_FRAME = 2 + 20 + 1 + LONGEST_NAME + 1 + 8 + 3 + 2 * 64 + 1
"""Bytes of the longest line that `write` can make, its line end included."""

# Why a line is not a frame; `candump.REASONS` says it in words.
TIME, TIME_RANGE, CHANNEL, IDENTIFIER, STANDARD_RANGE, EXTENDED_RANGE, ODD, DIGIT, CLASSIC_LENGTH = range(1, 10)
FLAGS, FD_LENGTH, REQUEST, TAIL, LONG, CHANNELS = range(10, 16)

_NEWLINE, _OPEN, _CLOSE, _HASH, _UNDERSCORE = 10, 40, 41, 35, 95
_DIGITS = np.frombuffer(b"0123456789ABCDEF", np.uint8)
_ERROR_FLAG = 0x20000000
_SHORTEST = len(b"(1436509052.249713) a 044#")
"""Bytes of an ordinary line, at least."""
_REACH = 20 + LANES
"""Bytes from the start of an ordinary line on that are looked at, at most."""
_CLOSE_BLANK = np.uint64(_CLOSE | BLANK << 8)
_LABEL_BITS = 6
"""Of the place in a small table where a channel's name is looked up, one that `_SPREAD` gives it."""
_SPREAD = np.uint64(0x9E3779B97F4A7C15)
_TOO_LATE = np.uint64((LAST_SECOND + 1) * 1_000_000)


@njit(cache=True, nogil=True)
def _parse_time(text: Text, p: int, stop: int) -> tuple[int, int, int]:
    """Parse `(1436509052.249713)` at `p`; return code, where parsing ended, ns."""
    if p >= stop or text[p] != _OPEN:
        return TIME, p, 0
    time, p = seconds_at(text, p + 1, stop)
    if time == -1 or p >= stop or text[p] != _CLOSE:
        return TIME, p, 0
    return (TIME_RANGE, p, 0) if time < 0 else (FRAME, p + 1, time)


@njit(cache=True, nogil=True)
def _parse_identifier(text: Text, p: int, stop: int) -> tuple[int, int, int, bool, int]:
    """Parse `044#` at `p`; return code, where parsing ended, identifier, whether it is extended, and kind."""
    number, start = 0, p
    while p < stop and HEX[text[p]] != NOT_HEX and p - start < 9:
        number = (number << 4) | HEX[text[p]]
        p += 1
    digits = p - start
    if p >= stop or text[p] != _HASH or digits not in (3, 8):
        return IDENTIFIER, p, 0, False, DATA
    if digits == 3 and number > STANDARD_MASK:
        return STANDARD_RANGE, p, 0, False, DATA
    if digits == 8 and number & ~EXTENDED_MASK == _ERROR_FLAG:
        return FRAME, p + 1, number & EXTENDED_MASK, True, ERROR
    return EXTENDED_RANGE if number > EXTENDED_MASK else FRAME, p + (number <= EXTENDED_MASK), number, digits == 8, DATA


@njit(cache=True, nogil=True)
def _parse_payload(text: Text, p: int, stop: int, fd: bool, payload: Text) -> tuple[int, int, int]:
    """Parse pairs of hex digits at `p` into `payload`; return code, where parsing ended, bytes."""
    k, limit = 0, 64 if fd else 8
    while p < stop and HEX[text[p]] != NOT_HEX:
        if k == limit:
            return FD_LENGTH if fd else CLASSIC_LENGTH, p, k
        low = HEX[text[p + 1]] if p + 1 < stop else NOT_HEX
        if low == NOT_HEX:
            return ODD if p + 1 == stop or is_blank(text[p + 1]) else DIGIT, p + 1, k
        payload[k] = (HEX[text[p]] << 4) | low
        k += 1
        p += 2
    if p < stop and text[p] == _UNDERSCORE and k == 8 and not fd:
        # `candump -8` tells a length code beyond 8, which the bus allows for 8 bytes.
        p += 1
        if p >= stop or not 9 <= HEX[text[p]] <= 15:
            return DIGIT, p, k
        p += 1
    if p < stop and not is_blank(text[p]):
        return DIGIT, p, k
    if fd and not IS_FD_LENGTH[k]:
        return FD_LENGTH, p, k
    return FRAME, p, k


@njit(cache=True, nogil=True)
def _parse_request(text: Text, p: int, stop: int) -> tuple[int, int]:
    """Parse what follows the `R` of a remote frame: nothing or a number of bytes."""
    if p < stop and not is_blank(text[p]):
        if not 0 <= text[p] - ZERO <= 8:
            return REQUEST, p
        p += 1
        if p < stop and text[p] == _UNDERSCORE:
            p += 1
            if p >= stop or not 9 <= HEX[text[p]] <= 15:
                return REQUEST, p
            p += 1
        if p < stop and not is_blank(text[p]):
            return REQUEST, p
    return FRAME, p


@njit(cache=True, nogil=True)
def _parse_tail(text: Text, p: int, stop: int) -> tuple[int, int]:
    """Parse what may follow a payload: nothing, or blanks and the direction `R` or `T`."""
    if p == stop:
        return FRAME, p
    if not is_blank(text[p]):
        return TAIL, p
    while is_blank(text[p]):
        p += 1
    if p + 1 == stop and text[p] in (82, 84, 114, 116):
        return FRAME, p + 1
    return TAIL, p


@njit(cache=True, nogil=True)
def _in_other_order(word: np.uint64) -> np.uint64:
    """Return four bytes with the first one highest."""
    word = word >> np.uint64(16) & np.uint64(0xFFFF) | (word & np.uint64(0xFFFF)) << np.uint64(16)
    return (word & np.uint64(0x00FF00FF)) << np.uint64(8) | word >> np.uint64(8) & np.uint64(0x00FF00FF)


@njit(cache=True, nogil=True)
def _enter_ordinary_lines(text: Text, ends: Numbers, number: int, found: Found) -> int:
    """Enter lines like `(1436509052.249713) can0 044#2A366C2BBA` from `number` on up to the first one that is not so.

    Nearly every line is. Taken a word at a time, without a branch at each character, they take a fifth of the time.
    Nothing is said of any other line, frame or not, nor of one that words would reach beyond the text's end from.

    Returns:
        The number of the line it stopped at.
    """
    times, channels, ids, extendeds, _, _, lengths, data, _, names, _, counts = found
    row, one, reach = counts[FRAMES], np.uint64(1), len(text) - _REACH
    labels, numbers = np.zeros(1 << _LABEL_BITS, np.uint64), np.zeros(1 << _LABEL_BITS, np.int16)
    while number < len(ends) and row < len(times):
        begin, end = ends[number - 1] + 1 if number else 0, ends[number]
        if end < begin + _SHORTEST or begin > reach:
            break
        start, stop = np.uint64(begin), np.uint64(end)
        stop -= np.uint64(text[stop - one] == RETURN)
        middle, last = word_at(text, start + np.uint64(9)), word_at(text, start + np.uint64(12))
        if text[start] != _OPEN or text[start + np.uint64(11)] != POINT or last >> np.uint64(48) != _CLOSE_BLANK:
            break
        hundreds, no_hundreds = decimal_word(word_at(text, start + one))
        microseconds, no_microseconds = decimal_word(last << np.uint64(16) | middle & np.uint64(0xFFFF))
        name = start + np.uint64(20)
        size = first_place(blanks_at(text, name))
        p = name + size + one
        if not 0 < size <= LONGEST_NAME or stop < p + np.uint64(4) or text[p - one] != BLANK:
            break
        octets, digits = hex_at(text, p)
        if text[p + np.uint64(3)] == _HASH:
            p, wanted, largest = p + np.uint64(4), np.uint64(0b111), STANDARD_MASK
            identifier = (octets & np.uint64(0xFF)) << np.uint64(4) | octets >> np.uint64(12) & np.uint64(0xF)
        elif stop >= p + np.uint64(9) and text[p + np.uint64(8)] == _HASH:
            p, wanted, largest = p + np.uint64(9), np.uint64(0xFF), EXTENDED_MASK
            identifier = _in_other_order(octets & np.uint64(0xFFFFFFFF))
        else:
            break
        no_identifier = digits & wanted != wanted
        count = stop - p
        if count > HEX_LANES or count & one:
            break
        octets, digits = hex_at(text, p)
        wanted = (one << count) - one
        time = hundreds * np.uint64(100_000_000) + microseconds
        no_payload = digits & wanted != wanted
        if no_hundreds | no_microseconds | no_identifier | no_payload or identifier > largest or time >= _TOO_LATE:
            break
        # A call for every line would take as long as all else, so only names of more than a word need one.
        label = first_of(word_at(text, name), np.int64(size))
        place = label * _SPREAD >> np.uint64(64 - _LABEL_BITS)
        channel = np.int64(numbers[place])
        if size > WORD or labels[place] != label:
            channel = channel_of(text, np.int64(name), np.int64(name + size), names, counts)
            if channel < 0:
                break
            labels[place], numbers[place] = label if size <= WORD else np.uint64(0), channel
        times[row], channels[row], ids[row] = time * np.uint64(1000), channel, identifier
        extendeds[row], lengths[row] = largest == EXTENDED_MASK, count >> one
        spare = np.uint64(4) * (np.uint64(HEX_LANES) - count)
        data[row] = octets << spare >> spare if count else np.uint64(0)
        row += 1
        number += 1
    counts[FRAMES] = row
    return number


@njit(cache=True, nogil=True)
def scan(
    text: Text,
    ends: Numbers,
    number: int,
    final: bool,  # noqa: ARG001 - that a cut fell right behind a byte of a payload cannot be known
    found: Found,
    state: Numbers,  # noqa: ARG001 - every line speaks for itself
) -> int:
    """Parse lines as `text_log.read_frames` wants it."""
    times, channels, ids, extendeds, fds, kinds, lengths, data, long_data, names, lines, counts = found
    words = np.zeros(8, np.uint64)
    payload = words.view(np.uint8)
    while number < len(ends) and has_room(times, lines, counts):
        number = _enter_ordinary_lines(text, ends, number, found)
        if number == len(ends) or not has_room(times, lines, counts):
            break
        start, stop, width = line_at(text, ends, number)
        number += 1
        if start == stop:
            continue
        clear(words)
        code, p, time, identifier, size, channel = LONG, start, 0, 0, 0, 0
        extended, fd, kind = False, False, DATA
        name, name_stop = 0, 0
        if width < LONGEST_LINE:
            code, p, time = _parse_time(text, start, stop)
        if code == FRAME:
            blanks = p
            while p < stop and is_blank(text[p]):
                p += 1
            name = p
            while p < stop and text[p] > BLANK:
                p += 1
            name_stop = p
            if blanks == name or not 0 < name_stop - name <= LONGEST_NAME or p >= stop:
                code = CHANNEL
        if code == FRAME:
            while p < stop and is_blank(text[p]):
                p += 1
            code, p, identifier, extended, kind = _parse_identifier(text, p, stop)
        if code == FRAME and kind == DATA and p < stop and text[p] in (82, 114):
            kind = REMOTE
            code, p = _parse_request(text, p + 1, stop)
        elif code == FRAME:
            if kind == DATA and p < stop and text[p] == _HASH:
                fd = True
                p += 1
                if p >= stop or HEX[text[p]] == NOT_HEX:
                    code = FLAGS
                p += 1
            if code == FRAME:
                code, p, size = _parse_payload(text, p, stop, fd, payload)
                counts[LONGEST] = max(counts[LONGEST], size)
        if code == FRAME:
            code, p = _parse_tail(text, p, stop)
        if code == FRAME:
            channel = channel_of(text, name, name_stop, names, counts)
            if channel < 0:
                code, p = CHANNELS, name
        if code == FRAME:
            row = counts[FRAMES]
            times[row], channels[row], ids[row] = time, channel, identifier
            extendeds[row], fds[row], kinds[row], lengths[row] = extended, fd, kind, size
            enter_payload(words, size, data, long_data, counts)
        else:
            set_aside(lines, counts, number - 1, code, start, stop, min(p, stop))
    return number


@njit(cache=True, nogil=True)
def write(
    time: npt.NDArray[np.int64],
    channel: npt.NDArray[np.int16],
    identifier: npt.NDArray[np.uint32],
    extended: npt.NDArray[np.bool_],
    fd: npt.NDArray[np.bool_],
    kind: npt.NDArray[np.uint8],
    length: npt.NDArray[np.uint8],
    data: npt.NDArray[np.uint8],
    names: npt.NDArray[np.uint8],
    text: npt.NDArray[np.uint8],
) -> int:
    """Write frames as lines into `text`; return how many bytes they take.

    Args:
        time: The arrays of a `FrameBatch`, from here to `data`: (n,); times are not negative.
        channel: See `time`.
        identifier: See `time`.
        extended: See `time`.
        fd: See `time`.
        kind: See `time`.
        length: See `time`.
        data: (n, 8) or (n, 64).
        names: (channels, 1 + `LONGEST_NAME`), a row is the length of a name and its bytes.
        text: At least n × `LONGEST_FRAME` bytes.
    """
    p = 0
    for row in range(len(time)):
        text[p] = _OPEN
        p += 1
        seconds, fraction, digits = time[row] // 1_000_000_000, time[row] % 1_000_000_000, 9
        if fraction % 1000 == 0:
            fraction //= 1000
            digits = 6
        places = 1
        while seconds // 10**places:
            places += 1
        for k in range(places - 1, -1, -1):
            text[p + k] = ZERO + seconds % 10
            seconds //= 10
        p += places
        text[p] = POINT
        p += 1
        for k in range(digits - 1, -1, -1):
            text[p + k] = ZERO + fraction % 10
            fraction //= 10
        p += digits
        text[p] = _CLOSE
        text[p + 1] = BLANK
        p += 2
        size = int(names[channel[row], 0])
        for k in range(size):
            text[p + k] = names[channel[row], 1 + k]
        p += size
        text[p] = BLANK
        p += 1
        number = int(identifier[row]) | (_ERROR_FLAG if kind[row] == ERROR else 0)
        for k in range(7 if extended[row] or kind[row] == ERROR else 2, -1, -1):
            text[p] = _DIGITS[(number >> (4 * k)) & 15]
            p += 1
        text[p] = _HASH
        p += 1
        if kind[row] == REMOTE:
            text[p] = 82
            p += 1
        else:
            if fd[row]:
                text[p] = _HASH
                text[p + 1] = ZERO
                p += 2
            for k in range(length[row]):
                text[p] = _DIGITS[data[row, k] >> 4]
                text[p + 1] = _DIGITS[data[row, k] & 15]
                p += 2
        text[p] = _NEWLINE
        p += 1
    return p
