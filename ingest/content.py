"""The bytes of a log, decompressed, in pieces of bounded size, with all that can be saved of a damaged file."""

from __future__ import annotations

import zlib
from collections.abc import Generator, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

from ..schemas.errors import InputError
from .account import Account

HEAD = 65_536
BLOCK = 4 << 20
CHUNK = 1 << 18
ZSTD_CHUNK = 1 << 10
"""So few bytes cannot unpack to more than 32 MiB, whatever they are."""

GZIP, ZSTD = b"\x1f\x8b", b"\x28\xb5\x2f\xfd"


def head(path: Path) -> bytes:
    """Return the first 64 KiB of a file's content, decompressed as far as it can be.

    Raises:
        InputError: The file is missing or cannot be read.
    """
    content = b""
    for block in blocks(path, Account(), CHUNK):
        content += block
        if len(content) >= HEAD:
            break
    return content[:HEAD]


def blocks(path: Path, account: Account, size: int = BLOCK) -> Generator[bytes, None, bool]:
    """Yield the content of a file, plain or compressed by gzip or Zstandard (recognised by its first bytes).

    Damage of a compressed file is counted in `account` as one rejection, a file that breaks off makes it truncated;
    what stands before is delivered.

    Args:
        path: The file.
        account: Of the file.
        size: Most bytes in a piece.

    Returns:
        Whether the content is whole.

    Raises:
        InputError: The file is missing or cannot be read.
    """
    try:
        with path.open("rb") as file:
            magic = file.peek(4)[:4]
            if magic[:2] == GZIP:
                return (yield from _gunzip(file, account, size))
            if magic == ZSTD:
                return (yield from _unzstd(file, account))
            while block := file.read(size):
                account.bytes_read += len(block)
                yield block
            return True
    except FileNotFoundError:
        raise InputError(path, "", "no such file; check the path, or whether the disk is mounted") from None
    except OSError as error:
        raise InputError(path, "", f"cannot be read: {error.strerror or error}") from None


def joined(pieces: Iterable[bytes], size: int) -> Iterator[bytes]:
    """Yield content in pieces of `size` bytes or more, all but the last; what is large enough already is not copied."""
    waiting: list[bytes] = []
    length = 0
    for piece in pieces:
        waiting.append(piece)
        length += len(piece)
        if length >= size:
            yield b"".join(waiting)
            waiting, length = [], 0
    if waiting:
        yield b"".join(waiting)


def _gunzip(file: BinaryIO, account: Account, size: int) -> Generator[bytes, None, bool]:
    """Yield the content of one or several gzip streams; trailing zeros, which some loggers write, are passed over."""
    inflater, within, chunk = zlib.decompressobj(wbits=31), False, b""
    while chunk := chunk or file.read(CHUNK):
        account.bytes_read = file.tell()
        undamaged = inflater.copy()
        try:
            content = inflater.decompress(chunk, size)
        except zlib.error as error:
            # zlib keeps to itself what it made of the chunk before the damage: give it the chunk again, bytewise.
            pieces: list[bytes] = []
            with suppress(zlib.error):
                pieces.extend(undamaged.decompress(chunk[k : k + 1]) for k in range(len(chunk)))
            yield from filter(None, [b"".join(pieces)])
            _reject_damage(account, file.tell() - len(chunk) + len(pieces), "gzip", error)
            return False
        yield from filter(None, [content])
        chunk, within = inflater.unconsumed_tail, True
        if inflater.eof:
            chunk, inflater, within = inflater.unused_data.lstrip(b"\0"), zlib.decompressobj(wbits=31), False
    if within:
        _reject_end(account, file.tell(), "gzip")
    return not within


def _unzstd(file: BinaryIO, account: Account) -> Generator[bytes, None, bool]:
    """Yield the content of one or several Zstandard frames."""
    from zstandard import ZstdDecompressor, ZstdError

    def frame() -> Any:
        return ZstdDecompressor().decompressobj()

    inflater, within, chunk = frame(), False, b""
    while chunk := chunk or file.read(ZSTD_CHUNK):
        account.bytes_read = file.tell()
        try:
            content = inflater.decompress(chunk)
        except ZstdError as error:
            _reject_damage(account, file.tell() - len(chunk), "Zstandard", error)
            return False
        yield from filter(None, [content])
        chunk, within = b"", True
        if inflater.eof:
            chunk, inflater, within = inflater.unused_data, frame(), False
    if within:
        _reject_end(account, file.tell(), "Zstandard")
    return not within


def _reject_damage(account: Account, byte: int, kind: str, error: Exception) -> None:
    reason = (
        f"the {kind} stream is damaged here ({error}); what stands before it was read, but {kind}'s checksum could not "
        "confirm it. Copy the file again from where it was recorded"
    )
    account.reject(f"byte {byte} of the compressed file", reason)


def _reject_end(account: Account, byte: int, kind: str) -> None:
    account.truncated = True
    reason = (
        f"the {kind} stream ends without its end; the recording was cut off or the copy is incomplete. "
        "What stands before it was read"
    )
    account.reject(f"byte {byte} of the compressed file", reason)
