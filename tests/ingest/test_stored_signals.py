"""Signals of navigation as means, for which hours at 100 Hz need not be in memory at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wheelprint.ingest.navigation import navigation_batch
from wheelprint.ingest.resample import resample
from wheelprint.ingest.stored_signals import NavigationSignal, find_navigation
from wheelprint.schemas.store import parquet_writer

START, SECOND, PERIOD, MAX_GAP = 1_700_000_000_000_000_000, 10**9, 50_000_000, 500_000_000


def stored(path: Path, step: int) -> NavigationSignal:
    """Half a minute of speed with a gap of 3 s, in a file of several pieces."""
    time = START + np.arange(0, 30 * SECOND, step)
    time = time[(time < START + 10 * SECOND) | (time > START + 13 * SECOND)]
    with parquet_writer(path, navigation_batch(time[:1], {}, {"origin": "null"}).schema) as writer:
        for part in np.array_split(time, 7):
            speed = 10 + np.sin((part - START) / SECOND)
            writer.write_batch(navigation_batch(part, {"nav_speed": speed}, {"origin": "null"}))
    signals, _ = find_navigation([path])
    assert [*signals] == ["nav_speed"]
    return signals["nav_speed"]


def test_a_dense_signal_gives_its_means(tmp_path: Path) -> None:
    signal = stored(tmp_path / "nav.parquet", 10_000_000)
    every = signal.read()
    assert len(every.time) == signal.samples == 2699
    means = signal.means(PERIOD, MAX_GAP)
    assert (np.diff(means.time) == PERIOD).all()
    expected = resample(every.time, every.values, means.time, "mean", MAX_GAP, PERIOD)
    np.testing.assert_allclose(means.values, expected, atol=1e-9)
    inside = (means.time > START + 10 * SECOND) & (means.time < START + 13 * SECOND)
    assert np.isnan(means.values[inside]).all()
    assert np.isfinite(means.values).sum() > 500


@pytest.mark.parametrize("copies", [1, 2])
def test_a_sparse_signal_and_several_logs_give_every_sample(tmp_path: Path, copies: int) -> None:
    signal = stored(tmp_path / "nav.parquet", 40_000_000 if copies == 1 else 10_000_000)
    signal = NavigationSignal(signal.files * copies, signal.name, signal.samples, signal.start, signal.stop)
    every, means = signal.read(), signal.means(PERIOD, MAX_GAP)
    np.testing.assert_array_equal(means.time, every.time)
    np.testing.assert_array_equal(means.values, every.values)
