"""Stepwise EM: close to the batch fit after all drives, in bounded memory, and the same after a night on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wheelprint.modeling.mixture import GaussianMixture
from wheelprint.modeling.online import OnlineMixture

MEANS = np.array([[0.0, 0.0, 0.0], [3.0, 1.0, 0.0], [-2.0, 3.0, 1.0]])
SHARES = [
    [0.6, 0.2, 0.2], [0.2, 0.6, 0.2], [0.1, 0.1, 0.8], [0.3, 0.3, 0.4], [0.5, 0.4, 0.1], [0.2, 0.2, 0.6],
]  # fmt: skip


def drive(rows: int, shares: list[float], seed: int) -> np.ndarray:
    """Rows of three components one after the other, as stretches of road come."""
    rng = np.random.default_rng(seed)
    component = np.sort(rng.choice(3, rows, p=shares))
    found: np.ndarray = rng.normal(MEANS[component], np.array([0.8, 1.0, 0.6])[component][:, None])
    return found


def learn_all(drives: list[np.ndarray], exponent: float) -> OnlineMixture:
    state = OnlineMixture.begin(drives[0], 3, exponent=exponent, n_starts=2)
    for number, rows in enumerate(drives[1:]):
        state = state.learn(rows, seed=number)
    return state


@pytest.mark.parametrize(("exponent", "below"), [(0.6, 0.05), (1.0, 0.002)])
def test_after_all_drives_it_is_near_the_batch_fit(exponent: float, below: float) -> None:
    drives = [drive(1500, shares, number) for number, shares in enumerate(SHARES)]
    rows = np.concatenate(drives)
    batch = GaussianMixture(3, n_starts=2).fit(rows)
    state = learn_all(drives, exponent)
    assert OnlineMixture.begin(drives[0], 3, n_starts=2).mixture.score(rows) < batch.score(rows) - 2 * below
    assert batch.score(rows) - state.mixture.score(rows) < below
    nearest = np.abs(state.mixture.means_[:, None] - batch.means_).max(axis=2).min(axis=0)
    assert nearest.max() < 0.15
    assert state.rows == len(rows)


def test_a_component_that_the_first_drive_lacked_is_found() -> None:
    drives = [drive(1500, shares, number) for number, shares in enumerate([[0.7, 0.3, 0.0], *SHARES[1:]])]
    rows = np.concatenate(drives)
    state = learn_all(drives, 0.6)
    assert GaussianMixture(3, n_starts=2).fit(rows).score(rows) - state.mixture.score(rows) < 0.1


def test_one_component_with_equal_weights_is_mean_and_covariance() -> None:
    """κ = 1 gives every row the same weight, and with one component responsibilities are all 1."""
    drives = [drive(rows, SHARES[0], rows) for rows in (300, 420, 77)]
    state = OnlineMixture.begin(drives[0], 1, exponent=1.0, batch=50)
    for rows in drives[1:]:
        state = state.learn(rows)
    together = np.concatenate(drives)
    np.testing.assert_allclose(state.means[0], together.mean(axis=0), rtol=1e-10)
    np.testing.assert_allclose(state.covariances[0], np.cov(together.T, bias=True), rtol=1e-10)


def test_memory_does_not_grow() -> None:
    state = OnlineMixture.begin(drive(500, SHARES[0], 0), 3)
    size = {name: values.nbytes for name, values in state.arrays().items()}
    for number in range(5):
        state = state.learn(drive(700, SHARES[number], number))
    assert {name: values.nbytes for name, values in state.arrays().items()} == size


def test_it_goes_on_from_disk(tmp_path: Path) -> None:
    first, second = (drive(600, shares, number) for number, shares in enumerate(SHARES[:2]))
    state = OnlineMixture.begin(first, 3)
    files = state.save(tmp_path / "model", {"driver": "anna"})
    assert [path.name for path in files] == ["arrays.npz", "golden.npz", "card.json"]
    loaded, card = OnlineMixture.load(tmp_path / "model")
    assert card["driver"] == "anna"
    for name, values in state.learn(second).arrays().items():
        np.testing.assert_array_equal(loaded.learn(second).arrays()[name], values)


def test_what_cannot_be_learnt() -> None:
    rows = drive(100, SHARES[0], 0)
    message = r"^exponent must be above 0\.5 and at most 1, batch at least 1; found 0\.5 and 200$"
    with pytest.raises(ValueError, match=message):
        OnlineMixture.begin(rows, 2, exponent=0.5)
    state = OnlineMixture.begin(rows, 2)
    with pytest.raises(ValueError, match=r"^drive has 2 columns, but 3 were learnt so far$"):
        state.learn(rows[:, :2])
