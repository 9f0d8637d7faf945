"""Writes the reference pages from the code: commands, project file, signals, tables. A test fails when they drift.

Run `python docs/reference.py` after changing a command, a config key, a signal or a table.
"""

from __future__ import annotations

import json
import types
import typing
from pathlib import Path

import pyarrow as pa
import typer
from pydantic import BaseModel, BeforeValidator
from pydantic_core import PydanticUndefined

from wheelprint.cli import app
from wheelprint.schemas import config, tables
from wheelprint.schemas.quantities import QUANTITIES, TIME_QUANTITIES
from wheelprint.schemas.signals import SIGNALS

NOTE = "<!-- Written by docs/reference.py; change the code, not this page. -->\n"


def commands() -> str:
    """Return the page of all commands."""
    group = typer.main.get_command(app)
    context = typer.Context(group, info_name="wheelprint")
    lines = [NOTE, "# Commands\n"]
    lines.append(
        "Exit status: 0 done, 1 failed, 2 wrong usage, 3 done but something was rejected or lost (and the command "
        "says what). Progress and problems go to standard error, tables and `--json` to standard output.\n"
    )
    for name in group.list_commands(context):  # type: ignore[attr-defined]
        command = group.get_command(context, name)  # type: ignore[attr-defined]
        lines.append(f"## wheelprint {name}\n\n{command.help}\n")
        rows = []
        for parameter in command.params:
            if parameter.name == "help":
                continue
            shown = parameter.metavar or parameter.name.upper()
            what = ", ".join(f"`{flag}`" for flag in parameter.opts) if parameter.opts[0][0] == "-" else f"`{shown}`"
            default = parameter.default
            if parameter.required:
                told = "required"
            elif default is None or default is False or default == Path():
                told = ""
            else:
                told = f"`{default}`"
            rows.append(f"| {what} | {getattr(parameter, 'help', '') or ''} | {told} |")
        if rows:
            lines += ["| option | meaning | default |", "|---|---|---|", *rows, ""]
    return "\n".join(lines).rstrip() + "\n"


def configuration() -> str:
    """Return the page of all keys of `wheelprint.toml`."""
    lines = [
        NOTE,
        "# wheelprint.toml\n",
        "Every key; unknown keys are errors. Only `[vehicle] wheelbase` has no default.\n",
    ]
    _section(lines, config.Config, "")
    return "\n".join(lines).rstrip() + "\n"


def _section(lines: list[str], model: type[BaseModel], prefix: str) -> None:
    rows, nested = [], []
    for name, info in model.model_fields.items():
        kind = info.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel) and kind is not config.Threshold:
            nested.append((f"{prefix}{name}", kind))
            continue
        if info.default_factory is not None:
            default = "`[]`" if typing.get_origin(kind) is list else "`{}`"
        else:
            shown = _toml(info.default)
            default = "required" if info.default is PydanticUndefined else f"`{shown}`" if shown else ""
        rows.append(f"| `{name}` | {_kind(kind)} | {info.description or ''} | {default} |")
    if rows:
        heading = f"## [{prefix.rstrip('.')}]\n"
        lines += [heading, "| key | value | meaning | default |", "|---|---|---|---|", *rows, ""]
    for name, kind in nested:
        _section(lines, kind, f"{name}.")


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if value is None:
        return ""
    if isinstance(value, list | tuple):
        return f"[{', '.join(_toml(one) for one in value)}]"
    if isinstance(value, config.Threshold):
        table = ", ".join(f"{key} = {number}" for key, number in value.model_dump(exclude_none=True).items())
        return str(value.at_least) if value.quantile is None else f"{{ {table} }}"
    return json.dumps(value, ensure_ascii=False).replace("|", "\\|") if isinstance(value, str) else str(value)


