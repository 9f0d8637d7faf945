"""From a navigation unit's axes and units to Wheelprint's, and the tables that hold the result; for every reader."""

from __future__ import annotations

import json
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from ..schemas.angles import wrap_degrees
from ..schemas.signals import NAV_SIGNALS, SIGNALS
from ..schemas.store import parquet_writer
from ..schemas.tables import NAVIGATION
from ..schemas.times import iso_utc
from .account import Account

Times = npt.NDArray[np.int64]
Values = npt.NDArray[np.float64]

SLOWEST_COURSE = 0.5
"""m/s; below it the velocity is mostly noise (a few cm/s), and the direction of travel has no meaning."""
GRAVITY = 9.80665
"""m/s², standard gravity; the real one differs by at most 0.3 %, which on a slope of 10 % is 0.003 m/s²."""

INERTIAL_SIGNALS = (
    "nav_speed", "course", "heading", "nav_yaw_rate", "nav_longitudinal_acceleration", "nav_lateral_acceleration",
)  # fmt: skip
"""What `motion.set_inertial` sets."""


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a recording's `x` and `y` are zero: its first valid position.

    Attributes:
        latitude: deg, WGS 84.
        longitude: deg.
        altitude: m, as the navigation unit gives it; 0 where it does not.
    """

    latitude: float
    longitude: float
    altitude: float


@dataclass(frozen=True, slots=True)
class Samples:
    """Some records of a navigation log, in the order of the log, with Wheelprint's axes and units.

    Attributes:
        place: int64 (n,), the byte, line or frame where each record begins.
        time: int64 (n,), ns since 1970, UTC.
        timed: bool (n,); a record without time (a status message) is accepted, but is no sample.
        signals: Navigation signals by name, (n,) each, NaN where missing; all but `x` and `y`.
        doubts: By number of the record among these: why it is rejected.
    """

    place: Times
    time: Times
    timed: npt.NDArray[np.bool_]
    signals: Mapping[str, npt.NDArray[np.generic]]
    doubts: Mapping[int, str]


def local_position(latitude: Values, longitude: Values, altitude: Values, origin: Origin) -> tuple[Values, Values]:
    """Return metres east and north of `origin` on the plane that touches the WGS 84 ellipsoid there.

    The plane keeps shapes and distances around the origin: 10 km away a metre is a metre within 1.2 parts per
    million, 100 km away within 1.2 in ten thousand.

    Args:
        latitude: (n,) deg.
        longitude: (n,) deg.
        altitude: (n,) m; where it is NaN, the origin's is taken.
        origin: Where x and y are zero.

    Returns:
        x and y, (n,) m; NaN where latitude or longitude is.
    """
    from .motion import east_north

    place = (origin.latitude, origin.longitude, origin.altitude)
    x, y = east_north(_contiguous(latitude), _contiguous(longitude), _contiguous(altitude), place)
    return x, y


def _contiguous(values: Values) -> Values:
    """Return values in the one form that is compiled for."""
    return np.ascontiguousarray(values, np.float64)


def anticlockwise_from_east(bearing: Values) -> Values:
    """Return directions in deg anticlockwise from east, in [-180, 180), for deg clockwise from north."""
    return wrap_degrees(90.0 - bearing)


def horizontal_motion(north: Values, east: Values) -> tuple[Values, Values]:
    """Return speed and course of a horizontal velocity.

    Args:
        north: (n,) m/s.
        east: (n,) m/s.

    Returns:
        Speed, m/s, and direction of travel, deg anticlockwise from east in [-180, 180), NaN where the speed is below
        `SLOWEST_COURSE`.
    """
    from .motion import horizontal

    speed, course = horizontal(_contiguous(north), _contiguous(east), SLOWEST_COURSE)
    return speed, course


def remove_gravity(specific_force: Values, pitch: Values, roll: Values) -> tuple[Values, Values]:
    """Return the car's own acceleration along and across itself from what accelerometers measure.

    Accelerometers measure a - g, where g in the body frame forward-right-down is g (-sin θ, cos θ sin φ, cos θ cos φ)
    with pitch θ (nose up) and roll φ (right side down); a level car at rest shows (0, 0, -g). Hence

        a forward = f_x - g sin θ,    a left = -(f_y + g cos θ sin φ).

    Args:
        specific_force: (n, 3) m/s², forward, right, down.
        pitch: (n,) rad; where it or roll is NaN, the car is taken to be level.
        roll: (n,) rad.

    Returns:
        Longitudinal and lateral acceleration, (n,) m/s², positive forwards and to the left.
    """
    from .motion import without_gravity

    along, across, _ = specific_force.T
    forward, left = without_gravity(*map(_contiguous, (along, across, pitch, roll)), GRAVITY)
    return forward, left


def inertial_signals(
    *,
    latitude: Values,
    longitude: Values,
    altitude: Values,
    velocity: Values,
    orientation: Values,
    specific_force: Values,
    yaw_rate: Values,
) -> dict[str, npt.NDArray[np.generic]]:
    """Return the navigation signals of an inertial unit with axes forward, right, down; NaN stays NaN.

    Gravity is removed from the accelerations, see `remove_gravity`.

    Args:
        latitude: (n,) deg, WGS 84.
        longitude: (n,) deg.
        altitude: (n,) m.
        velocity: (n, 2) m/s, north and east.
        orientation: (n, 3) rad, heading (clockwise from north), pitch (nose up), roll (right side down).
        specific_force: (n, 2 or 3) m/s², what accelerometers measure: a level car at rest has (0, 0, -g).
        yaw_rate: (n,) rad/s about the car's own axis, positive to the right.
    """
    from .motion import set_inertial

    measured = np.stack([*specific_force.T[:2], yaw_rate, *velocity.T, *orientation.T], dtype=np.float64)
    rows = np.empty((len(INERTIAL_SIGNALS), len(yaw_rate)))
    set_inertial(measured, SLOWEST_COURSE, GRAVITY, rows, 0, 0, len(yaw_rate))
    signals: dict[str, npt.NDArray[np.generic]] = {"latitude": latitude, "longitude": longitude, "altitude": altitude}
    return signals | dict(zip(INERTIAL_SIGNALS, rows, strict=True))


def is_on_earth(latitude: Values, longitude: Values, altitude: Values) -> npt.NDArray[np.bool_]:
    """Tell which positions (deg, deg, m) a car can be at; NaN is nowhere."""
    from .motion import within_limits

    limits = SIGNALS["altitude"].minimum, SIGNALS["altitude"].maximum
    inside: npt.NDArray[np.bool_] = within_limits(*map(_contiguous, (latitude, longitude, altitude)), limits)
    return inside


def impossible_positions(latitude: Values, longitude: Values, altitude: Values, record: str) -> dict[int, str]:
    """Return why records are rejected whose position (deg, deg, m; NaN where missing) is nowhere on earth.

    Args:
        latitude: (n,) deg.
        longitude: (n,) deg.
        altitude: (n,) m.
        record: What a record is called: `frame`, `line`.
    """
    plausible = is_on_earth(np.nan_to_num(latitude), np.nan_to_num(longitude), np.nan_to_num(altitude))
    return {
        index: (
            f"latitude {latitude[index]:.9g} deg, longitude {longitude[index]:.9g} deg, altitude {altitude[index]:.9g} "
            f"m is nowhere on earth; the {record} is damaged"
        )
        for index in np.flatnonzero(~plausible).tolist()
    }


def longest_increasing(time: Times, after: int) -> npt.NDArray[np.bool_]:
    """Choose the largest set of samples whose stamps strictly increase, all later than `after`.

    Of samples with the same stamp the first is kept; of two that changed places, one.

    Args:
        time: (n,) stamps, ns.
        after: Stamp of the last sample before them, ns.

    Returns:
        (n,) which samples to keep.
    """
    keep = time > after
    stamps = time[keep]
    if (stamps[1:] > stamps[:-1]).all():
        return keep
    # Patience sorting: for each length, the sequence of that length that ends earliest.
    ends: list[int] = []
    lasts: list[int] = []
    previous = [-1] * len(stamps)
    for sample, stamp in enumerate(stamps.tolist()):
        length = bisect_left(ends, stamp)
        if length < len(ends) and ends[length] == stamp:
            continue
        previous[sample] = lasts[length - 1] if length else -1
        ends[length : length + 1] = [stamp]
        lasts[length : length + 1] = [sample]
    chosen = np.zeros(len(stamps), bool)
    sample = lasts[-1]
    while sample >= 0:
        chosen[sample] = True
        sample = previous[sample]
    keep[keep] = chosen
    return keep


def navigation_batches(
    read: Callable[[Account], Iterable[Samples]],
    account: Account,
    metadata: Mapping[str, str],
    *,
    unit: str,
    record: str,
) -> Iterator[pa.RecordBatch]:
    """Yield a log's samples in the order of time, in the schema `NAVIGATION`, and count its records in `account`.

    Samples whose time does not increase are rejected: of repeated ones the first is kept, of those out of order as
    many as possible. The schema's metadata holds `origin`, see `origin_metadata`: the log's first position.

    Args:
        read: Yields the log's records from its beginning. It is called twice, the first time with an account of its
            own, to find the first position.
        account: Of the log.
        metadata: More for the schema.
        unit: What `Samples.place` counts, for the places of rejected records: `byte`, `line`.
        record: What a record is called in their reasons: `packet`, `line`.
    """
    origin = next(filter(None, map(_first_position, read(Account()))), None)
    metadata = {"origin": origin_metadata(origin), **metadata}
    last = int(np.iinfo(np.int64).min)
    for samples in read(account):
        timed = samples.timed.copy()
        timed[list(samples.doubts)] = False
        chosen = np.flatnonzero(timed)
        kept = longest_increasing(samples.time if timed.all() else samples.time[chosen], last)
        reasons = {**samples.doubts, **_out_of_order(samples.time, chosen, kept, last, record)}
        for number in sorted(reasons):
            account.reject(f"{unit} {samples.place[number]}", reasons[number])
        account.accepted += len(samples.time) - len(reasons)
        chosen = chosen if kept.all() else chosen[kept]
        if len(chosen):
            last = int(samples.time[chosen[-1]])
            rows = slice(None) if len(chosen) == len(samples.time) else chosen
            signals = {name: values[rows] for name, values in samples.signals.items()}
            if origin is not None:
                latitude, longitude, altitude = _position(signals)
                signals["x"], signals["y"] = local_position(latitude, longitude, altitude, origin)
            yield navigation_batch(samples.time[rows], signals, metadata)


def _position(signals: Mapping[str, npt.NDArray[np.generic]]) -> tuple[Values, ...]:
    return tuple(signals[name].astype(np.float64, copy=False) for name in ("latitude", "longitude", "altitude"))


def _first_position(samples: Samples) -> Origin | None:
    latitude, longitude, altitude = _position(samples.signals)
    known = samples.timed & ~np.isnan(latitude) & ~np.isnan(longitude)
    known[list(samples.doubts)] = False
    if not known.any():
        return None
    first = int(np.argmax(known))
    return Origin(float(latitude[first]), float(longitude[first]), float(np.nan_to_num(altitude[first])))


def _out_of_order(
    time: Times, samples: npt.NDArray[np.intp], kept: npt.NDArray[np.bool_], last: int, record: str
) -> dict[int, str]:
    """Say of each sample that was not kept why; `last` is the stamp of the last sample before these."""
    reasons = {}
    stamps = time[samples]
    kept_stamps = stamps[kept]
    for number in np.flatnonzero(~kept).tolist():
        stamp = int(stamps[number])
        place = int(np.searchsorted(kept_stamps, stamp))
        if stamp == last or (place < len(kept_stamps) and kept_stamps[place] == stamp):
            why = f"is that of another {record}; repeated in recording, the first one is kept"
        else:
            why = f"is out of order with the {record}s around it; they changed places, or the clock was set"
        reasons[int(samples[number])] = f"its time {iso_utc(stamp)} {why}"
    return reasons


def navigation_writer(path: Path, schema: pa.Schema) -> AbstractContextManager[pq.ParquetWriter]:
    """Open a Parquet writer of navigation.

    The last bits of what a navigation unit measures are noise, in which coding single bytes would find 0.3 % to save
    and take a seventh of the writing. A recording has one such file, so it can have a large buffer.
    """
    return parquet_writer(path, schema, level=-1, buffer=1 << 19)


def navigation_batch(
    time: Times, signals: Mapping[str, npt.NDArray[np.generic]], metadata: Mapping[str, str]
) -> pa.RecordBatch:
    """Return samples in the schema `NAVIGATION`.

    Args:
        time: (n,) stamps, ns since 1970, UTC.
        signals: Navigation signals by name, (n,) each, NaN where missing; a signal that is absent becomes null.
        metadata: For the schema; `origin` at least, see `origin_metadata`.
    """
    columns = [pa.array(time, NAVIGATION.field("time").type)]
    for name in NAV_SIGNALS:
        kind = NAVIGATION.field(name).type
        columns.append(_column(signals[name], kind) if name in signals else pa.nulls(len(time), kind))
    return pa.RecordBatch.from_arrays(columns, schema=NAVIGATION.with_metadata(dict(metadata)))


def _column(values: npt.NDArray[np.generic], kind: pa.DataType) -> pa.Array:
    """Return values as a column, null where they are NaN; they are copied only where something has to be changed."""
    if values.dtype == np.float64 and kind == pa.float64() and not np.isnan(values.min(initial=0.0)):
        return pa.Array.from_buffers(kind, len(values), [None, pa.py_buffer(np.ascontiguousarray(values))])
    return pa.array(values, from_pandas=True).cast(kind)


def origin_metadata(origin: Origin | None) -> str:
    """Return what the schema's metadata holds of the origin: JSON, null where no position was ever valid."""
    return json.dumps(None if origin is None else asdict(origin), sort_keys=True)


