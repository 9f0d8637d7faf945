"""Cross-validation groups of a driver's data (PP eq. 12), and the rows that may be trained on beside a test group."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray


def deal_folds(samples: int, folds: int, seed: int) -> NDArray[np.int16]:
    """Return the fold, from 0, of each of a driver's samples in the order of time.

    PP divides at random but does not say into what; neighbouring samples at 10 Hz are nearly equal, so the groups are
    whole blocks: `folds` contiguous stretches of the driver's samples, equal to within one sample, and a seeded
    permutation says which block is which fold. The groups are disjoint and complete.
    """
    block = np.arange(samples) * folds // samples
    fold: NDArray[np.int16] = np.random.default_rng(seed).permutation(folds).astype(np.int16)[block]
    return fold


def deal_recordings(samples: Sequence[int], folds: int, seed: int) -> NDArray[np.int16]:
    """Return the fold, from 0, of each of a driver's recordings, so that a fold is tested on drives of its own.

    The longest recording that is left goes to the fold that has the fewest samples so far, so that no fold is ahead of
    another one by more than the shortest recording dealt to it. The order of equals is seeded, and which fold is which.

    Args:
        samples: Of every recording, each above 0; at least as many recordings as folds, so that no fold is empty.
        folds: M of PP eq. 12.
        seed: Of the order.
    """
    generator = np.random.default_rng(seed)
    shuffled = generator.permutation(len(samples))
    name = generator.permutation(folds).astype(np.int16)
    fold = np.empty(len(samples), np.int16)
    filled = np.zeros(folds, np.int64)
    for recording in shuffled[np.argsort(-np.asarray(samples)[shuffled], kind="stable")]:
        emptiest = int(np.argmin(filled))
        fold[recording] = name[emptiest]
        filled[emptiest] += samples[recording]
    return fold


def training_mask(
    fold: NDArray[np.integer[Any]],
    recording: NDArray[Any],
    time: NDArray[np.int64],
    test_fold: int,
    embargo: int,
) -> NDArray[np.bool_]:
    """Return the rows (n_samples,) that may be trained on while `test_fold` is the test fold.

    These are the rows of other folds that are more than the embargo away from every test row of their recording. So
    no window around a training row shares a raw sample with a window around a test row, as long as a window, with
    what smoothing adds on both sides, is no longer than the embargo.

    Args:
        fold: Fold of every row.
        recording: What tells recordings apart, in any type that sorts.
        time: ns UTC.
        test_fold: The fold that is held out.
        embargo: ns.
    """
    in_test = fold == test_fold
    mask: NDArray[np.bool_] = ~in_test
    for name in np.unique(recording[in_test]):
        of_recording = recording == name
        test_time = np.sort(time[of_recording & in_test])
        rows = np.flatnonzero(of_recording & ~in_test)
        near_start = np.searchsorted(test_time, time[rows] - embargo, side="left")
        near_stop = np.searchsorted(test_time, time[rows] + embargo, side="right")
        mask[rows] = near_start == near_stop
    return mask
