"""The statements of a DBC: each a keyword and what belongs to it.

`BO_` with its `SG_` end where the next statement begins, most others at a semicolon.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

OPEN = frozenset({"VERSION", "NS_", "BS_", "BU_", "BO_", "SG_"})
"""Statements without a semicolon."""
CLOSED = frozenset(
    "BA_ BA_DEF_ BA_DEF_DEF_ BA_DEF_DEF_REL_ BA_DEF_REL_ BA_REL_ BO_TX_BU_ CM_ ENVVAR_DATA_ EV_ SG_MUL_VAL_ SIG_GROUP_ "
    "SIG_VALTYPE_ VAL_ VAL_TABLE_".split()
)
UNKNOWN = frozenset(
    "BA_DEF_SGTYPE_ BA_SGTYPE_ CAT_ CAT_DEF_ EV_DATA_ FILTER NS_DESC_ SGTYPE_ SGTYPE_VAL_ SIGTYPE_VALTYPE_ "
    "SIG_TYPE_REF_".split()
)
"""Statements with a semicolon that cantools does not know and that say nothing about decoding."""
KEYWORDS = OPEN | CLOSED | UNKNOWN
_INSIDE = {
    "CM_": {"SG_", "BO_", "EV_"}, "BA_": {"SG_", "BO_", "EV_"}, "BA_DEF_": {"SG_", "BO_", "EV_"}, "BA_REL_": {"SG_"},
}  # fmt: skip
"""Keywords that may stand within a statement."""

_TOKEN = re.compile(
    r"""(?P<space>\s+)
    |(?P<comment>//[^\n]*|\#[^\n]*|/\*.*?\*/)
    |(?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)
    |(?P<word>\w+)
    |(?P<string>"(?:\\"|[^"])*?")
    |(?P<rest>.)""",
    re.DOTALL | re.VERBOSE | re.ASCII,
)


@dataclass(frozen=True, slots=True)
class Token:
    """A piece of the text.

    Attributes:
        kind: `comment`, `number`, `word`, `string`, or `rest`: any other character.
        text: As it stands there.
        start: Place of its first character.
    """

    kind: str
    text: str
    start: int

    @property
    def stop(self) -> int:
        """Place behind its last character."""
        return self.start + len(self.text)


@dataclass(frozen=True, slots=True)
class Statement:
    """A keyword and what belongs to it, comments left out."""

    tokens: tuple[Token, ...]

    @property
    def keyword(self) -> str:
        """Its first word."""
        return self.tokens[0].text

    @property
    def start(self) -> int:
        """Place of its first character."""
        return self.tokens[0].start

    @property
    def stop(self) -> int:
        """Place behind its last character."""
        return self.tokens[-1].stop

    @property
    def closed(self) -> bool:
        """Whether it ends in a semicolon."""
        return self.tokens[-1].text == ";"

    def text(self, place: int) -> str:
        """Return a token's text, empty beyond the end."""
        return self.tokens[place].text if place < len(self.tokens) else ""

    def is_like(self, *kinds: str) -> bool:
        """Tell whether the tokens after the keyword begin so: a kind, or a sign such as `:`."""
        return len(self.tokens) > len(kinds) and all(
            kind in (token.kind, token.text) for kind, token in zip(kinds, self.tokens[1:], strict=False)
        )


def tokens_of(text: str) -> Iterator[Token]:
    """Yield the tokens of a text, spaces left out."""
    for match in _TOKEN.finditer(text):
        if match.lastgroup != "space":
            yield Token(str(match.lastgroup), match[0], match.start())


def statements_of(tokens: Sequence[Token], text: str) -> list[Statement]:
    """Return the statements that tokens make up; there must be no comments among them."""
    starts = [*_starts(tokens, text), len(tokens)]
    return [Statement(tuple(tokens[start:stop])) for start, stop in pairwise(starts)]


def _starts(tokens: Sequence[Token], text: str) -> Iterator[int]:
    """Yield the places of the tokens that begin a statement."""
    keyword, first = "", 0
    for place, token in enumerate(tokens):
        begins = token.text in KEYWORDS
        if begins and keyword == "NS_":
            # Its list of keywords ends at one that is followed by what belongs to it.
            begins = place + 1 < len(tokens) and (
                tokens[place + 1].text == ":" or tokens[place + 1].kind in ("number", "string")
            )
        elif begins and keyword in CLOSED | UNKNOWN and tokens[place - 1].text != ";":
            # Within a statement, or its semicolon is missing: then this stands first in its line.
            first_in_line = not text[text.rfind("\n", 0, token.start) + 1 : token.start].strip()
            begins = first_in_line and not (token.text in _INSIDE.get(keyword, ()) and place - first <= 2)
        elif not begins and keyword in CLOSED | UNKNOWN:
            begins = tokens[place - 1].text == ";"
        if begins or place == 0:
            keyword, first = token.text, place
            yield place
