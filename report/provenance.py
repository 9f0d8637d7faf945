"""Where the results come from: versions, parameters, and the hashes of everything that was read."""

from __future__ import annotations

import json
import platform
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from typing import Any

from ..schemas.config import Config, Vehicle
from .blocks import Column, Table
from .tables import count, entries, text

LIBRARIES = ("wheelprint", "numpy", "scipy", "scikit-learn", "numba", "pyarrow", "cantools", "plotly")


def versions_table() -> Table:
    """List the versions of Python and of what computes."""
    rows = [[text("Python"), text(platform.python_version())], *([text(n), text(version(n))] for n in LIBRARIES)]
    columns = [Column("Program", numeric=False), Column("Version", numeric=False)]
    return Table("Versions this report was made with.", columns, rows)


def parameters_table(config: Config) -> Table:
    """List every parameter of the project file, marked where it is not the default."""
    usual = dict(_flat(Config(vehicle=Vehicle(wheelbase=config.vehicle.wheelbase)).model_dump(mode="json")))
    del usual["vehicle.wheelbase"]  # It has no default.
    rows = [
        [text(key, "code"), text(shown), text("" if usual.get(key) == shown else "set in wheelprint.toml")]
        for key, shown in _flat(config.model_dump(mode="json"))
    ]
    columns = [Column("Parameter", numeric=False), Column("Value", numeric=False), Column("Origin", numeric=False)]
    return Table("Parameters; – stands for a default.", columns, rows)


def _flat(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for key, value in content.items():
        if isinstance(value, Mapping) and value:
            yield from _flat(value, f"{prefix}{key}.")
        elif value is not None:
            yield prefix + key, value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def signals_table(manifest: Mapping[str, Any]) -> Table:
    """List what each canonical signal was read from, over all recordings."""
    found: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for _, entry in entries(manifest, "recordings"):
        for name, signal in entry.get("signals", {}).items():
            source = (f"{signal['message']}.{signal['signal']}", signal["unit"], signal["factor"], signal["channel"])
            found.setdefault((name, *source), []).append(signal)
    rows = []
    for (name, source, unit, factor, channel), signals in sorted(found.items(), key=lambda item: str(item[0])):
        lost = sum(signal.get("out_of_range", 0) for signal in signals)
        rows.append(
            [
                text(name, "code"),
                text(source, "code"),
                text(channel),
                text(unit),
                text(f"{factor:.9g}".replace("-", "−")),
                count(len(signals)),
                count(sum(signal.get("samples", 0) for signal in signals)),
                count(lost, "alert" if lost else ""),
            ]
        )
    columns = [
        Column("Signal", numeric=False), Column("From", numeric=False), Column("Bus", numeric=False),
        Column("Unit of the database", numeric=False), Column("Factor to the stored unit"), Column("Recordings"),
        Column("Samples"), Column("Out of range"),
    ]  # fmt: skip
    return Table("What the car's signals were read from; samples out of range are null.", columns, rows)


def inputs_table(manifest: Mapping[str, Any]) -> Table:
    """List every file that was read, with its SHA-256."""
    rows = [
        [text(key), text(file["path"]), count(file["bytes"]), text(file["sha256"], "code")]
        for key, entry in entries(manifest, "recordings")
        for file in entry["inputs"]
    ]
    columns = [
        Column("Recording", numeric=False), Column("File", numeric=False), Column("Size", "bytes"),
        Column("SHA-256", numeric=False),
    ]  # fmt: skip
    caption = "Inputs. The hash of a folder of images is that of its listing: names and sizes."
    return Table(caption, columns, rows)
