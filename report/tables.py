"""Tables of the report: rows of text from the manifest, the results and the events."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from .blocks import Cell, Column, Mark, Table
from .scores import Score

KMH = 3.6
MISSING = "–"


def text(value: Any, mark: Mark = "") -> Cell:
    """Return a cell with a value as it is; nothing is a dash."""
    return Cell(MISSING if value is None or value == "" else str(value), mark)


def count(value: int | None, mark: Mark = "") -> Cell:
    """Return a cell with an integer, its thousands apart."""
    return Cell(MISSING if value is None else f"{value:,}", mark)


def number(value: float | None, digits: int, mark: Mark = "") -> Cell:
    """Return a cell with a number of so many decimals; what is missing is a dash."""
    absent = value is None or not math.isfinite(value)
    return Cell(MISSING if absent else f"{value:,.{digits}f}".replace("-", "−"), mark)


def spread(score: Score, name: str, digits: int, mark: Mark = "", factor: float = 1.0) -> Cell:
    """Return a cell with a score's mean over the folds and, of more than one, ± their standard deviation."""
    mean, deviation = factor * score.mean(name), factor * score.deviation(name)
    if not math.isfinite(mean):
        return Cell(MISSING, mark)
    shown = f"{mean:.{digits}f}".replace("-", "−")
    return Cell(f"{shown} ± {deviation:.{digits}f}" if math.isfinite(deviation) else shown, mark)


def clock_time(seconds: float) -> str:
    """Return a duration as `h:mm:ss`, rounded to seconds."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"


def recordings_table(manifest: Mapping[str, Any], period: float, trusted: bool) -> Table:
    """Count what every file gave: records in are accepted plus rejected.

    Args:
        manifest: The manifest.
        period: Grid period, s.
        trusted: The user says that the CAN clock is right as it is.
    """
    rows = []
    for key, entry in entries(manifest, "recordings"):
        synced = synced_output(entry)
        total = [sum(file[what] for file in entry["inputs"]) for what in ("accepted", "rejected")]
        for number_of_file, file in enumerate(entry["inputs"]):
            whole = number_of_file == 0
            rejected, truncated = file["rejected"], file["truncated"]
            rows.append(
                [
                    text(key if whole else " "),
                    text(file["path"], "alert" if "failed" in file else ""),
                    text(file["format"]),
                    count(file["accepted"] + rejected),
                    count(file["accepted"]),
                    count(rejected, "alert" if rejected else ""),
                    text("yes" if truncated else "no", "alert" if truncated else ""),
                    count(synced.get("rows")) if whole else text(" "),
                    count(synced.get("runs")) if whole else text(" "),
                    text(clock_time(synced.get("rows_in_runs", 0) * period)) if whole else text(" "),
                    _clock_state(entry["clock"], trusted) if whole else text(" "),
                ]
            )
        if sum(total) and len(entry["inputs"]) > 1:
            rows.append(
                [text(" "), text("sum"), text(" "), count(sum(total)), count(total[0]), count(total[1])]
                + [text(" ")] * 5
            )
    columns = [
        Column("Recording", numeric=False), Column("File", numeric=False), Column("Format", numeric=False),
        Column("Records in"), Column("Accepted"), Column("Rejected"), Column("Cut off", numeric=False),
        Column("Synced rows"), Column("Runs"), Column("In runs", "h:mm:ss"), Column("CAN clock", numeric=False),
    ]  # fmt: skip
    caption = (
        "Records in = accepted + rejected. A run is a stretch without gaps; nothing is computed across its ends. "
        "“Cut off”: the file ends within a record."
    )
    return Table(caption, columns, rows)


def _clock_state(clock: Mapping[str, Any], trusted: bool) -> Cell:
    if trusted:
        return text("trusted")
    return text("aligned") if clock["applied"] else text("not aligned", "alert")


def clock_table(manifest: Mapping[str, Any], trusted: bool) -> Table:
    """List the estimated CAN clock of every recording."""
    rows = []
    for key, entry in entries(manifest, "recordings"):
        clock = entry["clock"]
        rows.append(
            [
                text(key),
                number(clock["offset_s"], 4),
                number(clock.get("drift_ppm"), 1),
                number(clock.get("residual_ms"), 1),
                number(clock.get("standard_error_ms"), 1),
                number(clock.get("correlation"), 3),
                text("yes") if clock["applied"] else text("no", "" if trusted else "alert"),
                text(clock.get("reason")),
            ]
        )
    columns = [
        Column("Recording", numeric=False), Column("Offset", "s"), Column("Drift", "ppm"), Column("Residual", "ms"),
        Column("Standard error", "ms"), Column("Correlation"), Column("Applied", numeric=False),
        Column("Remark", numeric=False),
    ]  # fmt: skip
    caption = "Offset: CAN stamp − UTC at the recording's start. The standard error is that of the offset."
    return Table(caption, columns, rows)


def excluded_table(manifest: Mapping[str, Any], recorded: Mapping[str, float]) -> Table:
    """Say per driver what is in the dataset and what was left out of it, and why.

    Args:
        manifest: The manifest.
        recorded: Synced time of each driver, s.
    """
    rows = []
    for driver, entry in entries(manifest, "dataset"):
        whole = recorded.get(driver, math.nan)
        undecided = entry.get("undecided", {})
        parts: list[tuple[str, float, float | None]] = [("in the dataset", entry["driven_s"], None)]
        parts += [(f"left out: {kind}", s, undecided.get(kind, 0.0)) for kind, s in entry["excluded"].items()]
        whole_s = math.fsum(seconds for _, seconds, _ in parts)
        parts += [("sum", whole_s, math.fsum(undecided.values())), ("synced", whole, None)]
        for position, (what, seconds, of_proposals) in enumerate(parts):
            rows.append(
                [
                    text(driver if position == 0 else " "),
                    text(what),
                    number(seconds, 1),
                    number(100 * seconds / whole if whole else None, 1),
                    number(of_proposals or None, 1),
                ]
            )
    columns = [
        Column("Driver", numeric=False), Column("What", numeric=False), Column("Time", "s"),
        Column("Share of synced time", "%"), Column("Nobody decided", "s"),
    ]  # fmt: skip
    caption = (
        "What is in the dataset, what was left out and why; every synced row counts once. “gap”: outside of runs; "
        "“missing”: a signal that the dataset needs; “single”: a row alone between others left out; all else are kinds "
        "of events, left out until somebody calls them normal; “navigation”: its status or accuracy is not to be "
        "trusted."
    )
    return Table(caption, columns, rows)


def situations_table(manifest: Mapping[str, Any]) -> Table:
    """Say per driver in which situations the dataset was driven, as `situations.csv` has them.

    Args:
        manifest: The manifest.
    """
    rows = []
    for driver, entry in entries(manifest, "dataset"):
        parts = list(entry.get("situations", {}).items())
        parts.append(("nothing says", entry["driven_s"] - math.fsum(seconds for _, seconds in parts)))
        for position, (situation, seconds) in enumerate(parts):
            share = 100 * seconds / entry["driven_s"] if entry["driven_s"] else None
            rows.append([text(driver if position == 0 else " "), text(situation), number(seconds, 1), number(share, 1)])
    columns = [
        Column("Driver", numeric=False), Column("Situation", numeric=False), Column("Time", "s"),
        Column("Share of the dataset", "%"),
    ]  # fmt: skip
    return Table("Driving situations in the dataset, proposed or decided.", columns, rows)


TABLE_I = ((8.29, 0.15, 0.45, 33.45), (0.24, 0.008, 0.01, 50.31), (1.15, 0.024, 0.05, 54.69))
"""MP's Table I by its labels: td (s), ave_cd (deg), max_cd (deg), ave_vel (km/h)."""


