"""Random messages, as cantools knows them."""

from __future__ import annotations

from typing import Any

import pytest
from cantools.database import Message, Signal
from cantools.database.conversion import BaseConversion
from hypothesis import strategies as st

# (scale, offset) as databases have them: identities, integers, fractions, and the mixture that Python computes exactly.
CONVERSIONS = ((1, 0), (1, 0), (2, -5), (-3, 7), (0.1, -40), (0.5, 0), (1, 0.5), (3, 0.25), (1e-6, -90), (10**6, 1))

Path = dict[str, int]
"""The values of the multiplexers above a signal that select it."""


def _exclude(path: Path, other: Path) -> bool:
    """Tell whether two signals are never there together."""
    return any(other.get(name, value) != value for name, value in path.items())


@st.composite
def random_message(draw: Any, floats: bool) -> Message:
    """Draw a message of 1 to 64 bytes whose signals do not overlap wherever they are there together."""
    length = draw(st.sampled_from([1, 2, 5, 8, 8, 8, 12, 64]))
    occupied: list[tuple[Path, set[int]]] = []
    # Every multiplexer so far with the path of multiplexer values that selects it.
    multiplexers: list[tuple[str, Path]] = []
    signals = []
    for k in range(draw(st.integers(1, 9))):
        is_multiplexer = draw(st.integers(0, 3)) == 0
        is_float = floats and not is_multiplexer and draw(st.integers(0, 4)) == 0
        size = draw(
            st.sampled_from([16, 32, 64]) if is_float else st.integers(2, 4) if is_multiplexer else st.integers(1, 64)
        )
        if size > 8 * length:
            continue
        big, first = draw(st.booleans()), draw(st.integers(0, 8 * length - size))
        bits = {bit ^ 7 if big else bit for bit in range(first, first + size)}
        parent, above = draw(st.sampled_from([(None, {}), *multiplexers]))
        values = sorted(draw(st.sets(st.integers(0, 3), min_size=1, max_size=1 if is_multiplexer else 2)))
        paths = [above | {parent: value} for value in values] if parent else [above]
        if any(bits & others and not _exclude(path, other) for path in paths for other, others in occupied):
            continue
        occupied.extend((path, bits) for path in paths)
        name = f"s{k}"
        if is_multiplexer:
            multiplexers.append((name, paths[0]))
        scale, offset = (1, 0) if is_multiplexer else draw(st.sampled_from(CONVERSIONS))
        signals.append(
            Signal(
                name,
                first ^ 7 if big else first,
                size,
                "big_endian" if big else "little_endian",
                is_signed=not is_multiplexer and draw(st.booleans()),
                conversion=BaseConversion.factory(scale, offset, draw(st.sampled_from([None, {1: "one"}])), is_float),
                is_multiplexer=is_multiplexer,
                multiplexer_ids=values if parent else None,
                multiplexer_signal=parent,
            )
        )
    return Message(0x123, "M", length, signals, strict=True)


@pytest.fixture(scope="session")
def messages() -> st.SearchStrategy[Message]:
    return random_message(floats=True)


@pytest.fixture(scope="session")
def integer_messages() -> st.SearchStrategy[Message]:
    return random_message(floats=False)
