"""The frames among the lines of a Vector ASC log, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..text import LONGEST_LINE
from .frames import DATA, ERROR, REMOTE
from .text_fields import (
    EXTENDED_MASK,
    FD_LENGTHS,
    SECOND,
    STANDARD_MASK,
    ZERO,
    Numbers,
    Text,
    bytes_at,
    channel_of,
    clear,
    enter_payload,
    has_room,
    is_direction,
    is_word,
    line_at,
    number_at,
    seconds_at,
    set_aside,
    token_at,
    word,
)
from .text_log import FRAME, FRAMES, OTHER, Found

DECIMAL, DELTAS, START, LAST, BLOCK_BEGINS, BLOCK_DATE = range(6)
"""The state: numbers are decimal; stamps count from the one before; the moment they count from (ns since 1970); the
last stamp; a trigger block has begun and has had no stamp; its date."""

# Why a line is not a frame; `asc.REASONS` says it in words.
TIME, TIME_RANGE, IDENTIFIER, STANDARD_RANGE, EXTENDED_RANGE, SORT, CODE, MISSING, BYTE, TAIL = range(1, 11)
SWITCHES, LENGTH, FLAGS, SHORT, LONG, CHANNELS = range(11, 17)

_EPOCH = 1_000_000_000 * SECOND
_LAST_MOMENT = (1 << 63) - 1
_FLAG_REMOTE, _FLAG_FD = 0x10, 0x1000
_CANFD, _ERRORFRAME = word(b"canfd"), word(b"errorframe")
_LENGTH, _BITCOUNT, _ID = word(b"length"), word(b"bitcount"), word(b"id")


@njit(cache=True, nogil=True)
def _moment(stamp: int, state: Numbers) -> int:
    """Return when a stamp was, ns since 1970, or -1: beyond what 64 bits hold; carry the state on."""
    if state[BLOCK_BEGINS] == 1:
        if state[DELTAS] == 1 or stamp == 0 or stamp < state[LAST]:
            state[START] = state[BLOCK_DATE]
        state[BLOCK_BEGINS] = 0
    state[LAST] = stamp
    if stamp >= _EPOCH:
        return stamp
    if stamp > _LAST_MOMENT - state[START]:
        return -1
    moment: int = state[START] + stamp
    if state[DELTAS] == 1:
        state[START] = moment
    return moment


@njit(cache=True, nogil=True)
def _identifier(text: Text, start: int, stop: int, base: int) -> tuple[int, int, bool]:
    """Return code, identifier, and whether it is extended."""
    extended = stop > start and text[stop - 1] in (88, 120)
    number = number_at(text, start, stop - 1 if extended else stop, base)
    if number < 0:
        return IDENTIFIER, 0, extended
    if extended and number > EXTENDED_MASK:
        return EXTENDED_RANGE, 0, extended
    if not extended and number > STANDARD_MASK:
        return STANDARD_RANGE, 0, extended
    return FRAME, number, extended


@njit(cache=True, nogil=True)
def _length_code(text: Text, start: int, stop: int, base: int) -> int:
    """Return a length code of 0 to 15, or -1: one hex digit whatever the base, or two decimal ones in base 10."""
    code = number_at(text, start, stop, 16 if stop - start == 1 else base)
    return code if code <= 15 and stop - start <= 2 else -1


@njit(cache=True, nogil=True)
def _is_tail(text: Text, p: int, stop: int) -> bool:
    """Tell whether what is left of a classic frame's line is nothing, a comment or a known remark."""
    start, end = token_at(text, p, stop)
    if start == end:
        return True
    if end - start >= 2 and text[start] == 47 and text[start + 1] == 47:
        return True
    return bool(
        is_word(text, start, end, _LENGTH) or is_word(text, start, end, _BITCOUNT) or is_word(text, start, end, _ID)
    )


@njit(cache=True, nogil=True)
def _classic(text: Text, p: int, stop: int, base: int, final: bool, payload: Text) -> tuple[int, int, int]:
    """Parse a classic frame behind its direction; return code, kind and bytes."""
    start, p = token_at(text, p, stop)
    sort = text[start] | 32 if p - start == 1 else 0
    start, end = token_at(text, p, stop)
    if sort == 114:
        if _length_code(text, start, end, base) >= 0:
            p = end
        return FRAME if _is_tail(text, p, stop) else TAIL, REMOTE, 0
    if sort != 100:
        return SORT, DATA, 0
    code = _length_code(text, start, end, base)
    if code < 0:
        return CODE, DATA, 0
    count = min(code, 8)
    size, p = bytes_at(text, end, stop, base, count, payload)
    if size < count:
        return MISSING if p == stop or _is_tail(text, p, stop) else BYTE, DATA, size
    if final and base == 10 and size > 0 and p == stop:
        return SHORT, DATA, size
    return FRAME if _is_tail(text, p, stop) else TAIL, DATA, size


