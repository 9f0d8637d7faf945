"""Numbers that no CAN database means, refused before they take the memory."""

from __future__ import annotations

import re
from pathlib import Path

from ...schemas.errors import InputError

_LONGEST_MESSAGE = 4096  # bytes; what ISO-TP and J1939 carry in several frames is below
_MOST_BITS = 8 * _LONGEST_MESSAGE
_MOST_VALUES = 65536  # of a multiplexer, in one range
_LONGEST_PDU = 1 << 20  # bits; an ARXML file describes other networks too
_IN_BYTES, _IN_BITS = "bytes in a message", "bits in a signal"
_AT_BIT, _IN_EITHER = "as start bit of a signal", "bytes in a message or bits in a signal"
_LIMITS = {
    "dbc": (
        (r"^[ \t]*BO_\s+\d+\s+\w+\s*:\s*(\d+)", _LONGEST_MESSAGE, _IN_BYTES),
        (r"^[ \t]*SG_\s[^:\n]*:\s*(\d+)\s*\|", _MOST_BITS, _AT_BIT),
        (r"^[ \t]*SG_\s[^:\n]*:\s*\d+\s*\|\s*(\d+)", _MOST_BITS, _IN_BITS),
    ),
    "kcd": (
        (r"\slength\s*=\s*[\"']\s*0*(\d+)", _MOST_BITS, _IN_EITHER),
        (r"\soffset\s*=\s*[\"']\s*0*(\d+)", _MOST_BITS, _AT_BIT),
    ),
    "sym": (
        (r"^[ \t]*(?:Len|DLC)\s*=\s*(\d+)", _LONGEST_MESSAGE, _IN_BYTES),
        (r"^[ \t]*(?:Sig|Var)\s*=.*?\s(?:bit|signed|unsigned|float|double|string|char)\s+(\d+)", _MOST_BITS, _IN_BITS),
        (r"^[ \t]*(?:Sig|Var|Mux)\s*=.*?\s(\d+)(?:\s*,\s*\d+|[ \t]*(?:-[a-z]|//|$))", _MOST_BITS, _AT_BIT),
        (r"^[ \t]*(?:Var|Mux)\s*=.*?\s\d+\s*,\s*(\d+)", _MOST_BITS, _IN_BITS),
    ),
    "arxml": (
        (r"<(?:\w+:)?(?:FRAME-)?LENGTH>\s*0*(\d+)", _LONGEST_PDU, _IN_EITHER),
        (r"<(?:\w+:)?START-POSITION>\s*0*(\d+)", _LONGEST_PDU, _AT_BIT),
    ),
}
"""By kind of database: where a number stands, the most it may be, and what it counts."""


def refuse_monsters(path: Path, text: str, kind: str) -> None:
    """Refuse numbers for which cantools would take gigabytes of memory, as a damaged or hostile database has them.

    Args:
        path: Named in the error.
        text: The file.
        kind: `dbc`, `kcd`, `sym` or `arxml`.

    Raises:
        InputError: There is one; it says where.
    """
    for pattern, limit, what in _LIMITS[kind]:
        for match in re.finditer(pattern, text, re.MULTILINE):
            if len(match[1]) > 9 or int(match[1]) > limit:
                raise InputError(
                    path,
                    f"line {text.count(chr(10), 0, match.start(1)) + 1}",
                    f"{match[1]} {what}, where at most {limit} make sense; the file is damaged or not meant for CAN",
                )
    if kind != "dbc":
        return
    for statement in re.finditer(r"^[ \t]*SG_MUL_VAL_\s[^;]*", text, re.MULTILINE):
        for low, high in re.findall(r"(\d+)\s*-\s*(\d+)", statement[0]):
            if len(low + high) > 40 or int(high) - int(low) > _MOST_VALUES:
                raise InputError(
                    path,
                    f"line {text.count(chr(10), 0, statement.start()) + 1}",
                    f"a multiplexed signal with the values {low}-{high}, where at most {_MOST_VALUES} make sense; "
                    "the file is damaged",
                )
