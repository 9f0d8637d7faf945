"""Reader of NMEA 0183, the sentences of GNSS receivers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import reduce
from operator import xor
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from ..schemas.errors import InputError
from ..schemas.signals import SIGNALS
from .account import Account
from .text import lines, number_of, quote, time_of

if TYPE_CHECKING:
    import pyarrow as pa

    from .navigation import Samples

KNOT = 1852 / 3600
"""m/s"""
FIRST_YEAR = 80
"""Two-digit years from this one on are those of the last century; GPS began in 1980."""
BATCH = 16_384
"""Sentences of a batch; up to twice as many where an epoch goes on."""
DAY = 86_400_000_000_000
COLUMNS = ("latitude", "longitude", "altitude", "speed", "course", "heading", "status")
"""What an epoch's sentences tell, in deg, m, m/s, with directions clockwise from north."""
FIELDS = {"RMC": 9, "GGA": 9, "VTG": 7, "HDT": 1}
"""The sentences that are used, and the fields they have at least."""

_SENTENCE = re.compile(rb"[$!]([0-9A-Z]+(?:,[^*$!]*)?)\*([0-9A-Fa-f]{2})")
_TIME = re.compile(rb"(\d\d)(\d\d)(\d\d)(?:\.(\d*))?")
_DATE = re.compile(rb"(\d\d)(\d\d)(\d\d)")
_ANGLE = re.compile(rb"(\d{1,3})(\d\d(?:\.\d*)?)")
_TYPES = b"RMC|GGA|VTG|HDT|GSA|GSV|GLL|ZDA|GST|GNS|TXT|ROT|HDG"
_START = re.compile(rb"\s*\$(?:[A-Z]{2}(?:" + _TYPES + rb")|P[A-Z0-9]+),[ -~]*\*[0-9A-Fa-f]{2}\s*")


