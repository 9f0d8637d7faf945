"""Folds are disjoint, complete and balanced, and nothing that is tested is seen in training."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.dataset.folds import deal_folds, deal_recordings, training_mask

PERIOD = 100_000_000


@given(st.integers(1, 3000), st.integers(2, 20), st.integers(0, 5))
def test_folds_are_balanced_blocks(samples: int, folds: int, seed: int) -> None:
    fold = deal_folds(samples, folds, seed)
    counts = np.bincount(fold, minlength=folds)
    assert len(counts) == folds
    assert counts.sum() == len(fold) == samples
    assert counts.max() - counts.min() <= 1
    assert np.count_nonzero(np.diff(fold)) == min(folds, samples) - 1
    np.testing.assert_array_equal(fold, deal_folds(samples, folds, seed))


def test_the_seed_deals() -> None:
    dealt = {tuple(deal_folds(10, 10, seed).tolist()) for seed in range(20)}
    assert len(dealt) > 15


@given(st.lists(st.integers(1, 5000), min_size=2, max_size=40), st.data(), st.integers(0, 5))
def test_whole_recordings_are_dealt_and_balance(samples: list[int], data: st.DataObject, seed: int) -> None:
    folds = data.draw(st.integers(2, len(samples)))
    fold = deal_recordings(samples, folds, seed)
    filled = np.bincount(fold, weights=samples, minlength=folds)
    assert len(fold) == len(samples)
    assert len(filled) == folds
    assert filled.min() > 0
    np.testing.assert_array_equal(fold, deal_recordings(samples, folds, seed))
    # no fold is ahead of another by more than its own last, and shortest, recording
    for own in range(folds):
        assert filled[own] - min(size for size, of in zip(samples, fold, strict=True) if of == own) <= filled.min()


def test_the_seed_deals_recordings() -> None:
    assert len({tuple(deal_recordings([600] * 10, 10, seed).tolist()) for seed in range(20)}) > 15
    assert sorted(deal_recordings([600] * 10, 10, 3).tolist()) == list(range(10))


@st.composite
def drives(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    """Recording and time of a driver's samples: several recordings, each with gaps."""
    recordings, times = [], []
    for number in range(draw(st.integers(1, 3))):
        runs = draw(st.lists(st.tuples(st.integers(1, 60), st.integers(2, 20)), min_size=1, max_size=3))
        steps = np.concatenate([np.append(np.ones(samples, int), gap) for samples, gap in runs])
        times.append((number * 10_000 + np.cumsum(steps)) * PERIOD)
        recordings.append(np.full(len(steps), f"drive {number}"))
    return np.concatenate(recordings), np.concatenate(times)


@given(drives(), st.integers(2, 6), st.integers(0, 20), st.integers(0, 3), st.data())
def test_no_training_window_shares_a_raw_sample_with_a_test_window(
    drive: tuple[np.ndarray, np.ndarray], folds: int, embargo: int, half: int, data: st.DataObject
) -> None:
    recording, time = drive
    past = data.draw(st.integers(0, max(0, embargo - 2 * half)))
    future = max(0, embargo - 2 * half - past)
    smoothing = half if 2 * half <= embargo else 0
    fold = deal_folds(len(time), folds, 0)
    test_fold = data.draw(st.integers(0, folds - 1))
    mask = training_mask(fold, recording, time, test_fold, embargo * PERIOD)

    def raw(anchors: np.ndarray) -> set[tuple[str, int]]:
        """Grid points that the windows [t - past, t + future] around the anchors see through the smoothing."""
        reach = range(-past - smoothing, future + smoothing + 1)
        return {(recording[a], int(time[a]) + n * PERIOD) for a in np.flatnonzero(anchors) for n in reach}

    assert raw(mask).isdisjoint(raw(fold == test_fold))
    # and nothing more is left out than what is too near
    for row in np.flatnonzero(~mask):
        same = (fold == test_fold) & (recording == recording[row])
        assert np.any(np.abs(time[same] - time[row]) <= embargo * PERIOD)


def test_another_recording_is_not_near() -> None:
    fold, time = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1]) * PERIOD
    recording = np.array([7, 7, 8, 8])
    assert training_mask(fold, recording, time, 1, 60 * PERIOD).tolist() == [True, True, False, False]
    assert training_mask(fold, recording, time, 2, 60 * PERIOD).tolist() == [True] * 4
