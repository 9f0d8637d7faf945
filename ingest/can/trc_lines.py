"""The line of a PEAK trace, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from .frames import DATA, ERROR, REMOTE
from .text_fields import FD_LENGTHS, GOOD, MOST_FIELDS, decimal, hexadecimal, is_word, line_at, natural, split_blanks
from .text_log import ACCEPTED, NO_RECORD, Rows

# Why a line is not a frame; `trc.REASONS` says it in words.
MISSING, NUMBER, TIME, TYPE, BUS, IDENTIFIER, STANDARD_RANGE, EXTENDED_RANGE, DIRECTION = range(1, 10)
LENGTH, CLASSIC_LENGTH, FD_LENGTH, PAYLOAD, SHORT, TAIL = range(10, 16)

COLUMNS = "NOTBIdRLD"
"""Letters of `$COLUMNS`; `l` has the place of `L`."""
ABSENT = -1
_N, _O, _T, _B, _I, _D, _R, _L, _DATA = range(9)

_FD_CODES = np.array((*range(9), 12, 16, 20, 24, 32, 48, 64), np.int64)
_SEMICOLON, _CLOSE, _DASH = 59, 41, 45
_STATUS_IDENTIFIER = 0xFFFFFFFF
_UNKNOWN, _FD, _EVENT, _STATUS, _WARNING = 3, 4, 5, 6, 7
_DT, _FD_PLAIN, _FB, _FE, _BI, _RR, _ST, _ER, _EC, _EV = (
    256 * first + second for first, second in (b"DT", b"FD", b"FB", b"FE", b"BI", b"RR", b"ST", b"ER", b"EC", b"EV")
)


@njit(cache=True, nogil=True)
def _sort(text: npt.NDArray[np.uint8], start: int, stop: int, directions: bool) -> int:
    """Return what the type of a line says that the line is."""
    if directions:
        if is_word(text, start, stop, b"rx") or is_word(text, start, stop, b"tx"):
            return DATA
        if is_word(text, start, stop, b"error") or is_word(text, start, stop, b"warng"):
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
def _parse_bytes(
    text: npt.NDArray[np.uint8], bounds: npt.NDArray[np.int64], first: int, last: int, data: npt.NDArray[np.uint8]
) -> int:
    """Parse the fields from `first` to before `last` as bytes; return the field that is none, or `last`."""
    for k in range(first, last):
        value = hexadecimal(text, bounds[k, 0], bounds[k, 1])
        if value < 0 or bounds[k, 1] - bounds[k, 0] != 2:
            return k
        data[k - first] = value
    return last


@njit(cache=True, nogil=True)
def _parse_status(
    text: npt.NDArray[np.uint8],
    bounds: npt.NDArray[np.int64],
    count: int,
    place: npt.NDArray[np.int64],
    rows: Rows,
    row: int,
) -> tuple[int, int]:
    """Parse what follows the type of ST, ER and EC, whose columns may be left blank; return code and last field."""
    p = place[_T] + 1
    if place[_D] > place[_T]:
        while p < count and not (
            is_word(text, bounds[p, 0], bounds[p, 1], b"rx") or is_word(text, bounds[p, 0], bounds[p, 1], b"tx")
        ):
            p += 1
        if p == count or p > place[_D]:
            return DIRECTION, min(p, count - 1)
        p += 1
    elif place[_B] > place[_T]:
        p = place[_B] + 1
    while p < count and bounds[p, 1] - bounds[p, 0] == 1 and text[bounds[p, 0]] == _DASH:
        p += 1
    # A length is never padded with a zero, a byte always.
    has_length = p < count and bounds[p, 1] - bounds[p, 0] == 1
    size = count - p
    if has_length:
        size = natural(text, bounds[p, 0], bounds[p, 1])
        if size < 0:
            return LENGTH, p
        p += 1
    if size > 64:
        return TAIL, count - 1
    bad = _parse_bytes(text, bounds, p, min(p + size, count), rows.data[row])
    if bad < min(p + size, count):
        return PAYLOAD, bad
    if p + size > count:
        return SHORT, count - 1
    if p + size < count:
        return TAIL, p + size
    rows.id[row] = 0
    rows.extended[row] = False
    rows.fd[row] = False
    rows.kind[row] = ERROR
    rows.length[row] = size
    rows.open[row] = not has_length or size == 0
    return ACCEPTED, 0


@njit(cache=True, nogil=True)
def _parse_frame(
    text: npt.NDArray[np.uint8],
    bounds: npt.NDArray[np.int64],
    count: int,
    place: npt.NDArray[np.int64],
    is_code: bool,
    sort: int,
    rows: Rows,
    row: int,
) -> tuple[int, int]:
    """Parse identifier, direction, length and payload; return code and the field that it is about."""
    p = place[_I]
    if p >= count:
        return MISSING, count - 1
    digits = bounds[p, 1] - bounds[p, 0]
    number = hexadecimal(text, bounds[p, 0], bounds[p, 1])
    if number < 0:
        return IDENTIFIER, p
    if number == _STATUS_IDENTIFIER:
        sort, number, digits = _WARNING, 0, 1
    elif digits <= 4 and number > 0x7FF:
        return STANDARD_RANGE, p
    elif number > 0x1FFFFFFF:
        return EXTENDED_RANGE, p
    p = place[_D]
    if p != ABSENT:
        if p >= count:
            return MISSING, count - 1
        if not (is_word(text, bounds[p, 0], bounds[p, 1], b"rx") or is_word(text, bounds[p, 0], bounds[p, 1], b"tx")):
            return DIRECTION, p
    p = place[_L]
    if p >= count:
        return MISSING, count - 1
    size = natural(text, bounds[p, 0], bounds[p, 1])
    if size < 0 or size > (15 if is_code else 64):
        return LENGTH, p
    if is_code:
        size = _FD_CODES[size] if sort == _FD else min(size, 8)
    elif sort != _FD and size > 8:
        return CLASSIC_LENGTH, p
    elif not FD_LENGTHS[size]:
        return FD_LENGTH, p

    first = place[_DATA]
    if sort == REMOTE:
        size = 0
    elif sort == DATA and first < count and is_word(text, bounds[first, 0], bounds[first, 1], b"rtr"):
        sort, size = REMOTE, 0
        first += 1
    last = min(first + size, count)
    bad = _parse_bytes(text, bounds, first, last, rows.data[row])
    if bad < last:
        return PAYLOAD, bad
    if first + size > count:
        return SHORT, count - 1
    if first + size < count and sort != _WARNING:
        return TAIL, first + size
    rows.id[row] = number
    rows.extended[row] = digits > 4
    rows.fd[row] = sort == _FD
    rows.kind[row] = REMOTE if sort == REMOTE else ERROR if sort == _WARNING else DATA
    rows.length[row] = size
    # RTR may be what the line lacks.
    rows.open[row] = sort == DATA and size == 0 and place[_D] == ABSENT
    return ACCEPTED, 0


@njit(cache=True, nogil=True)
def scan(
    text: npt.NDArray[np.uint8],
    position: int,
    rows: Rows,
    place: npt.NDArray[np.int64],
    is_code: bool,
    directions: bool,
    start_time: int,
) -> tuple[int, int, bool]:
    """Parse lines as `Dialect.scan` does.

    Args:
        text: Whole lines.
        position: Where one starts.
        rows: What is filled.
        place: For each of `COLUMNS` which field of a line it is, or `ABSENT`; the payload is the last.
        is_code: The length column has data length codes, not lengths.
        directions: The type column says Rx, Tx, Error or Warng (versions 1), not DT, FD, …
        start_time: ns that offset 0 stands for.
    """
    bounds = np.empty((MOST_FIELDS, 2), np.int64)
    row = 0
    while position < len(text) and row < len(rows.code):
        start, stop, following = line_at(text, position)
        if start < stop and text[start] == _SEMICOLON:
            return position, row, True
        position = following
        rows.start[row], rows.stop[row], rows.open[row] = start, stop, False
        rows.data[row] = 0
        if start == stop:
            rows.code[row] = NO_RECORD
            row += 1
            continue
        count = split_blanks(text, start, stop, bounds)
        code, field, sort, bus = ACCEPTED, 0, DATA, 1
        p = place[_N]
        if p != ABSENT:
            if p >= count:
                code, field = MISSING, count - 1
            else:
                marked = text[bounds[p, 1] - 1] == _CLOSE
                if natural(text, bounds[p, 0], bounds[p, 1] - marked) < 0:
                    code, field = NUMBER, p
        if code == ACCEPTED:
            p = place[_O]
            if p >= count:
                code, field = MISSING, count - 1
            else:
                good, offset = decimal(text, bounds[p, 0], bounds[p, 1], 6)
                if good == GOOD:
                    rows.time[row] = start_time + offset
                else:
                    code, field = TIME, p
        p = place[_T]
        if code == ACCEPTED and p != ABSENT:
            if p >= count:
                code, field = MISSING, count - 1
            else:
                sort = _sort(text, bounds[p, 0], bounds[p, 1], directions)
                if sort == _UNKNOWN:
                    code, field = TYPE, p
        p = place[_B]
        if code == ACCEPTED and p != ABSENT and sort != _EVENT:
            if p >= count:
                code, field = MISSING, count - 1
            else:
                bus = natural(text, bounds[p, 0], bounds[p, 1])
                if not 0 <= bus <= 255:
                    code, field = BUS, p
        rows.bus[row] = bus
        if code == ACCEPTED and sort == _EVENT:
            code = NO_RECORD
        elif code == ACCEPTED and sort == _STATUS:
            code, field = _parse_status(text, bounds, count, place, rows, row)
        elif code == ACCEPTED:
            code, field = _parse_frame(text, bounds, count, place, is_code, sort, rows, row)
        rows.code[row] = code
        rows.reached[row] = bounds[field, 1]
        row += 1
    return position, row, False
