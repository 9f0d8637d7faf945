"""Two short simulated recordings of two drivers, and the command line in this process."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from wheelprint.cli import app
from wheelprint.modeling.simulation.campaign import draw_campaign, simulate


@dataclass(frozen=True)
class Answer:
    """What a command gave."""

    status: int
    content: dict[str, Any]

    @property
    def problems(self) -> list[str]:
        return [f"{p['path']}: {p['where']}: {p['reason']}" for p in self.content["problems"]]


@pytest.fixture
def wheelprint() -> Callable[..., Answer]:
    """Run a command with `--json`."""

    def run(*arguments: str | Path) -> Answer:
        result = CliRunner().invoke(app, [*map(str, arguments), "--json"], catch_exceptions=False)
        return Answer(result.exit_code, json.loads(result.stdout))

    return run


@pytest.fixture(scope="session")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with raw logs only, not to be changed."""
    folder = tmp_path_factory.mktemp("simulated")
    simulate(folder, draw_campaign(seed=3, drivers=2, recordings=1, minutes=2.0))
    return folder


@pytest.fixture
def project(simulated: Path, tmp_path: Path) -> Path:
    """A copy of it to work in."""
    folder = tmp_path / "project"
    shutil.copytree(simulated, folder)
    return folder
