"""Tables of the drivers' data cards: how much driving of which kind there is, segments, folds."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from .blocks import Cell, Column, Table
from .tables import KMH, clock_time, count, number, text

Card = Mapping[str, Any]


def driving_table(cards: Sequence[Card]) -> Table:
    """Sum up every driver's dataset."""
    rows = []
    for card in cards:
        absent = sum(part["seconds"] for part in card["excluded"])
        undecided = sum(part["undecided_s"] for part in card["excluded"])
        sides = card["segments"]["by_side"]
        samples = card["folds"]["samples"]
        rows.append(
            [
                text(card["driver"]),
                count(len(card["recordings"])),
                text(clock_time(card["driven_s"])),
                number(card["distance_m"] / 1000, 1),
                number(100 * absent / (card["driven_s"] + absent), 1),
                number(undecided, 1, "alert" if undecided else ""),
                *(count(sides.get(side, {}).get("segments", 0)) for side in ("left", "neutral", "right")),
                text(f"{len(samples)} by {card['folds']['by']}"),
                text(f"{min(samples):,} to {max(samples):,}"),
            ]
        )
    columns = [
        Column("Driver", numeric=False), Column("Recordings"), Column("Driven", "h:mm:ss"), Column("Way", "km"),
        Column("Left out", "%"), Column("of it undecided", "s"), Column("Left segments"), Column("Neutral"),
        Column("Right"), Column("Folds", numeric=False), Column("Samples of a fold"),
    ]  # fmt: skip
    caption = (
        "What the dataset holds of every driver. The whole data card, with the share of every reason for leaving out, "
        "units, versions and inputs, is dataset/driver=…/_card.json."
    )
    return Table(caption, columns, rows)


def road_table(cards: Sequence[Card]) -> Table:
    """Say how fast and on which bends every driver drove, and in which situations where something says."""
    rows = []
    for card in cards:
        kinds = ("speed_m_s", _speed), ("curvature_1_m", _bend), ("situation", _situation)
        parts = [(name(part), part) for key, name in kinds for part in card["road"].get(key, ()) if part["seconds"]]
        for position, (name, part) in enumerate(parts):
            rows.append(
                [
                    text(card["driver"] if position == 0 else " "),
                    text(name),
                    text(clock_time(part["seconds"])),
                    number(100 * part["seconds"] / card["driven_s"], 1),
                    number(part["distance_m"] / 1000, 2),
                ]
            )
    columns = [
        Column("Driver", numeric=False), Column("Road", numeric=False), Column("Driven", "h:mm:ss"),
        Column("Share", "%"), Column("Way", "km"),
    ]  # fmt: skip
    caption = (
        "The mix of roads: by speed, by the curvature of the driven path and, where situations are tagged or proposed, "
        "by situation; each adds up to all of the driving."
    )
    return Table(caption, columns, rows)


def folds_table(cards: Sequence[Card]) -> Table:
    """List the folds of every driver."""
    rows = list(_folds(cards))
    columns = [
        Column("Driver", numeric=False), Column("Fold"), Column("Samples"), Column("Share", "%"),
        Column("Recordings", numeric=False),
    ]  # fmt: skip
    caption = "The groups of cross-validation (PP eq. 12); every sample of a driver is in one of them."
    return Table(caption, columns, rows)


def _folds(cards: Sequence[Card]) -> Iterator[list[Cell]]:
    for card in cards:
        samples = card["folds"]["samples"]
        for fold, (own, recordings) in enumerate(zip(samples, card["folds"]["recordings"], strict=True)):
            driver = text(card["driver"] if fold == 0 else " ")
            shown = text(", ".join(itertools.islice(recordings, 3)) + (", …" if len(recordings) > 3 else ""))
            yield [driver, count(fold), count(own), number(100 * own / sum(samples), 1), shown]


def _speed(part: Mapping[str, Any]) -> str:
    low, high = part["from"], part["to"]
    if high is None:
        return f"from {KMH * low:.0f} km/h"
    return f"{KMH * low:.0f} to {KMH * high:.0f} km/h"


def _bend(part: Mapping[str, Any]) -> str:
    low, high = part["from"], part["to"]
    if low is None:
        return "curvature unknown: first of a run"
    if high is None:
        return f"radius up to {1 / low:.0f} m"
    return f"radius {1 / high:.0f} to {1 / low:.0f} m" if low else f"straight: radius over {1 / high:.0f} m"


def _situation(part: Mapping[str, Any]) -> str:
    name: str | None = part["situation"]
    return name or "no situation"
