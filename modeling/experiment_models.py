"""What the papers' experiments learn from, and their models: MP's windows and two levels, PP's lookahead distances."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..schemas.config import Config
from ..schemas.errors import InputError
from .baselines import Ridge
from .cells import FEWEST_SAMPLES
from .drivers import fit_path_types, label_rows, part, training_and_test
from .mixture import GaussianMixture
from .motion_primitives import EVERYTHING, N1, TOLERANCE, MotionPrimitives, fit_motion_primitives, windows_needed
from .path_types import PathTypes
from .regression import MixtureRegression
from .windows import Floats, Mask, Series, Windows, cut_windows, window_centres

LABELS = 3
"""Clusters of path segments, so that n₁ is 1, 3 and 27 as in MP."""

PATH_TYPES: tuple[N1, ...] = (1, 3, 27)
PAST_STEPS = (-1, 0, 1, 2, 3)
FUTURE_STEPS = 50
MP_COMPONENTS = (3, 6, 9)


@dataclass(frozen=True, slots=True)
class Split:
    """Windows to learn from and to test, the same for every number of past steps, with the path type of each.

    Attributes:
        types: Types of path of the training rows.
        path_type: Path type of every row, such as `1-3-2`, told by rows of its own side alone.
        learnt: Windows to learn from.
        asked: Windows to test.
    """

    types: PathTypes
    path_type: NDArray[np.str_]
    learnt: Windows
    asked: Windows

    @property
    def learnt_types(self) -> NDArray[np.str_]:
        """Path type of each window to learn from (n_windows,)."""
        return self.path_type[self.learnt.centres]

    @property
    def asked_types(self) -> NDArray[np.str_]:
        """Path type of each window to test (n_windows,)."""
        return self.path_type[self.asked.centres]


def with_labels(config: Config, clusters: int | Literal["bic"]) -> Config:
    """Return the project file with so many clusters of path segments."""
    return config.model_copy(update={"segments": config.segments.model_copy(update={"clusters": clusters})})


def known_lookahead(
    project: Path, driver: str, series: Series, fold: int, config: Config
) -> tuple[Floats, Floats, Mask, Mask]:
    """Return [Δθ, v] and lookahead distance of the rows that have both, and which of them to learn from and to test.

    Returns:
        Shapes (n_known, 2), deg per sample and m/s; (n_known,), m; and twice (n_known,).

    Raises:
        InputError: There are too few samples to learn from.
    """
    known = series.has_lookahead
    training, test = (rows[known] for rows in training_and_test(series, fold, config))
    if (found := int(training.sum())) < FEWEST_SAMPLES:
        raise _too_few(project, driver, fold, f"{found} lookahead distances to learn from", FEWEST_SAMPLES)
    return series.path_points[known], series.lookahead[known], training, test


def split_windows(
    project: Path, driver: str, series: Series, fold: int, past_steps: int, config: Config, *, faithful: bool
) -> Split:
    """Cut the windows of the training folds and of the test fold; they are whole for the largest n₂ of the grid.

    Raises:
        InputError: There are too few windows to learn from, or no segment lies entirely in the training folds.
    """
    training, test = training_and_test(series, fold, config)
    past = max(PAST_STEPS)
    complete = series.has_path_and_steering

    def cut(rows: Mask) -> Windows:
        centres = window_centres(series.stretch, rows & complete, past, FUTURE_STEPS)
        return cut_windows(series, centres, past_steps, FUTURE_STEPS)

    learnt, asked = cut(training), cut(test)
    needed = max(windows_needed(learnt.inputs.shape[1] + FUTURE_STEPS, max(MP_COMPONENTS)), FEWEST_SAMPLES)
    if (found := len(learnt.centres)) < needed:
        raise _too_few(project, driver, fold, f"{found} windows to learn from", needed)
    sides = part(series, training + 2 * test, config)
    types = fit_path_types(sides, training, with_labels(config, LABELS), logarithms=not faithful)
    path_type = label_rows(sides, types, config)
    return Split(types, path_type, learnt, asked)


def fit_structure(
    inputs: Floats,
    outputs: Floats,
    path_types: NDArray[np.str_],
    components: int,
    seed: int,
    past_steps: int,
    *,
    faithful: bool,
) -> MotionPrimitives:
    """Fit the two levels of MP; `coarser` of the result has n₁ = 3 and 1.

    Args:
        inputs: Shape (n_windows, n_inputs), columns of a window as `windows.cut_windows` lays it out.
        outputs: Shape (n_windows, n₃), deg.
        path_types: Path type of each window, such as `1-3-2` (n_windows,).
        components: n₄.
        seed: Of the k-means start.
        past_steps: n₂, for the gap between the blocks that choose the shrinkage.
        faithful: Every type apart and without shrinkage, see `fit_apart`.

    Raises:
        ValueError: There are fewer windows than `windows_needed`, or with `faithful` than components.
    """
    if faithful:
        return fit_apart(inputs, outputs, path_types, components, seed)
    penalty = Ridge.fit(inputs, outputs, gap=max(past_steps, 0) + FUTURE_STEPS).penalty
    return fit_motion_primitives(
        inputs, outputs, path_types, n1=27, components=components, shrinkage=penalty, seed=seed
    )


def fit_apart(
    inputs: Floats, outputs: Floats, path_types: NDArray[np.str_], components: int, seed: int
) -> MotionPrimitives:
    """Fit a mixture to each path type's windows alone, as MP does, and predict by its eqs. 20 and 22 as printed.

    The windows are grouped by MP eqs. 9 and 10, and each group is a training set of eq. 15.

    A type with fewer windows than `windows_needed` has no regression of its own and falls back to its label's, a label
    without one to that of everything.

    Args:
        inputs: Shape (n_windows, n_inputs), columns of a window as `windows.cut_windows` lays it out.
        outputs: Shape (n_windows, n₃), deg.
        path_types: Path type of each window, such as `1-3-2` (n_windows,).
        components: n₄; a mixture whose components collapse keeps fewer.
        seed: Of the k-means starts.

    Raises:
        ValueError: There are fewer windows than components.
    """
    joint = np.concatenate([inputs, outputs], axis=1)
    labels = own_labels(path_types)
    split = (range(inputs.shape[1]), range(inputs.shape[1], joint.shape[1]))
    samples: Counter[str] = Counter()
    regressions: dict[str, MixtureRegression] = {}
    for names in (np.full(len(joint), EVERYTHING), labels, path_types):
        for name in np.unique(names).tolist():
            own = joint[names == name]
            samples[name] = len(own)
            if name == EVERYTHING or len(own) >= windows_needed(joint.shape[1], components):
                mixture = GaussianMixture(components, max_iterations=100, tolerance=TOLERANCE, random_state=seed)
                regressions[name] = MixtureRegression.from_mixture(mixture.fit(own), *split, faithful=True)
    return MotionPrimitives(27, regressions, dict(sorted(samples.items())))


def own_labels(path_types: NDArray[np.str_]) -> NDArray[np.str_]:
    """Return the own label of path types: `3` of `1-3-2`, each (n,)."""
    distinct, which = np.unique(path_types, return_inverse=True)
    return np.array([name.split("-")[1] for name in distinct.tolist()], dtype=np.str_)[which]


def _too_few(project: Path, driver: str, fold: int, found: str, needed: int) -> InputError:
    reason = (
        f"driver {driver!r}, test fold {fold}: {found}, and the grid of the experiment needs {needed}; add recordings, "
        "or decide about proposed events (`wheelprint review`)"
    )
    return InputError(project / "wheelprint.toml", "dataset", reason)