@dataclass(frozen=True, slots=True)
class Nmea:
    """A log of NMEA sentences such as `$GPRMC,…*6A`, one a line, of any talker.

    RMC, GGA, VTG and HDT are used; others are accepted and give nothing. Sentences of one epoch become one sample: RMC
    and GGA open an epoch when their time differs from that of the last one, VTG and HDT, which have no time, belong to
    the epoch before them. Where several sentences of an epoch tell the same, the first one counts.

    Time is UTC; the date is that of RMC with a valid position, two-digit years from 80 on being those of the last
    century. Epochs without such a RMC are taken to be within half a day of the one before (before the first: of the
    first). A receiver whose GPS weeks rolled over tells dates 1,024 weeks early, which cannot be seen here.

    Course is missing below `SLOWEST_COURSE`; altitude is GGA's (above mean sea level); `nav_status` is GGA's quality of
    the fix (0 none, 1 GNSS, 2 differential, 4 RTK, 5 RTK float, 6 dead reckoning).

    Attributes:
        path: The log, plain or compressed.
    """

    format: ClassVar[str] = "nmea"
    kind: ClassVar[str] = "nav"

    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether one of the first two lines of `head` is a sentence; the first may have begun before the log."""
        return any(_START.fullmatch(line) for line in head.lstrip().split(b"\n", 2)[:2])

    def batches(self, account: Account) -> Iterator[pa.RecordBatch]:
        """Yield one sample for each epoch in the order of time, in the schema `NAVIGATION`.

        Args:
            account: Every line that is not blank is one record. Rejected are lines that are no sentence, with a wrong
                checksum or damaged fields; of an epoch whose time does not increase, the sentence that opened it.

        Raises:
            InputError: The file cannot be read, or no RMC tells the date.
        """
        from .navigation import navigation_batches

        start = self._first_date()

        def read(account: Account) -> Iterator[Samples]:
            epochs = _Epochs(start)
            for line in lines(self.path, account):
                if not line.text:
                    continue
                values, doubt = _NOTHING, ""
                try:
                    values = _sentence(line.text)
                except ValueError as error:
                    account.truncated |= not line.ended
                    doubt = str(error) if line.ended else f"the file ends within this line: {error}"
                if len(epochs.place) >= (BATCH if epochs.opens(values) else 2 * BATCH):
                    yield epochs.take()
                epochs.add(line.number, values, doubt)
            if epochs.place:
                yield epochs.take()

        metadata = {"utc_from": "RMC"}
        yield from navigation_batches(read, account, metadata, unit="line", record="epoch")

    def _first_date(self) -> int:
        sentences, account = 0, Account()
        for line in lines(self.path, account):
            try:
                values = _sentence(line.text)
            except ValueError:
                continue
            sentences += 1
            if values.time is not None and values.day is not None:
                return values.day + values.time
        if account.rejections:
            raise InputError(self.path, *account.rejections[0])
        reason = (
            f"its date cannot be known: none of its {sentences} sentences is a RMC with a valid position, time and "
            "date. The receiver had no reception, or its output leaves RMC out; record with reception and RMC"
        )
        raise InputError(self.path, "", reason)


@dataclass(frozen=True, slots=True)
class _Values:
    """What a sentence tells.

    Attributes:
        time: ns since midnight, UTC.
        day: Midnight of the date, ns since 1970.
        told: By names of `COLUMNS`.
    """

    time: int | None = None
    day: int | None = None
    told: dict[str, float] = field(default_factory=dict)


_NOTHING = _Values()


class _Epochs:
    """Sentences in the order of the log, merged into epochs.

    The values of an epoch stand at the sentence that opened it; the others are records without time.
    """

    def __init__(self, clock: int) -> None:
        self._clock = clock
        self._clear()

    def _clear(self) -> None:
        self.place: list[int] = []
        self._time: list[int | None] = []
        self._rows: list[dict[str, float]] = []
        self._doubts: dict[int, str] = {}
        self._opened = -1
        self._of_day = -1

    def opens(self, values: _Values) -> bool:
        """Tell whether a sentence opens an epoch."""
        return values.time is not None and values.time != self._of_day

    def add(self, number: int, values: _Values, doubt: str) -> None:
        """Add a line's sentence; with a reason to doubt it, it is only counted."""
        if self.opens(values):
            self._opened = len(self.place)
        if values.time is not None:
            self._of_day = values.time
            day = self._clock - self._clock % DAY if values.day is None else values.day
            self._clock = _nearest(day + values.time, self._clock) if values.day is None else day + values.time
        if doubt:
            self._doubts[len(self.place)] = doubt
        self.place.append(number)
        self._time.append(None)
        self._rows.append({})
        if self._opened >= 0:
            self._time[self._opened] = self._clock
            self._rows[self._opened] = {**values.told, **self._rows[self._opened]}

    def take(self) -> Samples:
        """Return and forget all sentences; the open epoch is closed."""
        from .navigation import SLOWEST_COURSE, Samples, anticlockwise_from_east

        values = np.array([[row.get(name, np.nan) for name in COLUMNS] for row in self._rows])
        latitude, longitude, altitude, speed, course, heading, status = values.T
        signals: dict[str, npt.NDArray[np.generic]] = {
            "latitude": latitude,
            "longitude": longitude,
            "altitude": altitude,
            "course": np.where(speed >= SLOWEST_COURSE, anticlockwise_from_east(course), np.nan),
            "heading": anticlockwise_from_east(heading),
            "nav_speed": speed,
            "nav_status": status,
        }
        time = np.array([stamp or 0 for stamp in self._time], np.int64)
        timed = np.array([stamp is not None for stamp in self._time])
        samples = Samples(np.array(self.place, np.int64), time, timed, signals, self._doubts)
        self._clear()
        return samples


def _nearest(time: int, reference: int) -> int:
    """Return a time of a day that is not known as that within half a day of a reference, ns."""
    return time - DAY * round((time - reference) / DAY)


def _sentence(text: bytes) -> _Values:
    """Return what a line tells; nothing where it is a sentence of no use here.

    Raises:
        ValueError: It is no sentence, or a damaged one.
    """
    match = _SENTENCE.fullmatch(text)
    if not match:
        raise ValueError(f"expected a sentence with its checksum, such as $GPHDT,123.456,T*32; found {quote(text)}")
    found = reduce(xor, text[1:-3])
    if found != int(match[2], 16):
        told = match[2].decode()
        raise ValueError(f"its checksum is {told}, but its characters make {found:02X}; the sentence is damaged")
    address, *fields = text[1:-3].split(b",")
    kind = address[2:].decode() if len(address) == 5 and address[:1] != b"P" else ""
    if kind not in FIELDS:
        return _NOTHING
    if len(fields) < FIELDS[kind]:
        raise ValueError(f"expected at least {FIELDS[kind]} fields of {kind}; found {len(fields)}: {quote(text)}")
    try:
        return {"RMC": _rmc, "GGA": _gga, "VTG": _vtg, "HDT": _hdt}[kind](fields)
    except ValueError as error:
        raise ValueError(f"{kind}: {error}") from None


