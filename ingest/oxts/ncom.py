"""Reader of NCOM, the binary log of OxTS inertial navigation units."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from ...schemas.errors import InputError
from ...schemas.signals import SIGNALS
from ...schemas.times import iso_utc
from ..account import Account
from . import ncom_layout as layout
from .leap_seconds import VALID_UNTIL
from .ncom_packets import NcomPackets, Scan, scan_packets

if TYPE_CHECKING:
    import pyarrow as pa

    from ..navigation import Origin


@dataclass(slots=True)
class Ncom:
    """An NCOM file, plain or compressed.

    Attributes:
        path: The file.
    """

    format: ClassVar[str] = "ncom"
    kind: ClassVar[str] = "nav"
    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether two packets follow one another directly in `head`, or a single packet is nearly all of it.

        In the containers that hold NCOM (XCOM, MCAP) packets never touch.
        """

        def is_packet(place: int) -> bool:
            body = head[place : place + layout.LENGTH]
            return len(body) == layout.LENGTH and body[0] == layout.SYNC and sum(body[1:-1]) & 0xFF == body[-1]

        if len(head) < 2 * layout.LENGTH:
            return is_packet(0)
        place = head.find(layout.SYNC)
        while place >= 0:
            if is_packet(place) and is_packet(place + layout.LENGTH):
                return True
            place = head.find(layout.SYNC, place + 1)
        return False

    def packets(self, account: Account) -> Iterator[NcomPackets]:
        """Yield the packets in the order of the file, in bounded batches.

        Args:
            account: Every packet is counted as accepted, every stretch of other bytes as one rejection with its first
                byte; a packet that the file ends within makes it truncated, and is counted as nothing else.

        Raises:
            InputError: The file is missing, unreadable, empty, or holds no packet.
        """
        for _, packets in scan_packets(self.path, account):
            account.accepted += len(packets)
            yield packets

    def batches(self, account: Account) -> Iterator[pa.RecordBatch]:
        """Yield the navigation samples in the order of time, in the schema `NAVIGATION`.

        Packets of navigation status 2, 3 and 4 give a sample, those of status 2 with accelerations and yaw rate alone;
        all others (raw IMU has no time) give none, but count as accepted. Checksums 1 and 2 may be wrong, as for
        OxTS's own decoder. Gravity is removed from the accelerations where pitch and roll are valid, see
        `remove_gravity`; the yaw rate is that about the car's own vertical axis. `position_accuracy` is
        √(σ_north² + σ_east²) of status channel 3, held until the next one.

        The schema's metadata holds `origin` (JSON: latitude, longitude, altitude of the first valid position, or null)
        and `utc_from`: where the difference between GPS time and UTC comes from.

        Args:
            account: As of `packets`; but a packet is counted as rejected, with its first byte, if its time cannot be
                known although its status says so, if its position is nowhere on earth, or if its time does not
                increase: of repeated packets the first is kept, of packets out of order as many as possible.

        Raises:
            InputError: As of `packets`, or the time of no packet can be known.
        """
        from ..navigation import longest_increasing, navigation_batch, origin_metadata

        scan = scan_packets(self.path, account)
        stamps = scan.stamps
        if not stamps.known.any():
            raise InputError(self.path, "", _why_no_time(scan))
        if stamps.utc_from == "leap second table" and stamps.time.max() >= VALID_UNTIL:
            reason = (
                "the log never tells UTC from GPS time (status channel 16), and the table of leap seconds ends on "
                f"{iso_utc(VALID_UNTIL)[:10]}: its times may be a second off. Update Wheelprint"
            )
            account.reject("", reason)
        origin = _first_position(scan)
        metadata = {"origin": origin_metadata(origin), "utc_from": stamps.utc_from}
        accuracy = np.nan
        last = int(np.iinfo(np.int64).min)
        for first, packets in scan:
            accuracies = _position_accuracy(packets, accuracy)
            accuracy = float(accuracies[-1])
            reasons = {
                number - first: why for number, why in stamps.doubts.items() if 0 <= number - first < len(packets)
            }
            reasons |= _impossible_positions(packets)
            usable = packets.time_known.copy()
            usable[list(reasons)] = False
            samples = np.flatnonzero(usable)
            kept = longest_increasing(packets.time[samples], last)
            reasons |= _out_of_order(packets.time, samples, kept, last)
            for packet in sorted(reasons):
                account.reject(f"byte {packets.offset[packet]}", reasons[packet])
            account.accepted += len(packets) - len(reasons)
            samples = samples[kept]
            if len(samples):
                last = int(packets.time[samples[-1]])
                signals = _signals(packets, samples, origin) | {"position_accuracy": accuracies[samples]}
                yield navigation_batch(packets.time[samples], signals, metadata)


