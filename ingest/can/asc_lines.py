"""The frames among the lines of a Vector ASC log, compiled: import it where it is used, numba is heavy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from .frames import DATA, ERROR, REMOTE
from .line_log import CHANNELS, CUT, FINAL, FULL, LONG, LONGEST_LINE
from .line_tokens import (
    FD_LENGTHS,
    SECOND,
    ZERO,
    Text,
    bytes_at,
    channel_of,
    is_word,
    line_at,
    number_at,
    seconds_at,
    token_at,
)

DECIMAL, DELTAS, START, LAST, BLOCK_BEGINS, BLOCK_DATE = range(FINAL + 1, FINAL + 7)
"""The rest of the state: numbers are decimal; stamps count from the one before; the moment they count from (ns since
1970); the last stamp; a trigger block has begun and has had no stamp; its date."""
STATE = FINAL + 7

# Why a line is not a frame; `asc.REASONS` says it in words.
OTHER, TIME, TIME_RANGE, IDENTIFIER, STANDARD_RANGE, EXTENDED_RANGE, SORT, CODE, MISSING, BYTE, TAIL = range(11)
SWITCHES, LENGTH, FLAGS, SHORT = range(11, 15)

_EPOCH = 1_000_000_000 * SECOND
_LAST_MOMENT = (1 << 63) - 1
_FLAG_REMOTE, _FLAG_FD = 0x10, 0x1000
_RX, _TX, _CANFD = (np.frombuffer(word, np.uint8) for word in (b"rx", b"tx", b"canfd"))
_ERRORFRAME = np.frombuffer(b"errorframe", np.uint8)
_TAILS = tuple(np.frombuffer(word, np.uint8) for word in (b"length", b"bitcount", b"id"))


@njit(cache=True, nogil=True)
def _moment(stamp: int, state: npt.NDArray[np.int64]) -> int:
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
    if extended and number > 0x1FFFFFFF:
        return EXTENDED_RANGE, 0, extended
    if not extended and number > 0x7FF:
        return STANDARD_RANGE, 0, extended
    return OTHER, number, extended


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
    for word in _TAILS:  # noqa: SIM110  numba compiles no generators
        if is_word(text, start, end, word):
            return True
    return False


@njit(cache=True, nogil=True)
def _classic(text: Text, p: int, stop: int, base: int, final: bool, row: Text) -> tuple[int, int, int]:
    """Parse a classic frame behind its direction; return code, kind and bytes."""
    start, p = token_at(text, p, stop)
    sort = text[start] | 32 if p - start == 1 else 0
    start, end = token_at(text, p, stop)
    if sort == 114:
        if _length_code(text, start, end, base) >= 0:
            p = end
        return OTHER if _is_tail(text, p, stop) else TAIL, REMOTE, 0
    if sort != 100:
        return SORT, DATA, 0
    code = _length_code(text, start, end, base)
    if code < 0:
        return CODE, DATA, 0
    count = min(code, 8)
    size, p = bytes_at(text, end, stop, base, count, row)
    if size < count:
        return MISSING if p == stop or _is_tail(text, p, stop) else BYTE, DATA, size
    if final and base == 10 and size > 0 and p == stop:
        return SHORT, DATA, size
    return OTHER if _is_tail(text, p, stop) else TAIL, DATA, size


@njit(cache=True, nogil=True)
def _fd(text: Text, p: int, stop: int, base: int, final: bool, row: Text) -> tuple[int, int, bool, int]:
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
    size, p = bytes_at(text, end, stop, base, count, row)
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
        return OTHER if count == 0 else LENGTH, REMOTE, False, 0
    fd = flags < 0 or (flags & _FLAG_FD) != 0
    return OTHER if count == (FD_LENGTHS[code] if fd else min(code, 8)) else LENGTH, DATA, fd, size


@njit(cache=True, nogil=True)
def scan(
    text: Text,
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
    state: npt.NDArray[np.int64],
) -> tuple[int, int, int, int, int, int, int]:
    """Parse lines of `text` into the arrays of a batch until one is no frame.

    See `line_log.frame_batches`, which calls it, for the arguments and what is returned; `state` has `STATE` places.
    """
    while count < len(time):
        end, start, stop = line_at(text, position)
        if end < 0:
            return position, line, count, known, CUT, 0, 0
        if end - position >= LONGEST_LINE:
            return end + 1, line + 1, count, known, LONG, start, stop
        position, line = end + 1, line + 1
        if start == stop:
            continue
        if not 0 <= text[start] - ZERO <= 9:
            return position, line, count, known, OTHER, start, stop
        stamp, p = seconds_at(text, start, stop)
        if stamp < 0 or (p < stop and text[p] > 32):
            return position, line, count, known, TIME_RANGE if stamp == -2 else TIME, start, stop
        moment = _moment(stamp, state)
        if moment < 0:
            return position, line, count, known, TIME_RANGE, start, stop

        base, final = 10 if state[DECIMAL] == 1 else 16, state[FINAL] == 1
        code, number, is_extended, is_fd, sort, size = OTHER, 0, False, False, ERROR, 0
        name_start, name_stop = token_at(text, p, stop)
        on_fd = is_word(text, name_start, name_stop, _CANFD)
        if on_fd:
            name_start, name_stop = token_at(text, name_stop, stop)
        first_start, first_stop = token_at(text, name_stop, stop)
        second_start, second_stop = token_at(text, first_stop, stop)
        if name_stop - name_start > 3 or number_at(text, name_start, name_stop, 10) < 0:
            return position, line, count, known, OTHER, start, stop
        # A classic line has its direction behind the identifier, a CANFD line before it.
        way_start, way_stop = (first_start, first_stop) if on_fd else (second_start, second_stop)
        directed = is_word(text, way_start, way_stop, _RX) or is_word(text, way_start, way_stop, _TX)
        if on_fd:
            error = directed and is_word(text, second_start, second_stop, _ERRORFRAME)
        else:
            error = is_word(text, first_start, first_stop, _ERRORFRAME)
        if not error:
            if not directed:
                return position, line, count, known, OTHER, start, stop
            if on_fd:
                code, number, is_extended = _identifier(text, second_start, second_stop, base)
            else:
                code, number, is_extended = _identifier(text, first_start, first_stop, base)
            if code == OTHER and on_fd:
                code, sort, is_fd, size = _fd(text, second_stop, stop, base, final, data[count])
            elif code == OTHER:
                code, sort, size = _classic(text, second_stop, stop, base, final, data[count])
        bus = 0
        if code == OTHER:
            bus, known = channel_of(text, name_start, name_stop, names, known)
            if bus < 0:
                code = CHANNELS
        if code != OTHER:
            data[count] = 0
            return position, line, count, known, code, start, stop
        time[count] = moment
        channel[count] = bus
        identifier[count] = number
        extended[count] = is_extended
        fd[count] = is_fd
        kind[count] = sort
        length[count] = size
        count += 1
    return position, line, count, known, FULL, 0, 0