def _rmc(fields: Sequence[bytes]) -> _Values:
    time = _time(fields[0])
    if fields[1] != b"A" or fields[11:12] == [b"N"]:
        return _Values(time)
    position = _position(fields[2:6])
    return _Values(
        time, _day(fields[8]), {**position, **_told(speed=_speed(fields[6], KNOT), course=_angle(fields[7]))}
    )


def _gga(fields: Sequence[bytes]) -> _Values:
    time, quality = _time(fields[0]), fields[5] or b"0"
    if quality not in b"0 1 2 3 4 5 6 7 8".split():
        raise ValueError(f"expected the quality of the fix (0 to 8); found {quote(quality)}")
    status = {"status": float(quality)}
    if quality == b"0":
        return _Values(time, None, status)
    altitude = number_of(fields[8]) if fields[8] else np.nan
    limits = SIGNALS["altitude"]
    if not (np.isnan(altitude) or limits.minimum <= altitude <= limits.maximum):
        raise ValueError(f"altitude {altitude:g} m is nowhere on earth; the sentence is damaged")
    return _Values(time, None, {**status, **_position(fields[1:5]), **_told(altitude=altitude)})


def _vtg(fields: Sequence[bytes]) -> _Values:
    if fields[8:9] == [b"N"]:
        return _NOTHING
    speed = _speed(fields[4], KNOT) if fields[4] else _speed(fields[6], 1 / 3.6)
    return _Values(told=_told(speed=speed, course=_angle(fields[0])))


def _hdt(fields: Sequence[bytes]) -> _Values:
    return _Values(told=_told(heading=_angle(fields[0])))


def _told(**values: float) -> dict[str, float]:
    return {name: value for name, value in values.items() if not np.isnan(value)}


def _time(text: bytes) -> int | None:
    """Return ns since midnight; None for an empty field."""
    if not text:
        return None
    match = _TIME.fullmatch(text)
    clock = b":".join(match.groups()[:3]).decode() if match else ""
    time = time_of("1970-01-01", clock, (match[4] or b"").decode()) if match else None
    if time is None:
        raise ValueError(f"expected a time such as 123519.25 (hhmmss); found {quote(text)}")
    return time


def _day(text: bytes) -> int | None:
    """Return midnight of a date, ns since 1970; None for an empty field."""
    if not text:
        return None
    match = _DATE.fullmatch(text)
    time = None
    if match:
        day, month, year = (part.decode() for part in match.groups())
        time = time_of(f"{19 if int(year) >= FIRST_YEAR else 20}{year}-{month}-{day}", "00:00:00")
    if time is None:
        raise ValueError(f"expected a date such as 230394 (ddmmyy); found {quote(text)}")
    return time


def _position(fields: Sequence[bytes]) -> dict[str, float]:
    """Return latitude and longitude of four fields, deg; nothing where both are empty."""
    if not any(fields):
        return {}
    position = {}
    for name, text, side, signs, most in (
        ("latitude", fields[0], fields[1], {b"N": 1, b"S": -1}, 90),
        ("longitude", fields[2], fields[3], {b"E": 1, b"W": -1}, 180),
    ):
        match = _ANGLE.fullmatch(text)
        degrees = int(match[1]) + float(match[2]) / 60 if match and float(match[2]) < 60 else np.inf
        if degrees > most or side not in signs:
            raise ValueError(
                f"expected a {name} such as 04807.038 (dddmm.mmm) and its side; found {quote(text + b',' + side)}"
            )
        position[name] = degrees * signs[side]
    return position


def _speed(text: bytes, factor: float) -> float:
    speed = number_of(text) * factor if text else np.nan
    if speed < 0 or speed > SIGNALS["nav_speed"].maximum:
        raise ValueError(f"a speed of {speed:g} m/s; the sentence is damaged")
    return speed


def _angle(text: bytes) -> float:
    angle = number_of(text) if text else np.nan
    if angle < 0 or angle > 360:
        raise ValueError(f"expected a direction from 0 to 360 deg; found {quote(text)}")
    return angle