def merge_navigation(tables: Sequence[pa.Table]) -> pa.Table:
    """Join the navigation logs of one recording.

    Args:
        tables: One or more tables of columns of the schema `NAVIGATION`, with `time` at least, and where there is
            `x` or `y` both and the three of the position; each in order of time, each with its own origin.

    Returns:
        One table in order of time; `x` and `y` are metres from the origin of the log that begins first (of those that
        know a position). Of samples with the same stamp, that of the log that begins first is kept.
    """
    tables = sorted((table for table in tables if len(table)), key=lambda table: table["time"][0].value) or tables[:1]
    if len(tables) == 1:
        return tables[0]
    origins = [json.loads((table.schema.metadata or {}).get(b"origin", b"null")) for table in tables]
    found = next((origin for origin in origins if origin is not None), None)
    joined = pa.concat_tables([table.replace_schema_metadata() for table in tables])
    if found is not None and "x" in joined.column_names:
        latitude, longitude, altitude = (joined[name].to_numpy() for name in ("latitude", "longitude", "altitude"))
        position = local_position(latitude, longitude, altitude, Origin(**found))
        for name, values in zip("xy", position, strict=True):
            place = joined.schema.get_field_index(name)
            joined = joined.set_column(place, NAVIGATION.field(name), pa.array(values, from_pandas=True))
    time = joined["time"].cast(pa.int64()).to_numpy()
    order = np.argsort(time, kind="stable")
    first = np.concatenate(([True], np.diff(time[order]) > 0))
    metadata = {**(tables[0].schema.metadata or {}), b"origin": json.dumps(found, sort_keys=True).encode()}
    return joined.take(order[first]).replace_schema_metadata(metadata)
