"""What is public in `modeling` says what it takes and gives: shapes, units, errors that it raises, its equation."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

import wheelprint.modeling

FOLDER = Path(wheelprint.modeling.__file__).parent
FILES = sorted(FOLDER.rglob("*.py"))
TREES = {file: ast.parse(file.read_text(encoding="utf-8")) for file in FILES}

ARRAY = re.compile(r"NDArray|ArrayLike|\b(?:FloatArray|Floats|Rows|Mask|Labels|Indices|Counts)\b")
BY_NAME = re.compile(r"(?:Mapping|dict)\[str, ")
"""Arrays by name, as files hold them, have a shape each."""
SHAPE = re.compile(r"\((?:[^()\s]+,|[^(),]+(?:, ?[^(),]+)+)\)")
ELSEWHERE = re.compile(
    r"(?:\bas|\blike|\barguments)\b[^.]*`|\b[Ss]ee\b|\b(?:as|arguments as) for\b|\blike `", re.IGNORECASE
)
"""Words that say where the shape or the unit stands: as for `predict`, see the class."""

FLOATS = re.compile(r"\b(?:FloatArray|Floats|ArrayLike|float|floating|float64|Drive)\b")
"""Annotations of numbers that have a unit, if only none."""
SYMBOLS = (
    "deg", "rad", "km", "ms", "ns", "min", "Hz", "ppm", "bar", "nats", "%", "m/s", "m/s²", "m/s³", "km/h", "deg/s",
    "rad/s", "deg²", "1/m", "1/km",
)  # fmt: skip
AMBIGUOUS = ("m", "s")
"""Metre and second, where they cannot be the name of a number: `in m`, `h, m (n,)`, `30 s`."""
LETTERS = re.compile(r"\(\w+(?:,|(?:, \w+)+)\)")
"""Shapes, whose letters are no units."""
WORDS = (
    "unit", "units", "ratio", "ratios", "share", "shares", "probability", "probabilities", "weight", "weights",
    "responsibility", "responsibilities", "standard deviations", "how often", "number of", "numbers of", "pure number",
    "pure numbers", "between 0 and 1",
)  # fmt: skip
UNIT = re.compile(
    rf"(?<![\w/])(?:{'|'.join(map(re.escape, SYMBOLS))})(?![\w/²³])"
    rf"|(?:^|\bin |\band |[,(] ?|\d )(?:{'|'.join(AMBIGUOUS)})(?=[\s,.;:)]|$)"
    rf"|\b(?:{'|'.join(WORDS)})\b",
    re.IGNORECASE | re.MULTILINE,
)

IN_UNITS = re.compile(r"\bunits?\b")
"""What is said of all numbers of a class before the list of them."""

MATHEMATICS = {
    "exp", "expm1", "log", "log1p", "sqrt", "square", "hypot", "sin", "cos", "tan", "atan", "atan2", "arctan",
    "arctan2", "einsum", "tensordot", "dot", "cholesky", "inv", "eigh", "lstsq", "ppf", "gammaincc",
}  # fmt: skip
EQUATION = re.compile(r"\beqs?\. \d| [=∝←≤] |arg max|[ΣΠ∫√‖ᵀ]|(?<!m/s)(?<!deg)[²³]")
SOURCES = ("WGS 84", "Webster", "Wilson", "BLAS", "scikit-learn")
"""Where the formula stands for itself: a method or library by its name."""
REFERENCE = re.compile(r"\b(?:[Ss]ee|of|for|by) (?:(the class|the module)|`([\w.]+)`)")

CITED = re.compile(r"\b(MP|PP)\b[^.;:]{0,40}?\beqs?\. ((?:\d+(?:, | to | and )?)+)")
PAPERS = {"MP": range(1, 23), "PP": range(1, 24)}
"""Numbers of the papers' equations."""


DOCUMENTS = (ast.Module, ast.ClassDef, ast.FunctionDef)


