"""Messages that say their own field names, as Foxglove's do: JSON, and protobuf by the definition in the file."""

from __future__ import annotations

import json
from functools import lru_cache
from typing import Any

from .mcap_container import Topic

DEEPEST = 20
"""Messages within messages; deeper ones are damage."""


def decode_fields(topic: Topic, data: bytes) -> tuple[int, dict[str, Any]]:
    """Decode one message of a topic in JSON or protobuf.

    Returns:
        The message's own stamp (`timestamp`, `stamp` or `header.stamp`), ns since 1970, 0 where it has none; and its
        fields by name in lower case without underscores: numbers, text, bytes (protobuf), lists, dicts.

    Raises:
        ValueError: The bytes are not such a message, or the topic's schema does not define it.
    """
    fields = _json(data) if topic.encoding == "json" else _protobuf(topic.schema, topic.definition, data)
    header = fields.get("header")
    stamp: Any = (
        fields.get("timestamp") or fields.get("stamp") or (header.get("stamp") if isinstance(header, dict) else 0)
    )
    if not stamp:
        return 0, fields
    try:
        seconds = next(stamp[name] for name in ("sec", "seconds", "secs") if name in stamp)
        rest = next((stamp[name] for name in ("nsec", "nanosec", "nanos", "nsecs") if name in stamp), 0)
        time = int(seconds) * 1_000_000_000 + int(rest)
    except (AttributeError, StopIteration, TypeError, ValueError, OverflowError):
        raise ValueError("expected a timestamp of sec and nsec") from None
    return time, fields


def _json(data: bytes) -> dict[str, Any]:
    try:
        said = json.loads(data)
    except (UnicodeDecodeError, ValueError, RecursionError) as problem:
        raise ValueError(f"expected a JSON object ({problem})") from None
    if not isinstance(said, dict):
        raise ValueError(f"expected a JSON object; found a {type(said).__name__}")  # noqa: TRY004
    return _plain_names(said, 0)


def _plain_names(said: dict[str, Any], depth: int) -> dict[str, Any]:
    return {
        _plain_name(name): _plain_names(value, depth + 1) if isinstance(value, dict) and depth < DEEPEST else value
        for name, value in said.items()
    }


def _plain_name(name: str) -> str:
    return name.lower().replace("_", "")


def _protobuf(schema: str, definition: bytes, data: bytes) -> dict[str, Any]:
    from google.protobuf.message import DecodeError

    kind = _message_class(schema, definition)
    try:
        return _fields(kind.FromString(data), 0)
    except DecodeError:
        raise ValueError(f"expected {schema} in protobuf") from None


@lru_cache(maxsize=64)
def _message_class(schema: str, definition: bytes) -> Any:
    """Return the class of a message that a serialised FileDescriptorSet defines."""
    from google.protobuf.descriptor_pb2 import FileDescriptorSet
    from google.protobuf.descriptor_pool import DescriptorPool
    from google.protobuf.message import DecodeError
    from google.protobuf.message_factory import GetMessageClass

    pool = DescriptorPool()
    try:
        files = {file.name: file for file in FileDescriptorSet.FromString(definition).file}
        while files:
            # A file is known only after those that it needs.
            ready = [name for name, file in files.items() if not files.keys() & set(file.dependency)]
            for name in ready or list(files):
                pool.Add(files.pop(name))
        return GetMessageClass(pool.FindMessageTypeByName(schema))
    except (DecodeError, TypeError, KeyError) as problem:
        reason = f"the file's schema does not define {schema} ({type(problem).__name__})"
        raise ValueError(reason) from None


def _fields(message: Any, depth: int) -> dict[str, Any]:
    if depth > DEEPEST:
        raise ValueError(f"messages within messages, more than {DEEPEST} deep")
    fields: dict[str, Any] = {}
    for field in message.DESCRIPTOR.fields:
        value = getattr(message, field.name)
        if field.is_repeated:
            fields[_plain_name(field.name)] = list(value) if field.message_type is None else []
        elif field.message_type is not None:
            fields[_plain_name(field.name)] = _fields(value, depth + 1) if message.HasField(field.name) else None
        else:
            fields[_plain_name(field.name)] = value
    return fields
