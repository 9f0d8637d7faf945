"""Which message a frame is: by its identifier or, in J1939, by its parameter group, on the message's bus.

A J1939 identifier (SAE J1939-21, 5.2) holds, from the most significant bit: priority (3 bits), extended data page,
data page, PDU format (8), PDU specific (8) and the sender's address (8). The parameter group number (PGN) is the 18
bits from the extended data page to the PDU specific byte; where the format is below 240 (PDU1) that byte is the
receiver's address and counts as 0 in the number.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from .database import MessageLayout

ANY_SOURCE = 0xFE
"""Null address: a message that a database writes with it may come from anyone."""

_STANDARD_IDS = 0x800
_ADDRESSED = 0x03FF_FFFF  # an identifier without its priority
_BY_ADDRESS, _BY_GROUP = 2 << 32, 3 << 32  # beside plain identifiers, below 2 << 32


def parameter_group(identifier: int) -> int:
    """Return the PGN of a 29-bit identifier."""
    return int(_groups(np.array([identifier]))[0])


def is_addressed(identifier: int) -> bool:
    """Tell whether a 29-bit identifier is a PDU1: it names a receiver."""
    return identifier >> 16 & 0xFF < 240


def _groups(identifiers: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    groups: npt.NDArray[np.int64] = identifiers >> 8 & 0x3FFFF
    return np.where(groups >> 8 & 0xFF < 240, groups & 0x3FF00, groups)


def identity(message: MessageLayout) -> Hashable:
    """Return what no two messages of one bus may share."""
    if not message.j1939:
        return message.id, message.extended
    if message.id & 0xFF == ANY_SOURCE:
        return "group", parameter_group(message.id)
    return "address", message.id & _ADDRESSED


def find_messages(
    messages: Sequence[MessageLayout],
    identifiers: npt.NDArray[np.uint32],
    extended: npt.NDArray[np.bool_],
    channel: str,
) -> npt.NDArray[np.uint16]:
    """Find the messages of frames from one bus.

    A message of a database for another bus is not looked at. A whole identifier goes before J1939. Where several J1939
    messages have the same PGN, each stands for the frames from its own address (and, in PDU1, to its own receiver), and
    one with the null address for those of all others; else the PGN alone decides, whatever priority and address are.

    Args:
        messages: Of a database.
        identifiers: (n,) without flag bits.
        extended: (n,) 29-bit identifier.
        channel: The bus.

    Returns:
        (n,) index of the message, `len(messages)` where there is none.
    """
    from .grouping import by_standard_identifier

    here = [(k, m) for k, m in enumerate(messages) if m.channel in (None, channel)]
    same_group = Counter(parameter_group(m.id) for _, m in here if m.j1939)
    keys: dict[int, int] = {}
    for index, message in here:
        if not message.j1939:
            key = message.id | message.extended << 32
        elif same_group[group := parameter_group(message.id)] == 1 or message.id & 0xFF == ANY_SOURCE:
            key = group | _BY_GROUP
        else:
            key = message.id & _ADDRESSED | _BY_ADDRESS
        keys.setdefault(key, index)
    standard = np.full(_STANDARD_IDS + 1, len(messages), np.uint16)
    for key, index in keys.items():
        if key < _STANDARD_IDS:
            standard[key] = index
    found: npt.NDArray[np.uint16] = by_standard_identifier(identifiers, extended, standard)
    rows = np.flatnonzero(extended)
    if not keys or not len(rows):
        return found
    known = np.array(sorted(keys), np.int64)
    indexes = np.array([keys[key] for key in known.tolist()], np.uint16)
    numbers = identifiers[rows].astype(np.int64)

    def look_up(rows: npt.NDArray[np.intp], wanted: npt.NDArray[np.int64]) -> None:
        place = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
        found[rows] = np.where(known[place] == wanted, indexes[place], found[rows])

    look_up(rows, numbers | 1 << 32)
    for kind in (_BY_ADDRESS, _BY_GROUP):
        if any(key & _BY_GROUP == kind for key in keys):
            left = found[rows] == len(messages)
            wanted = numbers[left] & _ADDRESSED if kind == _BY_ADDRESS else _groups(numbers[left])
            look_up(rows[left], wanted | kind)
    return found
