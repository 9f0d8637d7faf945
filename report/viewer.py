"""A recording as an MCAP file for viewers such as Foxglove: where the car was, what it measured, what was computed."""

from __future__ import annotations

import heapq
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa

from .. import __version__
from ..dataset.events import Event, read_events
from ..schemas.errors import InputError
from ..schemas.project import Project
from ..schemas.signals import CAN_SIGNALS, NAV_SIGNALS
from ..schemas.store import publish, read_table
from ..schemas.tables import DATASET, SYNCED
from .drives import nanoseconds
from .tables import synced_output

Message = tuple[int, int, bytes]
"""Time in ns UTC, number of the channel, content."""

SECOND = 1_000_000_000
_TIME = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer", "minimum": 0}, "nsec": {"type": "integer", "minimum": 0}},
}
_NUMBER = {"type": "number"}

LOCATION_FIX: dict[str, Any] = {
    "title": "foxglove.LocationFix",
    "type": "object",
    "properties": {
        "timestamp": _TIME,
        "frame_id": {"type": "string"},
        "latitude": _NUMBER | {"description": "deg"},
        "longitude": _NUMBER | {"description": "deg"},
        "altitude": _NUMBER | {"description": "m"},
        "position_covariance": {"type": "array", "items": _NUMBER, "minItems": 9, "maxItems": 9},
        "position_covariance_type": {"type": "integer", "description": "0 unknown, 1 approximated"},
    },
}
"""The fields of Foxglove's schema of that name, by which viewers know a position."""

LOG: dict[str, Any] = {
    "title": "foxglove.Log",
    "type": "object",
    "properties": {
        "timestamp": _TIME,
        "level": {"type": "integer", "description": "2 info, 3 warning"},
        "message": {"type": "string"},
        "name": {"type": "string"},
    },
}
"""The fields of Foxglove's schema of that name that events fill."""


def export_mcap(project: Project, driver: str, recording: str, path: Path) -> int:
    """Write one recording as MCAP with JSON messages, in the order of their times.

    Topics: `/position` (foxglove.LocationFix), `/car` and `/navigation` (the canonical signals, stored units),
    `/dataset` (the columns that models are trained on, where there is a dataset) and `/events` (foxglove.Log). What is
    null has no field in the message.

    Args:
        project: The project.
        driver: Whose recording it is.
        recording: Its name.
        path: The file to write; it is whole or absent. The same tables give the same bytes.

    Returns:
        How many messages were written.

    Raises:
        InputError: The recording is not converted, or a table is damaged.
    """
    from mcap.writer import Writer

    key = f"{driver}/{recording}"
    entry = project.manifest.get("recordings", {}).get(key, {})
    synced = synced_output(entry) if entry else {}
    if not synced:
        reason = f"recording {key!r} has no synced table; run `wheelprint convert` first"
        raise InputError(project.directory, "", reason)
    table = read_table(project.directory / synced["path"])
    outputs = project.manifest.get("dataset", {}).get(driver, {}).get("outputs", ())
    built = [output["path"] for output in outputs if output["recording"] == recording]
    events = [event for event in read_events(project.events_file) if event.recording == key]
    with publish(path) as draft, draft.open("wb") as file:
        writer = Writer(file)
        writer.start(library=f"wheelprint {__version__}")

        def channel(topic: str, schema: Mapping[str, Any]) -> int:
            encoded = json.dumps(schema, ensure_ascii=False).encode()
            number = writer.register_schema(schema["title"], "jsonschema", encoded)
            return writer.register_channel(topic, "json", number)

        streams = [
            _positions(channel("/position", LOCATION_FIX), table),
            _rows(channel("/car", _schema("wheelprint.Car", SYNCED, CAN_SIGNALS)), table, CAN_SIGNALS),
            _rows(channel("/navigation", _schema("wheelprint.Navigation", SYNCED, NAV_SIGNALS)), table, NAV_SIGNALS),
        ]
        if built:
            columns = DATASET.names[1:]
            dataset = read_table(project.directory / built[0])
            streams.append(
                _rows(channel("/dataset", _schema("wheelprint.Dataset", DATASET, columns)), dataset, columns)
            )
        if events:
            streams.append(_logs(channel("/events", LOG), events))
        messages = 0
        for time, number, content in heapq.merge(*streams):
            writer.add_message(number, time, content, time)
            messages += 1
        writer.add_metadata("wheelprint", {"driver": driver, "recording": recording, **_facts(entry, project)})
        writer.finish()  # type: ignore[no-untyped-call]  # mcap annotates all but this one
    return messages


def _schema(title: str, schema: pa.Schema, columns: Sequence[str]) -> dict[str, Any]:
    properties = {}
    for name in columns:
        field = schema.field(name)
        kind = "string" if pa.types.is_string(field.type) else "number"
        told = {what.decode(): text.decode() for what, text in field.metadata.items()}
        unit = f", {told['unit']}" if told["unit"] else ""
        properties[name] = {"type": kind, "description": told["description"] + unit}
    return {"title": title, "type": "object", "properties": properties}


def _rows(channel: int, table: pa.Table, columns: Sequence[str]) -> Iterator[Message]:
    """Yield each row that holds anything, without its nulls."""
    values = zip(*(table[name].to_pylist() for name in columns), strict=True)
    for time, row in zip(nanoseconds(table).tolist(), values, strict=True):
        present = {name: value for name, value in zip(columns, row, strict=True) if value is not None}
        if present:
            yield time, channel, _encode(present)


def _positions(channel: int, table: pa.Table) -> Iterator[Message]:
    columns = ("latitude", "longitude", "altitude", "position_accuracy")
    values = zip(*(table[name].to_pylist() for name in columns), strict=True)
    for time, (latitude, longitude, altitude, accuracy) in zip(nanoseconds(table).tolist(), values, strict=True):
        if latitude is not None and longitude is not None:
            # Only the horizontal accuracy is stored, hence "approximated" with the same value upwards.
            variance = 0.0 if accuracy is None else accuracy * accuracy
            fix = {
                "timestamp": _stamp(time),
                "frame_id": "navigation",
                "latitude": latitude,
                "longitude": longitude,
                "altitude": 0.0 if altitude is None else altitude,
                "position_covariance": [variance, 0, 0, 0, variance, 0, 0, 0, variance],
                "position_covariance_type": 0 if accuracy is None else 1,
            }
            yield time, channel, _encode(fix)


def _logs(channel: int, events: Iterable[Event]) -> Iterator[Message]:
    for event in sorted(events, key=lambda event: event.start):
        message = (
            f"{event.kind}, {(event.stop - event.start) / 1e9:.1f} s, severity {event.severity:.2f}: {event.decision}"
        )
        level = 3 if event.is_left_out else 2
        log = {"timestamp": _stamp(event.start), "level": level, "message": message, "name": "events.csv"}
        yield event.start, channel, _encode(log)


def _facts(entry: Mapping[str, Any], project: Project) -> dict[str, str]:
    clock = json.dumps(entry["clock"], sort_keys=True, ensure_ascii=False)
    return {"vehicle": project.config.vehicle.name, "clock": clock}


def _stamp(time: int) -> dict[str, int]:
    seconds, rest = divmod(time, SECOND)
    return {"sec": seconds, "nsec": rest}


def _encode(content: Mapping[str, Any]) -> bytes:
    return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
