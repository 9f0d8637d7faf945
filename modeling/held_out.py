"""Cross-validation within the windows to learn from: what is chosen and calibrated there never sees a test fold."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .calibration import Calibration, Forecast
from .motion_primitives import N1, MotionPrimitives

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]

BLOCKS = 10
"""Contiguous blocks of windows that are held out in turn: about as large a part as a test fold is, so that the errors
are as large. With 5, the bands of one racing driver held 72 % instead of 68 % on test folds."""

FEWER_BLOCKS = 5
"""Blocks where windows are plenty: what a tenth of an hour adds to an hour no longer shows in the errors."""

PLENTY = 15_000
"""Windows that are plenty: 25 minutes, or as many as `max_windows` leaves of more."""

STRIDES = (3, 2, 1)
"""Of every so many windows one is used: neighbours, 0.1 s apart, are nearly equal, and three times as few are three
times as fast. Where they are too few to learn from, more are used."""

ENOUGH = 6000
"""Windows beyond which still fewer are used: their errors tell two quantiles, and hours of driving have no more."""


def blocks_of(centres: Rows, length: int, needed: int) -> list[tuple[Rows, Rows]]:
    """Split windows into those to learn from and a contiguous block that is held out, for each block in turn.

    Args:
        centres: Row t of each window, rising (n_windows,).
        length: Rows that a window spans; no two windows on different sides share one.
        needed: Fewest windows to learn from.

    Returns:
        For each block the places (from 0) of the windows to learn from (n_learnt,), and of those held out (n_held,).
        Nothing where too few are left to learn from.
    """
    blocks = BLOCKS if len(centres) < PLENTY else FEWER_BLOCKS
    for stride in (max(len(centres) // ENOUGH, STRIDES[0]), *STRIDES[1:]):
        thinned = np.arange(0, len(centres), stride)
        splits = []
        for block in np.array_split(thinned, blocks):
            if len(block):
                first, last = centres[block[[0, -1]]]
                apart = (centres[thinned] <= first - length) | (centres[thinned] >= last + length)
                splits.append((thinned[apart], block))
        if len(splits) == blocks and min(len(learnt) for learnt, _ in splits) >= needed:
            return splits
    return []


def calibrate(
    fit: Callable[[Rows], MotionPrimitives],
    inputs: Floats,
    outputs: Floats,
    path_types: NDArray[Any],
    blocks: Sequence[tuple[Rows, Rows]],
    levels: Sequence[N1],
) -> dict[int, Calibration]:
    """Calibrate a kind of motion primitives by the errors on blocks of windows that they did not learn from.

    See `Calibration.fit` for the formula.

    Args:
        fit: Fits them to the windows at the given places (n_learnt,).
        inputs: Shape (n_windows, n_inputs), as `windows.cut_windows` lays them out.
        outputs: Shape (n_windows, n₃), deg.
        path_types: Path type of each window (n_windows,).
        blocks: As `blocks_of` returns them.
        levels: n₁ to calibrate, those of the structure that `fit` returns or coarser.

    Returns:
        The calibration of each n₁; none where there are no blocks.
    """
    if not blocks:
        return {}
    asked: list[Rows] = []
    forecasts: dict[int, list[Forecast]] = {n1: [] for n1 in levels}
    for learnt, block in blocks:
        asked.append(block)
        of_levels = fit(learnt).forecasts(inputs[block], path_types[block], levels)
        for n1, forecast in zip(levels, of_levels, strict=True):
            forecasts[n1].append(forecast)
    truth = outputs[np.concatenate(asked)]
    return {
        n1: Calibration.fit(truth - np.concatenate([f.mean for f in own]), np.concatenate([f.sd for f in own]))
        for n1, own in forecasts.items()
    }
