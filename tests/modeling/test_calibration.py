"""Student's t against scipy's distributions, the ranked probability score against its integral."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import integrate, stats

from wheelprint.modeling.calibration import Calibration, Forecast
from wheelprint.modeling.measures import measure

CALIBRATION = Calibration(np.array([1.0, 1.7, 0.6]), np.array([np.inf, 3.0, 8.0]))
SD = np.array([[2.0, 1.0, 3.0], [0.5, 4.0, 1.0]])
ERRORS = np.array([[0.0, -2.5, 4.0], [1.5, 9.0, -0.3]])


def distributions() -> list[list[Any]]:
    return [
        [
            stats.norm(scale=sd * scale) if np.isinf(freedom) else stats.t(freedom, scale=sd * scale)
            for sd, scale, freedom in zip(row, CALIBRATION.scale, CALIBRATION.freedom, strict=True)
        ]
        for row in SD
    ]


def test_bands_variance_and_probability_are_those_of_scipy() -> None:
    for i, row in enumerate(distributions()):
        for j, law in enumerate(row):
            for share in (0.68, 0.95):
                assert CALIBRATION.half_width(SD, share)[i, j] == pytest.approx(law.ppf((1 + share) / 2), rel=1e-9)
            assert CALIBRATION.variance(SD)[i, j] == pytest.approx(law.var(), rel=1e-9)
            assert CALIBRATION.probability(ERRORS, SD)[i, j] == pytest.approx(law.cdf(ERRORS[i, j]), rel=1e-9)


@pytest.mark.parametrize("freedom", [2.2, 2.9, 7.3, 100.0])
def test_probability_is_that_of_scipy_near_and_far(freedom: float) -> None:
    size = np.append(np.geomspace(1e-9, 1e9, 10_001), np.inf)
    errors = np.concatenate([-size[::-1], [0.0], size])[:, None]
    found = Calibration(np.ones(1), np.array([freedom])).probability(errors, np.ones_like(errors))
    np.testing.assert_allclose(found, stats.t(freedom).cdf(errors), rtol=0, atol=1e-9)
    assert np.diff(found[:, 0]).min() >= -1e-15


def test_ranked_probability_score_is_its_integral() -> None:
    score = CALIBRATION.crps(ERRORS, SD)
    for i, row in enumerate(distributions()):
        for j, law in enumerate(row):
            found = ERRORS[i, j]
            below = integrate.quad(lambda y, law=law: law.cdf(y) ** 2, -np.inf, found, epsabs=1e-10)[0]
            above = integrate.quad(lambda y, law=law: law.sf(y) ** 2, found, np.inf, epsabs=1e-10)[0]
            assert score[i, j] == pytest.approx(below + above, rel=1e-6)


def test_both_bands_hold_their_share_of_heavy_tailed_errors() -> None:
    rng = np.random.default_rng(3)
    sd = rng.uniform(1.0, 4.0, (20_000, 2))
    errors = sd * np.column_stack([2.0 * rng.standard_t(4.0, 20_000), rng.normal(0.0, 0.5, 20_000)])
    fitted = Calibration.fit(errors[:10_000], sd[:10_000])
    for share in (0.68, 0.95):
        inside = np.abs(errors[10_000:]) <= fitted.half_width(sd[10_000:], share)
        assert inside.mean(axis=0) == pytest.approx(share, abs=0.015)
    assert fitted.freedom[0] == pytest.approx(4.0, abs=0.8)
    assert fitted.freedom[1] > 15.0
    assert fitted.scale == pytest.approx([2.0, 0.5], rel=0.06)


def test_measures_of_a_gaussian_forecast() -> None:
    truth = np.array([[1.0, 2.0], [3.0, 4.0]])
    forecast = Forecast.gaussian(truth + np.array([[0.0, 1.5], [0.0, -3.0]]), np.ones((2, 2)))
    overall, horizons, probabilities = measure(forecast, truth, 0.1)
    assert (overall["mean_error"], overall["mean_variance"], overall["samples"]) == (1.125, 1.0, 2)
    assert (overall["coverage_68"], overall["coverage_95"]) == (0.5, 0.75)
    assert [row["horizon"] for row in horizons] == [0.1, 0.2]
    assert [row["mean_error"] for row in horizons] == [0.0, 2.25]
    assert horizons[1]["bias"] == -0.75
    assert sum(row["share"] for row in probabilities) == 1.0
    shares = {row["probability"]: row["share"] for row in probabilities if row["share"]}
    assert shares == {0.05: 0.25, 0.5: 0.5, 0.95: 0.25}


def test_an_empty_fold_has_no_measures() -> None:
    overall, horizons, probabilities = measure(
        Forecast.gaussian(np.empty((0, 3)), np.empty((0, 3))), np.empty((0, 3)), 0.1
    )
    assert overall["samples"] == 0
    assert {overall[name] for name in ("mean_error", "coverage_68", "coverage_95", "crps")} == {None}
    assert {row["crps"] for row in horizons} == {row["share"] for row in probabilities} == {None}