class Public(NamedTuple):
    """A public function or method, and what stands around it."""

    name: str
    node: ast.FunctionDef
    of_class: str
    of_module: str


def functions(tree: ast.Module) -> Iterator[Public]:
    """Yield public functions and methods, and the docstrings of the class and the module around them."""
    module = ast.get_docstring(tree) or ""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield Public(node.name, node, "", module)
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for part in node.body:
                if isinstance(part, ast.FunctionDef) and not part.name.startswith("_") and not is_overload(part):
                    yield Public(f"{node.name}.{part.name}", part, ast.get_docstring(node) or "", module)


def classes(tree: ast.Module) -> list[ast.ClassDef]:
    return [node for node in tree.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_")]


def is_overload(function: ast.FunctionDef) -> bool:
    return any(ast.unparse(decorator) == "overload" for decorator in function.decorator_list)


def takes(function: ast.FunctionDef) -> dict[str, str]:
    """Return the annotations of the arguments by name; those with an underscore are given by a decorator."""
    given = function.args
    every = [*given.posonlyargs, *given.args, *given.kwonlyargs, *filter(None, (given.vararg, given.kwarg))]
    return {one.arg: ast.unparse(one.annotation) for one in every if one.annotation and one.arg[0] != "_"}


def raises(function: ast.FunctionDef) -> list[str]:
    """Return what the function itself raises."""
    statements = (node for node in ast.walk(function) if isinstance(node, ast.Raise))
    return [ast.unparse(node.exc) for node in statements if node.exc is not None]


def described(docstring: str, section: str = "Args") -> dict[str, str]:
    """Return what a section says of each argument or attribute; without the section, nothing."""
    found = re.search(rf"^{section}:\n((?: .*\n|\n)*)", docstring + "\n", re.MULTILINE)
    lines = found[1] if found else ""
    parts = re.split(r"^ {4}(\w+): ", lines, flags=re.MULTILINE)[1:]
    return dict(zip(parts[::2], parts[1::2], strict=True))


def lead(docstring: str) -> str:
    """Return what stands before the sections."""
    return re.split(r"^(?:Args|Attributes|Returns|Raises|Yields):$", docstring, maxsplit=1, flags=re.MULTILINE)[0]


def is_array(annotation: str) -> bool:
    return bool(ARRAY.search(annotation)) and not BY_NAME.search(annotation)


def has_unit(annotation: str) -> bool:
    return bool(FLOATS.search(annotation)) and not BY_NAME.search(annotation) and "ClassVar" not in annotation


def names_unit(text: str) -> bool:
    return bool(UNIT.search(LETTERS.sub("", text)))


def says_shape(text: str) -> bool:
    return bool(SHAPE.search(text) or ELSEWHERE.search(text))


def says_unit(text: str) -> bool:
    return bool(names_unit(text) or ELSEWHERE.search(text))


def computes(function: ast.FunctionDef) -> bool:
    """Tell whether a function implements a formula: mathematics, or products that numbers are returned of."""
    operators = {type(node.op) for node in ast.walk(function) if isinstance(node, ast.BinOp | ast.AugAssign)}
    called = {node.func.attr for node in ast.walk(function) if isinstance(node, ast.Call)
              and isinstance(node.func, ast.Attribute)}  # fmt: skip
    if called & MATHEMATICS or operators & {ast.Pow, ast.MatMult}:
        return True
    returned = "" if function.returns is None else ast.unparse(function.returns)
    return bool(operators & {ast.Mult, ast.Div}) and has_unit(returned)


def documented() -> dict[str, str]:
    """Return the docstrings of `modeling` by name: `module`, `Class`, `Class.method`, `function`, `module.function`."""
    found: dict[str, str] = {}
    for file, tree in TREES.items():
        own = {one.name: ast.get_docstring(one.node) or "" for one in functions(tree)}
        own |= {one.name: ast.get_docstring(one) or "" for one in classes(tree)}
        found |= {file.stem: ast.get_docstring(tree) or ""} | own
        found |= {f"{file.stem}.{name}": text for name, text in own.items()}
    return found


DOCUMENTED = documented()


def gives_equation(one: Public, deep: int = 3) -> bool:
    """Tell whether a docstring holds an equation or a source, or refers to what does."""
    text = ast.get_docstring(one.node) or ""
    if EQUATION.search(text) or any(source in text for source in SOURCES):
        return True
    own_class = one.name.rpartition(".")[0]
    for around, name in REFERENCE.findall(text):
        if around:
            there = one.of_class if around == "the class" else one.of_module
        else:
            there = DOCUMENTED.get(f"{own_class}.{name}", DOCUMENTED.get(name, ""))
        other = ast.parse(f"def f():\n    {there!r}").body[0]
        assert isinstance(other, ast.FunctionDef)
        if deep and gives_equation(Public(name or one.name, other, one.of_class, one.of_module), deep - 1):
            return True
    return False


def complaints(one: Public) -> Iterator[str]:
    """Yield what a function does not say."""
    name, function = one.name, one.node
    text = ast.get_docstring(function)
    if not text:
        yield f"{name}: no docstring"
        return
    arguments, said = takes(function), described(text)
    if said and said.keys() != arguments.keys():
        yield f"{name}: takes {', '.join(arguments)}, but Args has {', '.join(said)}"
    if (what := raises(function)) and not re.search(r"^Raises:|\braises\b", text, re.MULTILINE):
        yield f"{name}: does not say that it raises {what[0]}"
    for argument, annotation in arguments.items():
        there = said.get(argument, lead(text) if said else text)
        if is_array(annotation) and not says_shape(there):
            yield f"{name}: no shape of {argument}"
        if has_unit(annotation) and not says_unit(there):
            yield f"{name}: no unit of {argument}"
    returned = "" if function.returns is None else ast.unparse(function.returns)
    whole = lead(text) + text.partition("Returns:")[2].partition("Raises:")[0]
    named = re.search(rf"^ {{4}}{function.name}: .*", one.of_class, re.MULTILINE)
    if is_array(returned) and not says_shape(whole) and not named:
        yield f"{name}: no shape of what it returns"
    if has_unit(returned) and not says_unit(whole):
        yield f"{name}: no unit of what it returns"
    if computes(function) and not gives_equation(one):
        yield f"{name}: no equation"


def vague_attributes(node: ast.ClassDef) -> Iterator[str]:
    """Yield the numbers of a class whose shape or unit it does not say, of each or of all together."""
    text = ast.get_docstring(node) or ""
    said = described(text, "Attributes") | described(text)
    for part in node.body:
        if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name) and not part.target.id.startswith("_"):
            name, annotation = part.target.id, ast.unparse(part.annotation)
            there = said.get(name, lead(text))
            if is_array(annotation) and not says_shape(there) and not SHAPE.search(lead(text)):
                yield f"{node.name}: no shape of {name}"
            if has_unit(annotation) and not says_unit(there) and not IN_UNITS.search(lead(text)):
                yield f"{node.name}: no unit of {name}"


