"""Rows of numbers in text, parsed at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from io import BytesIO

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from .text import LARGEST_NUMBER


def parse_rows(
    rows: Sequence[bytes], separator: str, width: int, places: Sequence[int], *, missing: Sequence[str], text: int = -1
) -> tuple[npt.NDArray[np.float64], pa.Array | None] | None:
    """Parse rows of cells, hundreds of thousands a second, where all of them are beyond doubt.

    Args:
        rows: One or more, none of them blank.
        separator: Between cells.
        width: Cells of a row.
        places: Of the columns with numbers.
        missing: Cells that stand for no number.
        text: Place of a column that is returned as it is written.

    Returns:
        Values (n, columns), NaN where missing, and the text. None where a row has other than `width` cells or a cell is
        no plain decimal number, up to `LARGEST_NUMBER`: the rows are then to be looked at one by one, as `number_of`
        does, for what is wrong with which.
    """
    from pyarrow import csv

    content = b"\n".join(rows)
    if b"\r" in content or content.count(b"\n") != len(rows) - 1:
        return None
    kinds: Mapping[str, pa.DataType] = {str(place): pa.float64() for place in places}
    try:
        table = csv.read_csv(
            BytesIO(content),
            csv.ReadOptions(use_threads=False, column_names=[str(place) for place in range(width)]),
            csv.ParseOptions(delimiter=separator, quote_char=False, ignore_empty_lines=False),
            csv.ConvertOptions(
                column_types={**kinds, str(text): pa.string()},
                include_columns=[*kinds, *([str(text)] if text >= 0 else [])],
                null_values=list(missing),
            ),
        ).combine_chunks()
    except pa.ArrowInvalid:
        return None
    columns = [table[str(place)] for place in places]
    values = np.column_stack([column.to_numpy() for column in columns])
    known = len(rows) * len(places) - sum(column.null_count for column in columns)
    # A number too large, infinite, or written as NaN.
    if np.count_nonzero(np.abs(values) <= LARGEST_NUMBER) != known:
        return None
    return values, table[str(text)].combine_chunks() if text >= 0 else None
