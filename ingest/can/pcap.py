"""Reader of pcap and pcapng captures of SocketCAN, as Wireshark, tcpdump and dumpcap write them."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from ...schemas.errors import InputError
from ..account import Account
from .frames import DATA, ERROR, REMOTE, FrameBatch
from .pending import BATCH, PendingFrames
from .window import Window

LONGEST_PACKET = 1 << 18
"""Bytes; the most that libpcap captures of one."""
LONGEST_BLOCK = 1 << 20
"""Bytes of a block of pcapng, at most."""
MOST_INTERFACES = 1024

_MAGIC = {
    b"\xa1\xb2\xc3\xd4": (">", 1000),
    b"\xd4\xc3\xb2\xa1": ("<", 1000),
    b"\xa1\xb2\x3c\x4d": (">", 1),
    b"\x4d\x3c\xb2\xa1": ("<", 1),
}
_SECTION, _BYTE_ORDER = b"\x0a\x0d\x0d\x0a", {b"\x1a\x2b\x3c\x4d": ">", b"\x4d\x3c\x2b\x1a": "<"}
_LINUX_SLL, _CAN_SOCKETCAN, _LINUX_SLL2 = 113, 227, 276
_LAST_TIME = (1 << 63) - 1
_FD_LENGTHS = frozenset((*range(9), 12, 16, 20, 24, 32, 48, 64))


class _NotAFrameError(Exception):
    """Why a packet holds no CAN frame."""


@dataclass(slots=True)
class _Interface:
    link: int
    name: str
    ticks: int = 1_000_000
    offset: int = 0


@dataclass(slots=True)
class _Frames:
    """Frames on their way into batches, with the names of their channels."""

    account: Account
    pending: PendingFrames = field(default_factory=PendingFrames)
    channels: dict[str, int] = field(default_factory=dict)

    def add(self, interface: _Interface, time: int, packet: bytes, where: str) -> None:
        """Enter the frame of a packet, or reject it."""
        reason = ""
        try:
            name, identifier, fd, payload = _parse(interface, packet)
        except _NotAFrameError as error:
            reason = str(error)
        else:
            if not 0 <= time <= _LAST_TIME:
                reason = "the time is before 1970 or beyond 2262, which 64-bit nanoseconds cannot hold"
            elif name not in self.channels and len(self.channels) == MOST_INTERFACES:
                reason = f"one interface more than the {MOST_INTERFACES} that a log may have"
        if reason:
            self.account.reject(where, reason)
            return
        if len(payload) > self.pending.arrays[-1].shape[1]:
            self.pending.widen()
        row, arrays = self.pending.count, self.pending.arrays
        arrays[0][row] = time
        arrays[1][row] = self.channels.setdefault(name, len(self.channels))
        arrays[2][row] = identifier & 0x1FFFFFFF
        arrays[3][row] = identifier >= 0x80000000 or identifier & 0x20000000
        arrays[4][row] = fd
        arrays[5][row] = ERROR if identifier & 0x20000000 else REMOTE if identifier & 0x40000000 else DATA
        arrays[6][row] = len(payload)
        if payload:
            arrays[7][row, : len(payload)] = memoryview(payload)
        self.pending.count += 1

    def take(self, at_least: int) -> Iterator[FrameBatch]:
        """Yield a batch if there are so many frames."""
        if self.pending.count >= at_least:
            self.account.accepted += self.pending.count
            yield self.pending.take(list(self.channels))


@dataclass(frozen=True, slots=True)
class Pcap:
    """A capture of CAN frames: pcap with µs or ns, or pcapng, both in either byte order.

    Link types are CAN_SOCKETCAN (227), LINUX_SLL (113) and LINUX_SLL2 (276), the last two with protocol CAN or CAN FD;
    packets of others are rejected. Stamps are UTC, as these formats define them. Channels are the interfaces' names
    (pcapng), else `if` and the interface's number: the kernel's (LINUX_SLL2) or the file's, 0 in pcap. Simple packet
    blocks of pcapng have no time and are rejected; blocks that hold no packet are counted nowhere. Error frames are
    extended, with their class as identifier, as in candump's logs.

    Attributes:
        path: The capture.
    """

    format: ClassVar[str] = "pcap"
    kind: ClassVar[str] = "can"

    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether `head` begins with a magic number of pcap or pcapng."""
        return head[:4] in _MAGIC or (head[:4] == _SECTION and head[8:12] in _BYTE_ORDER)

    def batches(self, account: Account) -> Iterator[FrameBatch]:
        """Yield the frames in the order of the file, up to `BATCH` at a time, and count every packet in `account`.

        A record whose length is impossible ends a pcap, which has no marks to find the next one by: the rest is one
        rejection. pcapng goes on at the next section, if there is one.

        Raises:
            InputError: The file cannot be read or is no capture.
        """
        window, frames = Window(self.path, account), _Frames(account)
        head = window.peek(12)
        if not self.sniff(head):
            reason = f"expected the magic number of pcap or pcapng; found {head[:4]!r}. Is it another format?"
            raise InputError(self.path, "byte 0", reason)
        yield from _read_pcap(window, frames) if head[:4] in _MAGIC else _read_pcapng(window, frames)
        yield from frames.take(1)


