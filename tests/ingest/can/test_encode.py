from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cantools.database import Message
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.ingest.can.database import MessageLayout, SignalLayout, _message_layout
from wheelprint.ingest.can.decode import decode_payloads, raw_range
from wheelprint.ingest.can.encode import byd_checksum, encode_payloads


def layout_of(*signals: SignalLayout, length: int = 8) -> MessageLayout:
    return MessageLayout("M", 0x123, False, length, "", signals)


def decode_again(layout: MessageLayout, payloads: np.ndarray[Any, Any]) -> dict[str, list[Any]]:
    width = 8 if layout.length <= 8 else 64
    data = np.zeros((len(payloads), width), np.uint8)
    data[:, : layout.length] = payloads
    lengths = np.full(len(payloads), layout.length, np.uint8)
    return {name: column.to_pylist() for name, column in decode_payloads(layout, data, lengths).items()}


@given(data=st.data(), seed=st.integers(0, 2**32))
def test_decoding_what_was_encoded_gives_it_back(
    messages: st.SearchStrategy[Message], data: st.DataObject, seed: int
) -> None:
    layout = _message_layout(data.draw(messages), "")
    rng = np.random.default_rng(seed)
    # What float64 cannot hold cannot come back; 44 bits and the scales that are drawn can.
    keep = [
        s
        for s in layout.signals
        if (s.is_float and s.scale == 1 and s.offset == 0) or (not s.is_float and s.length <= 44)
    ]
    payloads = rng.integers(0, 256, (10, layout.length), dtype=np.uint8)
    columns = decode_again(layout, payloads)
    values = {s.name: np.array(columns[s.column], np.float64) for s in keep}
    if not values:
        return
    again = decode_again(layout, encode_payloads(layout, values))
    for signal in keep:
        chain = [signal]
        while chain[-1].multiplexer is not None:
            chain.append(next(s for s in layout.signals if s.name == chain[-1].multiplexer))
        if all(s in keep for s in chain):
            assert again[signal.name] == columns[signal.name], signal


@given(data=st.data(), seed=st.integers(0, 2**32))
def test_encodes_like_cantools(integer_messages: st.SearchStrategy[Message], data: st.DataObject, seed: int) -> None:
    message = data.draw(integer_messages)
    if message.is_multiplexed():
        return
    layout = _message_layout(message, "")
    rng = np.random.default_rng(seed)
    low_high = {s.name: (raw_range(s), s) for s in layout.signals if s.length <= 44}
    values = {name: float(rng.uniform(*ends)) * s.scale + s.offset for name, (ends, s) in low_high.items()}
    if not values:
        return
    wanted = message.encode({s.name: values.get(s.name, 0) for s in layout.signals}, strict=False)
    got, expected = decode_again(layout, encode_payloads(layout, values)), message.decode_simple(wanted, False)
    assert {name: got[name] for name in values} == {name: [expected[name]] for name in values}


def test_rounds_to_the_nearest_and_limits_to_the_range() -> None:
    layout = layout_of(
        SignalLayout("unsigned", 0, 8, scale=0.5, offset=10),
        SignalLayout("signed", 8, 8, signed=True, scale=-2),
        length=2,
    )
    payloads = encode_payloads(
        layout,
        {
            "unsigned": np.array([10.0, 10.26, 10.24, 137.5, 1e9, -1e9, np.nan, np.inf]),
            "signed": np.array([0.0, 2.0, -6.9, 300.0, -300.0, 3.1, np.nan, -np.inf]),
        },
    )
    assert payloads.dtype == np.uint8
    assert payloads[:, 0].tolist() == [0, 1, 0, 255, 255, 0, 0, 255]
    assert payloads[:, 1].view(np.int8).tolist() == [0, -1, 3, -128, 127, -2, 0, 127]


def test_ends_of_64_bits() -> None:
    layout = layout_of(SignalLayout("s", 0, 64, signed=True))
    ends = [-(2**63), 2**63 - 1, -1, 2**53 + 1]
    assert encode_payloads(layout, {"s": np.array(ends)}).view("<i8")[:, 0].tolist() == ends
    limited = encode_payloads(layout, {"s": np.array([-1e30, 1e30])}).view("<i8")[:, 0].tolist()
    assert limited == [-(2**63), 2**63 - 1024]
    layout = layout_of(SignalLayout("u", 7, 64, big_endian=True))
    assert encode_payloads(layout, {"u": np.array([2**64 - 1], np.uint64)}).tobytes() == b"\xff" * 8
    assert encode_payloads(layout, {"u": np.array([-5])}).tobytes() == bytes(8)


def test_what_is_not_given_is_zero_and_one_value_serves_all_rows() -> None:
    layout = layout_of(SignalLayout("a", 0, 8), SignalLayout("b", 11, 12, big_endian=True), length=3)
    assert encode_payloads(layout, {"b": 0x321, "a": [1, 2]}).tolist() == [[1, 3, 0x21], [2, 3, 0x21]]
    assert encode_payloads(layout, {"b": [0xFFF]}).tolist() == [[0, 0x0F, 0xFF]]


def test_only_the_selected_signals_take_the_bits() -> None:
    layout = layout_of(
        SignalLayout("mode", 0, 8),
        SignalLayout("a", 8, 8, multiplexer="mode", multiplexer_values=(1, 2)),
        SignalLayout("b", 8, 8, multiplexer="mode", multiplexer_values=(3,)),
        length=2,
    )
    values = {"mode": np.array([1, 2, 3, 4]), "a": np.full(4, 0x0F), "b": np.full(4, 0xF0)}
    assert encode_payloads(layout, values).tolist() == [[1, 0x0F], [2, 0x0F], [3, 0xF0], [4, 0]]


def test_floats() -> None:
    layout = layout_of(
        SignalLayout("half", 0, 16, is_float=True),
        SignalLayout("single", 39, 32, is_float=True, big_endian=True, scale=2, offset=1),
        length=8,
    )
    payloads = encode_payloads(layout, {"half": [1.5, 1e9, np.nan], "single": [2.0, np.inf, np.nan]})
    halves = np.array([1.5, np.inf, np.nan]).astype("<f2").view(np.uint8).reshape(3, 2)
    singles = np.array([0.5, np.inf, np.nan]).astype(">f4").view(np.uint8).reshape(3, 4)
    assert payloads.tolist() == np.hstack([halves, np.zeros((3, 2), np.uint8), singles]).tolist()


def test_refuses_what_it_cannot_encode_all_at_once() -> None:
    layout = layout_of(
        SignalLayout("long", 0, 65),
        SignalLayout("outside", 60, 8),
        SignalLayout("flat", 0, 8, scale=0),
        SignalLayout("a", 0, 8),
    )
    with pytest.raises(ValueError, match="no such signal") as caught:
        encode_payloads(layout, {"c": 1, "a": 1, "long": 1, "outside": 1, "flat": 1})
    assert str(caught.value) == (
        "message M (0x123): c: no such signal; long: cannot be encoded; outside: cannot be encoded; "
        "flat: cannot be encoded"
    )


def test_nothing_given_is_no_rows() -> None:
    assert encode_payloads(layout_of(length=5), {}).shape == (0, 5)


def test_checksum_of_byd() -> None:
    payloads = np.array([[0] * 8, [1, 2, 3, 4, 5, 6, 7, 99], [255] * 8], np.uint8)
    assert byd_checksum(payloads).tolist() == [0xFF, 0xFF - 28, 0xFF - (7 * 255) % 256]