def _kind(annotation: object) -> str:
    origin = typing.get_origin(annotation)
    if origin is typing.Literal:
        return " or ".join(f"`{_toml(value)}`" for value in typing.get_args(annotation))
    if origin is typing.Annotated:
        kind, *how = typing.get_args(annotation)
        # Text stands for the table, or for the list, that says only this.
        shorter = any(isinstance(one, BeforeValidator) for one in how)
        return f"text or {_kind(kind)}" if shorter else _kind(kind)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(_kind(part) for part in typing.get_args(annotation) if part is not type(None))
    if origin in (list, tuple):
        return f"list of {_kind(typing.get_args(annotation)[0])}"
    if origin is dict:
        return f"table of name = {_kind(typing.get_args(annotation)[1])}"
    if annotation is config.Threshold:
        return f"number or {{ {', '.join(config.Threshold.model_fields)} }}"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return f"{{ {', '.join(annotation.model_fields)} }}"
    return {str: "text", float: "number", int: "whole number", bool: "true or false"}.get(annotation, str(annotation))  # type: ignore[call-overload, no-any-return]


def signals() -> str:
    """Return the page of the vocabulary."""
    lines = [NOTE, "# Canonical signals\n", "| name | unit | meaning | source | range | to the grid | VSS |"]
    lines.append("|---|---|---|---|---|---|---|")
    for signal in SIGNALS.values():
        limits = f"{signal.minimum:g} … {signal.maximum:g}"
        vss = f"`{signal.vss}`" if signal.vss else ""
        lines.append(
            f"| `{signal.name}` | {signal.unit} | {signal.description} | {signal.source} | {limits} | "
            f"{signal.resampling} | {vss} |"
        )
    lines += [
        "\n## What else a mapping of navigation may name\n",
        "`[nav.can]` and `[nav.columns]` take the canonical signals of navigation above, and:\n",
        "| name | unit | meaning |",
        "|---|---|---|",
        *(
            f"| `{quantity.name}` | {quantity.unit} | {quantity.description} |"
            for quantity in QUANTITIES.values()
            if quantity.name not in SIGNALS
        ),
        *(f"| `{name}` | s | {meaning}; in `[nav.can]` only |" for name, meaning in TIME_QUANTITIES.items()),
    ]
    return "\n".join(lines) + "\n"


def stored_tables() -> str:
    """Return the page of all stored tables."""
    lines = [NOTE, "# Stored tables\n"]
    schemas: dict[str, pa.Schema] = {
        "Frames: `read_frames`": tables.FRAMES,
        "Navigation: `read_nav`": tables.NAVIGATION,
        "`signals/…/cameras.parquet`": tables.CAMERA_FRAMES,
        "`synced/`": tables.SYNCED,
        "`dataset/`": tables.DATASET,
    }
    for title, schema in schemas.items():
        lines += [f"## {title}\n", "| column | type | unit | meaning |", "|---|---|---|---|"]
        for column in schema:
            unit, meaning = (column.metadata[key].decode() for key in (b"unit", b"description"))
            lines.append(f"| `{column.name}` | {column.type} | {unit} | {meaning} |")
        lines.append("")
    for title, columns in (
        ("`events.csv`", tables.EVENT_COLUMNS),
        ("`situations.csv`", tables.SITUATION_COLUMNS),
        ("`results/lookahead.csv`", tables.LOOKAHEAD_COLUMNS),
        ("`results/motion_primitives.csv`", tables.MOTION_PRIMITIVE_COLUMNS),
        ("`results/learning_curve.csv`", tables.LEARNING_CURVE_COLUMNS),
        ("`results/cross_driver.csv`", tables.CROSS_DRIVER_COLUMNS),
        ("`results/identification.csv`", tables.IDENTIFICATION_COLUMNS),
        ("`results/track.csv`", tables.TRACK_COLUMNS),
    ):
        lines += [f"## {title}\n", ", ".join(f"`{column}`" for column in columns), ""]
    return "\n".join(lines).rstrip() + "\n"


PAGES = {
    "commands.md": commands,
    "configuration.md": configuration,
    "signals.md": signals,
    "tables.md": stored_tables,
}

if __name__ == "__main__":
    for page, write in PAGES.items():
        (Path(__file__).parent / page).write_text(write(), encoding="utf-8")
