"""Encoding of signals into payloads, the inverse of `decode`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from .database import MessageLayout, SignalLayout
from .decode import raw_range


def encode_payloads(layout: MessageLayout, values: Mapping[str, npt.ArrayLike]) -> npt.NDArray[np.uint8]:
    """Encode physical values, each rounded to the nearest raw value and limited to what its bits hold.

    Bits of signals that are not given are 0, so are those of an integer signal where its value is NaN, and of a
    multiplexed one where the multiplexer given selects others. Signals whose bits overlap are or-ed.

    Args:
        layout: The message.
        values: By signal: (n,) physical values, or one for all rows.

    Returns:
        (n, `layout.length`) payloads.

    Raises:
        ValueError: A name is no signal of the message, or a signal cannot be encoded: more than 64 bits, bits outside
            the message, or a scale of 0.
    """
    by_name = {signal.name: signal for signal in layout.signals}
    wrong = [f"{name}: no such signal" for name in values if name not in by_name] + [
        f"{name}: cannot be encoded"
        for name in values
        if (signal := by_name.get(name)) is not None
        and (signal.length > 64 or signal.first_bit + signal.length > 8 * layout.length or signal.scale == 0)
    ]
    if wrong:
        raise ValueError(f"message {layout.label}: {'; '.join(wrong)}")
    arrays = dict(zip(values, np.broadcast_arrays(*(np.atleast_1d(value) for value in values.values())), strict=True))
    raw = {name: _raw_bits(by_name[name], array) for name, array in arrays.items()}
    n, n_words = len(next(iter(arrays.values()), ())), layout.length // 8 + 1
    little, big = np.zeros((n_words, n), np.uint64), np.zeros((n_words, n), np.uint64)
    for name, bits in raw.items():
        signal = by_name[name]
        given = np.where(_is_selected(signal, by_name, raw, n), bits, np.uint64(0))
        word, shift = divmod(signal.first_bit, 64)
        beyond = shift + signal.length - 64
        if signal.big_endian:
            big[word] |= given << np.uint64(-beyond) if beyond <= 0 else given >> np.uint64(beyond)
            if beyond > 0:
                big[word + 1] |= given << np.uint64(64 - beyond)
        else:
            little[word] |= given << np.uint64(shift)
            if beyond > 0:
                little[word + 1] |= given >> np.uint64(64 - shift)
    payloads = np.ascontiguousarray(little.T).astype("<u8").view(np.uint8)
    payloads |= np.ascontiguousarray(big.T).astype(">u8").view(np.uint8)
    return np.ascontiguousarray(payloads[:, : layout.length])


def _raw_bits(signal: SignalLayout, values: npt.NDArray[np.generic]) -> npt.NDArray[np.uint64]:
    """Return (n,) raw values as the unsigned numbers that their bits are."""
    if signal.is_float:
        size = signal.length // 8
        with np.errstate(over="ignore"):
            floats = ((values.astype(np.float64) - signal.offset) / signal.scale).astype(f"f{size}")
        return floats.view(f"u{size}").astype(np.uint64)
    low, high = raw_range(signal)
    bits: npt.NDArray[np.uint64]
    if values.dtype.kind in "iu" and (signal.scale, signal.offset) == (1, 0):
        # Integers that float64 does not hold stay what they are.
        if values.dtype.kind == "u":
            bits = np.minimum(values.astype(np.uint64), np.uint64(high))
        else:
            bits = np.clip(values.astype(np.int64), low, min(high, 2**63 - 1)).view(np.uint64)
    else:
        exact = np.rint((values.astype(np.float64) - signal.offset) / signal.scale)
        # float64 rounds the end of a 64-bit range up, beyond it.
        last = float(high) if float(high) <= high else np.nextafter(float(high), 0)
        limited = np.where(np.isnan(exact), 0, np.clip(exact, float(low), last))
        bits = limited.astype(np.int64 if signal.signed else np.uint64).view(np.uint64)
    return bits & np.uint64((1 << signal.length) - 1)


def _is_selected(
    signal: SignalLayout, by_name: Mapping[str, SignalLayout], raw: Mapping[str, npt.NDArray[np.uint64]], n: int
) -> npt.NDArray[np.bool_]:
    if signal.multiplexer is None:
        return np.ones(n, bool)
    bits = raw.get(signal.multiplexer, np.zeros(n, np.uint64))
    selected = np.isin(bits, np.array(signal.multiplexer_values, np.uint64))
    return selected & _is_selected(by_name[signal.multiplexer], by_name, raw, n)


def byd_checksum(payloads: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return what byte 7 of BYD's messages holds: the complement of the sum of bytes 0 to 6, of (n, 8) payloads."""
    total: npt.NDArray[np.uint8] = payloads[:, :7].sum(axis=1, dtype=np.uint8)
    return ~total
