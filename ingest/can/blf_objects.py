"""The objects inside the containers of a BLF file, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from ..words import word_at
from .frames import DATA, ERROR, REMOTE

Content = npt.NDArray[np.uint8]

CHANNEL_NUMBERS = 1 << 16
MOST_CHANNELS = 256
LONGEST_FRAME_OBJECT = 4096
LONGEST_OBJECT = 8 << 20
GAP = 8
"""Bytes, at most, in which the next object begins: a header never stands further than the padding reaches."""

# Why an object is not a frame; `blf.REASONS` says it in words.
NO_OBJECT, SIZE, ASTRAY, CUT_OBJECT, VERSION, SHORT, UNIT, TIME_RANGE, CLASSIC_LENGTH = range(1, 10)
FD_LENGTH, STANDARD_RANGE, CHANNELS, OFFSET = range(10, 14)

GOOD, MORE = 0, -1
"""There is nothing wrong; more has to be read first."""

# Why `scan` came back.
CUT, FULL, WIDE, REJECTIONS = range(4)

_CAN_MESSAGE, _CAN_ERROR, _CAN_OVERLOAD, _CAN_ERROR_EXT, _CAN_MESSAGE2 = 1, 2, 3, 73, 86
_CAN_FD_MESSAGE, _CAN_FD_MESSAGE_64, _CAN_FD_ERROR_64 = 100, 101, 104

_LAST_TIME = (1 << 63) - 1

# The first two words of the objects that nearly all frames are: LOBJ, a header of 32 bytes, version 1; size and type.
_LOBJ = np.uint64(0x4A424F4C)
_PLAIN_HEADER = np.uint64(0x4A424F4C | 32 << 32 | 1 << 48)
_PLAIN_MESSAGE, _PLAIN_MESSAGE2 = np.uint64(48 | _CAN_MESSAGE << 32), np.uint64(56 | _CAN_MESSAGE2 << 32)
_LOW_HALF = np.uint64(0xFFFFFFFF)


@njit(cache=True, nogil=True, inline="always")
def _u16(content: Content, p: int) -> int:
    return int(np.int64(content[p]) | np.int64(content[p + 1]) << 8)


@njit(cache=True, nogil=True, inline="always")
def _u32(content: Content, p: int) -> int:
    return int(_u16(content, p) | _u16(content, p + 2) << 16)


@njit(cache=True, nogil=True, inline="always")
def _begins(content: Content, p: int) -> bool:
    """Tell whether `LOBJ` stands at `p`."""
    return bool(content[p] == 76 and content[p + 1] == 79 and content[p + 2] == 66 and content[p + 3] == 74)


@njit(cache=True, nogil=True)
def _find(content: Content, p: int, stop: int) -> int:
    """Return where the first object at or after `p` and before `stop` begins, or -1."""
    for k in range(p, min(stop, len(content) - 3)):
        if _begins(content, k):
            return k
    return -1


@njit(cache=True, nogil=True)
def _parse_payload(
    content: Content, kind: int, p: int, start: int, stop: int
) -> tuple[int, int, int, int, bool, int, int, int]:
    """Parse the object of type `kind` from `start` to `stop` whose header ends at `p`.

    Returns:
        code, channel, identifier with its flag, sort, whether CAN FD, payload bytes, where they stand, and how many of
        them are there: CAN FD objects may leave out the last ones.
    """
    body = stop - p
    if kind in (_CAN_MESSAGE, _CAN_MESSAGE2):
        head = 8 if kind == _CAN_MESSAGE else 16
        if body < head:
            return SHORT, 0, 0, 0, False, 0, 0, 0
        remote, length = bool(content[p + 2] & 0x80), int(content[p + 3])
        if length > 15:
            return CLASSIC_LENGTH, 0, 0, 0, False, 0, 0, 0
        length = 0 if remote else min(length, 8)
        if body < head + length:
            return SHORT, 0, 0, 0, False, 0, 0, 0
        sort = REMOTE if remote else DATA
        return 0, _u16(content, p), _u32(content, p + 4), sort, False, length, p + 8, length
    if kind == _CAN_FD_MESSAGE:
        if body < 20:
            return SHORT, 0, 0, 0, False, 0, 0, 0
        fd, remote, length = bool(content[p + 13] & 1), bool(content[p + 2] & 0x80), int(content[p + 14])
        if not fd and length > 8:
            return CLASSIC_LENGTH, 0, 0, 0, False, 0, 0, 0
        if length > 64:
            return FD_LENGTH, 0, 0, 0, False, 0, 0, 0
        length = 0 if remote else length
        if body < 20 + length:
            return SHORT, 0, 0, 0, False, 0, 0, 0
        return 0, _u16(content, p), _u32(content, p + 4), REMOTE if remote else DATA, fd, length, p + 20, length
    if kind == _CAN_FD_MESSAGE_64:
        if body < 40:
            return SHORT, 0, 0, 0, False, 0, 0, 0
        flags = _u32(content, p + 12)
        fd, remote, length = flags & 0x1000 != 0, flags & 0x10 != 0, int(content[p + 2])
        if not fd and length > 8:
            return CLASSIC_LENGTH, 0, 0, 0, False, 0, 0, 0
        if length > 64:
            return FD_LENGTH, 0, 0, 0, False, 0, 0, 0
        end = start + int(content[p + 35])
        if end == start:
            end = stop
        if not p + 40 <= end <= stop:
            return OFFSET, 0, 0, 0, False, 0, 0, 0
        length = 0 if remote else length
        sort = REMOTE if remote else DATA
        return 0, int(content[p]), _u32(content, p + 4), sort, fd, length, p + 40, min(length, end - p - 40)
    if kind == _CAN_ERROR_EXT:
        if body < 32:
            return SHORT, 0, 0, 0, False, 0, 0, 0
        length = min(int(content[p + 10]), 8)
        return 0, _u16(content, p), _u32(content, p + 16), ERROR, False, length, p + 24, length
    if kind == _CAN_FD_ERROR_64:
        if body < 16:
            return SHORT, 0, 0, 0, False, 0, 0, 0
        return 0, int(content[p]), _u32(content, p + 12), ERROR, False, 0, 0, 0
    if body < 4:
        return SHORT, 0, 0, 0, False, 0, 0, 0
    return 0, _u16(content, p), 0, ERROR, False, 0, 0, 0


@njit(cache=True, nogil=True)
def _seek(content: Content, position: int, last: bool, lost: bool) -> tuple[int, int]:
    """Return a code and a place: where the next object begins; with `MORE` where to go on when there is more."""
    end = len(content)
    start = _find(content, position, end if lost else position + GAP)
    if start >= 0:
        return GOOD, start
    if lost:
        return MORE, end if last else max(position, end - 3)
    if not last and end - position < GAP + 3:
        return MORE, position
    padding = end - position < GAP
    for k in range(position, end if padding else position):
        padding = padding and content[k] == 0
    return (MORE, end) if padding else (NO_OBJECT, position)


@njit(cache=True, nogil=True)
def _is_frame(kind: int) -> bool:
    return (
        _CAN_MESSAGE <= kind <= _CAN_OVERLOAD
        or _CAN_FD_MESSAGE <= kind <= _CAN_FD_MESSAGE_64
        or kind in (_CAN_ERROR_EXT, _CAN_MESSAGE2, _CAN_FD_ERROR_64)
    )


@njit(cache=True, nogil=True)
def _extent(content: Content, start: int, last: bool) -> tuple[int, int, int]:
    """Return of the object that begins at `start`: code (`MORE`: it is not whole yet), type, and where it stops."""
    end = len(content)
    if end - start < 16:
        return CUT_OBJECT if last else MORE, 0, start
    kind, stop = _u32(content, start + 12), start + _u32(content, start + 8)
    if not 16 <= stop - start <= (LONGEST_FRAME_OBJECT if _is_frame(kind) else LONGEST_OBJECT):
        return SIZE, kind, stop
    if stop > end:
        return CUT_OBJECT if last else MORE, kind, stop
    if end - stop >= GAP + 3 and _find(content, stop, stop + GAP) < 0:
        return ASTRAY, kind, stop
    return GOOD, kind, stop


@njit(cache=True, nogil=True)
def _parse_header(content: Content, start: int, stop: int, origin: int) -> tuple[int, int, int]:
    """Parse the header of a frame's object; return code, where it ends, and the frame's stamp in ns since 1970."""
    header, version = _u16(content, start + 4), _u16(content, start + 6)
    if version not in (1, 2):
        return VERSION, start, 0
    if header < 24 + 8 * version or start + header > stop:
        return SHORT, start, 0
    flags, low, high = _u32(content, start + 16), _u32(content, start + 24), _u32(content, start + 28)
    unit = 1 if flags & 2 else 10_000 if flags & 1 else 0
    if unit == 0:
        return UNIT, start, 0
    if high >= 1 << 31 or (high << 32 | low) > (_LAST_TIME - origin) // unit:
        return TIME_RANGE, start, 0
    return GOOD, start + header, origin + unit * (high << 32 | low)


@njit(cache=True, nogil=True)
def _take_plain(
    content: Content,
    position: int,
    origin: int,
    count: int,
    arrays: tuple[npt.NDArray[Any], ...],
    numbers: npt.NDArray[np.int16],
) -> tuple[int, int]:
    """Take frames as long as each is a data frame of a known channel in an object as most are; see `scan`.

    Whatever is unusual about an object, or wrong with it, is left to `scan`: it finds the same frames, by and by.

    Returns:
        Where the first object begins that is not taken, and how many frames the arrays hold.
    """
    time, channel, identifier, extended, fd, sort, length, data = arrays
    payloads = data.view(np.uint64)
    latest = np.uint64(_LAST_TIME - origin), np.uint64((_LAST_TIME - origin) // 10_000)
    last = len(content) - 64  # The next object's first bytes are looked at, too.
    while position <= last and count < len(time):
        p = np.uint64(position)
        kind = word_at(content, p + np.uint64(8))
        if word_at(content, p) != _PLAIN_HEADER or kind not in (_PLAIN_MESSAGE, _PLAIN_MESSAGE2):
            break
        size = 48 if kind == _PLAIN_MESSAGE else 56
        flags, stamp = word_at(content, p + np.uint64(16)) & np.uint64(3), word_at(content, p + np.uint64(24))
        in_ns = flags & np.uint64(2) != np.uint64(0)
        head = word_at(content, p + np.uint64(32))
        number, code, bits = head & np.uint64(0xFFFF), head >> np.uint64(24) & np.uint64(0xFF), head >> np.uint64(32)
        wide = bits & np.uint64(0x80000000) != np.uint64(0)
        if (
            word_at(content, p + np.uint64(size)) & _LOW_HALF != _LOBJ
            or flags == np.uint64(0)
            or stamp > (latest[0] if in_ns else latest[1])
            or head & np.uint64(0x800000) != np.uint64(0)
            or code > np.uint64(8)
            or (not wide and bits & np.uint64(0x1FFFFFFF) > np.uint64(0x7FF))
            or numbers[number] < 0
        ):
            break
        kept = np.uint64(0xFFFFFFFFFFFFFFFF) >> (np.uint64(64) - np.uint64(8) * code) if code else np.uint64(0)
        payloads[count, 0] = word_at(content, p + np.uint64(40)) & kept
        time[count] = origin + np.int64(stamp if in_ns else np.uint64(10_000) * stamp)
        channel[count] = numbers[number]
        identifier[count], extended[count] = bits & np.uint64(0x1FFFFFFF), wide
        fd[count], sort[count], length[count] = False, DATA, code
        count += 1
        position += size
    return position, count


@njit(cache=True, nogil=True)
def scan(
    content: Content,
    position: int,
    last: bool,
    lost: bool,
    origin: int,
    count: int,
    arrays: tuple[npt.NDArray[Any], ...],
    numbers: npt.NDArray[np.int16],
    known: int,
    rejected: npt.NDArray[np.int64],
) -> tuple[int, bool, int, int, int, int]:
    """Take the frames of whole objects in `content` from `position` on into the arrays of a batch.

    Args:
        content: What containers hold.
        position: Where an object, or the padding before it, begins.
        last: Nothing follows: what is not whole is rejected.
        lost: Where the next object begins is not known; what stands before it was rejected already.
        origin: Time of the recording's start, in ns since 1970.
        count: Frames that the arrays hold already.
        arrays: Those of `PendingFrames`.
        numbers: (`CHANNEL_NUMBERS`,), index of each channel number, -1 where it is not known; new ones are entered.
        known: Channels that are entered already.
        rejected: (n, 3), a row is filled for each rejected object: where it begins, the code, its type.

    Returns:
        position, lost, count, known, rejected objects, and why it ended: `CUT` no whole object is left, `FULL` the
        batch is, `WIDE` a payload needs 64 columns, `REJECTIONS` their array is full.
    """
    time, channel, identifier, extended, fd, sort, length, data = arrays
    rejections = 0
    while count < len(time):
        if not lost:
            position, count = _take_plain(content, position, origin, count, arrays, numbers)
            if count == len(time):
                break
        if rejections == len(rejected):
            return position, lost, count, known, rejections, REJECTIONS
        code, position = _seek(content, position, last, lost)
        kind, stop, found = 0, position, code == GOOD
        if found:
            lost = False
            code, kind, stop = _extent(content, position, last)
        if code == MORE:
            return position, lost, count, known, rejections, CUT
        if code != GOOD:
            rejected[rejections, 0], rejected[rejections, 1], rejected[rejections, 2] = position, code, kind
            rejections += 1
            position, lost = position + 4 * found, True
            continue
        if not _is_frame(kind):
            position = stop
            continue
        number, bits, what, is_fd, size, place, present = 0, 0, DATA, False, 0, 0, 0
        code, place, stamp = _parse_header(content, position, stop, origin)
        if code == GOOD:
            code, number, bits, what, is_fd, size, place, present = _parse_payload(content, kind, place, position, stop)
        if code == GOOD and what != ERROR and bits & 0x80000000 == 0 and bits & 0x1FFFFFFF > 0x7FF:
            code = STANDARD_RANGE
        if code == GOOD and numbers[number] < 0 and known == MOST_CHANNELS:
            code = CHANNELS
        if code != GOOD:
            rejected[rejections, 0], rejected[rejections, 1], rejected[rejections, 2] = position, code, kind
            rejections += 1
            position = stop
            continue
        if numbers[number] < 0:
            numbers[number] = known
            known += 1
        if size > data.shape[1]:
            return position, lost, count, known, rejections, WIDE
        time[count], channel[count], identifier[count] = stamp, numbers[number], bits & 0x1FFFFFFF
        extended[count], fd[count], sort[count], length[count] = bits & 0x80000000 != 0, is_fd, what, size
        for k in range(present):
            data[count, k] = content[place + k]
        count += 1
        position = stop
    return position, lost, count, known, rejections, FULL
