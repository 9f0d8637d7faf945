"""The line of a PEAK trace, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..text import LONGEST_LINE
from .frames import DATA, ERROR, REMOTE
from .text_fields import (
    DASH,
    EXTENDED_MASK,
    FD_LENGTHS,
    GOOD,
    IS_FD_LENGTH,
    MOST_FIELDS,
    STANDARD_MASK,
    Numbers,
    Text,
    bus_of,
    bytes_at,
    clear,
    decimal,
    enter_payload,
    has_room,
    is_direction,
    is_word,
    line_at,
    number_at,
    set_aside,
    split_blanks,
    token_at,
    word,
)
from .text_log import FRAME, FRAMES, NO_RECORD, OPEN, OTHER, Found

# Why a line is not a frame; `trc.REASONS` says it in words.
MISSING, NUMBER, TIME, TYPE, BUS, IDENTIFIER, STANDARD_RANGE, EXTENDED_RANGE, DIRECTION = range(1, 10)
LENGTH, CLASSIC_LENGTH, FD_LENGTH, PAYLOAD, SHORT, TAIL, LONG = range(10, 17)

COLUMNS = "NOTBIdRLD"
"""Letters of `$COLUMNS`; `l` has the place of `L`."""
ABSENT = -1
_N, _O, _T, _B, _I, _D, _R, _L, _DATA = range(9)
IS_CODE, DIRECTIONS, START = 9, 10, 11
"""The state: for each of `COLUMNS` which field of a line it is, or `ABSENT`, the payload the last; the length column
has data length codes, not lengths; the type column says Rx, Tx, Error or Warng (versions 1), not DT, FD, …; the ns that
offset 0 stands for."""

_SEMICOLON, _CLOSE = 59, 41
_STATUS_IDENTIFIER = 0xFFFFFFFF
_UNKNOWN, _FD, _EVENT, _STATUS, _WARNING = 3, 4, 5, 6, 7
_DT, _FD_PLAIN, _FB, _FE, _BI, _RR, _ST, _ER, _EC, _EV = (
    256 * first + second for first, second in (b"DT", b"FD", b"FB", b"FE", b"BI", b"RR", b"ST", b"ER", b"EC", b"EV")
)
_ERROR, _WARNG, _RTR, _ONLY_BUS = word(b"error"), word(b"warng"), word(b"rtr"), word(b"1")


@njit(cache=True, nogil=True)
def _sort(text: Text, start: int, stop: int, directions: bool) -> int:
    """Return what the type of a line says that the line is."""
    if directions:
        if is_direction(text, start, stop):
            return DATA
        if is_word(text, start, stop, _ERROR) or is_word(text, start, stop, _WARNG):
            return _WARNING
        return _UNKNOWN
    if stop - start != 2:
        return _UNKNOWN
    pair = 256 * np.int64(text[start]) + np.int64(text[start + 1])
    if pair == _DT:
        return DATA
    if pair in (_FD_PLAIN, _FB, _FE, _BI):
        return _FD
    if pair == _RR:
        return REMOTE
    if pair in (_ST, _ER, _EC):
        return _STATUS
    return _EVENT if pair == _EV else _UNKNOWN


@njit(cache=True, nogil=True)
def _parse_bytes(text: Text, p: int, stop: int, size: int, payload: Text) -> tuple[int, int, int]:
    """Parse bytes up to `size`; return code, where parsing ended, and where the bytes end."""
    count, p = bytes_at(text, p, stop, 16, size, payload)
    start, end = token_at(text, p, stop)
    if count < size:
        return (SHORT, stop, p) if start == stop else (PAYLOAD, end, p)
    return (FRAME, p, p) if start == stop else (TAIL, end, p)


@njit(cache=True, nogil=True)
def _parse_status(
    text: Text, bounds: Numbers, start: int, stop: int, place: Numbers, payload: Text
) -> tuple[int, int, int, bool]:
    """Parse what follows the type of ST, ER and EC, whose columns may be left blank.

    Returns:
        Code, where parsing ended, bytes, and whether they are sure to be all that there were.
    """
    count, _ = split_blanks(text, start, stop, MOST_FIELDS, bounds)
    p = place[_T] + 1
    if place[_D] > place[_T]:
        while p < count and not is_direction(text, bounds[p, 0], bounds[p, 1]):
            p += 1
        if p == count or p > place[_D]:
            return DIRECTION, bounds[min(p, count - 1), 1], 0, True
        p += 1
    elif place[_B] > place[_T]:
        p = place[_B] + 1
    while p < count and bounds[p, 1] - bounds[p, 0] == 1 and text[bounds[p, 0]] == DASH:
        p += 1
    # A length is never padded with a zero, a byte always.
    has_length = p < count and bounds[p, 1] - bounds[p, 0] == 1
    size = count - p
    if has_length:
        size = number_at(text, bounds[p, 0], bounds[p, 1], 10)
        if size < 0:
            return LENGTH, bounds[p, 1], 0, True
        p += 1
    if size > 64:
        return TAIL, stop, 0, True
    code, reached, _ = _parse_bytes(text, bounds[p - 1, 1], stop, size, payload)
    return code, reached, size, has_length and size > 0


@njit(cache=True, nogil=True)
def _parse_frame(
    text: Text, bounds: Numbers, count: int, p: int, stop: int, state: Numbers, sort: int, payload: Text
) -> tuple[int, int, int, int, int, int]:
    """Parse identifier, direction, length and, from `p` on, payload.

    Returns:
        Code, where parsing ended, identifier, digits of it, kind of the frame, bytes.
    """
    column = state[_I]
    if column >= count:
        return MISSING, stop, 0, 0, sort, 0
    start, end = bounds[column, 0], bounds[column, 1]
    digits, identifier = end - start, number_at(text, start, end, 16)
    if identifier < 0:
        return IDENTIFIER, end, 0, 0, sort, 0
    if identifier == _STATUS_IDENTIFIER:
        sort, identifier, digits = _WARNING, 0, 1
    elif digits <= 4 and identifier > STANDARD_MASK:
        return STANDARD_RANGE, end, 0, 0, sort, 0
    elif identifier > EXTENDED_MASK:
        return EXTENDED_RANGE, end, 0, 0, sort, 0
    column = state[_D]
    if column >= count:
        return MISSING, stop, 0, 0, sort, 0
    if column != ABSENT and not is_direction(text, bounds[column, 0], bounds[column, 1]):
        return DIRECTION, bounds[column, 1], 0, 0, sort, 0
    column = state[_L]
    if column >= count:
        return MISSING, stop, 0, 0, sort, 0
    start, end = bounds[column, 0], bounds[column, 1]
    size = number_at(text, start, end, 10)
    if size < 0 or size > (15 if state[IS_CODE] else 64):
        return LENGTH, end, 0, 0, sort, 0
    if state[IS_CODE]:
        size = FD_LENGTHS[size] if sort == _FD else min(size, 8)
    elif sort != _FD and size > 8:
        return CLASSIC_LENGTH, end, 0, 0, sort, 0
    elif not IS_FD_LENGTH[size]:
        return FD_LENGTH, end, 0, 0, sort, 0

    if sort == REMOTE:
        size = 0
    elif sort == DATA:
        start, end = token_at(text, p, stop)
        if is_word(text, start, end, _RTR):
            sort, size, p = REMOTE, 0, end
    code, reached, _ = _parse_bytes(text, p, stop, size, payload)
    if code == TAIL and sort == _WARNING:
        code = FRAME
    return code, reached, identifier, digits, sort, size


@njit(cache=True, nogil=True)
def _parse_start(text: Text, bounds: Numbers, count: int, state: Numbers) -> tuple[int, int, int, int, int]:
    """Parse number, time, type and bus; return code, the field that it is about, ns, sort, and the bus's field."""
    column, sort, time = state[_N], DATA, 0
    if column >= count:
        return MISSING, count - 1, 0, sort, ABSENT
    if column != ABSENT:
        marked = text[bounds[column, 1] - 1] == _CLOSE
        if number_at(text, bounds[column, 0], bounds[column, 1] - marked, 10) < 0:
            return NUMBER, column, 0, sort, ABSENT
    column = state[_O]
    if column >= count:
        return MISSING, count - 1, 0, sort, ABSENT
    good, time = decimal(text, bounds[column, 0], bounds[column, 1], 6)
    if good != GOOD:
        return TIME, column, 0, sort, ABSENT
    column = state[_T]
    if column >= count:
        return MISSING, count - 1, 0, sort, ABSENT
    if column != ABSENT:
        sort = _sort(text, bounds[column, 0], bounds[column, 1], state[DIRECTIONS] == 1)
        if sort == _UNKNOWN:
            return TYPE, column, 0, sort, ABSENT
    column = state[_B]
    if sort == _EVENT:
        return NO_RECORD, 0, 0, sort, ABSENT
    if column >= count:
        return MISSING, count - 1, 0, sort, ABSENT
    if column != ABSENT and not 0 <= number_at(text, bounds[column, 0], bounds[column, 1], 10) <= 255:
        return BUS, column, 0, sort, ABSENT
    return FRAME, 0, state[START] + time, sort, column


