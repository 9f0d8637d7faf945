"""What a command says at its end: a short table, the problems, JSON for machines, and the exit status."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Any

from .schemas.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from .runner import StageResult


WIDTH_OF_FILES = 160


class Status(IntEnum):
    """Exit status of every command; 2, wrong usage, is typer's."""

    DONE = 0
    FAILED = 1
    LOSSY = 3


@dataclass(slots=True)
class Report:
    """What a command did, gathered while it works and shown once at its end.

    Attributes:
        command: Name of the command.
        as_json: Show JSON instead of tables.
        stages: What each stage did, in order.
        tables: Further tables: title, heads, rows.
        facts: What only the JSON holds beside the tables.
        problems: Problems outside any stage.
        failed: Nothing came of it.
    """

    command: str
    as_json: bool
    stages: dict[str, StageResult] = field(default_factory=dict)
    tables: list[tuple[str, Sequence[str], Sequence[Sequence[Any]]]] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    problems: list[InputError] = field(default_factory=list)
    failed: bool = False

    def all_problems(self) -> list[InputError]:
        """Return every problem once, in the order they came."""
        every = [*self.problems, *(p for stage in self.stages.values() for p in stage.problems)]
        return list({(p.path, p.where, p.reason): p for p in every}.values())

    @property
    def status(self) -> Status:
        """1 where nothing came of it, 3 where something was rejected or lost, else 0."""
        if self.failed:
            return Status.FAILED
        return Status.LOSSY if self.all_problems() else Status.DONE

    def show(self) -> None:
        """Print the report: tables to standard output, problems to standard error; or JSON to standard output."""
        if self.as_json:
            content = {
                "command": self.command,
                "status": int(self.status),
                "stages": {
                    title: {
                        "done": stage.done,
                        "current": stage.current,
                        "failed": stage.failed,
                        "seconds": stage.seconds,
                    }
                    for title, stage in self.stages.items()
                },
                "tables": {
                    title: [dict(zip(heads, row, strict=True)) for row in rows] for title, heads, rows in self.tables
                },
                "problems": [{"path": p.path, "where": p.where, "reason": p.reason} for p in self.all_problems()],
                **self.facts,
            }
            sys.stdout.write(json.dumps(content, indent=1, ensure_ascii=False) + "\n")
            return
        out, err = console(), console(stderr=True)
        if self.stages:
            counts: list[Sequence[Any]] = [
                (title, len(stage.done), len(stage.current), len(stage.failed), stage.seconds)
                for title, stage in self.stages.items()
            ]
            _print_table(out, "", ("stage", "done", "already current", "failed", "s"), counts)
        for title, heads, rows in self.tables:
            _print_table(out, title, heads, rows)
        problems = self.all_problems()
        if problems:
            err.print(f"[bold]{len(problems)} problem{'s' if len(problems) > 1 else ''}:[/bold]")
        for problem in problems:
            err.print("  [yellow]•[/yellow]", end=" ")
            err.print(str(problem), markup=False, highlight=False, soft_wrap=True)


def console(*, stderr: bool = False) -> Console:
    """Return a console for standard output, or standard error; tables are not folded where nobody looks at them."""
    from rich.console import Console

    found = Console(stderr=stderr)
    return found if found.is_terminal else Console(stderr=stderr, width=WIDTH_OF_FILES)


def _print_table(out: Console, title: str, heads: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(title=title or None, title_justify="left", box=box.SIMPLE_HEAD, min_width=len(title))
    for index, head in enumerate(heads):
        numeric = all(isinstance(row[index], int | float) or row[index] in (None, "") for row in rows)
        table.add_column(head, justify="right" if numeric and rows else "left", overflow="fold")
    for row in rows:
        table.add_row(*(Text(_cell(value)) for value in row))
    out.print(table)


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
