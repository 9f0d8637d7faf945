"""When each NCOM packet was measured.

A packet holds its milliseconds within the GPS minute; the minute itself comes now and then, in status channel 0. The
packets are counted through by their milliseconds, and every channel 0 says where the count stands. What lies before
the first channel 0 is stamped backwards from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from .leap_seconds import GPS_EPOCH, gps_to_utc
from .ncom_layout import INITIALISING, LOCKED, STATUS_ONLY

MINUTE = 60_000
REORDERED = 2_000
"""ms; milliseconds that fall back by less are those of a packet out of order, by more those of a later minute."""
LONG_STEP = 1.5
"""A step between packets that is longer than the usual one by this factor may hide lost minutes."""

UtcFrom = Literal["status channel 16", "leap second table"]


@dataclass(frozen=True, slots=True)
class Notices:
    """A quantity that some packets carry in their status channel.

    Attributes:
        packet: int64 (m,), numbers of those packets, increasing.
        value: int64 (m,), GPS minutes since 1980-01-06, or UTC - GPS in seconds.
    """

    packet: npt.NDArray[np.int64]
    value: npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Stamps:
    """The times of a file's packets.

    Attributes:
        time: int64 (n,), ns since 1970, UTC; 0 where not known.
        known: bool (n,); never for a packet whose navigation status says that it carries no time.
        doubts: By number of the packet: why it has no time although its status says so, or why it is not believed.
        utc_from: Where the difference between GPS time and UTC comes from.
    """

    time: npt.NDArray[np.int64]
    known: npt.NDArray[np.bool_]
    doubts: dict[int, str]
    utc_from: UtcFrom


def stamp_packets(
    status: npt.NDArray[np.uint8], milliseconds: npt.NDArray[np.uint16], minutes: Notices, utc_offsets: Notices
) -> Stamps:
    """Stamp the packets of a file.

    Status-only packets have no milliseconds of their own: their minute is that of the packet before, and is not used
    within two seconds of a change of minute. Where two channel 0 disagree with the count between them, minutes were
    lost (or the clock was set) at the longest step between the two; if no step is long, what lies between is not
    stamped. A channel 0 that contradicts the equal ones before and after it is not believed.

    Args:
        status: (n,) navigation status.
        milliseconds: (n,) into the GPS minute.
        minutes: Valid GPS minutes; only those of packets that carry time or are status-only are used.
        utc_offsets: Valid UTC - GPS. Each holds until the next, the first one also before it; if there is none, the
            table of leap seconds is used.
    """
    from .ncom_sync import count_through

    doubts: dict[int, str] = {}
    carries_time = (status >= INITIALISING) & (status <= LOCKED)
    for packet in np.flatnonzero(carries_time & (milliseconds >= MINUTE)).tolist():
        doubts[packet] = f"{milliseconds[packet]} ms into the minute, of 0 to 59999; the packet is damaged"
    packets = np.flatnonzero(carries_time & (milliseconds < MINUTE))
    utc_from: UtcFrom = "status channel 16" if len(utc_offsets.packet) else "leap second table"
    if len(packets) == 0:
        return _stamps(len(status), packets, packets, doubts, utc_from)

    complete = len(packets) == len(status)
    within = milliseconds if complete else milliseconds[packets]
    gps = count_through(within)
    starts, located = _start(packets, within, gps, status, minutes, doubts)
    if starts is None:
        return _stamps(len(status), packets[:0], gps[:0], doubts, utc_from)
    # In place, here and below: a day of packets is long.
    gps += starts
    gps *= 1_000_000
    if len(utc_offsets.packet):
        ahead = GPS_EPOCH + utc_offsets.value * 1_000_000_000
        if (ahead == ahead[0]).all():
            gps += ahead[0]
        else:
            gps += ahead[np.maximum(np.searchsorted(utc_offsets.packet, packets, "right") - 1, 0)]
        utc = gps
    else:
        utc = gps_to_utc(gps)
    if complete and located.all():
        return Stamps(utc, located, doubts, utc_from)
    return _stamps(len(status), packets[located], utc[located], doubts, utc_from)


def _stamps(
    count: int, packets: npt.NDArray[np.intp], utc: npt.NDArray[np.int64], doubts: dict[int, str], utc_from: UtcFrom
) -> Stamps:
    """Return the stamps of so many packets of which these have one."""
    time, known = np.zeros(count, np.int64), np.zeros(count, bool)
    time[packets], known[packets] = utc, True
    return Stamps(time, known, doubts, utc_from)


def _steps(within: npt.NDArray[np.uint16]) -> npt.NDArray[np.int32]:
    """Return the steps (n - 1,) between milliseconds within the minute, as if each were forward."""
    forward = within.astype(np.int32)
    return (forward[1:] - forward[:-1]) % np.int32(MINUTE)


def _start(
    packets: npt.NDArray[np.intp],
    within: npt.NDArray[np.uint16],
    count: npt.NDArray[np.int64],
    status: npt.NDArray[np.uint8],
    minutes: Notices,
    doubts: dict[int, str],
) -> tuple[npt.NDArray[np.int64] | None, npt.NDArray[np.bool_]]:
    """Return where the count of each packet (or, (1,), of all) starts, in ms of GPS time, and of which it is known.

    None where it is known of no packet.
    """
    located = np.ones(len(packets), bool)
    carriers, minute, place = minutes.packet, minutes.value, minutes.packet
    if len(packets) < len(status):
        place = np.maximum(np.searchsorted(packets, carriers, "right") - 1, 0)
        inside = (within[place] >= REORDERED) & (within[place] < MINUTE - REORDERED)
        usable = (packets[place] == carriers) | ((status[carriers] == STATUS_ONLY) & inside)
        carriers, minute, place = carriers[usable], minute[usable], place[usable]
    start = minute * MINUTE - (count[place] - within[place])
    if len(start) and (start == start[0]).all():
        # As a rule all of them agree, and a log may hold one in every few packets.
        return start[:1], located
    alone = np.zeros(len(start), bool)
    alone[1:-1] = (start[1:-1] != start[:-2]) & (start[:-2] == start[2:])
    for packet, lone in zip(carriers[alone].tolist(), minute[alone].tolist(), strict=True):
        doubts[packet] = f"GPS minute {lone} contradicts the packets before and after it; the packet is damaged"
    place, start = place[~alone], start[~alone]
    if len(start) == 0:
        return None, located

    # Each holds until the next one, the first also before it.
    bounds = np.concatenate(([0], place[1:], [len(packets)]))
    changes = np.flatnonzero(start[1:] != start[:-1]).tolist()
    if not changes:
        return start[:1], located
    starts = np.repeat(start, np.diff(bounds))
    step = _steps(within)
    for change in changes:
        before, after = int(place[change]), int(place[change + 1])
        if after - before < 2:
            continue
        longest = before + int(np.argmax(step[before:after]))
        if step[longest] > LONG_STEP * np.median(step):
            starts[longest + 1 : after] = start[change + 1]
        else:
            located[before + 1 : after] = False
    for packet in packets[~located].tolist():
        doubts[packet] = (
            "the GPS minute changed somewhere between the channel 0 before and the one after it, without a step in the "
            "milliseconds; its minute cannot be known"
        )
    return starts, located
