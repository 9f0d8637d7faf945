"""Reader of XCOM, the log of newer OxTS units: NCOM packets, each with its GPS time, in an Ogg container."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ...schemas.errors import InputError
from .. import ogg
from ..account import Account
from ..text import quote
from . import ncom_layout as layout
from .leap_seconds import BEYOND_TABLE, VALID_UNTIL, gps_to_utc
from .ncom import packet_samples, position_accuracy
from .ncom_packets import NcomPackets

if TYPE_CHECKING:
    import pyarrow as pa

    from ..navigation import Samples

BATCH = 16_384
"""Packets of a batch."""
TEXT = b"[OxTS-"
"""What packets of text begin with, such as `[OxTS-NCom]headers=1`."""
STAMP = 8
"""Bytes of the time before each NCOM packet."""
FIRST_VALID = layout.FIRST_VALID_MINUTE * 60_000_000_000
LAST_VALID = layout.LAST_VALID_MINUTE * 60_000_000_000


@dataclass(frozen=True, slots=True)
class Xcom:
    """An XCOM file.

    A packet of data is a 64-bit little-endian count of ns since GPS time began (1980-01-06) and an NCOM packet of 72
    bytes; its minute and milliseconds are not used. UTC is from the table of leap seconds.

    Attributes:
        path: The file, plain or compressed.
    """

    format: ClassVar[str] = "xcom"
    kind: ClassVar[str] = "nav"

    path: Path

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Tell whether `head` begins an Ogg stream and holds the text that names NCOM."""
        return head.startswith(ogg.CAPTURE) and b"[OxTS-NCom]" in head

    def batches(self, account: Account) -> Iterator[pa.RecordBatch]:
        """Yield the navigation samples in the order of time, in the schema `NAVIGATION`, as of NCOM (see `Ncom`).

        Args:
            account: Every Ogg packet is a record; those of text are accepted, too. Rejected are damaged pages and
                packets, and those whose time is not known although their status says so, or does not increase.

        Raises:
            InputError: The file cannot be read, or holds no packet of data.
        """
        from ..navigation import navigation_batches

        latest, data = 0, 0

        def read(account: Account) -> Iterator[Samples]:
            nonlocal latest, data
            accuracy, latest, data = np.nan, 0, 0
            numbered = ogg.packets(self.path, account)
            while batch := list(islice(numbered, BATCH)):
                found = []
                for offset, content in batch:
                    if why := _why_no_data(content):
                        account.reject(f"byte {offset}", why)
                    elif content.startswith(TEXT):
                        account.accepted += 1
                    else:
                        found.append((offset, content))
                if found:
                    data += len(found)
                    samples, accuracy = _samples(found, accuracy)
                    latest = max(latest, int(samples.time[samples.timed].max(initial=0)))
                    yield samples

        metadata = {"utc_from": "leap second table"}
        yield from navigation_batches(read, account, metadata, unit="byte", record="packet")
        if not data:
            reason = (
                "holds no packet of data (8 bytes of time and 72 of NCOM) in its Ogg stream; the unit may have been "
                "switched off before it wrote any, or the file is damaged"
            )
            raise InputError(self.path, "", reason)
        if latest >= VALID_UNTIL:
            account.remarks.append(("", f"the log's times are GPS time, and {BEYOND_TABLE}"))


def _why_no_data(content: bytes) -> str:
    """Return why a packet is neither text nor data, empty if it is."""
    if content.startswith(TEXT):
        return ""
    if len(content) != STAMP + layout.LENGTH:
        return f"expected 80 bytes (time and an NCOM packet) or text; found {len(content)}: {quote(content)}"
    if content[STAMP] != layout.SYNC or sum(content[STAMP + 1 : -1]) & 0xFF != content[-1]:
        return "expected an NCOM packet (from 0xE7 to a matching checksum) after the time; it is damaged"
    return ""


def _samples(found: list[tuple[int, bytes]], held: float) -> tuple[Samples, float]:
    """Return packets of data as samples, and the position accuracy that holds after them."""
    records = np.frombuffer(b"".join(content for _, content in found), np.uint8).reshape(-1, STAMP + layout.LENGTH)
    raw = records[:, STAMP:].copy()
    stamps = [struct.unpack_from("<Q", content)[0] for _, content in found]
    known = np.array([FIRST_VALID <= stamp < LAST_VALID for stamp in stamps])
    gps = np.array([stamp if stamp < LAST_VALID else 0 for stamp in stamps], np.int64)
    status = raw[:, 21].copy()
    carries_time = (status >= layout.INITIALISING) & (status <= layout.LOCKED)
    offset = np.array([place for place, _ in found], np.int64)
    packets = NcomPackets(offset, gps_to_utc(gps), known & carries_time, status, raw[:, 62].copy(), raw)
    doubts = {
        index: f"its time, {stamps[index]} ns since GPS began, is none that a unit with GNSS time can tell"
        for index in np.flatnonzero(carries_time & ~known).tolist()
    }
    accuracies = position_accuracy(packets, held)
    return packet_samples(packets, accuracies, doubts), float(accuracies[-1])
