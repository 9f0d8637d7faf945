"""What is parsed at once must be what is parsed cell by cell."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wheelprint.ingest.number_table import parse_rows
from wheelprint.ingest.text import number_of

ODD = (
    "",
    "-",
    " ",
    "nan",
    "NaN",
    "inf",
    "-inf",
    "1e400",
    "1e15",
    "2e15",
    "1_0",
    "+1",
    "0x1",
    ".5",
    "5.",
    "1e-5",
    " 7 ",
    "abc",
)
CELLS = st.one_of(st.floats(-1e6, 1e6).map(repr), st.integers(-999, 999).map(str), st.sampled_from(ODD))


@given(st.lists(st.lists(CELLS, min_size=3, max_size=3), min_size=1, max_size=6))
def test_it_agrees_with_cells_alone_or_leaves_them(rows: list[list[str]]) -> None:
    parsed = parse_rows([",".join(row).encode() for row in rows], ",", 3, (0, 2), missing=("", "-"))
    plain = all(cell not in ODD for row in rows for cell in (row[0], row[2]))
    assert parsed is not None or not plain
    if parsed is not None:
        expected = [
            [np.nan if row[place] in {"", "-"} else number_of(row[place].strip().encode()) for place in (0, 2)]
            for row in rows
        ]
        np.testing.assert_array_equal(parsed[0], expected)
        assert parsed[1] is None


def test_rows_of_another_width_and_line_ends_within_are_left() -> None:
    for rows in ([b"1,2", b"3"], [b"1,2", b"3,4,5"], [b"1,2\r3,4"], [b"1,2\n3,4"], [b'1,"2"'], [b"1,2", b"\xff,4"]):
        assert parse_rows(rows, ",", 2, (0, 1), missing=()) is None


def test_a_column_is_returned_as_it_is_written() -> None:
    parsed = parse_rows([b"1, 02.50,x", b"2,3,y"], ",", 3, (0,), missing=(), text=1)
    assert parsed is not None
    assert parsed[1] is not None
    assert parsed[1].to_pylist() == [" 02.50", "3"]
