"""Real CAN logs and databases: every line counted, every value that of python-can and cantools."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import can
import cantools
import numpy as np
import pytest
from cantools.database import DecodeError, Message, Signal

from wheelprint.ingest.account import Account
from wheelprint.ingest.can.candump import Candump
from wheelprint.ingest.can.database import load_database
from wheelprint.ingest.can.decode import decode, decode_payloads
from wheelprint.ingest.can.frames import FrameBatch

DATABASES = (
    "giulia/giulia.dbc",
    "rav4/rav4.dbc",
    "gr86/car.dbc",
    "canedge/OBD-v4.4.dbc",
    "canedge/canmod-gps.dbc",
    "canedge/canmod-gnss.dbc",
    "canedge/canedge-internal-can9.dbc",
    "canedge/CSS-Electronics-SAE-J1939-DEMO.dbc",
)
LOGS = (
    "giulia/exp2.log.gz",
    "giulia/exp3.log",
    "rav4/can.log",
    "gr86/raw/car72/indianapolis_01/can.log",
    "gr86/raw/car98/indianapolis_02/can.log",
)


def lines_of(path: Path) -> list[str]:
    content = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
    return [line for line in content.decode("ascii").split("\n") if line.strip()]


def read(path: Path) -> tuple[list[FrameBatch], Account]:
    account = Account()
    return list(Candump(path).batches(account)), account


@pytest.mark.parametrize("name", LOGS)
def test_every_line_is_a_frame_and_the_one_that_python_can_reads(shared_data: Path, tmp_path: Path, name: str) -> None:
    lines = lines_of(shared_data / name)
    batches, account = read(shared_data / name)
    assert account == Account(accepted=len(lines))
    assert sum(map(len, batches)) == len(lines)
    sample = tmp_path / "sample.log"
    chosen = sorted(np.random.default_rng(3).choice(len(lines), 3000, replace=False))
    sample.write_text("".join(lines[k] + "\n" for k in chosen))
    starts = np.cumsum([0, *map(len, batches)])
    for k, message in zip(chosen, can.io.CanutilsLogReader(sample), strict=True):
        number = int(np.searchsorted(starts, k, "right")) - 1
        batch, row = batches[number], int(k - starts[number])
        # These logs have microseconds, which python-can keeps in a float.
        assert batch.time[row] == round(message.timestamp * 1e6) * 1000
        assert batch.id[row] == message.arbitration_id
        assert batch.extended[row] == message.is_extended_id
        assert batch.channels[batch.channel[row]] == message.channel
        assert bytes(batch.data[row, : batch.length[row]]) == bytes(message.data)
        assert (batch.fd[row], batch.kind[row]) == (message.is_fd, message.is_remote_frame)


def test_the_other_logs_of_the_race_have_as_many_frames_as_lines(shared_data: Path) -> None:
    for path in sorted((shared_data / "gr86").rglob("can.log")):
        batches, account = read(path)
        assert account == Account(accepted=len(lines_of(path)))
        assert sum(map(len, batches)) == account.accepted


def alone(message: Message, signal: Signal) -> Message:
    single = Signal(
        signal.name, signal.start, signal.length, signal.byte_order, signal.is_signed, conversion=signal.conversion
    )
    return Message(0, message.name, message.length, [single], strict=False)


def undefined(message: Message, payload: bytes) -> dict[str, Any]:
    """Decode what cantools refuses: overlapping signals, and multiplexers with values that nothing has."""
    values: dict[str, Any] = {}
    for signal in message.signals:
        above, there = signal, True
        while there and above.multiplexer_signal is not None:
            parent = message.get_signal_by_name(above.multiplexer_signal)
            raw = alone(message, parent).decode_simple(payload, decode_choices=False, scaling=False)[parent.name]
            there, above = raw in above.multiplexer_ids, parent
        if there:
            values |= alone(message, signal).decode_simple(payload, decode_choices=False)
    return values


@pytest.mark.parametrize("name", DATABASES)
def test_every_message_of_every_database_equals_cantools(shared_data: Path, name: str) -> None:
    database = load_database([name], shared_data)
    messages = cantools.database.load_file(shared_data / name, strict=False).messages
    assert [(m.name, m.frame_id, m.is_extended_frame) for m in messages] == [
        (m.name, m.id, m.extended) for m in database.messages
    ]
    rng = np.random.default_rng(11)
    n = 100
    for message, layout in zip(messages, database.messages, strict=True):
        payloads = [rng.bytes(message.length) for _ in range(n)]
        payloads[n // 2 :] = [select_known(message, payload, rng) for payload in payloads[n // 2 :]]
        data = np.array([list(payload.ljust(8, b"\0")) for payload in payloads], np.uint8)
        columns = decode_payloads(layout, data, np.full(n, message.length, np.uint8))
        for k, payload in enumerate(payloads):
            try:
                wanted = message.decode(payload, decode_choices=False)
            except DecodeError:
                wanted = undefined(message, payload)
            got = {name: value for name in columns if (value := columns[name][k].as_py()) is not None}
            assert got == wanted
            assert [type(got[key]) for key in wanted] == [type(value) for value in wanted.values()]


def select_known(message: Message, payload: bytes, rng: np.random.Generator) -> bytes:
    """Write values of multiplexers, all big-endian here, that select something, from the outermost inwards."""
    number, level = int.from_bytes(payload, "big"), message.signal_tree
    while nodes := [node for node in level if isinstance(node, dict)]:
        ((name, children),) = nodes[0].items()
        signal = message.get_signal_by_name(name)
        shift = 8 * len(payload) - (signal.start ^ 7) - signal.length
        value = int(rng.choice(sorted(children)))
        number = number & ~((1 << signal.length) - 1 << shift) | value << shift
        level = children[value]
    return number.to_bytes(len(payload), "big")


def test_real_traffic_equals_cantools(shared_data: Path) -> None:
    batches, _ = read(shared_data / "rav4" / "can.log")
    database = cantools.database.load_file(shared_data / "rav4" / "rav4.dbc", strict=False)
    tables = decode(batches[0], load_database(["rav4/rav4.dbc"], shared_data))
    by_id = {message.frame_id: message for message in database.messages}
    seen: dict[str, int] = {}
    for row in range(20_000):
        message = by_id.get(int(batches[0].id[row]))
        if message is None:
            continue
        k = seen.get(message.name, 0)
        seen[message.name] = k + 1
        try:
            wanted = message.decode(batches[0].data[row].tobytes(), decode_choices=False)
        except DecodeError:
            wanted = undefined(message, batches[0].data[row].tobytes())
        assert {name: tables[message.name][name][k].as_py() for name in wanted} == wanted
        assert tables[message.name]["time"][k].value == batches[0].time[row]
    assert len(seen) > 20


def test_steering_against_yaw_rate_over_speed(shared_data: Path) -> None:
    """In the Giulia steering is positive to the other side than yaw: what is decoded has to be the car."""
    batches, _ = read(shared_data / "giulia" / "exp2.log.gz")
    database = load_database(["giulia/giulia.dbc"], shared_data)
    messages = [decode(batch, database) for batch in batches]

    def column(message: str, signal: str) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        tables = [tables[message] for tables in messages]
        return (
            np.concatenate([table["time"].to_numpy().astype(np.int64) for table in tables]) / 1e9,
            np.concatenate([table[signal].to_numpy() for table in tables]),
        )

    yaw = next(message for message in database.messages if message.id == 254)
    time, steering = column("EPS_1", "STEERING_ANGLE")
    speed = np.interp(time, *column("ABS_1", "WHEEL_SPEED_RL"))
    rate = np.interp(time, *column(yaw.name, "YAW_RATE"))
    moving = speed > 5
    assert np.corrcoef(steering[moving], rate[moving] / speed[moving])[0, 1] < -0.99