def _why_no_time(scan: Scan) -> str:
    count = len(scan.offset)
    statuses = sorted(set(scan.data[scan.offset + 21].tolist()))
    if not any(layout.INITIALISING <= status <= layout.LOCKED for status in statuses):
        return (
            f"none of its {count} packets carries time: their navigation status is {', '.join(map(str, statuses))}, "
            "and only 2, 3 and 4 do. The unit was not initialised while this was recorded; wait for that before driving"
        )
    return (
        f"the time of its {count} packets cannot be known: none tells the GPS minute (status channel 0 with at least "
        f"{layout.FIRST_VALID_MINUTE} minutes). The unit had no GNSS time while this was recorded, or its output "
        "leaves that channel out; record with reception and all status channels"
    )


def _is_valid(packets: NcomPackets) -> npt.NDArray[np.bool_]:
    """Tell which packets hold a valid position, velocity and orientation, by their navigation status."""
    return np.isin(packets.status, (layout.LOCKING, layout.LOCKED))


def _is_on_earth(packets: NcomPackets) -> npt.NDArray[np.bool_]:
    altitude = SIGNALS["altitude"]
    return (
        (np.abs(packets.latitude) <= np.pi / 2)
        & (np.abs(packets.longitude) <= np.pi)
        & (packets.altitude >= altitude.minimum)
        & (packets.altitude <= altitude.maximum)
    )


def _impossible_positions(packets: NcomPackets) -> dict[int, str]:
    return {
        packet: (
            f"latitude {packets.latitude[packet]:.9g} rad, longitude {packets.longitude[packet]:.9g} rad, altitude "
            f"{packets.altitude[packet]:.9g} m is nowhere on earth; the packet is damaged"
        )
        for packet in np.flatnonzero(_is_valid(packets) & ~_is_on_earth(packets)).tolist()
    }


def _first_position(scan: Scan) -> Origin | None:
    from ..navigation import Origin

    for _, packets in scan:
        found = np.flatnonzero(packets.time_known & _is_valid(packets) & _is_on_earth(packets))
        if len(found):
            latitude, longitude = packets.latitude[found[0]], packets.longitude[found[0]]
            return Origin(float(np.degrees(latitude)), float(np.degrees(longitude)), float(packets.altitude[found[0]]))
    return None


def _position_accuracy(packets: NcomPackets, held: float) -> npt.NDArray[np.float64]:
    """Return for each packet the horizontal accuracy, m, that status channel 3 told last; `held` before the first."""
    telling = np.flatnonzero(
        layout.holds_channel(packets.status) & (packets.channel == layout.POSITION_ACCURACY_CHANNEL)
    )
    batch = packets.batch[telling]
    deviations = batch[:, :4].view("<u2") * 1e-3
    told = np.where(batch[:, 6] < layout.TOO_OLD, np.hypot(deviations[:, 0], deviations[:, 1]), np.nan)
    return np.concatenate(([held], told))[np.searchsorted(telling, np.arange(len(packets)), "right")]


def _out_of_order(
    time: npt.NDArray[np.int64], samples: npt.NDArray[np.intp], kept: npt.NDArray[np.bool_], last: int
) -> dict[int, str]:
    """Say of each sample that was not kept why; `last` is the stamp of the last sample before these."""
    reasons = {}
    stamps = time[samples]
    kept_stamps = stamps[kept]
    for number in np.flatnonzero(~kept).tolist():
        stamp = int(stamps[number])
        place = int(np.searchsorted(kept_stamps, stamp))
        if stamp == last or (place < len(kept_stamps) and kept_stamps[place] == stamp):
            why = "is that of another packet; repeated in recording, the first one is kept"
        else:
            why = "is out of order with the packets around it; they changed places, or the clock was set"
        reasons[int(samples[number])] = f"its time {iso_utc(stamp)} {why}"
    return reasons


def _signals(
    packets: NcomPackets, samples: npt.NDArray[np.intp], origin: Origin | None
) -> dict[str, npt.NDArray[np.generic]]:
    """Return some packets' navigation signals, with Wheelprint's axes and units."""
    from ..navigation import anticlockwise_from_east, horizontal_motion, local_position, remove_gravity

    valid = _is_valid(packets)[samples]

    def where_valid(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return np.where(valid, values[samples], np.nan)

    latitude, longitude = np.degrees(where_valid(packets.latitude)), np.degrees(where_valid(packets.longitude))
    altitude = where_valid(packets.altitude)
    speed, course = horizontal_motion(where_valid(packets.velocity[:, 0]), where_valid(packets.velocity[:, 1]))
    heading, pitch, roll = (where_valid(angle) for angle in packets.orientation.T)
    longitudinal, lateral = remove_gravity(packets.acceleration[samples], pitch, roll)
    signals: dict[str, npt.NDArray[np.generic]] = {
        "latitude": latitude,
        "longitude": longitude,
        "altitude": altitude,
        "course": course,
        "heading": anticlockwise_from_east(np.degrees(heading)),
        "nav_speed": speed,
        "nav_yaw_rate": -np.degrees(packets.angular_rate[samples, 2]),
        "nav_longitudinal_acceleration": longitudinal,
        "nav_lateral_acceleration": lateral,
        "nav_status": packets.status[samples],
    }
    if origin is not None:
        signals["x"], signals["y"] = local_position(latitude, longitude, altitude, origin)
    return signals
