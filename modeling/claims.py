"""What the papers claim, tested on the user's drivers: paired over folds and drivers, with confidence intervals.

For each driver and fold both models of a claim were fitted to the same data and tested on the same data; the logarithm
of the ratio of their measures is one pair. The interval is Student's t with the variance of Nadeau and Bengio (2003):
folds share most of their training data, so that the mean of J pairs varies by s² (1/J + 1/(M − 1)) and not by s²/J, M
being the number of folds and 1/(M − 1) the ratio of test to training data. Over D drivers, each with equal weight,

    d = mean over drivers of d_i,    Var = Σ_i s² (1/J_i + 1/(M − 1)) / D²,    ΣJ − D degrees of freedom

with s² pooled within the drivers. It speaks for these drivers; other drivers may differ by more.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from importlib.resources import files
from typing import Any

CONFIDENCE = 0.95

NEGLIGIBLE = 5.0
"""%; a claim that something changes nothing holds where the whole interval is smaller than this, up and down."""

HOLDS, FAILS, OPEN = "holds", "does not hold", "cannot be told"

Row = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Change:
    """By how much a measure changes, %, with its interval; None where there are too few pairs.

    Attributes:
        pairs: Pairs of a driver and a fold.
        base: Mean of the measure before, over the pairs, in its own unit.
        changed: Mean of the measure after, in the same unit.
        change: Relative change (geometric mean over the pairs), %.
        low: Lower end of the interval, %.
        high: Upper end of the interval, %.
    """

    pairs: int
    base: float | None
    changed: float | None
    change: float | None
    low: float | None
    high: float | None


@dataclass(frozen=True, slots=True)
class Finding:
    """A claim of a paper and what the user's data say of it.

    Attributes:
        name: Short name of the claim.
        claim: The claim in words.
        paper: MP or PP.
        where: Where the paper says so.
        measure: Column of the results that is compared.
        printed: The paper's figures.
        paper_change: The paper's relative change, %; None where it gives none.
        driver: Whose data; `all` is every driver with equal weight.
        windows: MP: all windows, or those of path type 1-1-1 as in the paper; empty for PP.
        pairs: See `Change`.
        base: See `Change`.
        changed: See `Change`.
        change: See `Change`.
        low: See `Change`.
        high: See `Change`.
        verdict: `holds`, `does not hold` or `cannot be told`.
        in_words: The verdict with its reason.
    """

    name: str
    claim: str
    paper: str
    where: str
    measure: str
    printed: str
    paper_change: float | None
    driver: str
    windows: str
    pairs: int
    base: float | None
    changed: float | None
    change: float | None
    low: float | None
    high: float | None
    verdict: str
    in_words: str


@cache
def papers() -> dict[str, Any]:
    """Return what the papers report (`papers.toml`)."""
    return tomllib.loads((files(__package__) / "papers.toml").read_text(encoding="utf-8"))


def weigh_claims(rows: Sequence[Row], paper: str, folds: int) -> list[Finding]:
    """Test the claims of a paper by `paired_change`.

    Args:
        rows: Results of its experiment, one for each point, driver and fold.
        paper: MP or PP.
        folds: M, at least 2, also where only some of them are done.

    Returns:
        A finding for each claim, kind of windows, and driver; `all` drivers first.

    Raises:
        ValueError: A measure is zero or negative and so has no logarithm.
    """
    drivers = list(dict.fromkeys(row["driver"] for row in rows))
    kinds = list(dict.fromkeys(row.get("windows", "") for row in rows))
    findings = []
    for claim in papers()["claims"]:
        if claim["paper"] != paper:
            continue
        for windows in kinds:
            own = [row for row in rows if row.get("windows", "") == windows]
            base, changed = (_values(own, claim[point], claim["measure"]) for point in ("base", "changed"))
            for driver in ("all", *drivers):
                chosen = [pair for pair in base if pair in changed and driver in ("all", pair[0])]
                change = paired_change([(pair[0], base[pair], changed[pair]) for pair in chosen], folds)
                verdict, why = judge(change, claim["expected"])
                told = {key: claim[key] for key in ("name", "claim", "paper", "where", "measure", "printed")}
                findings.append(
                    Finding(
                        **told,
                        paper_change=claim.get("change"),
                        driver=driver,
                        windows=windows,
                        **asdict(change),
                        verdict=verdict,
                        in_words=why,
                    )
                )
    return findings


def paired_change(pairs: Iterable[tuple[str, float, float]], folds: int) -> Change:
    """Return the relative change, exp(d) − 1, with its interval, exp(d ± t √Var) − 1, in %; see the module.

    Args:
        pairs: Driver, measure before and measure after, both positive and in any one unit, of each fold.
        folds: M, at least 2.

    Raises:
        ValueError: A measure is zero or negative and so has no logarithm.
    """
    by_driver: dict[str, list[tuple[float, float]]] = {}
    for driver, before, after in pairs:
        by_driver.setdefault(driver, []).append((before, after))
    found = [pair for own in by_driver.values() for pair in own]
    count, drivers = len(found), len(by_driver)
    if not count:
        return Change(0, None, None, None, None, None)
    before, after = (sum(pair[side] for pair in found) / count for side in (0, 1))
    logs = [[math.log(changed / base) for base, changed in own] for own in by_driver.values()]
    means = [sum(own) / len(own) for own in logs]
    mean = sum(means) / drivers
    low = high = None
    if (freedom := count - drivers) > 0:
        from scipy.stats import t

        square = sum((value - m) ** 2 for own, m in zip(logs, means, strict=True) for value in own) / freedom
        variance = sum(square * (1 / len(own) + 1 / (folds - 1)) for own in logs) / drivers**2
        half = float(t.ppf(0.5 + CONFIDENCE / 2, freedom)) * math.sqrt(variance)
        low, high = _percent(mean - half), _percent(mean + half)
    return Change(count, before, after, _percent(mean), low, high)


def judge(change: Change, expected: str) -> tuple[str, str]:
    """Return the verdict on a claim, `HOLDS`, `FAILS` or `OPEN`, and the reason in words.

    Args:
        change: What was found.
        expected: `lower`: the measure falls; `same`: it changes by less than `NEGLIGIBLE`.
    """
    if change.change is None or change.low is None or change.high is None:
        return OPEN, f"{OPEN}, too few pairs of folds for an interval: {change.pairs}"
    told = f"{_signed(change.change)} ({CONFIDENCE:.0%}: {_signed(change.low)} to {_signed(change.high)})"
    if expected == "lower":
        if change.high < 0:
            return HOLDS, f"{HOLDS}: {told}"
        if change.low > 0:
            return FAILS, f"{FAILS}, it is the other way round: {told}"
        return OPEN, f"{OPEN}, the interval includes no change: {told}"
    if change.low > -NEGLIGIBLE and change.high < NEGLIGIBLE:
        return HOLDS, f"{HOLDS}, less than {NEGLIGIBLE:g} % either way: {told}"
    if change.low >= NEGLIGIBLE or change.high <= -NEGLIGIBLE:
        return FAILS, f"{FAILS}, more than {NEGLIGIBLE:g} %: {told}"
    return OPEN, f"{OPEN}, the interval reaches beyond {NEGLIGIBLE:g} %: {told}"


def _values(rows: Iterable[Row], point: Row, measure: str) -> dict[tuple[str, int], float]:
    """Return the measure at a point of the grid, by driver and fold; the future path is always given."""
    return {
        (row["driver"], row["fold"]): row[measure]
        for row in rows
        if row["samples"] and row.get("future_path", True) and all(row[name] == value for name, value in point.items())
    }


def _percent(logarithm: float) -> float:
    return 100.0 * math.expm1(logarithm)


def _signed(percent: float) -> str:
    return f"{percent:+.1f} %".replace("-", "−")
