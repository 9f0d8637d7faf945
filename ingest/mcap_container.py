"""The messages of an MCAP file, chosen by their channels, with all that can be read of a damaged one."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .account import Account
from .content import blocks

if TYPE_CHECKING:
    from mcap.records import Schema

MAGIC = b"\x89MCAP0\r\n"
LARGEST = 1 << 27
"""Bytes of a record, or of a chunk unpacked; a length beyond that is taken for damage."""


@dataclass(frozen=True, slots=True)
class Topic:
    """A channel of an MCAP file.

    Attributes:
        name: The topic.
        schema: Name of its messages' schema.
        encoding: Of its messages: `cdr` (ROS 2), `json`, `protobuf`, `ros1`...
        definition: What the file holds of the schema itself: text, or for protobuf a FileDescriptorSet.
    """

    name: str
    schema: str
    encoding: str
    definition: bytes = field(default=b"", repr=False)

    @property
    def ros_schema(self) -> str:
        """The full name of a ROS 2 message: that of `sensor_msgs/Imu` is `sensor_msgs/msg/Imu`."""
        package, slash, name = self.schema.partition("/")
        return self.schema if name.startswith("msg/") or not slash else f"{package}/msg/{name}"


@dataclass(frozen=True, slots=True)
class Message:
    """A message as it stands in the file.

    Attributes:
        topic: Its channel.
        offset: Byte of the (decompressed) file where its record, or the chunk that holds it, begins.
        number: Of its record within the chunk, from 1; 0 outside of chunks.
        time: ns since 1970 when it was logged.
        data: Its bytes.
    """

    topic: Topic
    offset: int
    number: int
    time: int
    data: bytes

    @property
    def where(self) -> str:
        """Its place, for an account."""
        return f"{_place(self.offset, self.number)}, topic {self.topic.name}"


def _place(offset: int, number: int) -> str:
    return f"byte {offset}, record {number} of the chunk" if number else f"byte {offset}"


def is_mcap(head: bytes) -> bool:
    """Tell whether a file that begins with `head` is MCAP."""
    return head.startswith(MAGIC)


def messages(path: Path, account: Account, wants: Callable[[Topic], bool]) -> Iterator[Message]:
    """Yield the messages of the channels that are wanted, in the order of the file.

    A chunk is read as a whole or, where it is damaged, is one rejection. The file's index is not needed; its checksum
    and its count of messages are compared. A file that ends without its footer is truncated.

    Args:
        path: The file, plain or compressed as a whole.
        account: Of the file; messages are not counted as accepted here.
        wants: Chooses channels.

    Raises:
        InputError: The file cannot be read.
    """
    from mcap.exceptions import EndOfFile, McapError
    from mcap.records import Channel, Chunk, Schema, Statistics
    from mcap.records import Message as Record
    from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
    from zstandard import ZstdError

    source = _Source(blocks(path, account))
    schemas: dict[int, Schema] = {}
    topics: dict[int, Topic | None] = {}

    seen = 0

    def records(record: Any, number: int) -> Iterator[Message]:
        nonlocal seen
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel) and record.id not in topics:
            schema = schemas.get(record.schema_id)
            name, definition = (schema.name, schema.data) if schema is not None else ("", b"")
            topic = Topic(record.topic, name, record.message_encoding, definition)
            topics[record.id] = topic if wants(topic) else None
        elif isinstance(record, Record):
            seen += 1
            if record.channel_id not in topics:
                account.reject(
                    _place(place, number), f"its channel {record.channel_id} was never described; the file is damaged"
                )
            elif topic_of := topics[record.channel_id]:
                yield Message(topic_of, place, number, record.log_time, record.data)

    stream = StreamReader(source, emit_chunks=True, validate_crcs=True, record_size_limit=LARGEST)  # type: ignore[arg-type]  # it only reads
    reader = iter(stream.records)
    while True:
        place = source.count
        try:
            record = next(reader)
        except StopIteration:
            return
        except EndOfFile:
            account.truncated = True
            account.reject(f"byte {place}", "the file ends within this record; the recording was cut off")
            return
        except CRCValidationError:
            reason = "the checksum of all that stands before does not match: some of it is damaged, though it was read"
            account.reject(f"byte {place}", reason)
            return
        except (McapError, UnicodeDecodeError, struct.error, ValueError, OverflowError, MemoryError) as error:
            reason = f"no record of MCAP ({type(error).__name__}: {str(error)[:100]}); nothing behind it can be read"
            account.truncated = True
            account.reject(f"byte {place}", reason)
            return
        if isinstance(record, Statistics) and record.message_count != seen:
            reason = f"the file's statistics count {record.message_count} messages, {seen} were found; it is damaged"
            account.reject(f"byte {place}", reason)
        if not isinstance(record, Chunk):
            yield from records(record, 0)
            continue
        try:
            if record.uncompressed_size > LARGEST:
                raise ValueError(f"it claims to be {record.uncompressed_size} bytes unpacked")  # noqa: TRY301
            content = breakup_chunk(record, validate_crc=True)
        except (McapError, ZstdError, RuntimeError, ValueError, struct.error, OverflowError, MemoryError) as error:
            reason = f"a chunk of messages is damaged ({str(error)[:100]}); what it held is lost"
            account.reject(f"byte {place}", reason)
            continue
        for number, inner in enumerate(content, 1):
            yield from records(inner, number)


class _Source:
    """What `mcap` reads from: the pieces of a file as one stream.

    Attributes:
        count: Bytes that were read.
    """

    def __init__(self, pieces: Iterator[bytes]) -> None:
        self.count = 0
        self._pieces = pieces
        self._buffer, self._place = b"", 0

    def read(self, size: int) -> bytes:
        """Return the next bytes; unlike a file, never less than `size`, which `mcap` would not notice."""
        from mcap.exceptions import EndOfFile

        place = self._place
        if place + size > len(self._buffer):
            parts = [self._buffer[place:]]
            missing = size - len(parts[0])
            while missing > 0:
                piece = next(self._pieces, b"")
                if not piece:
                    raise EndOfFile
                parts.append(piece)
                missing -= len(piece)
            self._buffer, place = b"".join(parts), 0
        self._place = place + size
        self.count += size
        return self._buffer[place : place + size]