def _parse(interface: _Interface, packet: bytes) -> tuple[str, int, bool, bytes]:
    """Return channel, identifier with flags, whether CAN FD, and payload of a packet."""
    name, start, protocol = interface.name, 0, 0
    if interface.link == _LINUX_SLL:
        start, protocol = 16, int.from_bytes(packet[14:16], "big")
    elif interface.link == _LINUX_SLL2:
        start, protocol = 20, int.from_bytes(packet[:2], "big")
        name = f"if{int.from_bytes(packet[4:8], 'big')}"
    elif interface.link != _CAN_SOCKETCAN:
        raise _NotAFrameError(
            f"expected link type 227 (CAN_SOCKETCAN), 113 (LINUX_SLL) or 276 (LINUX_SLL2), found {interface.link}; "
            "this interface is no CAN bus"
        )
    if len(packet) < start + 8:
        raise _NotAFrameError(f"expected at least {start + 8} bytes of a CAN frame, found {len(packet)}")
    if start and protocol not in (0x000C, 0x000D):
        raise _NotAFrameError(f"expected protocol 0x000C (CAN) or 0x000D (CAN FD), found 0x{protocol:04X}")
    identifier, length, flags = struct.unpack_from(">IBB", packet, start)
    fd = protocol == 0x000D or (not start and bool(flags & 4 or len(packet) == 72))
    if length & 0x80 and not start:
        raise _NotAFrameError("a frame of CAN XL, for which there is no place here")
    if length > 64 if fd else length > 8:
        raise _NotAFrameError(f"{length} bytes are more than a {'CAN FD' if fd else 'classic'} frame can have")
    if fd and length not in _FD_LENGTHS:
        raise _NotAFrameError(f"no CAN FD frame has {length} bytes (only 0 to 8, 12, 16, 20, 24, 32, 48, 64)")
    if identifier & 0xA0000000 == 0 and identifier & 0x1FFFFFFF > 0x7FF:
        raise _NotAFrameError("the identifier is beyond 11 bits (7FF) and not marked as one of 29 bits")
    if identifier & 0x60000000 == 0x40000000:
        return name, identifier, fd, b""
    payload = packet[start + 8 : start + 8 + length]
    if len(payload) < length:
        raise _NotAFrameError(f"the capture holds only {len(payload)} of the payload's {length} bytes")
    return name, identifier, fd, payload


def _cut(window: Window, account: Account, what: str) -> None:
    account.truncated = True
    account.reject(f"byte {window.offset}", f"the file ends within this {what}")


