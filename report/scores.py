"""The tables of the evaluation, gathered by model: what every fold measured."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..schemas.errors import InputError


@dataclass(frozen=True, slots=True)
class Score:
    """What the folds say of one model of one driver.

    Attributes:
        driver: The driver.
        model: Name of the model or baseline.
        parameters: Its parameters by column name; empty for a baseline.
        values: Per fold, by column name (with `train_` before what was measured on the training split).
    """

    driver: str
    model: str
    parameters: Mapping[str, int]
    values: Mapping[str, Sequence[float]]

    @property
    def is_baseline(self) -> bool:
        """Whether it is there to be beaten: it has no mixture components."""
        return "components" not in self.parameters

    def mean(self, name: str) -> float:
        """Return the mean over the folds that have a value; NaN where none has."""
        finite = self._finite(name)
        return float(np.mean(finite)) if finite else math.nan

    def deviation(self, name: str) -> float:
        """Return the standard deviation over the folds that have a value; NaN where fewer than two have."""
        finite = self._finite(name)
        return float(np.std(finite, ddof=1)) if len(finite) > 1 else math.nan

    def folds_below(self, other: Score) -> tuple[int, int]:
        """Return in how many folds the error is smaller than the other's, and of how many folds both have one."""
        mine, theirs = (dict(zip(s.values["fold"], s.values["mean_error"], strict=True)) for s in (self, other))
        both = [fold for fold in mine if math.isfinite(mine[fold]) and math.isfinite(theirs.get(fold, math.nan))]
        return sum(mine[fold] < theirs[fold] for fold in both), len(both)

    def _finite(self, name: str) -> list[float]:
        return [value for value in self.values.get(name, ()) if math.isfinite(value)]

    @property
    def label(self) -> str:
        """Name and parameters in MP's letters; of a baseline, those that it depends on."""
        letters = {"path_types": "n₁", "past_steps": "n₂", "components": "n₄"}
        told = [
            f"{letter} = {self.parameters[name]}"
            for name, letter in letters.items()
            if name in self.parameters and not (self.is_baseline and name == "path_types")
        ]
        return f"{self.model}, {', '.join(told)}".replace("-", "−") if told else self.model


def read_scores(path: Path, columns: Sequence[str]) -> list[Score]:
    """Gather a table of results by driver, model and parameters; models follow baselines.

    Raises:
        InputError: Columns are missing or hold no numbers.
    """
    names = ("path_types", "past_steps", "future_steps", "components", "regressors")
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        if missing := [name for name in columns if name not in (reader.fieldnames or ())]:
            reason = f"the columns {', '.join(missing)} are missing; remove it and run `wheelprint evaluate` again"
            raise InputError(path, "line 1", reason)
        found: dict[tuple[Any, ...], dict[str, list[float]]] = {}
        for row in reader:
            key = (row["driver"], row["model"], *(row.get(name) or "" for name in names))
            prefix = "train_" if row.get("split") == "train" else ""
            values = found.setdefault(key, {})
            for name in columns:
                if name.startswith(("mean_", "coverage_")) or name in ("fold", "samples"):
                    values.setdefault(prefix + name, []).append(_number(path, reader.line_num, name, row[name]))
    scores = [
        Score(driver, model, {n: int(float(v)) for n, v in zip(names, given, strict=True) if v}, values)
        for (driver, model, *given), values in found.items()
    ]
    return sorted(scores, key=lambda s: (s.driver, not s.is_baseline, s.model, *s.parameters.values()))


def _number(path: Path, line: int, name: str, found: str) -> float:
    try:
        return float(found) if found else math.nan
    except ValueError:
        reason = f"{name}: expected a number, found {found!r}; run `wheelprint evaluate` again"
        raise InputError(path, f"line {line}", reason) from None
