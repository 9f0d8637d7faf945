"""Readers of MCAP: CAN frames and navigation as ROS 2 (CDR) records them, and CAN frames as JSON."""

from __future__ import annotations

import base64
import binascii
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from ..schemas.errors import InputError
from .account import KEPT_REJECTIONS, Account
from .can.frames import DATA, ERROR, REMOTE, FrameBatch
from .mcap_container import Message, Topic, is_mcap, messages
from .oxts.ncom import Ncom
from .ros_messages import decode_cdr

if TYPE_CHECKING:
    import pyarrow as pa

    from .navigation import Origin

BATCH = 1 << 16
"""Frames or samples of a batch, at most."""
HOLD = 10_000_000_000
"""ns; so much later may a navigation message come than others of its time."""
LATEST = np.iinfo(np.int64).max

CLASSIC, FD = "can_msgs/msg/Frame", "ros2_socketcan_msgs/msg/FdFrame"
JSON_FRAME = re.compile(r"(?i)can.{0,6}(frame|message)")
NCOM = "oxts_msgs/msg/Ncom"
FIX, ODOMETRY, TWIST, IMU = (
    "sensor_msgs/msg/NavSatFix",
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/TwistStamped",
    "sensor_msgs/msg/Imu",
)
LENGTHS = frozenset((*range(9), 12, 16, 20, 24, 32, 48, 64))
"""Bytes that a payload can have; beyond 8 only in CAN FD."""


def _schema(topic: Topic) -> str:
    return _full_name(topic.schema)


@cache
def _full_name(schema: str) -> str:
    """Return a schema's full name: `sensor_msgs/Imu` is `sensor_msgs/msg/Imu`."""
    package, slash, name = schema.partition("/")
    return schema if name.startswith("msg/") or not slash else f"{package}/msg/{name}"