@pytest.mark.parametrize("file", FILES, ids=[str(file.relative_to(FOLDER)) for file in FILES])
def test_public_things_say_what_they_take_give_and_raise(file: Path) -> None:
    tree = TREES[file]
    found = [f"{node.name}: no docstring" for node in classes(tree) if not ast.get_docstring(node)]
    found += [] if ast.get_docstring(tree) else ["the file: no docstring"]
    found += [one for node in classes(tree) for one in vague_attributes(node)]
    for one in functions(tree):
        found += complaints(one)
    assert found == []


def test_every_equation_of_the_papers_stands_where_it_is_implemented() -> None:
    trees = [ast.parse(file.read_text(encoding="utf-8")) for file in (FOLDER.parent / "dataset").rglob("*.py")]
    parts = [part for tree in (*TREES.values(), *trees) for part in ast.walk(tree)]
    texts = [ast.get_docstring(part) or "" for part in parts if isinstance(part, DOCUMENTS)]
    cited: dict[str, set[int]] = {paper: set() for paper in PAPERS}
    for text in texts:
        for paper, numbers in CITED.findall(" ".join(text.split())):
            for first, last in re.findall(r"(\d+)(?: to (\d+))?", numbers):
                cited[paper].update(range(int(first), int(last or first) + 1))
    assert cited == {paper: set(numbers) for paper, numbers in PAPERS.items()}