def cluster_table(manifest: Mapping[str, Any]) -> Table:
    """List the path clusters of every driver in the units of MP, Table I, and that table below."""
    rows = [
        [
            text(driver),
            count(cluster["label"]),
            number(100 * cluster["share"], 1),
            number(cluster["duration_s"], 2),
            number(cluster["average_course_deviation_deg"], 3),
            number(cluster["maximum_course_deviation_deg"], 3),
            number(KMH * cluster["average_speed_m_s"], 2),
        ]
        for driver, entry in entries(manifest, "dataset")
        for cluster in entry.get("clusters", ())
    ]
    rows += [
        [
            text("MP, Table I", "baseline"),
            count(label),
            number(None, 1),
            *(number(value, digits) for value, digits in zip(means, (2, 3, 3, 2), strict=True)),
        ]
        for label, means in enumerate(TABLE_I, start=1)
    ]
    columns = [
        Column("Driver", numeric=False), Column("Label"), Column("Share of segments", "%"), Column("td", "s"),
        Column("ave_cd", "°"), Column("max_cd", "°"), Column("ave_vel", "km/h"),
    ]  # fmt: skip
    caption = (
        "Mean features of the path segments of each cluster: duration, average and maximum course deviation per 0.1 s, "
        "average speed. Labels go by falling average course deviation: label 1 is the sharpest kind of each driver, so "
        "two drivers' labels have a rank in common, not a meaning. MP's labels have another order."
    )
    return Table(caption, columns, rows)


