"""What a page is made of: sections of notes, facts, tables and figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    import plotly.graph_objects as go

Mark = Literal["", "best", "baseline", "alert", "code"]


@dataclass(frozen=True, slots=True)
class Column:
    """Head of a column.

    Attributes:
        title: What it holds.
        unit: Unit of its numbers, shown in the head.
        numeric: Numbers stand to the right.
    """

    title: str
    unit: str = ""
    numeric: bool = True


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell: text, and whether it stands out."""

    text: str
    mark: Mark = ""


@dataclass(frozen=True, slots=True)
class Table:
    """A table as the page shows it: every cell is text and is escaped there."""

    caption: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]
    kind: Literal["table"] = "table"


@dataclass(frozen=True, slots=True)
class Note:
    """A sentence, with the command that would change it where there is one."""

    text: str
    command: str = ""
    kind: Literal["note"] = "note"


@dataclass(frozen=True, slots=True)
class Facts:
    """A few numbers that stand out: value with unit, and what it is."""

    numbers: Sequence[tuple[str, str]]
    kind: Literal["facts"] = "facts"


@dataclass(frozen=True, slots=True)
class Listing:
    """A list of problems: what they concern, and what is wrong."""

    title: str
    problems: Sequence[tuple[str, str]]
    kind: Literal["listing"] = "listing"


@dataclass(frozen=True, slots=True)
class Figure:
    """A plotly figure with its caption."""

    caption: str
    figure: go.Figure


@dataclass(frozen=True, slots=True)
class Gallery:
    """Figures of one kind: side by side where the page is wide enough, or each over the whole width."""

    figures: Sequence[Figure]
    wide: bool = False
    kind: Literal["gallery"] = "gallery"


Block: TypeAlias = Note | Facts | Listing | Table | Gallery


@dataclass(frozen=True, slots=True)
class Section:
    """A section: anchor, title and what it shows."""

    anchor: str
    title: str
    blocks: Sequence[Block]
