"""The line of a candump log in both directions, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from .frames import DATA, ERROR, REMOTE

LONGEST_NAME = 32
MOST_CHANNELS = 256
LONGEST_LINE = 4096
LONGEST_FRAME = 2 + 20 + 1 + LONGEST_NAME + 1 + 8 + 3 + 2 * 64 + 1
"""Bytes of the longest line that `write` can make, its line end included."""

# Why a line is not a frame; `candump.REASONS` says it in words.
TIME, TIME_RANGE, CHANNEL, IDENTIFIER, STANDARD_RANGE, EXTENDED_RANGE, ODD, DIGIT, CLASSIC_LENGTH = range(1, 10)
FLAGS, FD_LENGTH, REQUEST, TAIL, LONG, CHANNELS = range(10, 16)

# Why `scan` came back.
CUT, FULL, WIDE, REJECTIONS = range(4)

_NEWLINE, _RETURN, _TAB, _BLANK = 10, 13, 9, 32
_OPEN, _CLOSE, _POINT, _ZERO, _HASH, _UNDERSCORE = 40, 41, 46, 48, 35, 95
_NOT_HEX = 16
_HEX = np.full(256, _NOT_HEX, np.uint8)
for _digits in (b"0123456789abcdef", b"0123456789ABCDEF"):
    _HEX[np.frombuffer(_digits, np.uint8)] = np.arange(16)
_DIGITS = np.frombuffer(b"0123456789ABCDEF", np.uint8).copy()
_FD_LENGTHS = np.isin(np.arange(65), (*range(9), 12, 16, 20, 24, 32, 48, 64))

_LAST_SECOND = 9_223_372_035
_ERROR_FLAG, _EXTENDED_MASK = 0x20000000, 0x1FFFFFFF


@njit(cache=True, nogil=True)
def _is_blank(character: int) -> bool:
    return character in (_BLANK, _TAB, _RETURN)


@njit(cache=True, nogil=True)
def _parse_time(text: npt.NDArray[np.uint8], p: int, stop: int) -> tuple[int, int, int]:
    """Parse `(1436509052.249713)` at `p`; return code, where parsing ended, ns."""
    if p >= stop or text[p] != _OPEN:
        return TIME, p, 0
    p += 1
    seconds, digits = 0, 0
    while p < stop and 0 <= text[p] - _ZERO <= 9:
        if digits < 12:
            seconds = 10 * seconds + (text[p] - _ZERO)
        digits += 1
        p += 1
    if p >= stop or digits == 0 or text[p] != _POINT:
        return TIME, p, 0
    p += 1
    fraction, unit = 0, 1_000_000_000
    while p < stop and 0 <= text[p] - _ZERO <= 9 and unit > 1:
        fraction = 10 * fraction + (text[p] - _ZERO)
        unit //= 10
        p += 1
    if p >= stop or unit == 1_000_000_000 or text[p] != _CLOSE:
        return TIME, p, 0
    if digits > 12 or seconds > _LAST_SECOND:
        return TIME_RANGE, p, 0
    return 0, p + 1, seconds * 1_000_000_000 + fraction * unit


@njit(cache=True, nogil=True)
def _parse_tail(text: npt.NDArray[np.uint8], p: int, stop: int) -> tuple[int, int]:
    """Parse what may follow a payload: nothing, or blanks and the direction `R` or `T`."""
    if p == stop:
        return 0, p
    if not _is_blank(text[p]):
        return TAIL, p
    while _is_blank(text[p]):
        p += 1
    if p + 1 == stop and text[p] in (82, 84, 114, 116):
        return 0, p + 1
    return TAIL, p


@njit(cache=True, nogil=True)
def _parse_payload(
    text: npt.NDArray[np.uint8], p: int, stop: int, fd: bool, data: npt.NDArray[np.uint8], row: int
) -> tuple[int, int, int]:
    """Parse pairs of hex digits at `p` into `data[row]`; return code, where parsing ended, bytes."""
    k, limit = 0, data.shape[1] if fd else 8
    while p < stop and _HEX[text[p]] != _NOT_HEX:
        if k == limit:
            return CLASSIC_LENGTH if not fd else FD_LENGTH if k == 64 else -WIDE, p, k
        low = _HEX[text[p + 1]] if p + 1 < stop else _NOT_HEX
        if low == _NOT_HEX:
            return ODD if p + 1 == stop or _is_blank(text[p + 1]) else DIGIT, p + 1, k
        data[row, k] = (_HEX[text[p]] << 4) | low
        k += 1
        p += 2
    if p < stop and text[p] == _UNDERSCORE and k == 8 and not fd:
        # `candump -8` tells a length code beyond 8, which the bus allows for 8 bytes.
        p += 1
        if p >= stop or not 9 <= _HEX[text[p]] <= 15:
            return DIGIT, p, k
        p += 1
    if p < stop and not _is_blank(text[p]):
        return DIGIT, p, k
    if fd and not _FD_LENGTHS[k]:
        return FD_LENGTH, p, k
    return 0, p, k


@njit(cache=True, nogil=True)
def _parse_request(text: npt.NDArray[np.uint8], p: int, stop: int) -> tuple[int, int]:
    """Parse what follows the `R` of a remote frame: nothing or a number of bytes."""
    if p < stop and not _is_blank(text[p]):
        if not 0 <= text[p] - _ZERO <= 8:
            return REQUEST, p
        p += 1
        if p < stop and text[p] == _UNDERSCORE:
            p += 1
            if p >= stop or not 9 <= _HEX[text[p]] <= 15:
                return REQUEST, p
            p += 1
        if p < stop and not _is_blank(text[p]):
            return REQUEST, p
    return 0, p


@njit(cache=True, nogil=True)
def _find_channel(
    text: npt.NDArray[np.uint8], start: int, stop: int, names: npt.NDArray[np.uint8], known: int
) -> tuple[int, int]:
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


@njit(cache=True, nogil=True)
def scan(
    text: npt.NDArray[np.uint8],
    position: int,
    line: int,
    count: int,
    time: npt.NDArray[np.int64],
    channel: npt.NDArray[np.int16],
    identifier: npt.NDArray[np.uint32],
    extended: npt.NDArray[np.bool_],
    fd: npt.NDArray[np.bool_],
    kind: npt.NDArray[np.uint8],
    length: npt.NDArray[np.uint8],
    data: npt.NDArray[np.uint8],
    names: npt.NDArray[np.uint8],
    known: int,
    rejected: npt.NDArray[np.int64],
) -> tuple[int, int, int, int, int, int]:
    """Parse whole lines of `text` from `position` on into the arrays of a batch.

    Args:
        text: Bytes of the log.
        position: Where a line starts.
        line: Number of that line.
        count: Frames that the arrays hold already.
        time: The arrays of a `FrameBatch`, from here to `data`: (capacity,); `data`: zeros from row `count` on.
        channel: See `time`.
        identifier: See `time`.
        extended: See `time`.
        fd: See `time`.
        kind: See `time`.
        length: See `time`.
        data: (capacity, 8) or (capacity, 64).
        names: (channels, 1 + `LONGEST_NAME`), a row is the length of a name and its bytes; new ones are entered.
        known: Names that are entered already.
        rejected: (n, 5), a row is filled for each rejected line: its number, the code, where it starts and stops in
            `text` without blanks, and where parsing ended: at the stop where the line may only lack its rest.

    Returns:
        position, line, count, known, rejected lines, and why it ended: `CUT` no whole line is left, `FULL` the batch
        is, `WIDE` a payload needs 64 columns, `REJECTIONS` their array is full.
    """
    rejections = 0
    previous_start, previous_stop, previous = 0, 0, -1
    while count < len(time):
        if rejections == len(rejected):
            return position, line, count, known, rejections, REJECTIONS
        end = position
        while end < len(text) and text[end] != _NEWLINE:
            end += 1
        if end == len(text):
            return position, line, count, known, rejections, CUT
        start, stop = position, end
        while stop > start and _is_blank(text[stop - 1]):
            stop -= 1
        while start < stop and _is_blank(text[start]):
            start += 1
        if start == stop:
            position = end + 1
            line += 1
            continue

        code, p, stamp, number, size, k = LONG, start, 0, 0, 0, 0
        is_extended, is_fd, sort = False, False, DATA
        name_start, name_stop = 0, 0
        if end - position < LONGEST_LINE:
            code, p, stamp = _parse_time(text, start, stop)
        if code == 0:
            blanks = p
            while p < stop and _is_blank(text[p]):
                p += 1
            name_start = p
            while p < stop and text[p] > _BLANK:
                p += 1
            name_stop = p
            size = name_stop - name_start
            if blanks == name_start or not 0 < size <= LONGEST_NAME or p >= stop:
                code = CHANNEL
        if code == 0:
            while p < stop and _is_blank(text[p]):
                p += 1
            digits = p
            while p < stop and _HEX[text[p]] != _NOT_HEX and p - digits < 9:
                number = (number << 4) | _HEX[text[p]]
                p += 1
            digits = p - digits
            is_extended = digits == 8
            if p >= stop or text[p] != _HASH or digits not in (3, 8):
                code = IDENTIFIER
            elif digits == 3 and number > 0x7FF:
                code = STANDARD_RANGE
            elif is_extended and number & ~_EXTENDED_MASK == _ERROR_FLAG:
                sort = ERROR
                number &= _EXTENDED_MASK
            elif number > _EXTENDED_MASK:
                code = EXTENDED_RANGE
        if code == 0:
            p += 1
            if sort == DATA and p < stop and text[p] in (82, 114):
                sort = REMOTE
                code, p = _parse_request(text, p + 1, stop)
            else:
                if sort == DATA and p < stop and text[p] == _HASH:
                    is_fd = True
                    p += 1
                    if p >= stop or _HEX[text[p]] == _NOT_HEX:
                        code = FLAGS
                    p += 1
                if code == 0:
                    code, p, k = _parse_payload(text, p, stop, is_fd, data, count)
        if code == 0:
            code, p = _parse_tail(text, p, stop)
        if code == 0:
            same = size == previous_stop - previous_start and previous >= 0
            i = 0
            while same and i < size:
                same = text[name_start + i] == text[previous_start + i]
                i += 1
            if not same:
                previous, known = _find_channel(text, name_start, name_stop, names, known)
                previous_start, previous_stop = name_start, name_stop
                if previous < 0:
                    code, p = CHANNELS, name_start
        if code != 0:
            for i in range(k):
                data[count, i] = 0
            if code == -WIDE:
                return position, line, count, known, rejections, WIDE
            rejected[rejections, 0], rejected[rejections, 1] = line, code
            rejected[rejections, 2], rejected[rejections, 3], rejected[rejections, 4] = start, stop, min(p, stop)
            rejections += 1
        else:
            time[count] = stamp
            channel[count] = previous
            identifier[count] = number
            extended[count] = is_extended
            fd[count] = is_fd
            kind[count] = sort
            length[count] = k
            count += 1
        position = end + 1
        line += 1
    return position, line, count, known, rejections, FULL


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
            text[p + k] = _ZERO + seconds % 10
            seconds //= 10
        p += places
        text[p] = _POINT
        p += 1
        for k in range(digits - 1, -1, -1):
            text[p + k] = _ZERO + fraction % 10
            fraction //= 10
        p += digits
        text[p] = _CLOSE
        text[p + 1] = _BLANK
        p += 2
        size = int(names[channel[row], 0])
        for k in range(size):
            text[p + k] = names[channel[row], 1 + k]
        p += size
        text[p] = _BLANK
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
                text[p + 1] = _ZERO
                p += 2
            for k in range(length[row]):
                text[p] = _DIGITS[data[row, k] >> 4]
                text[p + 1] = _DIGITS[data[row, k] & 15]
                p += 2
        text[p] = _NEWLINE
        p += 1
    return p