@njit(cache=True, nogil=True)
def _fd(text: Text, p: int, stop: int, base: int, final: bool, payload: Text) -> tuple[int, int, bool, int]:
    """Parse a frame of a CANFD line behind its identifier; return code, kind, whether it is CAN FD, and bytes."""
    start, p = token_at(text, p, stop)
    following, end = token_at(text, p, stop)
    if not (p - start == 1 and 0 <= text[start] - ZERO <= 1 and end - following == 1):
        start, p = following, end
        following, end = token_at(text, p, stop)
    if not (p - start == 1 and 0 <= text[start] - ZERO <= 1 and end - following == 1 and text[following] in (48, 49)):
        return SWITCHES, DATA, True, 0
    start, end = token_at(text, end, stop)
    code = _length_code(text, start, end, base)
    if code < 0:
        return CODE, DATA, True, 0
    start, end = token_at(text, end, stop)
    count = number_at(text, start, end, 10)
    if not 0 <= count <= 64:
        return LENGTH, DATA, True, 0
    size, p = bytes_at(text, end, stop, base, count, payload)
    if size < count:
        return MISSING if p == stop else BYTE, DATA, True, size
    flags = -1
    for place in range(4):
        start, p = token_at(text, p, stop)
        if place == 2 and start < p:
            flags = number_at(text, start, p, 16)
            if flags < 0:
                return FLAGS, DATA, True, size
    if final and start == p:
        return SHORT, DATA, True, size
    remote = count == 0 and code > 0 if flags < 0 else (flags & _FLAG_REMOTE) != 0
    if remote:
        return FRAME if count == 0 else LENGTH, REMOTE, False, 0
    fd = flags < 0 or (flags & _FLAG_FD) != 0
    return FRAME if count == (FD_LENGTHS[code] if fd else min(code, 8)) else LENGTH, DATA, fd, size


@njit(cache=True, nogil=True)
def _frame(
    text: Text, p: int, stop: int, base: int, final: bool, payload: Text
) -> tuple[int, int, int, int, bool, bool, int, int]:
    """Parse a frame behind its stamp.

    Returns:
        Code, where the channel's number starts and stops, identifier, whether it is extended, whether it is CAN FD,
        kind, bytes.
    """
    name, name_stop = token_at(text, p, stop)
    on_fd = is_word(text, name, name_stop, _CANFD)
    if on_fd:
        name, name_stop = token_at(text, name_stop, stop)
    first, first_stop = token_at(text, name_stop, stop)
    second, second_stop = token_at(text, first_stop, stop)
    if name_stop - name > 3 or number_at(text, name, name_stop, 10) < 0:
        return OTHER, name, name_stop, 0, False, False, ERROR, 0
    # A classic line has its direction behind the identifier, a CANFD line before it.
    directed = is_direction(text, first, first_stop) if on_fd else is_direction(text, second, second_stop)
    if on_fd:
        error = directed and is_word(text, second, second_stop, _ERRORFRAME)
    else:
        error = is_word(text, first, first_stop, _ERRORFRAME)
    if error:
        return FRAME, name, name_stop, 0, False, False, ERROR, 0
    if not directed:
        return OTHER, name, name_stop, 0, False, False, ERROR, 0
    if on_fd:
        first, first_stop = second, second_stop
    code, identifier, extended = _identifier(text, first, first_stop, base)
    fd, kind, size = False, DATA, 0
    if code == FRAME and on_fd:
        code, kind, fd, size = _fd(text, second_stop, stop, base, final, payload)
    elif code == FRAME:
        code, kind, size = _classic(text, second_stop, stop, base, final, payload)
    return code, name, name_stop, identifier, extended, fd, kind, size


@njit(cache=True, nogil=True)
def scan(text: Text, ends: Numbers, number: int, final: bool, found: Found, state: Numbers) -> int:
    """Parse lines as `text_log.read_frames` wants it; a line without a stamp may change the state."""
    times, channels, ids, extendeds, fds, kinds, lengths, data, long_data, names, lines, counts = found
    words = np.zeros(8, np.uint64)
    payload = words.view(np.uint8)
    while number < len(ends) and has_room(times, lines, counts):
        start, stop, width = line_at(text, ends, number)
        number += 1
        if start == stop:
            continue
        code, moment, identifier, extended, fd, kind, size, channel = LONG, 0, 0, False, False, DATA, 0, 0
        name = name_stop = 0
        if width < LONGEST_LINE:
            if not 0 <= text[start] - ZERO <= 9:
                set_aside(lines, counts, number - 1, OTHER, start, stop, stop)
                return number
            moment, p = seconds_at(text, start, stop)
            if moment < 0 or (p < stop and text[p] > 32):
                code = TIME_RANGE if moment == -2 else TIME
            else:
                moment = _moment(moment, state)
                code = TIME_RANGE if moment < 0 else FRAME
        if code == FRAME:
            clear(words)
            base = 10 if state[DECIMAL] == 1 else 16
            code, name, name_stop, identifier, extended, fd, kind, size = _frame(text, p, stop, base, final, payload)
        if code == FRAME:
            channel = channel_of(text, name, name_stop, names, counts)
            if channel < 0:
                code = CHANNELS
        if code == FRAME:
            row = counts[FRAMES]
            times[row], channels[row], ids[row] = moment, channel, identifier
            extendeds[row], fds[row], kinds[row], lengths[row] = extended, fd, kind, size
            enter_payload(words, size, data, long_data, counts)
        else:
            set_aside(lines, counts, number - 1, code, start, stop, start if code == LONG else stop)
    return number