KNOWS_MORE = "persistence"
"""The lookahead baseline that is given what no model is: the distance of the sample before, known from the steering."""


def lookahead_table(driver: str, scores: Sequence[Score]) -> Table:
    """List the errors of the lookahead models of one driver, its baselines first (PP eq. 22 and 23)."""
    rivals = [score for score in scores if score.model != KNOWS_MORE]
    columns = [
        Column("Model", numeric=False), Column("Components N"), Column("Regressors n₂"),
        Column("Test error", "m"), Column("against best baseline", "%"), Column("better in", "folds"),
        Column("Test sd", "m"), Column("Training error", "m"), Column("Training sd", "m"), Column("Test samples"),
    ]  # fmt: skip
    rows = [
        [
            text(score.model, "baseline" if score.is_baseline else ""),
            count(score.parameters.get("components")),
            count(score.parameters.get("regressors")),
            spread(score, "mean_error", 2, _best(score, rivals)),
            *_gain(score, rivals),
            spread(score, "mean_sd", 2),
            spread(score, "train_mean_error", 2),
            spread(score, "train_mean_sd", 2),
            count(_total(score)),
        ]
        for score in scores
    ]
    caption = (
        f"{driver}: error of the predicted lookahead distance, mean ± standard deviation over the folds; ★ is the "
        "smallest mean. “sd” is the standard deviation that the model itself states (PP eq. 22 and 23). Persistence "
        "repeats the distance of 0.1 s before, which takes the driver's own steering to know; no model is given it, "
        "and none is measured by it."
    )
    return Table(caption, columns, rows)


def motion_primitives_table(driver: str, scores: Sequence[Score]) -> Table:
    """List the errors of the motion primitives of one driver, its baselines first (MP, Table II)."""
    columns = [
        Column("Model", numeric=False), Column("Path types n₁"), Column("Past steps n₂"), Column("Components n₄"),
        Column("ave_err", "°"), Column("against best baseline", "%"), Column("better in", "folds"), Column("var", "°²"),
        Column("within 68 % band", "%"), Column("within 95 % band", "%"), Column("Test samples"),
    ]  # fmt: skip
    rows = [
        [
            text(score.model, "baseline" if score.is_baseline else ""),
            count(None if score.is_baseline else score.parameters.get("path_types")),
            number(score.parameters.get("past_steps"), 0),
            count(score.parameters.get("components")),
            spread(score, "mean_error", 2, _best(score, scores)),
            *_gain(score, scores),
            spread(score, "mean_variance", 2),
            spread(score, "coverage_68", 1, factor=100),
            spread(score, "coverage_95", 1, factor=100),
            count(_total(score)),
        ]
        for score in scores
    ]
    caption = (
        f"{driver}: error of the predicted steering wheel angle, mean ± standard deviation over the folds "
        "(MP, Table II); ★ is the smallest mean. “var” is the variance that the model states; its bands should hold "
        "what they promise."
    )
    return Table(caption, columns, rows)


def _best(score: Score, scores: Sequence[Score]) -> Mark:
    least = min((error for other in scores if math.isfinite(error := other.mean("mean_error"))), default=math.nan)
    return "best" if score in scores and score.mean("mean_error") == least else ""


def _gain(score: Score, rivals: Sequence[Score]) -> list[Cell]:
    """Compare a model's error with the best baseline's: by how much it differs, and in how many folds it is smaller."""
    baselines = [other for other in rivals if other.is_baseline and math.isfinite(other.mean("mean_error"))]
    if score.is_baseline or not baselines or not math.isfinite(score.mean("mean_error")):
        return [text(None), text(None)]
    bar = min(baselines, key=lambda other: other.mean("mean_error"))
    percent = round(100 * (score.mean("mean_error") / bar.mean("mean_error") - 1))
    below, folds = score.folds_below(bar)
    shown = f"{percent:+d}".replace("-", "−") if percent else "0"
    return [text(shown, "alert" if percent > 0 else ""), text(f"{below} of {folds}")]


def _total(score: Score) -> int | None:
    finite = [value for value in score.values.get("samples", ()) if math.isfinite(value)]
    return round(sum(finite)) if finite else None


def entries(manifest: Mapping[str, Any], section: str) -> list[tuple[str, Mapping[str, Any]]]:
    """Return the entries of a section of the manifest that stand for something, sorted by name."""
    return [(name, entry) for name, entry in sorted(manifest.get(section, {}).items()) if entry.get("outputs")]


def synced_output(entry: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return what a recording's entry says of its synced file, nothing where it has none."""
    return next((output for output in entry["outputs"] if output["path"].startswith("synced/")), {})
