"""PP's two regressions on drivers whose lookahead laws are known."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.modeling.lookahead_models import GeneralLookahead, LookaheadModel, VelocityLookahead, share_out

Array = npt.NDArray[np.float64]


def drive(seed: int, n: int = 3000) -> tuple[Array, Array, Array]:
    """Inputs [Δθ, v], lookahead distances and their noiseless law: three speeds, in each another slope."""
    generator = np.random.default_rng(seed)
    band = generator.choice(3, n, p=[0.5, 0.3, 0.2])
    speed = np.array([5.0, 12.0, 25.0])[band] + generator.standard_normal(n)
    turn = 0.5 * generator.standard_normal(n)
    law = np.array([6.0, 12.0, 20.0])[band] + np.array([0.5, 1.2, 0.2])[band] * (speed - 10) - 2 * turn
    return np.column_stack([turn, speed]), law + 0.5 * generator.standard_normal(n), law


@pytest.mark.parametrize("model", [GeneralLookahead(3, starts=3), VelocityLookahead(3, 3, starts=3)])
def test_finds_the_law_and_its_scatter(model: LookaheadModel) -> None:
    inputs, lookahead, _ = drive(0)
    fresh, truth, law = drive(1)
    model.fit(inputs, lookahead)
    mean, sd = model.predict(fresh)
    assert mean.shape == sd.shape == (len(fresh),)
    assert np.abs(mean - law).mean() < 0.1
    assert sd.mean() == pytest.approx(0.5, rel=0.05)
    assert (np.abs(truth - mean) < sd).mean() == pytest.approx(0.68, abs=0.03)
    assert model.fallbacks == ()


def test_the_first_layer_is_a_mixture_of_the_speed_alone() -> None:
    inputs, lookahead, _ = drive(2)
    model = VelocityLookahead(6, 3, starts=3).fit(inputs, lookahead)
    np.testing.assert_allclose(model.classes.means_[:, 0], [5.0, 12.0, 25.0], atol=0.15)
    assert model.shares == (3, 2, 1)
    changed = inputs.copy()
    changed[:, 0] += 100.0
    np.testing.assert_array_equal(
        VelocityLookahead(6, 3, starts=3).fit(changed, lookahead).classes.means_, model.classes.means_
    )


def test_classes_of_speed_may_be_those_of_another_number_of_components() -> None:
    inputs, lookahead, _ = drive(2)
    classes = VelocityLookahead(6, 3, starts=3).fit(inputs, lookahead).classes
    given = VelocityLookahead(12, 3, starts=3).fit(inputs, lookahead, classes)
    alone = VelocityLookahead(12, 3, starts=3).fit(inputs, lookahead)
    for ours, theirs in zip(given.predict(inputs), alone.predict(inputs), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_each_class_is_fitted_to_its_own_samples() -> None:
    inputs, lookahead, _ = drive(3)
    model = VelocityLookahead(3, 3, starts=3).fit(inputs, lookahead)
    own = model.classes.predict(inputs[:, [1]])
    mean, sd = model.predict(inputs)
    for number in range(3):
        alone = GeneralLookahead(1).fit(inputs[own == number], lookahead[own == number])
        expected_mean, expected_sd = alone.predict(inputs[own == number])
        np.testing.assert_allclose(mean[own == number], expected_mean, rtol=1e-9)
        np.testing.assert_allclose(sd[own == number], expected_sd, rtol=1e-9)


def test_fewer_components_than_classes_make_fewer_classes() -> None:
    inputs, lookahead, _ = drive(4)
    model = VelocityLookahead(2, 3, starts=3).fit(inputs, lookahead)
    assert len(model.regressions) == len(model.classes.weights_) == 2
    assert model.shares == (1, 1)
    assert model.fallbacks == ("2 instead of 3 classes of speed",)


def test_a_class_of_few_samples_falls_back_to_the_general_model_and_says_so() -> None:
    inputs, lookahead, _ = drive(5, 400)
    few, few_lookahead, _ = drive(6, 12)
    few[:, 1] = np.linspace(59.0, 61.0, 12)
    inputs, lookahead = np.vstack([inputs, few]), np.concatenate([lookahead, few_lookahead])
    model = VelocityLookahead(4, 4, starts=5).fit(inputs, lookahead)
    assert model.fallbacks == ("the general model in class 4 of speed, about 60.0 m/s, for 12 samples",)
    mean, sd = model.predict(few)
    general_mean, general_sd = GeneralLookahead(4, starts=5).fit(inputs, lookahead).predict(few)
    np.testing.assert_array_equal(mean, general_mean)
    np.testing.assert_array_equal(sd, general_sd)


def test_few_samples_get_fewer_components_and_it_is_said() -> None:
    inputs, lookahead, _ = drive(7, 100)
    model = GeneralLookahead(12).fit(inputs, lookahead)
    assert len(model.regression.mixture_.weights_) == 2
    assert model.fallbacks == ("2 instead of 12 components for 100 samples",)
    inputs, lookahead, _ = drive(8, 300)
    by_speed = VelocityLookahead(20, 3, starts=3).fit(inputs, lookahead)
    assert all("components for" in reason and "samples in class" in reason for reason in by_speed.fallbacks)
    assert len(by_speed.fallbacks) == 3


def test_faithful_ignores_priors() -> None:
    inputs, lookahead, _ = drive(9)
    corrected = GeneralLookahead(4).fit(inputs, lookahead)
    printed = GeneralLookahead(4, faithful=True).fit(inputs, lookahead)
    np.testing.assert_array_equal(printed.regression.mixture_.means_, corrected.regression.mixture_.means_)
    assert np.abs(printed.predict(inputs)[1] - corrected.predict(inputs)[1]).max() > 1e-3


def test_arrays_bring_both_models_back() -> None:
    inputs, lookahead, _ = drive(10, 600)
    general = GeneralLookahead(3, faithful=True).fit(inputs, lookahead)
    by_speed = VelocityLookahead(6, 3).fit(inputs, lookahead)
    for model, again in (
        (general, GeneralLookahead.from_arrays(general.arrays())),
        (by_speed, VelocityLookahead.from_arrays(by_speed.arrays())),
    ):
        for then, now in zip(model.predict(inputs), again.predict(inputs), strict=True):
            np.testing.assert_allclose(now, then, rtol=1e-12)
    assert VelocityLookahead.from_arrays(by_speed.arrays()).shares == by_speed.shares


def test_no_samples_say_so() -> None:
    for model in (GeneralLookahead(3), VelocityLookahead(3, 3)):
        with pytest.raises(
            ValueError, match=r"^Expected n_samples >= n_components but got n_components = 1, n_samples = 0"
        ):
            model.fit(np.empty((0, 2)), np.empty(0))


@given(samples=st.lists(st.integers(0, 1000), min_size=1, max_size=6), extra=st.integers(0, 20))
def test_shares_are_proportional_and_their_sum_is_right(samples: list[int], extra: int) -> None:
    samples[0] += 1
    total = len(samples) + extra
    shares = share_out(total, np.array(samples))
    assert sum(shares) == total
    assert min(shares) >= 1
    for share, own in zip(shares, samples, strict=True):
        for other, others in zip(shares, samples, strict=True):
            assert share == 1 or own * (2 * other + 1) >= others * (2 * share - 1)


def test_shares_by_hand() -> None:
    assert share_out(12, np.array([500, 300, 200])) == (6, 4, 2)
    assert share_out(3, np.array([7, 1, 1])) == (1, 1, 1)
