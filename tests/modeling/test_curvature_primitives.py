"""The curvature mixture: its coordinates, and that it learns what is linear in them."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from wheelprint.modeling.baselines import Ridge
from wheelprint.modeling.curvature import CurvatureCoordinates, curvature_blocks
from wheelprint.modeling.curvature_primitives import TIED, fit_curvature_primitives
from wheelprint.modeling.held_out import BLOCKS, blocks_of
from wheelprint.modeling.kinematic import Kinematic
from wheelprint.modeling.learned_baselines import LearnedBaseline
from wheelprint.modeling.motion_primitives import EVERYTHING, MotionPrimitives

PAST, FUTURE, STEP = 1, 8, 0.1


def drive(rows: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Windows, by a plain loop, of a winding road at changing speed; a bicycle model steers, with noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(rows) * STEP
    speed = 20.0 + 8.0 * np.sin(t / 11)
    curvature = 0.01 * np.sin(t / 3) + 0.004 * np.sin(t / 0.9 + 1)
    deviation = np.degrees(curvature * speed * STEP)
    angle = 2000.0 * curvature + 2.0 * curvature * speed**2 + rng.normal(0, 0.3, rows)
    inputs, outputs = [], []
    for centre in range(PAST, rows - FUTURE):
        path = slice(centre - PAST, centre + FUTURE + 1)
        inputs.append([*deviation[path], *speed[path], *angle[centre - PAST : centre + 1]])
        outputs.append(angle[centre + 1 : centre + FUTURE + 1])
    return np.array(inputs), np.array(outputs), np.arange(PAST, rows - FUTURE)


def test_blocks_are_curvature_lateral_acceleration_and_its_product_with_braking() -> None:
    inputs = np.array([[0.9, 1.8, 0.0, 10.0, 11.0, 12.0, 5.0, 6.0]])
    curvature, lateral, braking, seen = curvature_blocks(inputs, 1, 1, STEP)
    expected = np.radians([[0.9, 1.8, 0.0]]) / [[1.0, 1.1, 1.2]]
    np.testing.assert_allclose(curvature, 1e3 * expected)
    np.testing.assert_allclose(lateral, expected * [[100.0, 121.0, 144.0]])
    np.testing.assert_allclose(braking, 10.0 * lateral)
    assert seen.tolist() == [[5.0, 6.0]]
    assert curvature_blocks(np.ones((3, 4)), -1, 1, STEP)[3].shape == (3, 0)


def test_blocks_and_windows_share_no_rows() -> None:
    centres = np.concatenate([np.arange(100, 400), np.arange(500, 700)])
    splits = blocks_of(centres, 10, needed=100)
    assert len(splits) == BLOCKS
    for learnt, block in splits:
        assert np.abs(centres[learnt][:, None] - centres[block]).min() >= 10
    assert sorted(np.concatenate([block for _, block in splits])) == list(range(0, 500, 3))
    assert len(np.concatenate([block for _, block in blocks_of(centres, 10, needed=200)])) == 250
    assert blocks_of(centres, 10, needed=500) == []


@pytest.mark.parametrize("components", [1, 3])
def test_it_predicts_new_driving_with_bands_that_hold(components: int) -> None:
    inputs, outputs, centres = drive(1500, 1)
    types = np.full(len(inputs), "1-1-1")
    primitives, tied = fit_curvature_primitives(
        inputs, outputs, types, centres, n1=1, components=components, past_steps=PAST, step=STEP, levels=[1]
    )
    assert tied in TIED
    asked, truth, _ = drive(900, 2)
    forecast = primitives.forecast(asked, types[: len(asked)])
    errors = truth - forecast.mean
    ridge = Ridge.fit(inputs, outputs, gap=10).predict(asked)[0] - truth
    assert np.abs(errors).mean() < 0.9 * np.abs(ridge).mean()
    for share in (0.68, 0.95):
        inside = np.abs(errors) <= forecast.calibration.half_width(forecast.sd, share)
        assert inside.mean() == pytest.approx(share, abs=0.05)
    mean, variance = primitives.predict(asked, types[: len(asked)])
    np.testing.assert_array_equal(mean, forecast.mean)
    np.testing.assert_allclose(variance, forecast.calibration.variance(forecast.sd))


def test_arrays_bring_it_back_and_few_windows_leave_it_uncalibrated() -> None:
    inputs, outputs, centres = drive(160, 3)
    types = np.full(len(inputs), "1-1-1")
    for rows, calibrated in ((150, True), (60, False)):
        primitives, tied = fit_curvature_primitives(
            inputs[:rows], outputs[:rows], types[:rows], centres[:rows],
            n1=3, components=1, past_steps=PAST, step=STEP, levels=[1, 3],
        )  # fmt: skip
        assert bool(primitives.calibrations) == calibrated
        assert calibrated or tied == TIED[-1]
        again = MotionPrimitives.from_arrays(primitives.arrays())
        for ours, theirs in zip(primitives.predict(inputs, types), again.predict(inputs, types), strict=True):
            np.testing.assert_array_equal(ours, theirs)
        assert set(primitives.coarser(1).regressions) == {EVERYTHING}


def test_too_few_windows() -> None:
    inputs, outputs, centres = drive(40, 4)
    types = np.full(len(inputs), "1-1-1")
    with pytest.raises(ValueError, match=r"^2 components of 40 coordinates need 80 windows, not 31$"):
        fit_curvature_primitives(inputs, outputs, types, centres, n1=1, components=2, past_steps=PAST, step=STEP)


def test_coordinates_without_rank_loss_keep_the_blocks() -> None:
    inputs, _, _ = drive(200, 5)
    coordinates = CurvatureCoordinates.fit(inputs, PAST, FUTURE, STEP)
    blocks = np.concatenate(curvature_blocks(inputs, PAST, FUTURE, STEP), axis=1)
    given = coordinates.transform(inputs)
    assert given.shape == (191, 3 * 10 + 2)
    back = np.linalg.lstsq(coordinates.basis.T, given.T, rcond=None)[0].T + coordinates.mean
    np.testing.assert_allclose(back, blocks, atol=1e-8 * np.abs(blocks).max())


def test_kinematic_steering_is_that_of_the_bicycle_model() -> None:
    inputs, outputs, _ = drive(1500, 6)
    asked, truth, _ = drive(600, 7)
    mean, variance = Kinematic.fit(inputs, outputs, PAST, STEP, gap=10).predict(asked)
    # Within the window by five steps on both sides nothing but the noise, of mean amount 0.24, is left.
    assert np.abs(mean - truth)[:, 3].mean() == pytest.approx(0.24, abs=0.15)
    assert np.sqrt(variance[0, 3]) == pytest.approx(np.sqrt(np.square(mean - truth)[:, 3].mean()), rel=0.3)


@pytest.mark.parametrize("kind", ["trees", "network"])
def test_learned_baselines_beat_persistence(kind: Literal["trees", "network"]) -> None:
    inputs, outputs, _ = drive(1500, 8)
    asked, truth, _ = drive(600, 9)
    learned = LearnedBaseline.fit(kind, inputs, outputs, past_steps=PAST, gap=10)
    mean, variance = learned.predict(asked)
    assert np.abs(mean - truth).mean() < 0.5 * np.abs(truth - asked[:, -1:]).mean()
    assert (variance > 0).all()
    np.testing.assert_array_equal(
        mean, LearnedBaseline.fit(kind, inputs, outputs, past_steps=PAST, gap=10).predict(asked)[0]
    )
