"""The lines of CSV logs of frames, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..text import LONGEST_LINE
from .frames import DATA, ERROR, REMOTE
from .text_fields import (
    EXTENDED_MASK,
    GOOD,
    IS_FD_LENGTH,
    MOST_FIELDS,
    OUT_OF_RANGE,
    POINT,
    STANDARD_MASK,
    ZERO,
    Numbers,
    Text,
    bus_of,
    channel_of,
    clear,
    decimal,
    enter_payload,
    has_room,
    is_direction,
    is_word,
    line_at,
    number_at,
    set_aside,
    split_commas,
    word,
)
from .text_log import FRAME, FRAMES, OPEN, OTHER, Found

# Why a line is not a frame; `python_can_csv.REASONS` and `gvret_csv.REASONS` say it in words.
MISSING, TIME, TIME_RANGE, IDENTIFIER, STANDARD_RANGE, EXTENDED_RANGE, FLAG, LENGTH, PAYLOAD, TAIL = range(1, 11)
DIRECTION, BUS, LONG = 11, 12, 13
CLASSIC_LENGTH, FD_LENGTH, BOTH, LONG_PYTHON_CAN = 11, 12, 13, 14

GVRET_COLUMNS = ("time stamp", "id", "extended", "dir", "bus", "len", "d1")
ABSENT = -1
_SHORTEST_HEADER = len("Time Stamp,ID,LEN")
_TIME, _ID, _EXTENDED, _DIR, _BUS, _LEN, _D1 = range(7)
PREVIOUS, TURNS, UNSTAMPED = 7, 8, 9
"""The state of GVRET: for each of `GVRET_COLUMNS` which field of a line it is, or `ABSENT`, the payload the last; the
last stamp; how often the counter passed its end, in µs; there was no stamp yet."""
_TURN = 1 << 32
_NEAR = 60_000_000
"""µs between neighbouring stamps that a counter of 32 bits may have stepped over its end."""

_PAD, _X = 61, 120
_YES, _NO, _TRUE, _FALSE, _ONLY_BUS = word(b"1"), word(b"0"), word(b"true"), word(b"false"), word(b"0")
_NOT_BASE64 = 64
_BASE64 = np.full(256, _NOT_BASE64, np.int64)
_BASE64[np.frombuffer(b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/", np.uint8)] = np.arange(64)


@njit(cache=True, nogil=True)
def _is_header(text: Text, start: int, stop: int) -> bool:
    """Tell whether a line starts as no row does, with a letter, a quotation mark or a byte order mark, and is long."""
    if stop - start < _SHORTEST_HEADER:
        return False
    return 65 <= (text[start] & 0xDF) <= 90 or text[start] in (34, 239)


@njit(cache=True, nogil=True)
def _parse_identifier(text: Text, start: int, stop: int) -> int:
    """Return the value of an identifier in hex digits with or without 0x; -1 if it is none."""
    if stop - start > 2 and text[start] == ZERO and text[start + 1] | 32 == _X:
        start += 2
    number: int = number_at(text, start, stop, 16)
    return number


@njit(cache=True, nogil=True)
def _parse_flag(text: Text, start: int, stop: int) -> int:
    """Return 1 for true, 0 for false, -1 for neither."""
    if is_word(text, start, stop, _YES) or is_word(text, start, stop, _TRUE):
        return 1
    if is_word(text, start, stop, _NO) or is_word(text, start, stop, _FALSE):
        return 0
    return -1


@njit(cache=True, nogil=True)
def _parse_base64(text: Text, start: int, stop: int, size: int, data: Text) -> bool:
    """Decode base64 into `data`; return whether it is that, and of `size` bytes."""
    if stop - start != (size + 2) // 3 * 4:
        return False
    pads = -size % 3
    bits, held, count = 0, 0, 0
    for p in range(start, stop - pads):
        value = _BASE64[text[p]]
        if value == _NOT_BASE64:
            return False
        bits = ((bits << 6) | value) & 0xFFFF
        held += 6
        if held >= 8:
            held -= 8
            data[count] = (bits >> held) & 255
            count += 1
    return (pads == 0 or text[stop - 1] == _PAD) and (pads < 2 or text[stop - 2] == _PAD)


@njit(cache=True, nogil=True)
def scan_python_can(
    text: Text,
    ends: Numbers,
    number: int,
    final: bool,  # noqa: ARG001 - base64 of the right size is whole
    found: Found,
    state: Numbers,  # noqa: ARG001 - every line speaks for itself
) -> int:
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
        if _is_header(text, start, stop):
            set_aside(lines, counts, number - 1, OTHER, start, stop, stop)
            return number
        if width >= LONGEST_LINE:
            set_aside(lines, counts, number - 1, LONG_PYTHON_CAN, start, stop, start)
            continue
        clear(words)
        count = split_commas(text, start, stop, bounds)
        code, reached = FRAME, stop
        good, stamp = decimal(text, bounds[0, 0], bounds[0, 1], 9)
        if good != GOOD:
            code, reached = TIME_RANGE if good == OUT_OF_RANGE else TIME, bounds[0, 1]
        identifier, flags = 0, 0
        if code == FRAME and count > 1:
            identifier = _parse_identifier(text, bounds[1, 0], bounds[1, 1])
            if identifier < 0:
                code, reached = IDENTIFIER, bounds[1, 1]
            elif identifier > EXTENDED_MASK:
                code, reached = EXTENDED_RANGE, bounds[1, 1]
        for k in range(2, min(5, count)):
            if code == FRAME:
                flag = _parse_flag(text, bounds[k, 0], bounds[k, 1])
                if flag < 0:
                    code, reached = FLAG, bounds[k, 1]
                flags |= flag << k
        extended, remote, error = flags & 4 != 0, flags & 8 != 0, flags & 16 != 0
        if code == FRAME and count > 4 and not extended and not error and identifier > STANDARD_MASK:
            code, reached = STANDARD_RANGE, bounds[2, 0]
        elif code == FRAME and remote and error:
            code, reached = BOTH, bounds[4, 0]
        size = 0
        if code == FRAME and count > 5:
            size = number_at(text, bounds[5, 0], bounds[5, 1], 10)
            if not 0 <= size <= 64:
                code, reached = LENGTH, bounds[5, 1]
            elif (remote or error) and size > 8:
                code, reached = CLASSIC_LENGTH, bounds[5, 1]
            elif not IS_FD_LENGTH[size]:
                code, reached = FD_LENGTH, bounds[5, 1]
        if code == FRAME and count < 7:
            code = MISSING
        if code == FRAME:
            size = 0 if remote else size
            if not _parse_base64(text, bounds[6, 0], bounds[6, 1], size, payload):
                code, reached = PAYLOAD, bounds[6, 1]
            elif count > 7:
                code, reached = TAIL, bounds[6, 1]
        if code == FRAME:
            row = counts[FRAMES]
            times[row], channels[row], ids[row] = stamp, channel_of(text, 0, 0, names, counts), identifier
            extendeds[row], fds[row], lengths[row] = extended, size > 8, size
            kinds[row] = REMOTE if remote else ERROR if error else DATA
            enter_payload(words, size, data, long_data, counts)
        else:
            set_aside(lines, counts, number - 1, code, start, stop, reached)
    return number


@njit(cache=True, nogil=True)
def _unwrap(stamp: int, state: Numbers) -> int:
    """Let the stamps of a counter of 32 bits go on where it passed its end, in either direction; return µs."""
    step = 0 if state[UNSTAMPED] == 1 else stamp - state[PREVIOUS]
    shortest = (step + _TURN // 2) % _TURN - _TURN // 2
    if _TURN // 2 < abs(step) < _TURN and abs(shortest) <= _NEAR:
        state[TURNS] += shortest - step
    state[PREVIOUS], state[UNSTAMPED] = stamp, 0
    return stamp + int(state[TURNS])


@njit(cache=True, nogil=True)
def _parse_stamp(text: Text, start: int, stop: int) -> tuple[int, int]:
    """Return code and stamp: an integer, for with a point it is not in µs, and what it is in cannot be known."""
    is_integer = True
    for p in range(start, stop):
        is_integer = is_integer and (text[p] < 58 and text[p] != POINT)
    good, stamp = decimal(text, start, stop, 0)
    if good == GOOD and not is_integer:
        return TIME, stamp
    if good == OUT_OF_RANGE or abs(stamp) > 1 << 52:
        return TIME_RANGE, stamp
    return FRAME if good == GOOD else TIME, stamp


@njit(cache=True, nogil=True)
def _parse_gvret_column(text: Text, column: int, start: int, stop: int) -> tuple[int, int]:
    """Return code and value of a field, by its place in `GVRET_COLUMNS`; any other column is passed over."""
    code, value = FRAME, 0
    if column == _TIME:
        code, value = _parse_stamp(text, start, stop)
    elif column == _ID:
        value = _parse_identifier(text, start, stop)
        code = IDENTIFIER if value < 0 else EXTENDED_RANGE if value > EXTENDED_MASK else FRAME
    elif column == _EXTENDED:
        value = _parse_flag(text, start, stop)
        code = FLAG if value < 0 else FRAME
    elif column == _DIR:
        code = DIRECTION if start < stop and not is_direction(text, start, stop) else FRAME
    elif column == _BUS:
        code = FRAME if 0 <= number_at(text, start, stop, 10) <= 255 else BUS
    elif column == _LEN:
        value = number_at(text, start, stop, 10)
        code = FRAME if 0 <= value <= 64 and IS_FD_LENGTH[value] else LENGTH
    return code, value


@njit(cache=True, nogil=True)
def _parse_gvret_payload(
    text: Text, bounds: Numbers, first: int, count: int, size: int, payload: Text
) -> tuple[int, int, int]:
    """Parse the fields from `first` on as bytes into `payload`; return code, how many there are, where parsing ended.

    The last is -1 where there was nothing to parse.
    """
    present, reached, ended = 0, -1, False
    for k in range(first, count):
        start, stop = bounds[k, 0], bounds[k, 1]
        if start == stop:
            ended = True
            continue
        value, reached = number_at(text, start, stop, 16), stop
        if value < 0 or stop - start > 2 or ended:
            return PAYLOAD, present, reached
        if present == size:
            # Loggers that pad their payloads to eight columns pad with zeros.
            if value != 0:
                return TAIL, present, reached
            continue
        payload[present] = value
        present += 1
    return FRAME, present, reached


@njit(cache=True, nogil=True)
def scan_gvret(text: Text, ends: Numbers, number: int, final: bool, found: Found, state: Numbers) -> int:
    """Parse lines as `text_log.read_frames` wants it."""
    times, channels, ids, extendeds, fds, kinds, lengths, data, long_data, names, lines, counts = found
    bounds = np.empty((MOST_FIELDS, 2), np.int64)
    words, values = np.zeros(8, np.uint64), np.zeros(len(GVRET_COLUMNS), np.int64)
    payload = words.view(np.uint8)
    while number < len(ends) and has_room(times, lines, counts):
        start, stop, width = line_at(text, ends, number)
        number += 1
        if start == stop:
            continue
        if _is_header(text, start, stop):
            set_aside(lines, counts, number - 1, OTHER, start, stop, stop)
            return number
        if width >= LONGEST_LINE:
            set_aside(lines, counts, number - 1, LONG, start, stop, start)
            continue
        clear(words)
        values[:] = 0
        count, first = split_commas(text, start, stop, bounds), state[_D1]
        code, reached, present = FRAME, stop, 0
        for k in range(min(count, first)):
            if code != FRAME:
                break
            reached = bounds[k, 1]
            for column in range(_D1):
                if state[column] == k:
                    code, values[column] = _parse_gvret_column(text, column, bounds[k, 0], reached)
        size, identifier = values[_LEN], values[_ID]
        if code == FRAME and (count < first or (count == first and size > 0)):
            code, reached = MISSING, stop
        if code == FRAME and values[_EXTENDED] == 0 and identifier > STANDARD_MASK:
            code, reached = STANDARD_RANGE, bounds[state[_ID], 0]
        if code == FRAME:
            code, present, last = _parse_gvret_payload(text, bounds, first, count, size, payload)
            reached = last if last >= 0 else reached
        if code == FRAME and final and count <= first + size:
            last_digits = bounds[count - 1, 1] - bounds[count - 1, 0]
            if present < size or (size > 0 and last_digits < 2):
                code, reached = OPEN, stop
        if code != FRAME:
            set_aside(lines, counts, number - 1, code, start, stop, reached)
            continue
        row, bus = counts[FRAMES], state[_BUS]
        if bus == ABSENT:
            channels[row] = bus_of(_ONLY_BUS, 0, 1, names, counts)
        else:
            channels[row] = bus_of(text, bounds[bus, 0], bounds[bus, 1], names, counts)
        times[row], ids[row], extendeds[row] = _unwrap(values[_TIME], state) * 1000, identifier, values[_EXTENDED] > 0
        fds[row], kinds[row], lengths[row] = size > 8, DATA, present
        enter_payload(words, present, data, long_data, counts)
    return number
