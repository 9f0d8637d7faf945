"""The reference pages say what the code does."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"


def reference() -> ModuleType:
    spec = importlib.util.spec_from_file_location("reference", DOCS / "reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("page", ["commands.md", "configuration.md", "signals.md", "tables.md"])
def test_the_page_is_what_the_code_gives(page: str) -> None:
    assert (DOCS / page).read_text(encoding="utf-8") == reference().PAGES[page](), "run `python docs/reference.py`"


def test_every_command_says_what_it_does() -> None:
    text = reference().PAGES["commands.md"]()
    commands = "inspect init convert build review train evaluate track report export predict run simulate demo".split()
    assert [f"## wheelprint {name}" for name in commands] == [line for line in text.splitlines() if line[:2] == "##"]
    assert "None" not in text
