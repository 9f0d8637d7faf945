"""Characters looked at together, against Python's own string functions."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from wheelprint.ingest.can.text_lanes import HEX_LANES, LANES, blanks_at, first_place, hex_at, newlines_at

TEXTS = st.one_of(
    st.binary(min_size=2 * LANES, max_size=2 * LANES),
    st.text("\n\r\t !0189aAfFgG`@/:\x7f", min_size=2 * LANES, max_size=2 * LANES).map(str.encode),
)


def look(text: Any, place: Any) -> Any:
    octets, digits = hex_at(text, place)
    return newlines_at(text, place), blanks_at(text, place), octets, digits


def lowest(places: Any) -> Any:
    return first_place(places)


looked_at, lowest_of = njit(look), njit(lowest)


def bits(of: list[bool]) -> int:
    return sum(1 << place for place, here in enumerate(of) if here)


@given(TEXTS, st.integers(0, LANES))
def test_every_lane_is_the_character_at_its_place(text: bytes, place: int) -> None:
    newlines, blanks, octets, digits = looked_at(np.frombuffer(text, np.uint8), np.uint64(place))
    seen, first = text[place : place + LANES], text[place : place + HEX_LANES]
    assert int(newlines) == bits([character == 10 for character in seen])
    assert int(blanks) == bits([character <= 32 for character in seen])
    assert int(digits) == bits([chr(character) in "0123456789abcdefABCDEF" for character in first])
    only_digits = "".join(chr(c) if chr(c) in "0123456789abcdefABCDEF" else "0" for c in first)
    assert int(octets).to_bytes(8, "little") == bytes.fromhex(only_digits)


@given(st.integers(0, 2**64 - 1))
def test_the_first_place_is_the_lowest_bit(places: int) -> None:
    wanted = 64 if places == 0 else (places & -places).bit_length() - 1
    assert int(lowest_of(np.uint64(places))) == wanted