def test_the_check_finds_what_is_missing() -> None:
    source = '''
def silent(x): ...
def vague(x: FloatArray, y: int) -> FloatArray:
    """Return x."""
    if y:
        raise ValueError("y")
def partly(x: FloatArray, y: int) -> FloatArray:
    """Return x (n,), m.

    Args:
        x: Numbers.
    """
def root(x: FloatArray) -> FloatArray:
    """Return the root of x (n,), m."""
    return np.sqrt(x)
def doubled(x: float) -> float:
    """Return twice x, m; see `vague`."""
    return 2 * x
def whole(x: FloatArray, y: float, z: dict[str, FloatArray], s: float) -> FloatArray:
    """Return x^3 in m/s (n, 3), by the formula of `adapt`.

    Args:
        x: In m/s (n,).
        y: As for `other`.
        z: By name.
        s: A share.

    Raises:
        ValueError: y is wrong.
    """
    raise ValueError(x ** 3)
'''
    assert [one for part in functions(ast.parse(source)) for one in complaints(part)] == [
        "silent: no docstring",
        "vague: does not say that it raises ValueError('y')",
        "vague: no shape of x",
        "vague: no unit of x",
        "vague: no shape of what it returns",
        "vague: no unit of what it returns",
        "partly: takes x, y, but Args has x",
        "partly: no shape of x",
        "partly: no unit of x",
        "root: no equation",
        "doubled: no equation",
    ]


def test_the_check_finds_vague_attributes() -> None:
    source = '''
class Vague:
    """Two numbers.

    Attributes:
        x: Numbers (n,).
        y: m.
    """
    x: FloatArray
    y: FloatArray
    z: float
class Whole:
    """Three numbers in the units of the data, each (n,).

    Attributes:
        x: The first.
    """
    x: FloatArray
    y: FloatArray
    z: ClassVar[float]
'''
    assert [one for node in classes(ast.parse(source)) for one in vague_attributes(node)] == [
        "Vague: no unit of x",
        "Vague: no shape of y",
        "Vague: no unit of z",
    ]


@pytest.mark.parametrize(
    ("text", "is_one"),
    [
        ("m (n,), east", True), ("Length (m) and radius", True), ("in deg and m/s", True), ("h, m, above 0", True),
        ("0.5 s", True), ("rad/(m/s²)", True), ("means in deg²", True), ("1/m", True), ("in any unit", True),
        ("of m outputs", False), ("degrees of freedom", False), ("shape (n, m)", False), ("(m,)", False),
        ("the same", False),
    ],
)  # fmt: skip
def test_units_are_told_from_letters(text: str, *, is_one: bool) -> None:
    assert names_unit(text) is is_one


@pytest.mark.parametrize(
    ("text", "is_one"),
    [
        ("(MP eq. 5)", True), ("κ = tan δ", True), ("Σ w x", True), ("v² |κ|", True), ("see `adapt`", True),
        ("by Webster's method", True), ("in m/s² or deg²", False), ("see `papers`", False), ("see `unheard_of`", False),
        ("see the class", False), ("see the module", True),
    ],
)  # fmt: skip
def test_equations_are_told_from_words(text: str, *, is_one: bool) -> None:
    function = ast.parse(f"def f():\n    {text!r}").body[0]
    assert isinstance(function, ast.FunctionDef)
    assert gives_equation(Public("f", function, of_class="Nothing.", of_module="y = x")) is is_one
