"""Whether the models are personal: learning curves, models of one driver on another, and whose minute it is."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from ..schemas.errors import InputError
from ..schemas.project import Project
from ..schemas.tables import CROSS_DRIVER_COLUMNS, LEARNING_CURVE_COLUMNS
from .blocks import Block, Column, Figure, Gallery, Note, Table
from .model_figures import error_over_minutes, matrix
from .tables import count, number, text

UNITS = {"steering": "°", "lookahead": "m"}
NOTHING = Note(
    "No personal models were compared yet; it takes two drivers and models.personal.evaluate.", "wheelprint evaluate"
)

Rows = Sequence[Mapping[str, str]]


def personal_blocks(project: Project) -> list[Block]:
    """Return the blocks of the section.

    Raises:
        InputError: A table of results lacks columns or holds no numbers.
    """
    folder = project.results_folder
    if not (folder / "identification.json").exists():
        return [NOTHING]
    curve = _read(folder / "learning_curve.csv", LEARNING_CURVE_COLUMNS)
    crossed = _read(folder / "cross_driver.csv", CROSS_DRIVER_COLUMNS)
    rates = json.loads((folder / "identification.json").read_text(encoding="utf-8"))
    try:
        return [
            Note(
                "Learning curves: the population is the other drivers alone, and “adapted” is that population adapted "
                "to the minutes of this driver. Elsewhere every model has learnt from all folds but the tested one."
            ),
            Gallery(list(_curves(curve))),
            Gallery(list(_matrices(crossed))),
            *_identification(rates),
        ]
    except ValueError as error:
        reason = f"expected numbers ({error}); run `wheelprint evaluate` again"
        raise InputError(folder / "learning_curve.csv", "", reason) from None


def _curves(rows: Rows) -> list[Figure]:
    figures = []
    for quantity in dict.fromkeys(row["quantity"] for row in rows):
        for driver in sorted({row["driver"] for row in rows}):
            lines: dict[str, dict[int, list[float]]] = {}
            for row in rows:
                if (row["quantity"], row["driver"]) == (quantity, driver):
                    of_model = lines.setdefault(row["model"], {})
                    of_model.setdefault(int(row["minutes"]), []).append(float(row["mean_error"]))
            if lines:
                caption = (
                    f"{driver}: error of {quantity} on test folds over the minutes learnt from; bars: sd over folds."
                )
                figures.append(
                    Figure(caption, error_over_minutes(lines, f"mean error of {quantity}, {UNITS[quantity]}"))
                )
    return figures


def _matrices(rows: Rows) -> list[Figure]:
    figures = []
    drivers = sorted({row["driver"] for row in rows} | {row["model_driver"] for row in rows})
    adapted = [row for row in rows if row["model"] == "adapted"]
    for quantity in dict.fromkeys(row["quantity"] for row in adapted):
        for what, title, digits in (
            ("mean_error", f"mean error, {UNITS[quantity]}", 2),
            ("log_likelihood", "log-likelihood, nats", 2),
        ):
            cells: dict[tuple[str, str], list[float]] = {}
            for row in adapted:
                if row["quantity"] == quantity:
                    cells.setdefault((row["model_driver"], row["driver"]), []).append(float(row[what]))
            values = [[fmean(cells[m, d]) if (m, d) in cells else None for d in drivers] for m in drivers]
            caption = f"{quantity.capitalize()}, {title}: adapted model of one driver on the test folds of another."
            figures.append(
                Figure(caption, matrix(drivers, values, "driven by", "model of", digits, reverse=what == "mean_error"))
            )
    return figures


def _identification(rates: Sequence[Mapping[str, Any]]) -> list[Block]:
    columns = [
        Column("Models", numeric=False), Column("Density", numeric=False), Column("Evidence", numeric=False),
        Column("Minutes"), Column("Named rightly", "%"), Column("95 % interval", "%", numeric=False),
    ]  # fmt: skip
    rows = [
        [
            text(rate["model"]),
            text(rate["density"]),
            text(rate["evidence"]),
            count(rate["minutes"]),
            number(100 * rate["rate"], 1),
            text(f"{100 * rate['low']:.1f} to {100 * rate['high']:.1f}"),
        ]
        for rate in rates
    ]
    caption = (
        "Whose model explains a held-out minute best? The conditional density, of what the driver does given the "
        "road and the speed, names drivers; the joint density also knows roads and speeds apart."
    )
    blocks: list[Block] = [Table(caption, columns, rows)]
    shown = [r for r in rates if (r["model"], r["density"]) == ("adapted", "conditional")]
    if shown:
        best = next((r for r in shown if r["evidence"] == "both"), shown[0])
        confusion = best["confusion"]
        drivers = sorted({*confusion, *(named for row in confusion.values() for named in row)})
        values = [[float(confusion.get(driver, {}).get(named, 0)) for named in drivers] for driver in drivers]
        figure = matrix(drivers, values, "named", "driven by", 0)
        caption = f"Held-out minutes by driver and by who was named: adapted, conditional, {best['evidence']}."
        blocks.append(Gallery([Figure(caption, figure)]))
    return blocks


def _read(path: Path, columns: Sequence[str]) -> Rows:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file)
            missing = [name for name in columns if name not in (reader.fieldnames or ())]
            rows = list(reader)
    except FileNotFoundError:
        raise InputError(path, "", "no such file; run `wheelprint evaluate` again") from None
    if missing:
        reason = f"the columns {', '.join(missing)} are missing; remove it and run `wheelprint evaluate` again"
        raise InputError(path, "line 1", reason)
    return rows