@njit(cache=True, nogil=True)
def scan(text: Text, ends: Numbers, number: int, final: bool, found: Found, state: Numbers) -> int:
    """Parse lines as `text_log.read_frames` wants it."""
    times, channels, ids, extendeds, fds, kinds, lengths, data, long_data, names, lines, counts = found
    bounds = np.empty((MOST_FIELDS, 2), np.int64)
    words = np.zeros(8, np.uint64)
    payload = words.view(np.uint8)
    while number < len(ends) and has_room(times, lines, counts):
        start, stop, width = line_at(text, ends, number)
        number += 1
        if start == stop:
            continue
        if text[start] == _SEMICOLON:
            set_aside(lines, counts, number - 1, OTHER, start, stop, stop)
            return number
        if width >= LONGEST_LINE:
            set_aside(lines, counts, number - 1, LONG, start, stop, start)
            continue
        clear(words)
        identifier, digits, size = 0, 0, 0
        count, p = split_blanks(text, start, stop, state[_DATA], bounds)
        code, field, time, sort, bus = _parse_start(text, bounds, count, state)
        reached, whole = bounds[field, 1], True
        if code == FRAME and sort == _STATUS:
            code, reached, size, whole = _parse_status(text, bounds, start, stop, state, payload)
        elif code == FRAME:
            code, reached, identifier, digits, sort, size = _parse_frame(
                text, bounds, count, p, stop, state, sort, payload
            )
            # RTR may be what the line lacks.
            whole = sort != DATA or size > 0 or state[_D] != ABSENT
        if code == FRAME and final and not whole:
            code, reached = OPEN, stop
        if code == FRAME:
            row = counts[FRAMES]
            times[row], ids[row], extendeds[row], fds[row] = time, identifier, digits > 4, sort == _FD
            if bus == ABSENT:
                channels[row] = bus_of(_ONLY_BUS, 0, 1, names, counts)
            else:
                channels[row] = bus_of(text, bounds[bus, 0], bounds[bus, 1], names, counts)
            kinds[row] = REMOTE if sort == REMOTE else ERROR if sort in (_WARNING, _STATUS) else DATA
            lengths[row] = size
            enter_payload(words, size, data, long_data, counts)
        elif code != NO_RECORD:
            set_aside(lines, counts, number - 1, code, start, stop, reached)
    return number
