"""The packets of an Ogg stream (RFC 3533), the container that OxTS's XCOM logs use."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .account import Account
from .content import blocks

CAPTURE = b"OggS"
HEADER = struct.Struct("<4sBBqIIIB")
"""Capture pattern, version, flags, granule position, serial number, page number, checksum, number of segments."""
CONTINUED = 1
LONGEST_PACKET = 1 << 20
"""Bytes; a longer packet is none of a measuring unit."""


@dataclass(frozen=True, slots=True)
class Page:
    """A page whose checksum is right.

    Attributes:
        offset: Byte of the file where it begins.
        serial: Number of its logical stream.
        number: Its place in that stream.
        continued: Whether its first packet began on the page before.
        pieces: Bytes of packets, the last one of a packet that goes on on the next page if `open_ended`.
        open_ended: See `pieces`.
    """

    offset: int
    serial: int
    number: int
    continued: bool
    pieces: list[bytes]
    open_ended: bool


def packets(path: Path, account: Account) -> Iterator[tuple[int, bytes]]:
    """Yield each packet with the byte of the page that it begins on.

    Args:
        path: The file, plain or compressed.
        account: Stretches of bytes that are no whole page, gaps in the numbers of the pages, and packets whose
            beginning or end is lost are counted as one rejection each. A page or packet that the file ends within makes
            it truncated, and is counted as nothing else.

    Raises:
        InputError: The file is missing or cannot be read.
    """
    started: dict[int, tuple[int, bytes]] = {}
    numbers: dict[int, int] = {}
    for page in _pages(path, account):
        place = f"byte {page.offset}"
        expected = numbers.get(page.serial, page.number)
        numbers[page.serial] = page.number + 1
        start = started.pop(page.serial, None)
        if page.number != expected:
            account.reject(
                place, f"expected Ogg page {expected}; found {page.number}: pages were lost or changed places"
            )
            start = None
        elif start and not page.continued:
            account.reject(f"byte {start[0]}", "the packet that begins on this page has no end")
            start = None
        for index, piece in enumerate(page.pieces):
            offset, content = page.offset, piece
            if index == 0 and page.continued:
                if start is None:
                    if not (page.open_ended and len(page.pieces) == 1):
                        account.reject(place, "the packet that ends on this page has no beginning")
                    continue
                offset, content = start[0], start[1] + piece
            if index == len(page.pieces) - 1 and page.open_ended:
                if len(content) <= LONGEST_PACKET:
                    started[page.serial] = (offset, content)
                else:
                    account.reject(f"byte {offset}", f"a packet of more than {LONGEST_PACKET} bytes; it is damaged")
            else:
                yield offset, content
    account.truncated |= bool(started)


def _pages(path: Path, account: Account) -> Iterator[Page]:
    from .ogg_checksum import checksum

    content, first, lost, ended = b"", 0, -1, False
    source = blocks(path, account)
    while not ended:
        block = next(source, b"")
        ended = not block
        content += block
        position, unfinished = 0, -1
        while position < len(content):
            found = content.find(CAPTURE, position)
            if found < 0:
                found = next(
                    (len(content) - k for k in (3, 2, 1) if content[position:].endswith(CAPTURE[:k])), len(content)
                )
            if found > position and unfinished < 0 and lost < 0:
                lost = first + position
            size = _size(content, found)
            if found + size > len(content):
                if not ended:
                    position = found
                    break
                unfinished = found if unfinished < 0 and found < len(content) else unfinished
                position = found + 1
                continue
            page = np.frombuffer(content, np.uint8, size, found).copy()
            page[22:26] = 0
            if content[found + 4] != 0 or checksum(page) != int.from_bytes(content[found + 22 : found + 26], "little"):
                lost = first + found if lost < 0 else lost
                position = found + 1
                continue
            # What looked like an unfinished page was a damaged one, as a whole one follows.
            lost = first + unfinished if unfinished >= 0 and lost < 0 else lost
            unfinished = -1
            _reject_stretch(account, lost, first + found)
            lost, position = -1, found + size
            yield _page(page.tobytes(), first + found)
        if ended:
            end = first + (unfinished if unfinished >= 0 else len(content))
            account.truncated |= unfinished >= 0
            _reject_stretch(account, lost, end)
        content, first = content[position:], first + position


def _size(content: bytes, place: int) -> int:
    """Return the bytes of the page that begins at a place, at least more than there are if its header is not whole."""
    if len(content) < place + HEADER.size:
        return HEADER.size
    segments = content[place + HEADER.size - 1]
    table = content[place + HEADER.size : place + HEADER.size + segments]
    return HEADER.size + segments + sum(table)


def _page(page: bytes, offset: int) -> Page:
    _, _, flags, _, serial, number, _, segments = HEADER.unpack_from(page)
    pieces, size, position = [], 0, HEADER.size + segments
    table = page[HEADER.size : position]
    for lacing in table:
        size += lacing
        if lacing < 255:
            pieces.append(page[position : position + size])
            position, size = position + size, 0
    open_ended = bool(table) and table[-1] == 255
    if open_ended:
        pieces.append(page[position:])
    return Page(offset, serial, number, bool(flags & CONTINUED), pieces, open_ended)


def _reject_stretch(account: Account, begin: int, end: int) -> None:
    if 0 <= begin < end:
        reason = (
            f"{end - begin} bytes that are no page of an Ogg stream (from OggS to a matching checksum): damaged or "
            "lost in recording"
        )
        account.reject(f"byte {begin}", reason)
