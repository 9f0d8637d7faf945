"""Reader of Vector's Binary Logging Format (BLF), plain or compressed once more."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np

from ...schemas.errors import InputError
from ..account import Account
from .frames import FrameBatch
from .pending import PendingFrames
from .window import Window

LONGEST_CONTAINER = 32 << 20
"""Bytes, packed or unpacked; Vector's own containers hold 128 KiB."""
LONGEST_OBJECT = 8 << 20
"""Bytes of an object that stands outside of containers, at most."""
LONGEST_HEADER = 4096
"""Bytes of the file's header, at most; Vector's have 144."""

REASONS = (
    "",
    "expected the next object, which begins with LOBJ, within 8 bytes of the last one's end; went on at the next LOBJ",
    "the size of this object of type {kind} is impossible; went on at the next LOBJ",
    "the size of this object of type {kind} does not lead to the next one; went on at the next LOBJ",
    "this object breaks off: its rest is beyond the end of the file or in a damaged part of it",
    "expected an object header of version 1 or 2 on this frame of type {kind}",
    "this frame of type {kind} is shorter than its header and payload",
    "this frame of type {kind} does not say whether its time is in 10 µs or in ns",
    "the time of this frame of type {kind} is beyond the year 2262, the last that 64-bit nanoseconds can hold",
    "more than 8 bytes, or a length code above 15, on this classic frame of type {kind}",
    "more than 64 bytes on this CAN FD frame of type {kind}",
    "the identifier of this frame of type {kind} is beyond 11 bits (7FF) and not marked as one of 29 bits",
    "this frame of type {kind} is on one channel more than the 256 that a log may have",
    "the payload of this frame of type {kind} does not end within it",
)
"""What is said of a rejected object, by the codes of `blf_objects`."""

_FILE_HEADER, _OBJECT_HEADER, _CONTAINER_HEADER = 72, 16, 32
_LOG_CONTAINER = 10
_STORED, _DEFLATED = 0, 2
_REACH = 11
"""Bytes in which the next `LOBJ` stands whole: up to 7 of padding and itself."""


