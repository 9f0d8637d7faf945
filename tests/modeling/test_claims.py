"""Claims: intervals against a plain computation, verdicts, and the papers' figures as data."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy import stats

from wheelprint.modeling.claims import Change, judge, paired_change, papers, weigh_claims


def test_interval_of_one_driver_is_the_corrected_t() -> None:
    rng = np.random.default_rng(1)
    before = rng.uniform(1, 2, 10)
    after = before * np.exp(rng.normal(-0.2, 0.1, 10))
    change = paired_change([("a", x, y) for x, y in zip(before.tolist(), after.tolist(), strict=True)], folds=10)
    logs = np.log(after / before)
    spread = math.sqrt((1 / 10 + 1 / 9) * logs.var(ddof=1))
    low, high = stats.t.interval(0.95, 9, logs.mean(), spread)
    assert change.pairs == 10
    assert change.base == pytest.approx(before.mean())
    assert change.changed == pytest.approx(after.mean())
    assert change.change == pytest.approx(100 * (np.exp(logs.mean()) - 1))
    assert change.low == pytest.approx(100 * (np.exp(low) - 1))
    assert change.high == pytest.approx(100 * (np.exp(high) - 1))


def test_drivers_have_equal_weight_and_their_level_does_not_widen_the_interval() -> None:
    """One driver changes by half and one not at all, each without any spread over its folds."""
    pairs = [("a", 2.0, 1.0)] * 3 + [("b", 5.0, 5.0)] * 9
    change = paired_change(pairs, folds=10)
    assert change.change == pytest.approx(100 * (math.sqrt(0.5) - 1))
    assert change.low == pytest.approx(change.change)
    assert change.high == pytest.approx(change.change)


def test_intervals_cover_the_truth_where_folds_share_training_data() -> None:
    """Folds whose errors are correlated by 1/M, as sharing data makes them: 95 % intervals hold the truth."""
    rng = np.random.default_rng(0)
    folds, held = 10, 0
    for _ in range(400):
        shared = rng.normal(0, math.sqrt(1 / folds))
        logs = -0.1 + 0.2 * (shared + rng.normal(0, math.sqrt(1 - 1 / folds), folds))
        change = paired_change([("a", 1.0, math.exp(value)) for value in logs.tolist()], folds)
        assert change.low is not None
        assert change.high is not None
        held += change.low <= 100 * math.expm1(-0.1) <= change.high
    assert 0.92 <= held / 400 <= 0.99


@pytest.mark.parametrize(
    ("expected", "change", "low", "high", "verdict", "why"),
    [
        ("lower", -9.0, -12.0, -6.0, "holds", "holds: −9.0 % (95%: −12.0 % to −6.0 %)"),
        (
            "lower", 4.0, 1.0, 7.0, "does not hold",
            "does not hold, it is the other way round: +4.0 % (95%: +1.0 % to +7.0 %)",
        ),
        (
            "lower", -4.0, -9.0, 1.0, "cannot be told",
            "cannot be told, the interval includes no change: −4.0 % (95%: −9.0 % to +1.0 %)",
        ),
        ("same", 1.0, -3.0, 4.0, "holds", "holds, less than 5 % either way: +1.0 % (95%: −3.0 % to +4.0 %)"),
        ("same", -9.0, -12.0, -6.0, "does not hold", "does not hold, more than 5 %: −9.0 % (95%: −12.0 % to −6.0 %)"),
        (
            "same", -4.0, -9.0, 1.0, "cannot be told",
            "cannot be told, the interval reaches beyond 5 %: −4.0 % (95%: −9.0 % to +1.0 %)",
        ),
    ],
)  # fmt: skip
def test_verdicts(expected: str, change: float, low: float, high: float, verdict: str, why: str) -> None:
    assert judge(Change(10, 2.0, 1.0, change, low, high), expected) == (verdict, why)


def test_one_fold_tells_nothing() -> None:
    change = paired_change([("a", 2.0, 1.0)], folds=10)
    assert change.change == pytest.approx(-50.0)
    assert change.low is change.high is None
    told = "cannot be told, too few pairs of folds for an interval: 1"
    assert judge(change, "lower") == ("cannot be told", told)
    assert paired_change([], folds=10) == Change(0, None, None, None, None, None)


def test_only_whole_pairs_count() -> None:
    """A fold without windows, one that only one of the points has, and other points of the grid are left out."""

    def row(fold: int, regressors: int | None, components: int, error: float, **other: Any) -> dict[str, Any]:
        model = "general" if regressors is None else "velocity"
        point = {"driver": "a", "fold": fold, "model": model, "regressors": regressors, "components": components}
        return {**point, "split": "test", "mean_error": error, "mean_sd": 1.0, "samples": 5, **other}

    rows = [
        row(0, None, 12, 2.0), row(0, 3, 12, 1.0), row(0, 3, 20, 9.0),
        row(1, None, 12, 2.0), row(1, 3, 12, 1.0),
        row(2, None, 12, 2.0),
        row(3, None, 12, 2.0), row(3, 3, 12, 7.0, samples=0),
    ]  # fmt: skip
    findings = {(f.name, f.driver): f for f in weigh_claims(rows, "PP", folds=10)}
    found = findings["velocity-based, n₂ = 3", "all"]
    assert (found.pairs, found.verdict) == (2, "holds")
    assert found.change == pytest.approx(-50.0)
    assert findings["velocity-based, n₂ = 6", "all"].pairs == 0


def test_the_papers_changes_follow_from_their_tables() -> None:
    """Typed figures agree with each other: each change of a claim of Table II is that of its two rows."""
    table = papers()["table_2"]
    columns = table["columns"]
    rows = [dict(zip(columns, row, strict=True)) for row in table["rows"]]
    measures = {"mean_error": "ave_err", "mean_variance": "var"}
    checked = 0
    for claim in papers()["claims"]:
        if claim["paper"] == "MP" and "change" in claim:
            before, after = (
                next(row for row in rows if all(row[name] == claim[point][name] for name in claim[point]))
                for point in ("base", "changed")
            )
            name = measures[claim["measure"]]
            assert claim["change"] == pytest.approx(100 * (after[name] / before[name] - 1), abs=0.1), claim["name"]
            checked += 1
    assert checked == 8
    assert len(rows) == 14
