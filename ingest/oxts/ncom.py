"""Reader of NCOM, the binary log of OxTS inertial navigation units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from ...schemas.errors import InputError
from ..account import Account
from . import ncom_layout as layout
from .leap_seconds import BEYOND_TABLE, VALID_UNTIL
from .ncom_packets import NcomPackets, Scan, scan_packets

if TYPE_CHECKING:
    import pyarrow as pa

    from ..navigation import Samples


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
            InputError: The file is missing, unreadable, empty, or holds no packet, or it shrinks while it is read.
        """
        for _, packets in scan_packets(self.path, account).batches(account):
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
        from ..navigation import navigation_batches

        scan = scan_packets(self.path, account)
        stamps = scan.stamps
        if not stamps.known.any():
            raise InputError(self.path, "", _why_no_time(scan))
        if stamps.utc_from == "leap second table" and stamps.time.max() >= VALID_UNTIL:
            reason = f"the log never tells UTC from GPS time (status channel 16), and {BEYOND_TABLE}"
            account.remarks.append(("", reason))
        metadata = {"utc_from": stamps.utc_from}
        yield from navigation_batches(
            lambda account: _samples(scan, account), account, metadata, unit="byte", record="packet"
        )


def _why_no_time(scan: Scan) -> str:
    count = len(scan.offset)
    statuses = sorted(set(scan.status.tolist()))
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


def _samples(scan: Scan, account: Account) -> Iterator[Samples]:
    accuracy = np.nan
    for first, packets in scan.batches(account):
        accuracies = position_accuracy(packets, accuracy)
        accuracy = float(accuracies[-1])
        doubts = {
            number - first: why for number, why in scan.stamps.doubts.items() if 0 <= number - first < len(packets)
        }
        yield packet_samples(packets, accuracies, doubts)


def packet_samples(packets: NcomPackets, accuracy: npt.NDArray[np.float64], doubts: Mapping[int, str]) -> Samples:
    """Return packets as samples, with Wheelprint's axes and units.

    Args:
        packets: Of a file.
        accuracy: (n,) m, of `position_accuracy`.
        doubts: By number among these packets: why the time of one is not known or not believed.
    """
    from ..navigation import GRAVITY, INERTIAL_SIGNALS, SLOWEST_COURSE, Samples, is_on_earth
    from .ncom_fields import navigation

    valid = (packets.status == layout.LOCKING) | (packets.status == layout.LOCKED)
    rows = navigation(packets.raw, valid, SLOWEST_COURSE, GRAVITY)
    signals = dict(zip(("latitude", "longitude", "altitude", *INERTIAL_SIGNALS), rows, strict=True))
    impossible = {}
    if (damaged := valid & ~is_on_earth(*rows[:3])).any():
        latitude, longitude, altitude = packets.latitude, packets.longitude, packets.altitude
        impossible = {
            packet: (
                f"latitude {latitude[packet]:.9g} rad, longitude {longitude[packet]:.9g} rad, altitude "
                f"{altitude[packet]:.9g} m is nowhere on earth; the packet is damaged"
            )
            for packet in np.flatnonzero(damaged).tolist()
        }
    signals |= {"nav_status": packets.status, "position_accuracy": accuracy}
    return Samples(packets.offset, packets.time, packets.time_known, signals, {**doubts, **impossible})


def position_accuracy(packets: NcomPackets, held: float) -> npt.NDArray[np.float64]:
    """Return for each packet the horizontal accuracy, m, that status channel 3 told last; `held` before the first."""
    from .ncom_fields import held_position_accuracy

    accuracies: npt.NDArray[np.float64] = held_position_accuracy(packets.raw, packets.status, packets.channel, held)
    return accuracies
