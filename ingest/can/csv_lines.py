"""The lines of CSV logs of frames, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from .frames import DATA, ERROR, REMOTE
from .text_fields import (
    FD_LENGTHS,
    GOOD,
    MOST_FIELDS,
    OUT_OF_RANGE,
    decimal,
    hexadecimal,
    is_word,
    line_at,
    natural,
    split_commas,
)
from .text_log import ACCEPTED, NO_RECORD, Rows

# Why a line is not a frame; `python_can_csv.REASONS` and `gvret_csv.REASONS` say it in words.
MISSING, TIME, TIME_RANGE, IDENTIFIER, STANDARD_RANGE, EXTENDED_RANGE, FLAG, LENGTH, PAYLOAD, TAIL = range(1, 11)
DIRECTION, BUS = 11, 12
CLASSIC_LENGTH, FD_LENGTH, BOTH = 11, 12, 13

GVRET_COLUMNS = ("time stamp", "id", "extended", "dir", "bus", "len", "d1")
ABSENT = -1
_SHORTEST_HEADER = len("Time Stamp,ID,LEN")
_TIME, _ID, _EXTENDED, _DIR, _BUS, _LEN, _D1 = range(7)

_ZERO, _PAD, _POINT, _X = 48, 61, 46, 120
_NOT_BASE64 = 64
_BASE64 = np.full(256, _NOT_BASE64, np.int64)
_BASE64[np.frombuffer(b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/", np.uint8)] = np.arange(64)


@njit(cache=True, nogil=True)
def _is_header(text: npt.NDArray[np.uint8], start: int, stop: int) -> bool:
    """Tell whether a line starts as no row does, with a letter, a quotation mark or a byte order mark, and is long."""
    if stop - start < _SHORTEST_HEADER:
        return False
    return 65 <= (text[start] & 0xDF) <= 90 or text[start] in (34, 239)


@njit(cache=True, nogil=True)
def _parse_identifier(text: npt.NDArray[np.uint8], start: int, stop: int) -> int:
    """Return the value of an identifier in hex digits with or without 0x; -1 if it is none."""
    if stop - start > 2 and text[start] == _ZERO and text[start + 1] | 32 == _X:
        start += 2
    number: int = hexadecimal(text, start, stop)
    return number


@njit(cache=True, nogil=True)
def _parse_flag(text: npt.NDArray[np.uint8], start: int, stop: int) -> int:
    """Return 1 for true, 0 for false, -1 for neither."""
    if is_word(text, start, stop, b"1") or is_word(text, start, stop, b"true"):
        return 1
    if is_word(text, start, stop, b"0") or is_word(text, start, stop, b"false"):
        return 0
    return -1


@njit(cache=True, nogil=True)
def _parse_base64(text: npt.NDArray[np.uint8], start: int, stop: int, size: int, data: npt.NDArray[np.uint8]) -> bool:
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
def scan_python_can(text: npt.NDArray[np.uint8], position: int, rows: Rows) -> tuple[int, int, bool]:
    """Parse lines `timestamp,arbitration_id,extended,remote,error,dlc,data` as `Dialect.scan` does."""
    bounds = np.empty((MOST_FIELDS, 2), np.int64)
    row = 0
    while position < len(text) and row < len(rows.code):
        start, stop, following = line_at(text, position)
        if _is_header(text, start, stop):
            return position, row, True
        position = following
        rows.start[row], rows.stop[row], rows.open[row] = start, stop, False
        rows.bus[row] = 0
        rows.data[row] = 0
        if start == stop:
            rows.code[row] = NO_RECORD
            row += 1
            continue
        count = split_commas(text, start, stop, bounds)
        code, reached = ACCEPTED, stop
        good, stamp = decimal(text, bounds[0, 0], bounds[0, 1], 9)
        if good != GOOD:
            code, reached = TIME_RANGE if good == OUT_OF_RANGE else TIME, bounds[0, 1]
        number, flags = 0, 0
        if code == ACCEPTED and count > 1:
            number = _parse_identifier(text, bounds[1, 0], bounds[1, 1])
            if number < 0:
                code, reached = IDENTIFIER, bounds[1, 1]
            elif number > 0x1FFFFFFF:
                code, reached = EXTENDED_RANGE, bounds[1, 1]
        for k in range(2, min(5, count)):
            if code == ACCEPTED:
                flag = _parse_flag(text, bounds[k, 0], bounds[k, 1])
                if flag < 0:
                    code, reached = FLAG, bounds[k, 1]
                flags |= flag << k
        extended, remote, error = flags & 4 != 0, flags & 8 != 0, flags & 16 != 0
        if code == ACCEPTED and count > 4 and not extended and not error and number > 0x7FF:
            code, reached = STANDARD_RANGE, bounds[2, 0]
        elif code == ACCEPTED and remote and error:
            code, reached = BOTH, bounds[4, 0]
        size = 0
        if code == ACCEPTED and count > 5:
            size = natural(text, bounds[5, 0], bounds[5, 1])
            if not 0 <= size <= 64:
                code, reached = LENGTH, bounds[5, 1]
            elif (remote or error) and size > 8:
                code, reached = CLASSIC_LENGTH, bounds[5, 1]
            elif not FD_LENGTHS[size]:
                code, reached = FD_LENGTH, bounds[5, 1]
        if code == ACCEPTED and count < 7:
            code = MISSING
        if code == ACCEPTED:
            size = 0 if remote else size
            if not _parse_base64(text, bounds[6, 0], bounds[6, 1], size, rows.data[row]):
                code, reached = PAYLOAD, bounds[6, 1]
            elif count > 7:
                code, reached = TAIL, bounds[6, 1]
        rows.time[row] = stamp
        rows.id[row] = max(number, 0)
        rows.extended[row] = extended
        rows.fd[row] = size > 8
        rows.kind[row] = REMOTE if remote else ERROR if error else DATA
        rows.length[row] = max(0, min(size, 64))
        rows.code[row], rows.reached[row] = code, reached
        row += 1
    return position, row, False


@njit(cache=True, nogil=True)
def scan_gvret(
    text: npt.NDArray[np.uint8], position: int, rows: Rows, place: npt.NDArray[np.int64]
) -> tuple[int, int, bool]:
    """Parse lines of SavvyCAN as `Dialect.scan` does.

    Args:
        text: Whole lines.
        position: Where one starts.
        rows: What is filled; times are the stamps as they stand there, in µs.
        place: For each of `GVRET_COLUMNS` which field of a line it is, or `ABSENT`; the payload stands last.
    """
    bounds = np.empty((MOST_FIELDS, 2), np.int64)
    row = 0
    while position < len(text) and row < len(rows.code):
        start, stop, following = line_at(text, position)
        if _is_header(text, start, stop):
            return position, row, True
        position = following
        rows.start[row], rows.stop[row], rows.open[row] = start, stop, False
        rows.data[row] = 0
        if start == stop:
            rows.code[row] = NO_RECORD
            row += 1
            continue
        count = split_commas(text, start, stop, bounds)
        code, reached, stamp, number, extended, bus, size, present = ACCEPTED, stop, 0, 0, 0, 0, 0, 0
        for k in range(min(count, place[_D1])):
            if code != ACCEPTED:
                break
            first, last = bounds[k, 0], bounds[k, 1]
            reached = last
            if k == place[_TIME]:
                # A stamp is an integer: with a point it is not in µs, and what it is in cannot be known.
                is_integer = True
                for p in range(first, last):
                    is_integer = is_integer and (text[p] < 58 and text[p] != _POINT)
                good, stamp = decimal(text, first, last, 0)
                if good == GOOD and not is_integer:
                    code = TIME
                elif good == OUT_OF_RANGE or abs(stamp) > 1 << 52:
                    code = TIME_RANGE
                elif good != GOOD:
                    code = TIME
            elif k == place[_ID]:
                number = _parse_identifier(text, first, last)
                if number < 0:
                    code = IDENTIFIER
                elif number > 0x1FFFFFFF:
                    code = EXTENDED_RANGE
            elif k == place[_EXTENDED]:
                extended = _parse_flag(text, first, last)
                if extended < 0:
                    code = FLAG
            elif k == place[_DIR]:
                if first < last and not (is_word(text, first, last, b"rx") or is_word(text, first, last, b"tx")):
                    code = DIRECTION
            elif k == place[_BUS]:
                bus = natural(text, first, last)
                if not 0 <= bus <= 255:
                    code = BUS
            elif k == place[_LEN]:
                size = natural(text, first, last)
                if not 0 <= size <= 64 or not FD_LENGTHS[size]:
                    code = LENGTH
        if code == ACCEPTED and (count < place[_D1] or (count == place[_D1] and size > 0)):
            code, reached = MISSING, stop
        if code == ACCEPTED and extended == 0 and number > 0x7FF:
            code, reached = STANDARD_RANGE, bounds[place[_ID], 0]
        ended = False
        for k in range(place[_D1], count):
            if code != ACCEPTED:
                break
            first, last = bounds[k, 0], bounds[k, 1]
            if first == last:
                ended = True
                continue
            value = hexadecimal(text, first, last)
            reached = last
            if value < 0 or last - first > 2 or ended:
                code = PAYLOAD
            elif present == size:
                # Loggers that pad their payloads to eight columns pad with zeros.
                if value != 0:
                    code = TAIL
            else:
                rows.data[row, present] = value
                present += 1
        if code == ACCEPTED and count <= place[_D1] + size:
            final = bounds[count - 1, 1] - bounds[count - 1, 0]
            rows.open[row] = present < size or (size > 0 and final < 2)
        rows.time[row] = stamp
        rows.bus[row] = bus
        rows.id[row] = max(number, 0)
        rows.extended[row] = extended > 0
        rows.fd[row] = size > 8
        rows.kind[row] = DATA
        rows.length[row] = present
        rows.code[row], rows.reached[row] = code, reached
        row += 1
    return position, row, False
