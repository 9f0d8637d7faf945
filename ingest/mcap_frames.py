"""Reader of CAN frames in MCAP: as ROS 2 (CDR) records them, as JSON, as protobuf."""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from .account import Account
from .can.frames import DATA, ERROR, REMOTE, FrameBatch
from .foxglove_messages import decode_fields
from .mcap_container import Message, Topic, is_mcap, messages
from .ros_messages import decode_cdr

BATCH = 1 << 16
"""Frames of a batch, at most."""
LATEST = np.iinfo(np.int64).max
SAID = frozenset({"json", "protobuf"})
"""Encodings of messages that name their fields."""

CLASSIC, FD = "can_msgs/msg/Frame", "ros2_socketcan_msgs/msg/FdFrame"
FRAME_NAME = re.compile(r"(?i)can.{0,6}(frame|message)")
LENGTHS = frozenset((*range(9), 12, 16, 20, 24, 32, 48, 64))
"""Bytes that a payload can have; beyond 8 only in CAN FD."""


@dataclass(frozen=True, slots=True)
class McapFrames:
    """The CAN frames of an MCAP file.

    Read are `can_msgs/msg/Frame` and `ros2_socketcan_msgs/msg/FdFrame` in CDR, and messages in JSON or protobuf whose
    schema's name holds "can" and "frame" or "message": `id` (number, or text such as `0x1A0`), `data` (bytes, base64
    or a list of numbers), and where they are there `timestamp` (`sec` and `nsec`) or `header.stamp`, `is_extended`,
    `is_fd`, `is_rtr`, `is_error`, `dlc` or `len`, `channel`. The stamp is the message's own or, if it has none, when it
    was logged. The channel is what the message says, else the topic without its first slash. Messages of other kinds
    are not looked at.

    Attributes:
        path: The file.
    """

    format: ClassVar[str] = "mcap"
    kind: ClassVar[str] = "can"

    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether `head` begins as MCAP does."""
        return is_mcap(head)

    def batches(self, account: Account) -> Iterator[FrameBatch]:
        """Yield the frames in the order of the file; nothing if the file has no topic of frames.

        Raises:
            InputError: The file cannot be read.
        """
        pending: list[tuple[Any, ...]] = []
        for message in messages(self.path, account, holds_frames):
            try:
                pending.append(_frame(message))
            except ValueError as error:
                account.reject(message.where, f"{error}; the message is damaged or of another definition")
            if len(pending) == BATCH:
                account.accepted += BATCH
                yield _frame_batch(pending)
                pending = []
        if pending:
            account.accepted += len(pending)
            yield _frame_batch(pending)


def holds_frames(topic: Topic) -> bool:
    """Tell whether a topic can be read here."""
    said = topic.encoding in SAID and FRAME_NAME.search(topic.schema) is not None
    return topic.ros_schema in {CLASSIC, FD} or said


def _frame(message: Message) -> tuple[Any, ...]:
    """Return time, channel, identifier, extended, FD, kind and payload of a message."""
    topic = message.topic
    fields: tuple[Any, ...]
    channel = topic.name.removeprefix("/")
    requested: int | None = None
    if topic.encoding in SAID:
        time, channel, identifier, extended, fd, remote, error, data, requested = _said_frame(message, channel)
    elif topic.encoding != "cdr":
        raise ValueError(f"encoded as {topic.encoding!r}; only cdr (ROS 2), json and protobuf are read")
    elif topic.ros_schema == CLASSIC:
        time, fields = decode_cdr(CLASSIC, message.data)
        identifier, remote, extended, error, requested, data = fields
        fd = False
    else:
        time, fields = decode_cdr(FD, message.data)
        identifier, extended, error, requested, data = fields
        fd, remote = True, False
    if requested is not None and not remote:
        if requested > len(data):
            raise ValueError(f"{requested} bytes of payload are told, {len(data)} are there")
        data = data[:requested]
    if error:
        identifier &= 0x1FFFFFFF  # Drivers leave SocketCAN's flag in it.
    most = 0x1FFFFFFF if extended or error else 0x7FF
    if not 0 <= identifier <= most:
        raise ValueError(f"identifier {identifier:X} is beyond {most:X}")
    if len(data) not in LENGTHS or (len(data) > 8 and not fd):
        raise ValueError(f"no {'CAN FD' if fd else 'classic'} frame has {len(data)} bytes of payload")
    stamp = time or message.time
    if not 0 <= stamp <= LATEST:
        raise ValueError("its time is not within the years 1970 to 2262")
    kind = ERROR if error else REMOTE if remote else DATA
    return stamp, channel, identifier, bool(extended), fd, kind, b"" if remote else bytes(data)


def _said_frame(message: Message, channel: str) -> tuple[Any, ...]:
    """Return what a message that names its fields says: JSON or protobuf."""
    time, said = decode_fields(message.topic, message.data)
    try:
        identifier = next(said[name] for name in ("id", "canid", "arbitrationid", "identifier") if name in said)
        identifier = int(identifier, 0) if isinstance(identifier, str) else int(identifier)
        payload = next((said[name] for name in ("data", "payload") if said.get(name)), b"")
        payload = base64.b64decode(payload, validate=True) if isinstance(payload, str) else bytes(payload)
        extended, fd, remote, error = (
            bool(next((said[name] for name in (f"is{flag}", f"is{flag}id", flag) if name in said), default))
            for flag, default in (
                ("extended", identifier > 0x7FF), ("fd", len(payload) > 8), ("rtr", False), ("error", False),
            )
        )  # fmt: skip
        length = said.get("len", said.get("dlc"))
        # A DLC of CAN FD is a code, not a length; a number that was never set is 0 in protobuf.
        unset = message.topic.encoding == "protobuf" and not length
        requested = None if length is None or fd or unset else int(length)
    except StopIteration:
        raise ValueError("expected a message with id and data; it has no id") from None
    except (binascii.Error, KeyError, TypeError, OverflowError, ValueError) as problem:
        raise ValueError(f"expected a message with id and data ({problem})") from None
    name = next((said[name] for name in ("channel", "bus", "interface") if said.get(name) not in (None, "")), channel)
    return time, str(name), identifier, extended, fd, remote, error, payload, requested


def _frame_batch(frames: list[tuple[Any, ...]]) -> FrameBatch:
    time, channel, identifier, extended, fd, kind, payload = zip(*frames, strict=True)
    channels = tuple(dict.fromkeys(channel))
    number = {name: k for k, name in enumerate(channels)}
    length = np.array([len(octets) for octets in payload], np.uint8)
    width = 8 if length.max() <= 8 else 64
    data = np.frombuffer(b"".join(octets.ljust(width, b"\0") for octets in payload), np.uint8).reshape(-1, width)
    return FrameBatch(
        time=np.array(time, np.int64),
        channel=np.array([number[name] for name in channel], np.int16),
        channels=channels,
        id=np.array(identifier, np.uint32),
        extended=np.array(extended, bool),
        fd=np.array(fd, bool),
        kind=np.array(kind, np.uint8),
        length=length,
        data=data,
    )
