"""The line of a CRTD log, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from .frames import DATA
from .text_fields import GOOD, MOST_FIELDS, OUT_OF_RANGE, decimal, hexadecimal, line_at, natural, split_blanks
from .text_log import ACCEPTED, NO_RECORD, Rows

# Why a line is not a frame; `crtd.REASONS` says it in words.
MISSING, TIME, TIME_RANGE, TYPE, IDENTIFIER, STANDARD_RANGE, EXTENDED_RANGE, PAYLOAD, TAIL = range(1, 10)

_ZERO, _ONE, _TWO, _NINE, _C, _R, _T = 48, 49, 50, 57, 67, 82, 84


@njit(cache=True, nogil=True)
def scan(text: npt.NDArray[np.uint8], position: int, rows: Rows) -> tuple[int, int, bool]:
    """Parse lines as `Dialect.scan` does."""
    bounds = np.empty((MOST_FIELDS, 2), np.int64)
    row = 0
    while position < len(text) and row < len(rows.code):
        start, stop, position = line_at(text, position)
        rows.start[row], rows.stop[row], rows.open[row] = start, stop, False
        rows.data[row] = 0
        if start == stop:
            rows.code[row] = NO_RECORD
            row += 1
            continue
        count = split_blanks(text, start, stop, bounds)
        code, reached, bus, number, size, extended = ACCEPTED, stop, 1, 0, 0, False
        good, stamp = decimal(text, bounds[0, 0], bounds[0, 1], 9)
        if good != GOOD:
            code, reached = TIME_RANGE if good == OUT_OF_RANGE else TIME, bounds[0, 1]
        elif count < 2:
            code = MISSING
        else:
            p, last = bounds[1, 0], bounds[1, 1]
            while p < last and _ZERO <= text[p] <= _NINE:
                p += 1
            if p > bounds[1, 0]:
                bus = natural(text, bounds[1, 0], p)
            if last - p != 3 or not 0 <= bus <= 255:
                code, reached = TYPE, last
            elif text[p] == _C and 65 <= text[p + 1] <= 90 and 65 <= text[p + 2] <= 90:
                code = NO_RECORD
            elif text[p] not in (_R, _T):
                code, reached = TYPE, last
            elif text[p + 1] == _ONE and text[p + 2] == _ONE:
                extended = False
            elif text[p + 1] == _TWO and text[p + 2] == _NINE:
                extended = True
            else:
                code, reached = TYPE, last
        if code == ACCEPTED and count < 3:
            code = MISSING
        elif code == ACCEPTED:
            number = hexadecimal(text, bounds[2, 0], bounds[2, 1])
            reached = bounds[2, 1]
            if number < 0:
                code = IDENTIFIER
            elif number > 0x1FFFFFFF:
                code = EXTENDED_RANGE
            elif not extended and number > 0x7FF:
                code = STANDARD_RANGE
        for k in range(3, count):
            if code != ACCEPTED:
                break
            value = hexadecimal(text, bounds[k, 0], bounds[k, 1])
            reached = bounds[k, 1]
            if value < 0 or bounds[k, 1] - bounds[k, 0] != 2:
                code = PAYLOAD
            elif size == 8:
                code, reached = TAIL, bounds[k, 0]
            else:
                rows.data[row, size] = value
                size += 1
        rows.time[row] = stamp
        rows.bus[row] = bus
        rows.id[row] = max(number, 0)
        rows.extended[row] = extended
        rows.fd[row] = False
        rows.kind[row] = DATA
        rows.length[row] = size
        rows.open[row] = code == ACCEPTED and size < 8
        rows.code[row], rows.reached[row] = code, reached
        row += 1
    return position, row, False