def _read_pcap(window: Window, frames: _Frames) -> Iterator[FrameBatch]:
    head = window.peek(24)
    if len(head) < 24:
        _cut(window, frames.account, "header of 24 bytes")
        return
    order, unit = _MAGIC[head[:4]]
    # Above the link type stand flags about a check sequence, which CAN has none of.
    interface = _Interface(struct.unpack_from(f"{order}I", head, 20)[0] & 0xFFFF, "if0")
    record = struct.Struct(f"{order}IIII")
    window.skip(24)
    while base := window.peek(16):
        if len(base) < 16:
            _cut(window, frames.account, "record")
            return
        seconds, fraction, length, _ = record.unpack(base)
        if length > LONGEST_PACKET or fraction * unit >= 1_000_000_000:
            reason = (
                f"expected a record of up to {LONGEST_PACKET} bytes and less than a second as fraction, found {length} "
                f"bytes and {fraction * unit} ns; pcap has no marks to go on by, so the rest is lost"
            )
            frames.account.reject(f"byte {window.offset}", reason)
            return
        packet = window.peek(16 + length)[16:]
        if len(packet) < length:
            _cut(window, frames.account, "record")
            return
        frames.add(interface, 1_000_000_000 * seconds + unit * fraction, packet, f"byte {window.offset}")
        window.skip(16 + length)
        yield from frames.take(BATCH)


def _read_pcapng(window: Window, frames: _Frames) -> Iterator[FrameBatch]:
    order, interfaces = "<", list[_Interface]()
    while head := window.peek(12):
        account, where = frames.account, f"byte {window.offset}"
        if len(head) < 12:
            _cut(window, account, "block")
            return
        is_section = head[:4] == _SECTION
        if is_section and head[8:12] in _BYTE_ORDER:
            order, interfaces = _BYTE_ORDER[head[8:12]], []
        kind, size = struct.unpack_from(f"{order}II", head)
        sound = 12 <= size <= LONGEST_BLOCK and size % 4 == 0 and not (is_section and head[8:12] not in _BYTE_ORDER)
        block = window.peek(size) if sound else b""
        if sound and len(block) < size:
            _cut(window, account, "block")
            return
        if not sound or struct.unpack_from(f"{order}I", block, size - 4)[0] != size:
            reason = f"expected a block with its size at both ends, found type {kind} and {size} bytes at the first"
            account.reject(where, f"{reason}; went on at the next section, if there is one")
            window.skip(4)
            window.seek(_SECTION)
            continue
        body = block[8:-4]
        if kind == 1 and not is_section:
            _add_interface(interfaces, body, order)
        elif kind in (2, 6):
            _add_packet(frames, interfaces, kind, body, order, where)
        elif kind == 3:
            account.reject(where, "a simple packet block has no time; capture with enhanced packet blocks")
        window.skip(size)
        yield from frames.take(BATCH)


def _add_interface(interfaces: list[_Interface], body: bytes, order: str) -> None:
    """Enter what an interface description block tells: link type, name, resolution and offset of its stamps."""
    interface = _Interface(int.from_bytes(body[:2], "big" if order == ">" else "little"), f"if{len(interfaces)}")
    place = 8
    while place + 4 <= len(body):
        code, length = struct.unpack_from(f"{order}HH", body, place)
        content = body[place + 4 : place + 4 + length]
        if code == 0 or len(content) < length:
            break
        if code == 2 and content.rstrip(b"\0"):
            interface.name = content.rstrip(b"\0").decode("utf-8", "backslashreplace")
        elif code == 9 and length == 1:
            interface.ticks = 1 << (content[0] & 0x7F) if content[0] & 0x80 else 10 ** content[0]
        elif code == 14 and length == 8:
            interface.offset = struct.unpack(f"{order}q", content)[0]
        place += 4 + (length + 3) // 4 * 4
    interfaces.append(interface)


def _add_packet(frames: _Frames, interfaces: list[_Interface], kind: int, body: bytes, order: str, where: str) -> None:
    """Enter the packet of an enhanced packet block, or of its obsolete forerunner."""
    if len(body) < 20:
        frames.account.reject(where, f"expected at least 20 bytes in a packet block, found {len(body)}")
        return
    number, high, low, length, _ = struct.unpack_from(f"{order}IIIII" if kind == 6 else f"{order}HxxIIII", body)
    if number >= len(interfaces):
        frames.account.reject(where, f"interface {number} is described by no block of this section")
    elif length > len(body) - 20:
        frames.account.reject(where, f"expected a packet of {length} bytes in this block, found {len(body) - 20}")
    else:
        interface = interfaces[number]
        time = 1_000_000_000 * interface.offset + (high << 32 | low) * 1_000_000_000 // interface.ticks
        frames.add(interface, time, body[20 : 20 + length], where)
