"""What is wrong with a message of a database: what makes it impossible to decode, and what is taken as it is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

from .repair import Repair

if TYPE_CHECKING:
    from .database import MessageLayout, SignalLayout

LARGEST = 1e300
"""Scale and offset are smaller."""


def complaints(message: MessageLayout) -> list[str]:
    """Say what makes a message impossible to decode."""
    by_name = {signal.name: signal for signal in message.signals}
    bits = 29 if message.extended else 11
    found = [] if 0 <= message.id < 1 << bits else [f"its identifier {message.id} is not one of {bits} bits"]
    found += ["it has no name"] if not message.name else []
    found += ["a signal has no name"] if not all(by_name) else []
    found += [
        f"{count} signals are called {name}; rename all but one"
        for name, count in Counter(signal.column for signal in message.signals).items()
        if count > 1
    ]
    for signal in message.signals:
        if signal.start < 0 or signal.length < 1:
            found.append(f"signal {signal.name} has {signal.length} bits from bit {signal.start}")
        if signal.is_float and signal.length not in (16, 32, 64):
            found.append(f"signal {signal.name} is a float of {signal.length} bits, where 16, 32 and 64 exist")
        if not (abs(signal.scale) < LARGEST and abs(signal.offset) < LARGEST):
            found.append(f"signal {signal.name} has a scale or offset beyond {LARGEST:g}")
        chain = [signal.name]
        while (parent := by_name[chain[-1]].multiplexer) is not None and len(chain) == len(set(chain)):
            if parent not in by_name:
                found.append(f"signal {chain[-1]} is selected by {parent}, which is not there")
                break
            if by_name[parent].length > 64:
                found.append(f"multiplexer {parent} has {by_name[parent].length} bits, more than 64")
                break
            chain.append(parent)
        if len(chain) > len(set(chain)):
            found.append(f"multiplexers select each other: {' by '.join(chain)}")
    return found


def tolerated(path: Path, message: MessageLayout, lines: Mapping[int, int]) -> list[Repair]:
    """List what other tools refuse and the decoder takes as it is."""
    line = lines.get(message.id | message.extended << 31)
    where = f"line {line}" if line else ""
    by_name = {signal.name: signal for signal in message.signals}
    found = [
        (
            f"signal {signal.name} of message {message.label} ends in byte {(stop + 7) // 8} of {message.length}",
            "kept; it is null in frames that are too short for it",
        )
        for signal in message.signals
        if (stop := signal.first_bit + signal.length) > 8 * message.length
    ]
    bits = {signal.name: _bits(signal) for signal in message.signals}
    found += [
        (f"signals {one.name} and {other.name} of message {message.label} overlap", "both are kept")
        for one, other in combinations(message.signals, 2)
        if bits[one.name] & bits[other.name] and not _exclude(one, other, by_name)
    ]
    return [Repair(str(path), where, what, done) for what, done in found]


def _bits(signal: SignalLayout) -> int:
    """Return a number whose ones are the signal's bits in the payload, bit 0 of byte 0 the least significant."""
    stop, ones = signal.first_bit + signal.length, (1 << signal.length) - 1
    if not signal.big_endian:
        return ones << signal.first_bit
    size = (stop + 7) // 8
    return int.from_bytes((ones << 8 * size - stop).to_bytes(size, "big"), "little")


def _exclude(one: SignalLayout, other: SignalLayout, by_name: Mapping[str, SignalLayout]) -> bool:
    """Tell whether multiplexers never select both signals."""
    selected = _selection(one, by_name)
    return any(
        selected.get(multiplexer, values).isdisjoint(values)
        for multiplexer, values in _selection(other, by_name).items()
    )


def _selection(signal: SignalLayout, by_name: Mapping[str, SignalLayout]) -> dict[str, frozenset[int]]:
    """Return the values of every multiplexer above a signal that select it."""
    selection: dict[str, frozenset[int]] = {}
    while signal.multiplexer is not None:
        selection[signal.multiplexer] = frozenset(signal.multiplexer_values)
        signal = by_name[signal.multiplexer]
    return selection
