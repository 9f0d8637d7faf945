"""The lines that candump writes to a terminal, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..text import LONGEST_LINE
from .frames import DATA, ERROR, REMOTE
from .text_fields import (
    DASH,
    EXTENDED_MASK,
    IS_FD_LENGTH,
    SECOND,
    STANDARD_MASK,
    TAB,
    ZERO,
    Numbers,
    Text,
    bytes_at,
    channel_of,
    clear,
    enter_payload,
    has_room,
    is_word,
    line_at,
    number_at,
    seconds_at,
    set_aside,
    token_at,
    word,
)
from .text_log import FRAME, FRAMES, LONGEST_NAME, Found

DELTAS, MOMENT, AFTER_ERROR = range(3)
"""The state: stamps count from the one before; the last moment; the last line was an error frame."""

# Why a line is not a frame; `candump_console.REASONS` says it in words.
TIME, NO_TIME, TIME_RANGE, CHANNEL, EXTRA, IDENTIFIER, STANDARD_RANGE, EXTENDED_RANGE = range(1, 9)
LENGTH, FD_LENGTH, MISSING, BYTE, TAIL, SHORT, LONG, CHANNELS = range(9, 17)

_OPEN, _CLOSE, _QUOTE = 40, 41, 39
_EPOCH = 1_000_000_000 * SECOND
_LAST_MOMENT = (1 << 63) - 1
_ERROR_FLAG = 0x20000000
_ERRORFRAME, _REMOTE, _REQUEST = word(b"errorframe"), word(b"remote"), word(b"request")
_DATE = word(b"0000-00-00 00:00:00.")
_MONTH_DAYS = np.array([31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31])


@njit(cache=True, nogil=True)
def _date_at(text: Text, p: int, stop: int) -> tuple[int, int]:
    """Return the ns since 1970 that a date such as 2015-07-10 06:17:32.249713 at `p` is, or -1; and where it ends."""
    if stop - p < len(_DATE):
        return -1, p
    for k in range(len(_DATE)):
        if text[p + k] != _DATE[k] and not (_DATE[k] == ZERO and 0 <= text[p + k] - ZERO <= 9):
            return -1, p
    year, month, day = (
        number_at(text, p, p + 4, 10),
        number_at(text, p + 5, p + 7, 10),
        number_at(text, p + 8, p + 10, 10),
    )
    hour, minute = number_at(text, p + 11, p + 13, 10), number_at(text, p + 14, p + 16, 10)
    second, end = seconds_at(text, p + 17, stop)
    if not (1970 <= year <= 2261 and 1 <= month <= 12 and hour < 24 and minute < 60 and 0 <= second < 60 * SECOND):
        return -1, p
    leap = year % 4 == 0 and (year % 100 != 0 or year % 400 == 0)
    if not 1 <= day <= _MONTH_DAYS[month - 1] + (leap and month == 2):
        return -1, p
    before = year - 1
    days = 365 * before + before // 4 - before // 100 + before // 400 - 719_162 + day - 1 + (leap and month > 2)
    for k in range(month - 1):
        days += _MONTH_DAYS[k]
    return (days * 86_400 + hour * 3600 + minute * 60) * SECOND + second, end


@njit(cache=True, nogil=True)
def _stamp_at(text: Text, p: int, stop: int, state: Numbers) -> tuple[int, int, int]:
    """Parse `(…) ` at `p`; return code, ns since 1970, and where it ends."""
    if p >= stop or text[p] != _OPEN:
        return NO_TIME, 0, p
    dated = p + 5 < stop and text[p + 5] == DASH
    stamp, end = _date_at(text, p + 1, stop) if dated else seconds_at(text, p + 1, stop)
    if stamp == -2:
        return TIME_RANGE, 0, end
    if stamp < 0 or end + 1 >= stop or text[end] != _CLOSE or text[end + 1] > 32:
        return TIME, 0, end
    if state[DELTAS] == 1 and not dated and stamp < _EPOCH:
        if stamp > _LAST_MOMENT - state[MOMENT]:
            return TIME_RANGE, 0, end
        stamp += state[MOMENT]
    state[MOMENT] = stamp
    return FRAME, stamp, end + 1


@njit(cache=True, nogil=True)
def _payload(text: Text, p: int, stop: int, sort: int, final: bool, payload: Text) -> tuple[int, int, bool, int]:
    """Parse from `[8]` on; return code, kind, whether it is CAN FD, and bytes."""
    start, p = token_at(text, p, stop)
    digits = p - start - 2
    raw = digits == 1 and text[start] == 123 and text[p - 1] == 125
    if not raw and not (1 <= digits <= 2 and text[start] == 91 and text[p - 1] == 93):
        return LENGTH, sort, False, 0
    count = number_at(text, start + 1, p - 1, 16 if raw else 10)
    fd = digits == 2
    if count < 0 or (digits == 1 and not raw and count > 8):
        return LENGTH, sort, False, 0
    if raw:
        count = min(count, 8)
    if fd and not (count <= 64 and IS_FD_LENGTH[count]):
        return FD_LENGTH, sort, True, 0
    start, end = token_at(text, p, stop)
    if not fd and sort == DATA and is_word(text, start, end, _REMOTE):
        start, end = token_at(text, end, stop)
        following = token_at(text, end, stop)[0]
        return FRAME if is_word(text, start, end, _REQUEST) and following == stop else TAIL, REMOTE, False, 0
    size, p = bytes_at(text, p, stop, 16, count, payload)
    if size < count:
        return MISSING if p == stop else BYTE, sort, fd, size
    start, end = token_at(text, p, stop)
    if start == stop:
        return SHORT if final and size == 0 else FRAME, sort, fd, size
    if text[start] == _QUOTE and text[stop - 1] == _QUOTE and stop - start >= 2:
        return FRAME, sort, fd, size
    if sort == ERROR and is_word(text, start, end, _ERRORFRAME) and end == stop:
        return FRAME, sort, fd, size
    return TAIL, sort, fd, size


@njit(cache=True, nogil=True)
def _frame(text: Text, p: int, stop: int, final: bool, payload: Text) -> tuple[int, int, bool, int, bool, int]:
    """Parse what stands behind the interface; return code, identifier, extended, kind, CAN FD, bytes."""
    start, p = token_at(text, p, stop)
    if p - start == 2 and text[start] in (82, 84) and text[start + 1] == 88:
        switch, p = token_at(text, p, stop)
        state, end = token_at(text, p, stop)
        if p - switch != 1 or end - state != 1 or text[switch] not in (66, DASH) or text[state] not in (69, DASH):
            return EXTRA, 0, False, DATA, False, 0
        start, p = token_at(text, end, stop)
    digits = p - start
    number = number_at(text, start, p, 16)
    if number < 0 or digits not in (3, 8):
        return IDENTIFIER, 0, False, DATA, False, 0
    if digits == 3 and number > STANDARD_MASK:
        return STANDARD_RANGE, 0, False, DATA, False, 0
    sort = DATA
    if digits == 8 and number & ~EXTENDED_MASK == _ERROR_FLAG:
        sort = ERROR
        number &= EXTENDED_MASK
    elif number > EXTENDED_MASK:
        return EXTENDED_RANGE, 0, False, DATA, False, 0
    code, sort, fd, size = _payload(text, p, stop, sort, final, payload)
    return code, number, digits == 8, sort, fd, size


@njit(cache=True, nogil=True)
def scan(text: Text, ends: Numbers, number: int, final: bool, found: Found, state: Numbers) -> int:
    """Parse lines as `text_log.read_frames` wants it."""
    times, channels, ids, extendeds, fds, kinds, lengths, data, long_data, names, lines, counts = found
    words = np.zeros(8, np.uint64)
    payload = words.view(np.uint8)
    while number < len(ends) and has_room(times, lines, counts):
        start, stop, width = line_at(text, ends, number)
        number += 1
        indented = width > 0 and text[ends[number - 1] - width] == TAB
        # `candump -e` explains an error frame on indented lines below it.
        if start == stop or (indented and state[AFTER_ERROR] == 1 and text[start] != _OPEN and width < LONGEST_LINE):
            continue
        code, moment, identifier, extended, fd, kind, size, channel = LONG, 0, 0, False, False, DATA, 0, 0
        name = name_stop = 0
        if width < LONGEST_LINE:
            clear(words)
            state[AFTER_ERROR] = 0
            code, moment, p = _stamp_at(text, start, stop, state)
            name, name_stop = token_at(text, p, stop)
        if code in (FRAME, NO_TIME):
            parsed = CHANNEL
            if 0 < name_stop - name <= LONGEST_NAME and name_stop < stop:
                parsed, identifier, extended, kind, fd, size = _frame(text, name_stop, stop, final, payload)
            if code == FRAME:
                code = parsed
            elif parsed != FRAME:
                code = TIME
        if code == FRAME:
            channel = channel_of(text, name, name_stop, names, counts)
            if channel < 0:
                code = CHANNELS
        if code == FRAME:
            state[AFTER_ERROR] = kind == ERROR
            row = counts[FRAMES]
            times[row], channels[row], ids[row] = moment, channel, identifier
            extendeds[row], fds[row], kinds[row], lengths[row] = extended, fd, kind, size
            enter_payload(words, size, data, long_data, counts)
        else:
            set_aside(lines, counts, number - 1, code, start, stop, start if code == LONG else stop)
    return number