@dataclass(frozen=True, slots=True)
class McapFrames:
    """The CAN frames of an MCAP file.

    Read are `can_msgs/msg/Frame` and `ros2_socketcan_msgs/msg/FdFrame` in CDR, and JSON objects whose schema's name
    holds "can" and "frame" or "message": `id` (number, or text such as `0x1A0`), `data` (base64 or a list of numbers),
    and where they are there `timestamp` (`sec` and `nsec`) or `header.stamp`, `is_extended`, `is_fd`, `is_rtr`,
    `is_error`, `dlc`, `channel`. The stamp is the message's own or, if it has none, when it was logged. The channel is
    what the message says, else the topic without its first slash. Messages of other kinds are not looked at.

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
        for message in messages(self.path, account, _holds_frames):
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


def _holds_frames(topic: Topic) -> bool:
    return _schema(topic) in {CLASSIC, FD} or (topic.encoding == "json" and JSON_FRAME.search(topic.schema) is not None)


def _frame(message: Message) -> tuple[Any, ...]:
    """Return time, channel, identifier, extended, FD, kind and payload of a message."""
    topic = message.topic
    fields: tuple[Any, ...]
    channel = topic.name.removeprefix("/")
    requested: int | None = None
    if topic.encoding == "json":
        time, channel, identifier, extended, fd, remote, error, data, requested = _json_frame(message.data, channel)
    elif topic.encoding != "cdr":
        raise ValueError(f"encoded as {topic.encoding!r}; only cdr (ROS 2) and json are read")
    elif _schema(topic) == CLASSIC:
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


def _json_frame(data: bytes, channel: str) -> tuple[Any, ...]:
    try:
        said = json.loads(data)
        names = {str(name).lower(): value for name, value in said.items()}
        header = names.get("header") or {}
        stamp = names.get("timestamp") or names.get("stamp") or header.get("stamp") or {}
        time = int(stamp.get("sec", 0)) * 1_000_000_000 + int(stamp.get("nsec", stamp.get("nanosec", 0)))
        identifier = next(names[name] for name in ("id", "can_id", "arbitration_id") if name in names)
        identifier = int(identifier, 0) if isinstance(identifier, str) else int(identifier)
        payload = names.get("data") or ""
        payload = base64.b64decode(payload, validate=True) if isinstance(payload, str) else bytes(payload)
        flags = [
            bool(names.get(f"is_{name}", names.get(name, default)))
            for name, default in (("extended", identifier > 0x7FF), ("fd", len(payload) > 8), ("rtr", False))
        ]
        error = bool(names.get("is_error", names.get("error", False)))
        length = names.get("len", names.get("dlc"))
        # A DLC of CAN FD is a code, not a length.
        requested = None if length is None or flags[1] else int(length)
    except (AttributeError, KeyError, TypeError, OverflowError, UnicodeDecodeError, RecursionError) as problem:
        raise ValueError(f"expected a JSON object with id and data ({type(problem).__name__})") from None
    except StopIteration:
        raise ValueError("expected a JSON object with id and data; it has no id") from None
    except (binascii.Error, ValueError) as problem:
        raise ValueError(f"expected a JSON object with id and data ({problem})") from None
    extended, fd, remote = flags
    name = names.get("channel", names.get("bus", names.get("interface", channel)))
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


@dataclass(frozen=True, slots=True)
class McapNavigation:
    """The navigation of an MCAP file.

    Where there is `oxts_msgs/msg/Ncom`, its raw packets are read as `Ncom` reads them, and nothing else is. Otherwise
    there is one sample for every stamp that occurs in `NavSatFix` (position, accuracy), `Odometry` (speed, course,
    heading) or, without one, `TwistStamped` (speed), and `Imu` (yaw rate, accelerations, heading): of each kind the
    topic with most messages. Nothing is interpolated: what a stamp's messages do not tell is null.

    Axes are those of REP 103 (x forward, y left, z up; directions anticlockwise from east); an `Imu` whose vertical
    acceleration at rest is negative is forward-right-down, as that of the OxTS driver, and is turned. Gravity is
    removed by the orientation that it tells, or as if the car were level. `position_accuracy` is the root of the sum of
    the horizontal variances. Stamps are taken as UTC.

    Attributes:
        path: The file.
    """

    format: ClassVar[str] = "mcap"
    kind: ClassVar[str] = "nav"

    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether `head` begins as MCAP does."""
        return is_mcap(head)

    def batches(self, account: Account) -> Iterator[pa.RecordBatch]:
        """Yield the samples in the order of time; nothing if the file has no topic of navigation.

        The schema's metadata holds `origin`, as of every reader, and `topics`, those that were read.

        Raises:
            InputError: The file cannot be read, or the time of no NCOM packet can be known.
        """
        survey = _survey(self.path)
        if survey.packets:
            yield from self._from_packets(max(survey.packets, key=survey.packets.__getitem__), account)
        elif survey.topics:
            yield from self._from_messages(survey, account)

    def _from_packets(self, topic: str, account: Account) -> Iterator[pa.RecordBatch]:
        """Yield what `Ncom` makes of the raw packets of a topic, in a file of their own."""
        inner = Account()
        with TemporaryDirectory(prefix="wheelprint-mcap-") as folder:
            path = Path(folder) / "packets.ncom"
            with path.open("wb") as file:
                for message in messages(self.path, account, lambda found: _schema(found) == NCOM):
                    if message.topic.name == topic:
                        try:
                            _, (packet,) = _decoded(message)
                        except ValueError as error:
                            account.reject(message.where, str(error))
                        else:
                            file.write(packet)
            try:
                for batch in Ncom(path).batches(inner):
                    metadata = {**(batch.schema.metadata or {}), b"topics": json.dumps([topic]).encode()}
                    yield batch.replace_schema_metadata(metadata)
            except InputError as error:
                raise InputError(self.path, f"topic {topic}", error.reason) from None
            finally:
                account.accepted += inner.accepted
                account.rejected += inner.rejected
                for where, reason in inner.rejections[: KEPT_REJECTIONS - len(account.rejections)]:
                    number = where.removeprefix("byte ")
                    place = f", packet {int(number) // 72 + 1}" if number.isdigit() else ""
                    account.rejections.append((f"topic {topic}{place}", reason))

    def _from_messages(self, survey: _Survey, account: Account) -> Iterator[pa.RecordBatch]:
        """Yield samples of the chosen topics, sorted within a window of `HOLD`."""
        from .navigation import navigation_batch, origin_metadata

        topics = survey.topics
        origin = survey.origins.get(topics.get(FIX, ""))
        metadata = {"origin": origin_metadata(origin), "topics": json.dumps(sorted(topics.values()))}
        samples: dict[int, dict[str, float]] = {}
        done = -1

        def batch(until: int) -> pa.RecordBatch:
            times = sorted(time for time in samples if time <= until)
            rows = [samples.pop(time) for time in times]
            names = sorted({name for row in rows for name in row})
            signals: dict[str, npt.NDArray[np.generic]] = {
                name: np.array([row.get(name, np.nan) for row in rows]) for name in names
            }
            if origin is not None and "latitude" in signals:
                from .navigation import local_position

                latitude, longitude, altitude = (
                    np.asarray(signals[name], np.float64) for name in ("latitude", "longitude", "altitude")
                )
                signals["x"], signals["y"] = local_position(latitude, longitude, altitude, origin)
            return navigation_batch(np.array(times, np.int64), signals, metadata)

        for message in messages(self.path, account, lambda topic: topics.get(_schema(topic)) == topic.name):
            schema = _schema(message.topic)
            try:
                time, values = _decoded(message)
                time = time or message.time
                if not 0 <= time <= LATEST - HOLD:
                    raise ValueError("its time is not within the years 1970 to 2262")  # noqa: TRY301
                with np.errstate(all="ignore"):  # Damaged numbers may be anything.
                    told = _TELLS[schema](values)
            except ValueError as error:
                account.reject(message.where, str(error))
                continue
            if time <= done:
                account.reject(message.where, "its stamp is more than 10 s before that of others already read")
                continue
            row = samples.setdefault(time, {})
            for name, value in told.items():
                # Where two kinds tell the same, an earlier one in this order is believed: odometry, then the others.
                if np.isfinite(value) and (name not in row or schema == ODOMETRY):
                    row[name] = value
            account.accepted += 1
            if len(samples) >= BATCH:
                done = max(max(samples) - HOLD, sorted(samples)[BATCH // 2])
                yield batch(done)
        if samples:
            yield batch(LATEST)


@dataclass(slots=True)
class _Survey:
    """What a first look at a file finds.

    Attributes:
        packets: Messages with NCOM packets by topic.
        topics: The topic that is read by its schema.
        origins: The first valid position by topic.
    """

    packets: dict[str, int] = field(default_factory=dict)
    topics: dict[str, str] = field(default_factory=dict)
    origins: dict[str, Origin] = field(default_factory=dict)


def _survey(path: Path) -> _Survey:
    from .navigation import Origin

    found = _Survey()
    counts: dict[str, dict[str, int]] = {}
    for message in messages(path, Account(), lambda topic: _schema(topic) in {NCOM, *_TELLS}):
        schema, name = _schema(message.topic), message.topic.name
        counts.setdefault(schema, {}).setdefault(name, 0)
        counts[schema][name] += 1
        if schema == FIX and name not in found.origins:
            try:
                told = _fix(_decoded(message)[1])
            except ValueError:
                continue
            if all(np.isfinite(told[axis]) for axis in ("latitude", "longitude", "altitude")):
                found.origins[name] = Origin(told["latitude"], told["longitude"], told["altitude"])
    found.packets = counts.pop(NCOM, {})
    found.topics = {schema: max(names, key=names.__getitem__) for schema, names in sorted(counts.items())}
    if ODOMETRY in found.topics:
        found.topics.pop(TWIST, None)
    return found


def _decoded(message: Message) -> tuple[int, tuple[Any, ...]]:
    if message.topic.encoding != "cdr":
        raise ValueError(f"encoded as {message.topic.encoding!r}; only cdr (ROS 2) is read")
    return decode_cdr(_schema(message.topic), message.data)


def _fix(values: tuple[Any, ...]) -> dict[str, float]:
    status, _, latitude, longitude, altitude, *covariance, covariance_type = values
    if status < 0:
        return dict.fromkeys(("latitude", "longitude", "altitude", "position_accuracy"), np.nan)
    if not (abs(latitude) <= 90 and abs(longitude) <= 180):
        raise ValueError(f"latitude {latitude:.9g} deg, longitude {longitude:.9g} deg is nowhere on earth")
    variance = covariance[0] + covariance[4]
    accuracy = float(np.sqrt(variance)) if covariance_type and variance >= 0 else np.nan
    return {"latitude": latitude, "longitude": longitude, "altitude": altitude, "position_accuracy": accuracy}


def _angles(x: float, y: float, z: float, w: float) -> tuple[float, float, float]:
    """Return roll, pitch (nose down, as REP 103 counts it) and yaw of a quaternion, rad; NaN if it is none."""
    if not 0.9 < x * x + y * y + z * z + w * w < 1.1:
        return np.nan, np.nan, np.nan
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return float(roll), float(pitch), float(yaw)


def _degrees(angle: float) -> float:
    """Return an angle of rad in deg, in [-180, 180)."""
    return float((np.degrees(angle) + 180) % 360 - 180)


def _odometry(values: tuple[Any, ...]) -> dict[str, float]:
    from .navigation import SLOWEST_COURSE

    forward, left = values[44:46]
    _, _, yaw = _angles(*values[4:8])
    speed = float(np.hypot(forward, left))
    course = _degrees(yaw + np.arctan2(left, forward)) if speed >= SLOWEST_COURSE else np.nan
    return {"nav_speed": speed, "course": course, "heading": _degrees(yaw)}


def _twist(values: tuple[Any, ...]) -> dict[str, float]:
    # Drivers differ in whether these are along the car or along east and north: only the speed is the same in both.
    return {"nav_speed": float(np.hypot(values[0], values[1]))}


def _imu(values: tuple[Any, ...]) -> dict[str, float]:
    from .navigation import GRAVITY, remove_gravity

    acceleration = np.array(values[25:28], np.float64)
    roll, pitch, yaw = _angles(*values[:4]) if values[4] >= 0 else (np.nan, np.nan, np.nan)
    vertical = acceleration[2]
    if vertical < -GRAVITY / 2:
        # Forward-right-down; what its orientation then means drivers disagree on.
        roll = pitch = yaw = np.nan
        turn, forward_right_down = -1.0, acceleration
    else:
        turn, forward_right_down = 1.0, acceleration * (1.0, -1.0, -1.0)
    if abs(vertical) < GRAVITY / 2:
        along, across = forward_right_down[0], -forward_right_down[1]
    else:
        (along,), (across,) = remove_gravity(forward_right_down[None], np.array([-pitch]), np.array([roll]))
    return {
        "nav_yaw_rate": turn * float(np.degrees(values[15])),
        "nav_longitudinal_acceleration": float(along),
        "nav_lateral_acceleration": float(across),
        "heading": _degrees(yaw),
    }


_TELLS = {FIX: _fix, ODOMETRY: _odometry, TWIST: _twist, IMU: _imu}


def purpose(topic: Topic) -> str:
    """Return what a topic can be read as here: `can` or `nav`; empty: it is not looked at."""
    return "can" if _holds_frames(topic) else "nav" if _schema(topic) in {NCOM, *_TELLS} else ""
