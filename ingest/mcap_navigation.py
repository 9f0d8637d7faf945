"""Reader of navigation in MCAP: as ROS 2 (CDR) and Foxglove (JSON, protobuf) record it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from ..schemas.errors import InputError
from .account import KEPT_REJECTIONS, Account
from .foxglove_messages import decode_fields
from .mcap_container import Message, Topic, is_mcap, messages
from .oxts.ncom import Ncom
from .ros_messages import decode_cdr

if TYPE_CHECKING:
    import pyarrow as pa

    from .navigation import Origin

BATCH = 1 << 16
"""Samples of a batch, at most."""
HOLD = 10_000_000_000
"""ns; so much later may a navigation message come than others of its time."""
LATEST = np.iinfo(np.int64).max

NCOM = "oxts_msgs/msg/Ncom"
FIX, ODOMETRY, TWIST, IMU = (
    "sensor_msgs/msg/NavSatFix",
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/TwistStamped",
    "sensor_msgs/msg/Imu",
)
LOCATION = "foxglove.LocationFix"


@dataclass(frozen=True, slots=True)
class McapNavigation:
    """The navigation of an MCAP file.

    Where there is `oxts_msgs/msg/Ncom`, its raw packets are read as `Ncom` reads them, and nothing else is. Otherwise
    there is one sample for every stamp that occurs in `NavSatFix` or, without one, `foxglove.LocationFix` (position,
    accuracy), `Odometry` (speed, course,
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
        surveyed = Account()
        survey = _survey(self.path, surveyed)
        if survey.packets:
            yield from self._from_packets(max(survey.packets, key=survey.packets.__getitem__), account)
        elif survey.topics:
            yield from self._from_messages(survey, account)
        else:
            account.truncated |= surveyed.truncated

    def _from_packets(self, topic: str, account: Account) -> Iterator[pa.RecordBatch]:
        """Yield what `Ncom` makes of the raw packets of a topic, in a file of their own."""
        inner = Account()
        with TemporaryDirectory(prefix="wheelprint-mcap-") as folder:
            path = Path(folder) / "packets.ncom"
            with path.open("wb") as file:
                for message in messages(self.path, account, lambda found: found.ros_schema == NCOM):
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
                account.remarks += [(f"topic {topic}", what) for _, what in inner.remarks]
                for where, reason in inner.rejections[: KEPT_REJECTIONS - len(account.rejections)]:
                    number = where.removeprefix("byte ")
                    place = f", packet {int(number) // 72 + 1}" if number.isdigit() else ""
                    account.rejections.append((f"topic {topic}{place}", reason))

    def _from_messages(self, survey: _Survey, account: Account) -> Iterator[pa.RecordBatch]:
        """Yield samples of the chosen topics, sorted within a window of `HOLD`."""
        from .navigation import navigation_batch, origin_metadata

        topics = survey.topics
        origin = survey.origins.get(topics.get(FIX, topics.get(LOCATION, "")))
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

        for message in messages(self.path, account, lambda topic: topics.get(topic.ros_schema) == topic.name):
            schema = message.topic.ros_schema
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


def _survey(path: Path, account: Account) -> _Survey:
    from .navigation import Origin

    found = _Survey()
    counts: dict[str, dict[str, int]] = {}
    for message in messages(path, account, lambda topic: topic.ros_schema in {NCOM, *_TELLS}):
        schema, name = message.topic.ros_schema, message.topic.name
        counts.setdefault(schema, {}).setdefault(name, 0)
        counts[schema][name] += 1
        if schema in {FIX, LOCATION} and name not in found.origins:
            try:
                told = _TELLS[schema](_decoded(message)[1])
            except ValueError:
                continue
            if all(np.isfinite(told[axis]) for axis in ("latitude", "longitude", "altitude")):
                found.origins[name] = Origin(told["latitude"], told["longitude"], told["altitude"])
    found.packets = counts.pop(NCOM, {})
    found.topics = {schema: max(names, key=names.__getitem__) for schema, names in sorted(counts.items())}
    if ODOMETRY in found.topics:
        found.topics.pop(TWIST, None)
    if FIX in found.topics:
        found.topics.pop(LOCATION, None)
    return found


def _decoded(message: Message) -> tuple[int, Any]:
    """Return stamp and values: of ROS 2's messages a tuple in the order of their definition, of Foxglove's a dict."""
    topic = message.topic
    known = {"json", "protobuf"} if topic.ros_schema == LOCATION else {"cdr"}
    if topic.encoding not in known:
        raise ValueError(f"encoded as {topic.encoding!r}; only {' and '.join(sorted(known))} of {topic.schema} is read")
    return (
        decode_fields(topic, message.data)
        if topic.ros_schema == LOCATION
        else decode_cdr(topic.ros_schema, message.data)
    )


def _fix(values: tuple[Any, ...]) -> dict[str, float]:
    status, _, latitude, longitude, altitude, *covariance, covariance_type = values
    if status < 0:
        return dict.fromkeys(("latitude", "longitude", "altitude", "position_accuracy"), np.nan)
    if not (abs(latitude) <= 90 and abs(longitude) <= 180):
        raise ValueError(f"latitude {latitude:.9g} deg, longitude {longitude:.9g} deg is nowhere on earth")
    variance = covariance[0] + covariance[4]
    accuracy = float(np.sqrt(variance)) if covariance_type and variance >= 0 else np.nan
    return {"latitude": latitude, "longitude": longitude, "altitude": altitude, "position_accuracy": accuracy}


def _location(values: dict[str, Any]) -> dict[str, float]:
    try:
        covariance = [float(variance) for variance in values.get("positioncovariance") or [0.0] * 9]
        latitude, longitude = float(values["latitude"]), float(values["longitude"])
        altitude = values.get("altitude")
        kind = int(values.get("positioncovariancetype") or 0)
        place = (latitude, longitude, np.nan if altitude is None else float(altitude))
    except (KeyError, TypeError, ValueError, OverflowError):
        raise ValueError("expected latitude, longitude and position_covariance in numbers") from None
    if len(covariance) != 9:
        raise ValueError(f"{len(covariance)} covariances of the position, not 9")
    return _fix((0, 0, *place, *covariance, kind))


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


_TELLS: dict[str, Callable[[Any], dict[str, float]]] = {
    FIX: _fix,
    LOCATION: _location,
    ODOMETRY: _odometry,
    TWIST: _twist,
    IMU: _imu,
}


def tells_navigation(topic: Topic) -> bool:
    """Tell whether a topic can be read here."""
    return topic.ros_schema in {NCOM, *_TELLS}
