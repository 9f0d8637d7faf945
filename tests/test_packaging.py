"""The wheel holds every package, and importing the command line stays light."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("cli", "schemas", "ingest", "dataset", "modeling", "report")


def test_every_package_is_in_the_wheel() -> None:
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    found = {
        ".".join(("wheelprint", *(init.parent.relative_to(ROOT).parts[1 if folder == "cli" else 0 :])))
        for folder in FOLDERS
        for init in (ROOT / folder).rglob("__init__.py")
    }
    assert found == set(setuptools["packages"])


def test_every_data_file_is_in_the_wheel() -> None:
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    for folder in FOLDERS:
        for path in (ROOT / folder).rglob("*"):
            if path.is_file() and path.suffix not in (".py", ".pyc", ".nbi", ".nbc"):
                package = ".".join(path.parent.relative_to(ROOT).parts)
                package = "wheelprint" if package == "cli" else f"wheelprint.{package}"
                patterns = setuptools["package-data"].get(package, [])
                assert any(path.match(pattern) for pattern in patterns), f"{path} is not in package-data"


def test_each_folder_imports_only_what_stands_above_it() -> None:
    order = ("schemas", "ingest", "dataset", "modeling", "report")
    for level, folder in enumerate(order):
        for path in (ROOT / folder).rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            for below in order[level + 1 :]:
                assert f"..{below}" not in text, f"{path} imports {below}"


def test_the_command_line_imports_nothing_heavy() -> None:
    heavy = (
        "sklearn",
        "scipy",
        "numba",
        "plotly",
        "pandas",
        "pyarrow",
        "numpy",
        "distributed",
        "cantools",
        "can",
        "rich",
    )
    code = f"import sys, wheelprint.cli; print([m for m in {heavy!r} if m in sys.modules])"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert loaded.stdout.strip() == "[]"