@dataclass(frozen=True, slots=True)
class Blf:
    """A log of objects, which mostly stand in containers, compressed by zlib or not.

    Frames are CAN_MESSAGE (1), CAN_MESSAGE2 (86), CAN_FD_MESSAGE (100) and CAN_FD_MESSAGE_64 (101), with data or
    remote; as errors CAN_ERROR (2), CAN_OVERLOAD (3), which the error frames of SocketCAN tell too, CAN_ERROR_EXT (73)
    and CAN_FD_ERROR_64 (104). Objects of all other types (markers, statistics, other buses) are no frames and counted
    nowhere. Channels have their number in the file, from 1, as name. Of a CAN FD payload whose last bytes were left
    out these are zeros, as in Vector's tools.

    Stamps count in 10 µs or ns from the start in the file's header, a calendar date to the ms without time zone. It is
    taken as UTC, as today's python-can writes it; older versions and Vector's tools write local time. A file without a
    start date counts from 1970-01-01.

    Attributes:
        path: The log.
    """

    format: ClassVar[str] = "blf"
    kind: ClassVar[str] = "can"

    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether `head` begins with the signature of a BLF file."""
        return head.startswith(b"LOGG")

    def batches(self, account: Account) -> Iterator[FrameBatch]:
        """Yield the frames in the order of the file, up to `BATCH` at a time, and count them in `account`.

        Payloads have 8 columns, or 64 where the batch met a longer one. A rejection's place is the byte of the file
        where a container begins, and for an object the byte of the unpacked containers where it begins, too. A damaged
        container is rejected whole, since nothing vouches for what could be unpacked of it; reading goes on at the next
        `LOBJ`. Of a container that the file ends within everything that unpacks is delivered. A file that is shorter
        than its header says is `truncated`.

        Raises:
            InputError: The file cannot be read or does not begin like one of BLF.
        """
        from .blf_objects import CHANNEL_NUMBERS, CUT, CUT_OBJECT, FULL, WIDE, scan

        window = Window(self.path, account)
        header = window.peek(_FILE_HEADER)
        if not header.startswith(b"LOGG"):
            reason = f"expected LOGG, with which every BLF file begins; found {header[:8]!r}. Is it another format?"
            raise InputError(self.path, "byte 0", reason)
        if len(header) < _FILE_HEADER:
            account.truncated = True
            account.reject("byte 0", f"the file ends within its header of {_FILE_HEADER} bytes; it has {len(header)}")
            return
        origin = _start(header, account)

        pending, numbers, known = PendingFrames(), np.full(CHANNEL_NUMBERS, -1, np.int16), 0
        rejected = np.empty((256, 3), np.int64)
        carry, before, lost = b"", 0, False
        for place, content in _contents(window, header, account):
            joined = carry + content
            text, position, why = np.frombuffer(joined, np.uint8), 0, FULL
            while why != CUT:
                position, lost, pending.count, known, rejections, why = scan(
                    text, position, not content, lost, origin, pending.count, pending.arrays, numbers, known, rejected
                )
                for start, code, kind in rejected[:rejections].tolist():
                    if code == CUT_OBJECT and not window.available(1):
                        account.truncated = True
                    where = f"byte {place}, byte {before + start} of the unpacked objects"
                    account.reject(where, REASONS[code].format(kind=kind))
                if why == WIDE:
                    pending.widen()
                elif why == FULL:
                    account.accepted += pending.count
                    yield pending.take(_names(numbers, known))
            carry, before = joined[position:], before + position
            lost = lost or not content
        if pending.count:
            account.accepted += pending.count
            yield pending.take(_names(numbers, known))


def _names(numbers: np.ndarray, known: int) -> list[str]:
    """Return the names of the channels that are known, by their index."""
    names = np.flatnonzero(numbers >= 0)
    return [str(number) for number in names[np.argsort(numbers[names])].tolist()][:known]


def _start(header: bytes, account: Account) -> int:
    """Return the start that the file's header tells, in ns since 1970: 0 if it tells none."""
    year, month, _, day, hour, minute, second, millisecond = struct.unpack_from("<8H", header, 40)
    if not any(header[40:56]):
        return 0
    try:
        start = datetime(year, month, day, hour, minute, second, 1000 * millisecond, UTC) - datetime(
            1970, 1, 1, tzinfo=UTC
        )
        if not 1970 <= year < 2262:
            raise ValueError  # noqa: TRY301 - one way to say that a date is none
    except ValueError:
        found = f"{year}-{month}-{day} {hour}:{minute}:{second}.{millisecond}"
        reason = f"expected the date of the start, found {found}; times count from 1970-01-01"
        account.remarks.append(("byte 40", reason))
        return 0
    return start // timedelta(milliseconds=1) * 1_000_000


def _contents(window: Window, header: bytes, account: Account) -> Iterator[tuple[int, bytes | bytearray]]:
    """Yield what the containers of a file hold, one after the other.

    Yields:
        Where a container begins, and what it holds: nothing where the next one does not continue it.
    """
    header_size, file_size = struct.unpack_from("<I8xQ", header, 4)
    header_size = header_size if _FILE_HEADER <= header_size <= LONGEST_HEADER else _FILE_HEADER
    window.available(header_size)
    window.skip(header_size)
    while ahead := window.peek(_REACH):
        gap = ahead.find(b"LOBJ")
        window.skip(max(gap, 0))
        start = window.offset
        base = window.peek(_CONTAINER_HEADER)
        if gap < 0 and len(ahead) < 8 and not any(ahead):
            window.skip(len(ahead))
            break
        if len(ahead) < _REACH or (gap >= 0 and len(base) < _OBJECT_HEADER):
            account.truncated = True
            account.reject(f"byte {start}", "the file ends within this object")
            window.skip(len(base))
            break
        if gap < 0:
            reason = f"expected a container or an object, which begin with LOBJ; found {ahead!r}"
            account.reject(f"byte {start}", f"{reason}; went on at the next LOBJ")
            yield start, b""
            window.seek(b"LOBJ")
            continue
        size, kind = struct.unpack_from("<II", base, 8)
        if kind == _LOG_CONTAINER:
            yield from _container(window, base, size, account)
            continue
        following = window.peek(size + _REACH)[size:] if _OBJECT_HEADER <= size <= LONGEST_OBJECT else b"?" * _REACH
        if len(following) == _REACH and b"LOBJ" not in following:
            reason = f"the size of this object of type {kind}, {size} bytes, does not lead to the next one"
            account.reject(f"byte {start}", f"{reason}; went on at the next LOBJ")
            yield start, b""
            window.skip(4)
            window.seek(b"LOBJ")
            continue
        content = window.peek(size)
        yield start, b""
        window.skip(size)
        yield start, content
        yield start, b""
    yield window.offset, b""
    if file_size > window.offset and not account.truncated:
        account.truncated = True
        reason = f"the file ends here, while its header speaks of {file_size} bytes; the rest was not copied or written"
        account.reject(f"byte {window.offset}", reason)


