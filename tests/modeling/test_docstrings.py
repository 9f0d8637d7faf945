"""What is public in `modeling` says what it takes and gives: arguments, shapes of arrays, errors that it raises."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import wheelprint.modeling

FOLDER = Path(wheelprint.modeling.__file__).parent
FILES = sorted(FOLDER.rglob("*.py"))

ARRAY = re.compile(r"NDArray|ArrayLike|\b(?:FloatArray|Floats|Rows|Mask|Labels|Indices|Counts)\b")
BY_NAME = re.compile(r"(?:Mapping|dict)\[str, ")
"""Arrays by name, as files hold them, have a shape each."""
SHAPE = re.compile(r"\((?:[^()\s]+,|[^(),]+(?:, ?[^(),]+)+)\)")
ELSEWHERE = re.compile(
    r"(?:\bas|\blike|\barguments)\b[^.]*`|\b[Ss]ee\b|\b(?:as|arguments as) for\b|\blike `", re.IGNORECASE
)
"""Words that say where the shape stands: as for `predict`, see the class."""


def functions(tree: ast.Module) -> Iterator[tuple[str, ast.FunctionDef, str]]:
    """Yield public functions and methods, and the docstring of the class around them."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node.name, node, ""
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for part in node.body:
                if isinstance(part, ast.FunctionDef) and not part.name.startswith("_") and not is_overload(part):
                    yield f"{node.name}.{part.name}", part, ast.get_docstring(node) or ""


def is_overload(function: ast.FunctionDef) -> bool:
    return any(ast.unparse(decorator) == "overload" for decorator in function.decorator_list)


def takes(function: ast.FunctionDef) -> dict[str, str]:
    """Return the annotations of the arguments by name."""
    given = function.args
    every = [*given.posonlyargs, *given.args, *given.kwonlyargs, *filter(None, (given.vararg, given.kwarg))]
    return {one.arg: ast.unparse(one.annotation) for one in every if one.annotation is not None}


def raises(function: ast.FunctionDef) -> list[str]:
    """Return what the function itself raises."""
    statements = (node for node in ast.walk(function) if isinstance(node, ast.Raise))
    return [ast.unparse(node.exc) for node in statements if node.exc is not None]


def described(docstring: str) -> dict[str, str]:
    """Return what the section `Args` says of each argument; without the section, nothing."""
    found = re.search(r"^Args:\n((?: .*\n|\n)*)", docstring + "\n", re.MULTILINE)
    lines = found[1] if found else ""
    parts = re.split(r"^ {4}(\w+): ", lines, flags=re.MULTILINE)[1:]
    return dict(zip(parts[::2], parts[1::2], strict=True))


def is_array(annotation: str) -> bool:
    return bool(ARRAY.search(annotation)) and not BY_NAME.search(annotation)


def complaints(name: str, function: ast.FunctionDef, of_class: str) -> Iterator[str]:
    """Yield what a function does not say."""
    text = ast.get_docstring(function)
    if not text:
        yield f"{name}: no docstring"
        return
    arguments, said = takes(function), described(text)
    if said and said.keys() != arguments.keys():
        yield f"{name}: takes {', '.join(arguments)}, but Args has {', '.join(said)}"
    if (what := raises(function)) and not re.search(r"^Raises:|\braises\b", text, re.MULTILINE):
        yield f"{name}: does not say that it raises {what[0]}"
    arrays = [one for one, annotation in arguments.items() if is_array(annotation)]
    for one in arrays:
        there = said.get(one, text)
        if not SHAPE.search(there) and not ELSEWHERE.search(there):
            yield f"{name}: no shape of {one}"
    if function.returns is not None and is_array(ast.unparse(function.returns)):
        whole = text.split("Args:")[0] + text.partition("Returns:")[2]
        named = re.search(rf"^ {{4}}{function.name}: .*", of_class, re.MULTILINE)
        if not SHAPE.search(whole) and not ELSEWHERE.search(whole) and not named:
            yield f"{name}: no shape of what it returns"


@pytest.mark.parametrize("file", FILES, ids=[str(file.relative_to(FOLDER)) for file in FILES])
def test_public_things_say_what_they_take_give_and_raise(file: Path) -> None:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_")]
    found = [f"{node.name}: no docstring" for node in classes if not ast.get_docstring(node)]
    found += [] if ast.get_docstring(tree) else ["the file: no docstring"]
    for name, function, of_class in functions(tree):
        found += complaints(name, function, of_class)
    assert found == []


def test_the_check_finds_what_is_missing() -> None:
    source = '''
def silent(x): ...
def vague(x: FloatArray, y: int) -> FloatArray:
    """Return x."""
    if y:
        raise ValueError("y")
def partly(x: FloatArray, y: int) -> FloatArray:
    """Return x (n,).

    Args:
        x: Numbers.
    """
def whole(x: FloatArray, y: int, z: dict[str, FloatArray]) -> FloatArray:
    """Return x (n, 3).

    Args:
        x: Shape (n,).
        y: As for `other`.
        z: By name.

    Raises:
        ValueError: y is wrong.
    """
    raise ValueError("y")
'''
    found = [
        one for name, function, of_class in functions(ast.parse(source)) for one in complaints(name, function, of_class)
    ]
    assert found == [
        "silent: no docstring",
        "vague: does not say that it raises ValueError('y')",
        "vague: no shape of x",
        "vague: no shape of what it returns",
        "partly: takes x, y, but Args has x",
        "partly: no shape of x",
    ]
