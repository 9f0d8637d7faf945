"""`wheelprint simulate` and the logs of `wheelprint demo`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from .output import Report

if TYPE_CHECKING:
    from rich.console import Console


def simulate_project(
    report: Report,
    directory: Path,
    seed: int,
    drivers: int,
    recordings: int,
    minutes: float,
    clock_offset: float,
    clock_drift: float,
    *,
    oxts_on_can: bool,
) -> None:
    """Simulate a drawn campaign into a project folder and list its recordings."""
    from .modeling.simulation.campaign import draw_campaign, simulate

    campaign = draw_campaign(seed, drivers, recordings, minutes, clock_offset, clock_drift)
    simulated = simulate(directory, replace(campaign, navigation="can") if oxts_on_can else campaign)
    sizes = [
        (recording.key, minutes, sum(file.stat().st_size for file in recording.folder.iterdir()) / 1e6)
        for recording in simulated
    ]
    report.tables.append(("Simulated", ("recording", "minutes", "raw, MB"), list(sizes)))


FOLDS = """
# Eight minutes of each driver: five folds show as much as the usual ten, in half the time.
[dataset]
folds = 5
"""


def simulate_demo(directory: Path, console: Console, *, force: bool) -> None:
    """Write the demo's raw logs, unless they are there: `truth/campaign.json` is written after all logs."""
    from .modeling.simulation.campaign import demo_campaign, simulate
    from .schemas.store import publish_text

    file = directory / "wheelprint.toml"
    if force or not (directory / "truth" / "campaign.json").exists():
        new = not file.exists()
        with console.status("simulating four drivers"):
            simulate(directory, demo_campaign())
        if new:
            publish_text(file, file.read_text(encoding="utf-8") + FOLDS)
