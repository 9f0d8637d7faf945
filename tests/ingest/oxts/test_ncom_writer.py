"""The writer of NCOM logs, read back."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.ingest.account import Account
from wheelprint.ingest.oxts.ncom import Ncom
from wheelprint.ingest.oxts.ncom_packets import NcomPackets
from wheelprint.ingest.oxts.ncom_writer import write_ncom


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "nav.ncom"


def read_packets(path: Path) -> NcomPackets:
    account = Account()
    (packets,) = Ncom(path).packets(account)
    assert account == Account(accepted=path.stat().st_size // 72)
    return packets


@st.composite
def drives(draw: st.DrawFn) -> dict[str, Any]:
    count = draw(st.integers(1, 60))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    start = int(
        np.datetime64(draw(st.sampled_from(["2009-10-21", "2016-12-30T23:59:50", "2024-02-29T12:00"])), "ns").astype(
            np.int64
        )
    )
    return {
        "time": start + np.cumsum(random.integers(1, 3000, count)) * 1_000_000,
        "latitude": random.uniform(-89, 89, count),
        "longitude": random.uniform(-180, 180, count),
        "altitude": random.uniform(-100, 4000, count),
        "velocity": random.uniform(-60, 60, (count, 3)),
        "orientation": random.uniform(-1, 1, (count, 3)) * (np.pi, 0.5, 0.5),
        "acceleration": random.uniform(-20, 20, (count, 3)),
        "angular_rate": random.uniform(-2, 2, (count, 3)),
        "status": random.choice([2, 3, 4], count),
        "position_accuracy": np.where(random.random(count) < 0.2, np.nan, random.uniform(0, 20, count)),
        "leading": draw(st.integers(0, count - 1)),
    }


@given(drive=drives())
def test_what_is_written_is_read(tmp_path_factory: pytest.TempPathFactory, drive: dict[str, Any]) -> None:
    path = tmp_path_factory.mktemp("written") / "nav.ncom"
    count = len(drive["time"])
    assert write_ncom(path, **drive) == count
    assert path.stat().st_size == 72 * count
    found = read_packets(path)
    assert found.checksum1.all()
    assert found.checksum2.all()
    assert found.time_known.all()
    assert found.time.tolist() == drive["time"].tolist()
    assert found.status.tolist() == drive["status"].tolist()
    for name, quantum in (
        ("acceleration", 1e-4),
        ("angular_rate", 1e-5),
        ("velocity", 1e-4),
        ("orientation", 1e-6),
    ):
        assert np.abs(getattr(found, name) - drive[name]).max() <= 0.5001 * quantum
    assert np.abs(np.degrees(found.latitude) - drive["latitude"]).max() < 1e-13
    assert np.abs(np.degrees(found.longitude) - drive["longitude"]).max() < 1e-13
    assert np.abs(found.altitude - drive["altitude"]).max() < 2e-4
    leading = drive["leading"]
    assert 0 not in found.channel[:leading]
    assert found.channel[leading:].tolist() == [(0, 3, 4, 5, 16)[n % 5] for n in range(count - leading)]

    account = Account()
    table = pa.Table.from_batches(list(Ncom(path).batches(account)))
    assert account == Account(accepted=count)
    held: float | None = None
    for number, (row, channel) in enumerate(zip(table.to_pylist(), found.channel, strict=True)):
        if channel == 3:
            told = drive["position_accuracy"][number]
            held = None if np.isnan(told) else told
        assert row["position_accuracy"] == pytest.approx(held, abs=0.8e-3)


def test_missing_values_are_invalid(log: Path) -> None:
    missing = np.full(3, np.nan)
    count = write_ncom(
        log, time=np.arange(2) * 10**7 + 1_700_000_000_000_000_000, latitude=48.0, longitude=11.0, altitude=500.0,
        velocity=missing, orientation=missing, acceleration=(0.0, 0.0, -9.8), angular_rate=missing,
    )  # fmt: skip
    assert count == 2
    found = read_packets(log)
    assert np.isnan(found.velocity).all()
    assert np.isnan(found.orientation).all()
    assert np.isnan(found.angular_rate).all()
    assert found.acceleration.tolist() == [[0.0, 0.0, -9.8]] * 2


def test_stamps_are_rounded_to_milliseconds(log: Path) -> None:
    stamps = np.array([1_700_000_000_000_499_999, 1_700_000_000_000_500_000, 1_700_000_000_059_999_999], np.int64)
    write_ncom(
        log, time=stamps, latitude=0.0, longitude=0.0, altitude=0.0, velocity=(0.0, 0.0, 0.0),
        orientation=(0.0, 0.0, 0.0), acceleration=(0.0, 0.0, -9.8), angular_rate=(0.0, 0.0, 0.0),
    )  # fmt: skip
    found = read_packets(log)
    assert (found.time - 1_700_000_000_000_000_000).tolist() == [0, 1_000_000, 60_000_000]


def test_headings_beyond_half_a_turn_are_wrapped(log: Path) -> None:
    headings = np.array([0.0, 3.0, 4.0, 6.2, 20.0])
    write_ncom(
        log, time=np.arange(5) * 10**7 + 1_700_000_000_000_000_000, latitude=0.0, longitude=0.0, altitude=0.0,
        velocity=(0.0, 0.0, 0.0), orientation=np.stack([headings, 0 * headings, 0 * headings], axis=1),
        acceleration=(0.0, 0.0, -9.8), angular_rate=(0.0, 0.0, 0.0),
    )  # fmt: skip
    found = read_packets(log)
    expected = [0.0, 3.0, 4.0 - 2 * np.pi, 6.2 - 2 * np.pi, 20.0 - 6 * np.pi]
    assert found.orientation[:, 0].tolist() == pytest.approx(expected, abs=1e-6)


def test_a_value_too_large_is_an_error(log: Path) -> None:
    message = "-900.0 does not fit into 24 bits of 10000 counts a unit; the largest is 838.8607"
    with pytest.raises(ValueError, match=re.escape(message)):
        write_ncom(
            log, time=np.array([1_700_000_000_000_000_000]), latitude=0.0, longitude=0.0, altitude=0.0,
            velocity=(0.0, -900.0, 0.0), orientation=(0.0, 0.0, 0.0), acceleration=(0.0, 0.0, -9.8),
            angular_rate=(0.0, 0.0, 0.0),
        )  # fmt: skip
    assert not list(log.parent.iterdir())
