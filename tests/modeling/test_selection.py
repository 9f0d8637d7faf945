"""Information criteria along numbers of components: scikit-learn's, and the number that the rows were drawn with."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.mixture import GaussianMixture as Reference

from wheelprint.modeling import select_components
from wheelprint.modeling.mixture import GaussianMixture


def rows_of_three() -> np.ndarray:
    rng = np.random.default_rng(0)
    centres = np.array([[0.0, 0.0], [6.0, 0.0], [0.0, 7.0]])
    found: np.ndarray = centres[rng.integers(0, 3, 900)] + rng.normal(size=(900, 2))
    return found


def test_the_lowest_criterion_names_the_number_drawn_from() -> None:
    rows = rows_of_three()
    path = select_components(rows, range(1, 6), n_starts=3)
    assert path.n_components.tolist() == path.kept.tolist() == [1, 2, 3, 4, 5]
    assert path.n_components[path.bic.argmin()] == 3
    assert len(path.best().weights_) == 3
    assert path.best("aic") is path.mixtures[int(path.aic.argmin())]
    assert path.n_parameters.tolist() == [5, 11, 17, 23, 29]
    assert (np.diff(path.log_likelihood) > -1e-6).all()
    table = path.table()
    assert [row["n_components"] for row in table] == [1, 2, 3, 4, 5]
    assert table[2] == {
        "n_components": 3,
        "kept": 3,
        "log_likelihood": path.log_likelihood[2],
        "n_parameters": 17,
        "bic": path.bic[2],
        "aic": path.aic[2],
    }


def test_criteria_are_scikit_learns_and_those_of_each_mixture() -> None:
    rows = rows_of_three()
    path = select_components(rows, (1, 3), tolerance=1e-9, max_iterations=500)
    for place, k in enumerate((1, 3)):
        reference = Reference(k, tol=1e-9, max_iter=500, n_init=3, random_state=0).fit(rows)
        assert path.bic[place] == pytest.approx(reference.bic(rows), rel=1e-5)
        assert path.aic[place] == pytest.approx(reference.aic(rows), rel=1e-5)
        assert path.bic[place] == pytest.approx(path.mixtures[place].bic(rows), rel=1e-12)
        assert path.aic[place] == pytest.approx(path.mixtures[place].aic(rows), rel=1e-12)


def test_settings_go_to_the_mixtures_and_the_papers_count_is_kept_to() -> None:
    rows = rows_of_three()
    path = select_components(rows, [3], parameter_count="paper", covariance_type="tied")
    assert path.n_parameters.tolist() == [2 * 3 + 3 * 2]
    assert isinstance(path.best(), GaussianMixture)
    assert path.best().covariance_type == "tied"
    assert path.bic[0] == pytest.approx(path.best().bic(rows, "paper"), rel=1e-12)
    with pytest.raises(ValueError, match=r"^ks must name at least one number of components, found none$"):
        select_components(rows, [])
