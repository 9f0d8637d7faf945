"""The section on the papers' experiments: their tables and figures beside the same ones from the user's drivers."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..modeling.claims import CONFIDENCE, HOLDS, NEGLIGIBLE, OPEN, papers
from ..schemas.errors import InputError
from ..schemas.project import Project
from ..schemas.tables import LOOKAHEAD_COLUMNS
from . import experiment_figures, model_figures
from .blocks import Block, Column, Figure, Gallery, Note, Table
from .scores import read_scores
from .tables import count, number, text

VARIANTS = (("", "formulas corrected"), ("faithful", "formulas as printed"))
"""Folder below `results/experiments/` and what it holds."""


def experiment_blocks(project: Project) -> list[Block]:
    """Return what the section shows; an experiment that was not run yet says what runs it.

    Raises:
        InputError: A file of results is damaged.
    """
    blocks: list[Block] = []
    for folder, variant in VARIANTS:
        place = project.results_folder / "experiments" / folder
        if (place / "claims.json").is_file():
            blocks += [*_claims(place, variant), *_motion_primitives(place, variant), *_lookahead(place, variant)]
    if not blocks:
        return [
            Note(
                "MP's Table II was not run on these drivers yet.", "wheelprint evaluate --experiment motion-primitives"
            ),
            Note("PP's Fig. 5 was not run on these drivers yet.", "wheelprint evaluate --experiment lookahead"),
        ]
    sources = "; ".join(f"{key}: {value['title']}, {value['venue']}" for key, value in papers()["sources"].items())
    return [Note(f"The papers: {sources}. What differs by choice is in docs/choices.md."), *blocks]


def _claims(place: Path, variant: str) -> list[Block]:
    findings = [finding for finding in _json(place / "claims.json") if finding["driver"] == "all"]
    rows = [
        [
            text(finding["claim"]),
            text(f"{finding['paper']}, {finding['where']}"),
            text(finding["printed"]),
            text(finding["windows"]),
            count(finding["pairs"]),
            number(finding["base"], 2),
            number(finding["changed"], 2),
            text(
                finding["in_words"],
                "best" if finding["verdict"] == HOLDS else "" if finding["verdict"] == OPEN else "alert",
            ),
        ]
        for finding in findings
    ]
    columns = [
        Column("Claim", numeric=False), Column("Paper", numeric=False), Column("Its figures", numeric=False),
        Column("Windows", numeric=False), Column("Pairs"), Column("Before", "° or m"), Column("After", "° or m"),
        Column("Here", numeric=False),
    ]  # fmt: skip
    caption = (
        f"What the papers claim, tested on these drivers ({variant}). Pairs are drivers and folds; relative change of "
        f"the measure with its {CONFIDENCE:.0%} interval by Student's t over the pairs, its variance corrected for "
        f"folds that share training data. “Nothing that matters” is less than {NEGLIGIBLE:g} %. Variances are in °²."
    )
    return [Table(caption, columns, rows)]


def _motion_primitives(place: Path, variant: str) -> list[Block]:
    if not (place / "table_2.csv").is_file():
        return [
            Note(
                "MP's Table II was not run on these drivers yet.", "wheelprint evaluate --experiment motion-primitives"
            )
        ]
    blocks: list[Block] = [_table_1(place, variant), _table_2(place, variant)]
    shown = []
    told = ", ".join(f"{row['error_lower_by_deg']:g}°" for row in papers()["figure_2"])
    for cell in _json(place / "figure_2.json"):
        situations = cell["rows"]
        if situations:
            gains = ", ".join(
                f"{s['methods']['general']['mean_error'] - s['methods']['proposed']['mean_error']:.2f}°"
                for s in situations
            ).replace("-", "−")
            caption = (
                f"{situations[0]['driver']}: MP's Fig. 2 ({variant}), four situations of a test fold from the one with "
                f"the most steering on. The proposed method's error is lower than the general one's by {gains}; in the "
                f"paper's situations by {told}. Bands are one standard deviation."
            )
            shown.append(Figure(caption, experiment_figures.situations(situations)))
    return [*blocks, Gallery(shown, wide=True)] if shown else blocks


def _table_1(place: Path, variant: str) -> Table:
    names = ("duration_s", "average_course_deviation_deg", "maximum_course_deviation_deg", "average_speed_km_h")
    rows = [
        [
            text(row["source"], "baseline" if row["source"] == "paper" else ""),
            text(row["label"]),
            *(number(_float(row[name]), digits) for name, digits in zip(names, (2, 3, 3, 1), strict=True)),
        ]
        for row in _rows(place / "table_1.csv")
    ]
    columns = [
        Column("Of", numeric=False), Column("Label"), Column("Duration", "s"), Column("Average |Δθ|", "°/0.1 s"),
        Column("Maximum |Δθ|", "°/0.1 s"), Column("Average speed", "km/h"),
    ]  # fmt: skip
    return Table(f"MP's Table I ({variant}): three clusters of path segments, means over the folds.", columns, rows)


def _table_2(place: Path, variant: str) -> Table:
    rows = []
    for row in _rows(place / "table_2.csv"):
        numbers = {name: _float(value) for name, value in row.items()}
        cells = [text(row[name].replace("-", "−")) for name in ("type", "path_types", "past_steps", "components")]
        cells += [number(numbers["paper_error"], 2, "baseline"), number(numbers["paper_variance"], 2, "baseline")]
        for windows in ("1_1_1", "all"):
            fell_back = numbers[f"fell_back_{windows}"]
            cells += [
                number(numbers[f"error_{windows}"], 2),
                number(numbers[f"variance_{windows}"], 2),
                number(None if fell_back is None else 100 * fell_back, 1),
            ]
        rows.append([*cells, count(int(row["samples_all"])), count(int(row["folds_all"]))])
    columns = [
        Column("Type"), Column("n₁"), Column("n₂"), Column("n₄"), Column("Paper: ave_err", "°"), Column("Paper: var"),
        Column("1-1-1: error", "°"), Column("1-1-1: variance", "°²"), Column("1-1-1: fell back", "%"),
        Column("All: error", "°"), Column("All: variance", "°²"), Column("All: fell back", "%"), Column("Windows"),
        Column("Cells"),
    ]  # fmt: skip
    caption = (
        f"MP's Table II ({variant}) beside the same points on these drivers, means over drivers and folds; the paper's "
        "are of windows of path type 1-1-1. “Fell back”: windows that a coarser regression (27 → 3 → 1) predicted, "
        "because their path type had too few windows to learn from."
    )
    return Table(caption, columns, rows)


def _lookahead(place: Path, variant: str) -> list[Block]:
    if not (place / "lookahead.csv").is_file():
        return [Note("PP's Fig. 5 was not run on these drivers yet.", "wheelprint evaluate --experiment lookahead")]
    scores = read_scores(place / "lookahead.csv", LOOKAHEAD_COLUMNS)
    shown = []
    for driver in dict.fromkeys(score.driver for score in scores):
        figure = model_figures.errors_by_components([score for score in scores if score.driver == driver])
        experiment_figures.add_printed(figure, papers()["figure_5"])
        caption = (
            f"{driver}: PP's Fig. 5 ({variant}), means of 20 fits, bars over the folds; stars are what PP's text says "
            "of its driver."
        )
        shown.append(Figure(caption, figure))
    for cell in _json(place / "figure_6_7.json"):
        driven = cell["rows"]
        told = "; ".join(
            f"{row['model']}: {row['mean_deviation_m']:.2f} m from the track on average, "
            f"{row['largest_deviation_m']:.2f} m at most, standard deviation of the lookahead distance "
            f"{row['mean_sd_m']:.2f} m"
            for row in driven
        )
        printed = papers()["figure_7"]
        caption = (
            f"{driven[0]['driver']}: PP's Figs. 6 and 7 ({variant}), pure pursuit of a test track with N = "
            f"{printed['components']}. {told}. PP names errors of the lookahead distance: velocity-based below "
            f"{printed['velocity_error_below_m']:g} m, general above {printed['general_error_above_m']:g} m."
        )
        shown += [
            Figure(caption, experiment_figures.track(driven, cell["track"])),
            Figure(f"{driven[0]['driver']}: along the track.", experiment_figures.along_track(driven)),
        ]
    return [Gallery(shown, wide=True)] if shown else []


def _json(path: Path) -> Any:
    if not path.is_file():
        return []
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(path, "", f"not JSON ({error}); run `wheelprint evaluate --experiment` again") from None


def _rows(path: Path) -> Sequence[Mapping[str, str]]:
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _float(value: str) -> float | None:
    return float(value) if value else None
