"""The objects inside the containers of a BLF file, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from .frames import DATA, ERROR, REMOTE

CHANNEL_NUMBERS = 1 << 16
MOST_CHANNELS = 256
LONGEST_FRAME_OBJECT = 4096
LONGEST_OBJECT = 8 << 20
GAP = 8
"""Bytes, at most, in which the next object begins: a header never stands further than the padding reaches."""

# Why an object is not a frame; `blf.REASONS` says it in words.
NO_OBJECT, SIZE, ASTRAY, CUT_OBJECT, VERSION, SHORT, UNIT, TIME_RANGE, CLASSIC_LENGTH = range(1, 10)
FD_LENGTH, STANDARD_RANGE, CHANNELS, OFFSET = range(10, 14)

# Why `scan` came back.
CUT, FULL, WIDE, REJECTIONS = range(4)

_CAN_MESSAGE, _CAN_ERROR, _CAN_OVERLOAD, _CAN_ERROR_EXT, _CAN_MESSAGE2 = 1, 2, 3, 73, 86
_CAN_FD_MESSAGE, _CAN_FD_MESSAGE_64, _CAN_FD_ERROR_64 = 100, 101, 104

_LAST_TIME = (1 << 63) - 1


@njit(cache=True, nogil=True, inline="always")
def _u16(content: npt.NDArray[np.uint8], p: int) -> int:
    return int(np.int64(content[p]) | np.int64(content[p + 1]) << 8)


@njit(cache=True, nogil=True, inline="always")
def _u32(content: npt.NDArray[np.uint8], p: int) -> int:
    return int(_u16(content, p) | _u16(content, p + 2) << 16)


@njit(cache=True, nogil=True, inline="always")
def _begins(content: npt.NDArray[np.uint8], p: int) -> bool:
    """Tell whether `LOBJ` stands at `p`."""
    return bool(content[p] == 76 and content[p + 1] == 79 and content[p + 2] == 66 and content[p + 3] == 74)


@njit(cache=True, nogil=True)
def _find(content: npt.NDArray[np.uint8], p: int, stop: int) -> int:
    """Return where the first object at or after `p` and before `stop` begins, or -1."""
    for k in range(p, min(stop, len(content) - 3)):
        if _begins(content, k):
            return k
    return -1


@njit(cache=True, nogil=True)
def _parse_payload(
    content: npt.NDArray[np.uint8], kind: int, p: int, start: int, stop: int
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
def scan(
    content: npt.NDArray[np.uint8],
    position: int,
    last: bool,
    lost: bool,
    origin: int,
    count: int,
    time: npt.NDArray[np.int64],
    channel: npt.NDArray[np.int16],
    identifier: npt.NDArray[np.uint32],
    extended: npt.NDArray[np.bool_],
    fd: npt.NDArray[np.bool_],
    sort: npt.NDArray[np.uint8],
    length: npt.NDArray[np.uint8],
    data: npt.NDArray[np.uint8],
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
        time: The arrays of a `FrameBatch`, from here to `data`: (capacity,); `data`: zeros from row `count` on.
        channel: See `time`.
        identifier: See `time`.
        extended: See `time`.
        fd: See `time`.
        sort: See `time`.
        length: See `time`.
        data: (capacity, 8) or (capacity, 64).
        numbers: (`CHANNEL_NUMBERS`,), index of each channel number, -1 where it is not known; new ones are entered.
        known: Channels that are entered already.
        rejected: (n, 3), a row is filled for each rejected object: where it begins, the code, its type.

    Returns:
        position, lost, count, known, rejected objects, and why it ended: `CUT` no whole object is left, `FULL` the
        batch is, `WIDE` a payload needs 64 columns, `REJECTIONS` their array is full.
    """
    rejections, end = 0, len(content)
    while count < len(time):
        if rejections == len(rejected):
            return position, lost, count, known, rejections, REJECTIONS
        start = _find(content, position, end if lost else position + GAP)
        if start < 0 and lost:
            return (end if last else max(position, end - 3)), lost, count, known, rejections, CUT
        if start < 0 and not last and end - position < GAP + 3:
            return position, lost, count, known, rejections, CUT
        if start < 0:
            padding = end - position < GAP
            for k in range(position, end if padding else position):
                padding = padding and content[k] == 0
            if padding:
                return end, lost, count, known, rejections, CUT
            rejected[rejections, 0], rejected[rejections, 1], rejected[rejections, 2] = position, NO_OBJECT, 0
            rejections += 1
            lost = True
            continue
        position, lost = start, False
        if end - start < 16 and not last:
            return position, lost, count, known, rejections, CUT
        code, kind, stop = CUT_OBJECT, 0, start + 4
        is_frame = False
        if end - start >= 16:
            code, kind, stop = 0, _u32(content, start + 12), start + _u32(content, start + 8)
            is_frame = (
                _CAN_MESSAGE <= kind <= _CAN_OVERLOAD
                or _CAN_FD_MESSAGE <= kind <= _CAN_FD_MESSAGE_64
                or kind in (_CAN_ERROR_EXT, _CAN_MESSAGE2, _CAN_FD_ERROR_64)
            )
            if not 16 <= stop - start <= (LONGEST_FRAME_OBJECT if is_frame else LONGEST_OBJECT):
                code = SIZE
            elif stop > end:
                if not last:
                    return position, lost, count, known, rejections, CUT
                code = CUT_OBJECT
            elif end - stop >= GAP + 3 and _find(content, stop, stop + GAP) < 0:
                code = ASTRAY
        if code != 0:
            rejected[rejections, 0], rejected[rejections, 1], rejected[rejections, 2] = start, code, kind
            rejections += 1
            position, lost = start + 4, True
            continue
        if not is_frame:
            position = stop
            continue

        number, bits, what, is_fd, size, place, present, stamp = 0, 0, DATA, False, 0, 0, 0, 0
        header, version = _u16(content, start + 4), _u16(content, start + 6)
        if version not in (1, 2):
            code = VERSION
        elif header < 24 + 8 * version or start + header > stop:
            code = SHORT
        if code == 0:
            flags, low, high = _u32(content, start + 16), _u32(content, start + 24), _u32(content, start + 28)
            unit = 1 if flags & 2 else 10_000 if flags & 1 else 0
            if unit == 0:
                code = UNIT
            elif high >= 1 << 31 or (high << 32 | low) > (_LAST_TIME - origin) // unit:
                code = TIME_RANGE
            else:
                stamp = origin + unit * (high << 32 | low)
        if code == 0:
            code, number, bits, what, is_fd, size, place, present = _parse_payload(
                content, kind, start + header, start, stop
            )
        if code == 0 and what != ERROR and bits & 0x80000000 == 0 and bits & 0x1FFFFFFF > 0x7FF:
            code = STANDARD_RANGE
        if code == 0 and numbers[number] < 0:
            if known == MOST_CHANNELS:
                code = CHANNELS
            else:
                numbers[number] = known
                known += 1
        if code != 0:
            rejected[rejections, 0], rejected[rejections, 1], rejected[rejections, 2] = start, code, kind
            rejections += 1
            position = stop
            continue
        if size > data.shape[1]:
            return position, lost, count, known, rejections, WIDE
        time[count] = stamp
        channel[count] = numbers[number]
        identifier[count] = bits & 0x1FFFFFFF
        extended[count] = bits & 0x80000000 != 0
        fd[count] = is_fd
        sort[count] = what
        length[count] = size
        for k in range(present):
            data[count, k] = content[place + k]
        count += 1
        position = stop
    return position, lost, count, known, rejections, FULL
