"""The ROS 2 messages that Wheelprint reads, decoded from CDR by definitions kept here (bags may have none)."""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

# After their header: strings (s), sequences of bytes (B*) and fixed fields with the codes of `struct`.
DEFINITIONS = {
    "can_msgs/msg/Frame": "I ? ? ? B 8s",  # id, is_rtr, is_extended, is_error, dlc, data
    "ros2_socketcan_msgs/msg/FdFrame": "I ? ? B B*",  # id, is_extended, is_error, len, data
    "oxts_msgs/msg/Ncom": "72s",  # raw_packet
    # status, service; latitude, longitude, altitude; covariance (east, north, up) and its type
    "sensor_msgs/msg/NavSatFix": "b H d d d 9d B",
    # orientation x y z w, covariance; angular velocity x y z, covariance; linear acceleration x y z, covariance
    "sensor_msgs/msg/Imu": "4d 9d 3d 9d 3d 9d",
    "geometry_msgs/msg/TwistStamped": "3d 3d",  # linear, angular
    # child_frame_id; position, orientation x y z w, covariance; linear, angular, covariance
    "nav_msgs/msg/Odometry": "s 3d 4d 36d 3d 3d 36d",
    "sensor_msgs/msg/CompressedImage": "s",  # format; the image is left where it is
}
"""By name of the schema; all of them begin with `std_msgs/Header`: stamp (int32 s, uint32 ns) and frame_id."""

BIG_ENDIAN, LITTLE_ENDIAN = 0, 1


def decode_cdr(schema: str, data: bytes) -> tuple[int, tuple[Any, ...]]:
    """Decode one message of a schema in `DEFINITIONS`.

    Plain CDR (XCDR 1) of either byte order: every field at a multiple of its size, counted from behind the four bytes
    that tell the encoding (OMG DDS-XTypes 7.4.1).

    Returns:
        The header's stamp, ns since 1970 (0 where not set), and the fields after the header, arrays flattened.

    Raises:
        ValueError: The bytes are not such a message.
    """
    if len(data) < 16 or data[0] != 0 or data[1] not in {BIG_ENDIAN, LITTLE_ENDIAN}:
        raise ValueError("expected CDR: four bytes that tell the encoding (00 00 or 00 01 first), then a header")
    order = "<" if data[1] == LITTLE_ENDIAN else ">"
    body = memoryview(data)[4:]
    try:
        seconds, nanoseconds, length = struct.unpack_from(f"{order}iII", body)
        place = 12 + length
        values: list[Any] = []
        for kind in _parts(DEFINITIONS[schema]):
            if kind in {"s", "B*"}:
                place += -place % 4
                (length,) = struct.unpack_from(f"{order}I", body, place)
                place += 4
                if place + length > len(body):
                    raise ValueError(f"{length} bytes of text or data where {len(body) - place} are left")
                values.append(bytes(body[place : place + length]))
                place += length
            else:
                packed = _aligned(order, kind, place % 8)
                values.extend(packed.unpack_from(body, place))
                place += packed.size
    except struct.error:
        raise ValueError(f"{len(data)} bytes are too few for {schema}") from None
    if nanoseconds >= 1_000_000_000:
        raise ValueError(f"its stamp has {nanoseconds} ns within a second")
    return seconds * 1_000_000_000 + nanoseconds, tuple(values)


@cache
def _parts(definition: str) -> tuple[str, ...]:
    """Return a definition with its fixed fields joined: `s`, `B*`, and between them codes that are unpacked at once."""
    parts: list[str] = []
    for code in definition.split():
        if code in {"s", "B*"} or not parts or parts[-1] in {"s", "B*"}:
            parts.append(code)
        else:
            parts[-1] += f" {code}"
    return tuple(parts)


@cache
def _aligned(order: str, codes: str, place: int) -> struct.Struct:
    """Return the fields, padded so that each stands at a multiple of its size if they begin at `place`."""
    form, at = order, place
    for code in codes.split():
        padding = -at % struct.calcsize("=" + code[-1])
        form += f"{padding}x{code}"
        at += padding + struct.calcsize("=" + code)
    return struct.Struct(form)
