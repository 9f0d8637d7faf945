"""The line of a CRTD log, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..text import LONGEST_LINE
from .frames import DATA
from .text_fields import (
    EXTENDED_MASK,
    GOOD,
    OUT_OF_RANGE,
    STANDARD_MASK,
    ZERO,
    Numbers,
    Text,
    bus_of,
    byte_at,
    clear,
    decimal,
    enter_payload,
    has_room,
    line_at,
    number_at,
    set_aside,
    token_at,
    word,
)
from .text_log import FRAME, FRAMES, NO_RECORD, OPEN, Found

# Why a line is not a frame; `crtd.REASONS` says it in words.
MISSING, TIME, TIME_RANGE, TYPE, IDENTIFIER, STANDARD_RANGE, EXTENDED_RANGE, PAYLOAD, TAIL, LONG = range(1, 11)

_ONE, _TWO, _NINE, _A, _C, _R, _T, _Z = 49, 50, 57, 65, 67, 82, 84, 90
_ONLY_BUS = word(b"1")


@njit(cache=True, nogil=True)
def _parse_type(text: Text, start: int, stop: int) -> tuple[int, int, bool]:
    """Parse a type such as `1R11`; return code, where the bus ends, and whether the identifier is extended."""
    p = start
    while p < stop and ZERO <= text[p] <= _NINE:
        p += 1
    if stop - p != 3 or (p > start and not 0 <= number_at(text, start, p, 10) <= 255):
        return TYPE, p, False
    if text[p] == _C and _A <= text[p + 1] <= _Z and _A <= text[p + 2] <= _Z:
        return NO_RECORD, p, False
    extended = text[p + 1] == _TWO and text[p + 2] == _NINE
    if text[p] not in (_R, _T) or not (extended or (text[p + 1] == _ONE and text[p + 2] == _ONE)):
        return TYPE, p, False
    return FRAME, p, extended


@njit(cache=True, nogil=True)
def _parse_identifier(text: Text, start: int, stop: int, extended: bool) -> tuple[int, int]:
    """Return code and identifier."""
    number = number_at(text, start, stop, 16)
    if number < 0:
        return IDENTIFIER, 0
    if number > EXTENDED_MASK:
        return EXTENDED_RANGE, 0
    return STANDARD_RANGE if not extended and number > STANDARD_MASK else FRAME, number


@njit(cache=True, nogil=True)
def _parse_payload(text: Text, p: int, stop: int, payload: Text) -> tuple[int, int, int]:
    """Parse bytes up to the end of the line; return code, where parsing ended, and how many there are."""
    size = 0
    while p < stop:
        start, p = token_at(text, p, stop)
        value = byte_at(text, start, p)
        if value < 0:
            return PAYLOAD, p, size
        if size == 8:
            return TAIL, start, size
        payload[size] = value
        size += 1
    return FRAME, stop, size


@njit(cache=True, nogil=True)
def scan(
    text: Text,
    ends: Numbers,
    number: int,
    final: bool,
    found: Found,
    state: Numbers,  # noqa: ARG001 - every line speaks for itself
) -> int:
    """Parse lines as `text_log.read_frames` wants it."""
    times, channels, ids, extendeds, fds, kinds, lengths, data, long_data, names, lines, counts = found
    words = np.zeros(8, np.uint64)
    payload = words.view(np.uint8)
    while number < len(ends) and has_room(times, lines, counts):
        start, stop, width = line_at(text, ends, number)
        number += 1
        if start == stop:
            continue
        clear(words)
        code, reached, time, identifier, extended, size = LONG, start, 0, 0, False, 0
        bus = bus_stop = 0
        if width < LONGEST_LINE:
            bus, reached = token_at(text, start, stop)
            good, time = decimal(text, start, reached, 9)
            code = FRAME if good == GOOD else TIME_RANGE if good == OUT_OF_RANGE else TIME
        if code == FRAME:
            bus, reached = token_at(text, reached, stop)
            if bus == reached:
                code = MISSING
            else:
                code, bus_stop, extended = _parse_type(text, bus, reached)
        if code == FRAME:
            first, reached = token_at(text, reached, stop)
            if first == reached:
                code = MISSING
            else:
                code, identifier = _parse_identifier(text, first, reached, extended)
        if code == FRAME:
            code, reached, size = _parse_payload(text, reached, stop, payload)
        if code == FRAME and final and size < 8:
            code = OPEN
        if code == FRAME:
            row = counts[FRAMES]
            times[row], ids[row] = time, identifier
            if bus == bus_stop:
                channels[row] = bus_of(_ONLY_BUS, 0, 1, names, counts)
            else:
                channels[row] = bus_of(text, bus, bus_stop, names, counts)
            extendeds[row], fds[row], kinds[row], lengths[row] = extended, False, DATA, size
            enter_payload(words, size, data, long_data, counts)
        elif code != NO_RECORD:
            set_aside(lines, counts, number - 1, code, start, stop, reached)
    return number