def _container(window: Window, base: bytes, size: int, account: Account) -> Iterator[tuple[int, bytes | bytearray]]:
    """Yield what the container at the window's place holds and go behind it; see `_contents`."""
    start, reason = window.offset, ""
    possible = _CONTAINER_HEADER <= size <= LONGEST_CONTAINER
    packed = window.view(size)[_CONTAINER_HEADER:] if possible else memoryview(b"")
    whole = len(packed) == size - _CONTAINER_HEADER
    method, unpacked_size = struct.unpack_from("<H6xI", base, 16) if len(base) == _CONTAINER_HEADER else (_DEFLATED, 0)
    content: bytes | bytearray = b""
    passed, breaks = 4, True
    if not possible:
        reason = f"the size of this container, {size} bytes, is impossible"
    elif method == _DEFLATED:
        try:
            unpacked = _inflate(packed, unpacked_size)
        except zlib.error as error:
            reason = f"this container is damaged ({error}) and nothing was taken from it"
        else:
            content, breaks = unpacked.content, not unpacked.whole
            passed = _CONTAINER_HEADER + len(packed) - unpacked.unused
            if unpacked.longer:
                content, passed = b"", 4
                reason = f"this container unpacks to more than {LONGEST_CONTAINER} bytes and nothing was taken from it"
            elif unpacked.whole and unpacked.unused >= 4:
                reason = f"the size of this container, {size} bytes, is not that of its content, {passed} bytes"
            elif not unpacked.whole and whole:
                passed, reason = _CONTAINER_HEADER, "the size of this container is less than its compressed content"
    elif method != _STORED:
        reason = f"expected 0 (none) or 2 (zlib) as compression of this container, found {method}"
    elif unpacked_size not in (0, size - _CONTAINER_HEADER):
        reason = f"this container has {size} bytes, of which {unpacked_size} should be content; they do not agree"
    else:
        content, passed, breaks = bytes(packed), _CONTAINER_HEADER + len(packed), False
    if reason:
        account.reject(f"byte {start}", f"{reason}; went on at the next LOBJ")
    elif not whole and breaks | (method == _STORED):
        account.truncated = True
        account.reject(f"byte {start}", "the file ends within this container; what could be unpacked was taken")
    if content:
        yield start, content
    if breaks:
        yield start, b""
    window.skip(passed)
    if reason:
        window.seek(b"LOBJ")


class _Unpacked(NamedTuple):
    """What a container unpacks to, and whether that is all; bytes behind its end; whether it would go on too long."""

    content: bytes | bytearray
    whole: bool
    unused: int
    longer: bool


def _inflate(packed: memoryview, announced: int) -> _Unpacked:
    """Unpack a container, up to `LONGEST_CONTAINER` bytes.

    libdeflate takes less than half of zlib's time, but it does not say where the content ended: with its checksum, and
    at most three bytes behind that. Where this does not fit zlib says what is wrong, and saves what can be.

    Raises:
        zlib.error: It is damaged.
    """
    import deflate

    with suppress(deflate.DeflateError):
        content = deflate.zlib_decompress(packed, min(announced, LONGEST_CONTAINER))
        end = bytes(packed[-7:])
        checksum = end.rfind(deflate.adler32(content).to_bytes(4, "big"))
        if checksum >= 0 and len(content) == announced:
            return _Unpacked(content, whole=True, unused=len(end) - checksum - 4, longer=False)
    careful = zlib.decompressobj()
    saved = careful.decompress(packed, LONGEST_CONTAINER)
    return _Unpacked(saved, careful.eof, len(careful.unused_data), bool(careful.unconsumed_tail))
