"""From a navigation unit's axes and units to Wheelprint's, and the tables that hold the result; for every reader."""

from __future__ import annotations

import json
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ..schemas.angles import wrap_degrees
from ..schemas.signals import NAV_SIGNALS
from ..schemas.tables import NAVIGATION

Times = npt.NDArray[np.int64]
Values = npt.NDArray[np.float64]

SLOWEST_COURSE = 0.5
"""m/s; below it the velocity is mostly noise (a few cm/s), and the direction of travel has no meaning."""
GRAVITY = 9.80665
"""m/s², standard gravity; the real one differs by at most 0.3 %, which on a slope of 10 % is 0.003 m/s²."""


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a recording's `x` and `y` are zero: its first valid position.

    Attributes:
        latitude: deg, WGS 84.
        longitude: deg.
        altitude: m, as the navigation unit gives it.
    """

    latitude: float
    longitude: float
    altitude: float


def local_position(latitude: Values, longitude: Values, altitude: Values, origin: Origin) -> tuple[Values, Values]:
    """Return metres east and north of `origin` on the plane that touches the WGS 84 ellipsoid there.

    The plane keeps shapes and distances around the origin: 10 km away a metre is a metre within 1.2 parts per
    million, 100 km away within 1.2 in ten thousand.

    Args:
        latitude: (n,) deg.
        longitude: (n,) deg.
        altitude: (n,) m.
        origin: Where x and y are zero.

    Returns:
        x and y, (n,) m; NaN where an argument is.
    """
    from pymap3d import geodetic2enu

    x, y, _ = geodetic2enu(latitude, longitude, altitude, origin.latitude, origin.longitude, origin.altitude)
    return x, y


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
    speed = np.hypot(north, east)
    course = wrap_degrees(np.degrees(np.arctan2(north, east)))
    return speed, np.where(speed >= SLOWEST_COURSE, course, np.nan)


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
    level = np.isnan(pitch) | np.isnan(roll)
    pitch, roll = np.where(level, 0.0, pitch), np.where(level, 0.0, roll)
    forward = specific_force[:, 0] - GRAVITY * np.sin(pitch)
    right = specific_force[:, 1] + GRAVITY * np.cos(pitch) * np.sin(roll)
    return forward, -right


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
        columns.append(
            pa.array(signals[name], from_pandas=True).cast(kind) if name in signals else pa.nulls(len(time), kind)
        )
    return pa.RecordBatch.from_arrays(columns, schema=NAVIGATION.with_metadata(dict(metadata)))


def origin_metadata(origin: Origin | None) -> str:
    """Return what the schema's metadata holds of the origin: JSON, null where no position was ever valid."""
    return json.dumps(None if origin is None else asdict(origin), sort_keys=True)


def merge_navigation(tables: Sequence[pa.Table]) -> pa.Table:
    """Join the navigation logs of one recording.

    Args:
        tables: One or more tables in the schema `NAVIGATION`, each in order of time, each with its own origin.

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
    if found is not None:
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
