from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.ingest.can.text_words import decimal_word, first_of, line_ends

EIGHT = st.binary(min_size=8, max_size=8)


def word(characters: bytes) -> np.uint64:
    return np.uint64(int.from_bytes(characters, "little"))


@given(st.one_of(EIGHT, st.integers(0, 99_999_999).map(lambda number: b"%08d" % number)))
def test_eight_decimal_digits_are_a_number(characters: bytes) -> None:
    value, bad = decimal_word(word(characters))
    if all(48 <= character <= 57 for character in characters):
        assert (int(value), bad) == (int(characters), False)
    else:
        assert bad


@pytest.mark.parametrize("place", range(8))
def test_every_other_character_is_seen_at_every_place(place: int) -> None:
    for character in range(256):
        characters = b"0" * place + bytes([character]) + b"0" * (7 - place)
        assert decimal_word(word(characters))[1] == (character not in b"0123456789")


@given(EIGHT, st.integers(0, 9))
def test_the_first_characters_are_kept(characters: bytes, count: int) -> None:
    assert first_of(word(characters), count) == word(characters[:count].ljust(8, b"\0"))


@given(st.one_of(st.binary(max_size=300), st.text("\n\x09\x0b\x0a1", max_size=300).map(str.encode)))
def test_line_ends_are_those_of_a_plain_search(text: bytes) -> None:
    wanted = [place for place, character in enumerate(text) if character == 10]
    assert line_ends(np.frombuffer(text, np.uint8)).tolist() == wanted
