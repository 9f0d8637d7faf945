"""What the raw logs gave: what became of every frame, what their stamps show, cameras, repairs of the databases."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from .blocks import Column, Table
from .tables import count, entries, number, text


def frames_table(manifest: Mapping[str, Any]) -> Table | None:
    """Say what became of every CAN frame; None where there is no CAN log that could be read."""
    rows = []
    for key, file in _inputs(manifest):
        if file.get("kind") != "can" or "decoded" not in file:
            continue
        parts = [file["decoded"], file["unknown"], file["remote"], file["errors"], file["rejected"]]
        whole = file["accepted"] + file["rejected"]
        rows.append(
            [
                text(key),
                text(file["path"]),
                count(whole, "" if sum(parts) == whole else "alert"),
                *(count(part, "alert" if part and place == 4 else "") for place, part in enumerate(parts)),
                count(len(file.get("unknown_ids", ()))),
                number(100 * file["decoded"] / whole if whole else None, 1),
            ]
        )
    if not rows:
        return None
    columns = [
        Column("Recording", numeric=False), Column("File", numeric=False), Column("Frames in"), Column("Decoded"),
        Column("Unknown"), Column("Remote"), Column("Errors"), Column("Rejected"), Column("Unknown messages"),
        Column("Decoded", "%"),
    ]  # fmt: skip
    caption = (
        "CAN frames in = decoded + unknown + remote + errors + rejected. Unknown: no database has the identifier; "
        "remote and error frames carry no signals; rejected records are no frames."
    )
    return Table(caption, columns, rows)


def stamps_table(manifest: Mapping[str, Any]) -> Table | None:
    """List the logs whose own stamps go back or leave out more than a second; None where there is none."""
    rows = []
    for key, file in _inputs(manifest):
        stamps = file.get("stamps")
        if not stamps or not (stamps["backwards"]["count"] or stamps["gaps"]["count"]):
            continue
        back, repeated, gaps = stamps["backwards"], stamps["repeated"], stamps["gaps"]
        rows.append(
            [
                text(key),
                text(file["path"]),
                count(back["count"], "alert" if back["count"] else ""),
                number(back["worst_s"] if back["count"] else None, 3),
                text(_readable(back["at"])),
                count(gaps["count"]),
                number(gaps["longest_s"] if gaps["count"] else None, 2),
                text(_readable(gaps["at"])),
                count(repeated["count"]),
            ]
        )
    if not rows:
        return None
    columns = [
        Column("Recording", numeric=False), Column("File", numeric=False), Column("Go back"),
        Column("by up to", "s"), Column("after", "UTC", numeric=False), Column("Gaps over 1 s"),
        Column("Longest", "s"), Column("from", "UTC", numeric=False), Column("Repeated"),
    ]  # fmt: skip
    caption = (
        "What logs show by their own stamps, each record against the one before it. Logs that neither go back nor "
        "leave out more than 1 s are not listed."
    )
    return Table(caption, columns, rows)


def cameras_table(manifest: Mapping[str, Any]) -> Table | None:
    """List every camera; None where there is none."""
    rows = []
    for key, file in _inputs(manifest):
        for camera, frames in file.get("cameras", {}).items():
            common = file["clock"].get("common_s")
            rows.append(
                [
                    text(key),
                    text(camera),
                    count(frames["count"]),
                    number(frames["rate_hz"], 2),
                    count(frames["gaps"]),
                    number(frames["longest_interval_s"], 2),
                    number(common, 1, "alert" if common == 0 else ""),
                ]
            )
    if not rows:
        return None
    columns = [
        Column("Recording", numeric=False), Column("Camera", numeric=False), Column("Frames"), Column("Rate", "Hz"),
        Column("Gaps"), Column("Longest interval", "s"), Column("In common with the logs", "s"),
    ]  # fmt: skip
    return Table("Cameras; their stamps are trusted to be UTC. Frames stay where they are.", columns, rows)


def repairs_table(manifest: Mapping[str, Any]) -> Table | None:
    """List what was put right in the databases; None where nothing was."""
    repairs = dict.fromkeys(
        repair for _, entry in entries(manifest, "recordings") for repair in entry.get("database_repairs", ())
    )
    if not repairs:
        return None
    columns = [Column("Database", numeric=False), Column("What was done", numeric=False)]
    rows = [[text(path, "code"), text(done)] for path, _, done in (repair.partition(": ") for repair in repairs)]
    return Table("What was put right in the CAN databases before they were used.", columns, rows)


def _inputs(manifest: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    for key, entry in entries(manifest, "recordings"):
        for file in entry["inputs"]:
            yield key, file


def _readable(time: str | None) -> str | None:
    return time and time.replace("T", " ").removesuffix("Z")
