"""Reader of navigation in any CSV or Parquet, by the columns that the project file names."""

from __future__ import annotations

import csv
import difflib
import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatch
from itertools import count, islice
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from ..schemas.config import Nav
from ..schemas.errors import InputError
from ..schemas.quantities import QUANTITIES
from ..schemas.units import factor, known_units
from .account import Account
from .content import blocks, head
from .text import LARGEST_NUMBER

if TYPE_CHECKING:
    import pyarrow as pa

    from .navigation import Samples

BLOCK = 1 << 20
"""Bytes of a CSV that are parsed at once; no line is longer."""
ROWS = 1 << 16
"""Rows of a Parquet file that are read at once."""
PARQUET = b"PAR1"
SEPARATORS = (",", ";", "\t", "|")
MISSING = ("", "-", "nan", "null", "none", "na", "n/a")
"""What stands for a missing value, in lower case."""
NUMBER = r"^[+-]?(\d+[.]?\d*|[.]\d+)([eE][+-]?\d{1,3})?$"


def mapped_table(name: str, path: Path, nav: Nav) -> MappedTable | None:
    """Return the reader of a recording's file if `nav.files` names it, by its name or its path in the recording."""
    if nav.format not in ("auto", "columns"):
        return None
    named = any(fnmatch(name, pattern) or fnmatch(PurePosixPath(name).name, pattern) for pattern in nav.files)
    return MappedTable(path, nav) if named else None


@dataclass(frozen=True, slots=True)
class MappedTable:
    """A CSV or Parquet file that `[nav.columns]` holds for.

    The first line of a CSV names its columns. Cells are separated by what `nav.separator` says; quoted ones may hold
    it. An empty cell, `-`, NaN or null is a missing value.

    Attributes:
        path: The file; a CSV may be compressed.
        nav: The project file's `[nav]`, with `time` and `columns`.
    """

    format: ClassVar[str] = "columns"
    kind: ClassVar[str] = "nav"

    path: Path
    nav: Nav

    @staticmethod
    def sniff(head: bytes) -> bool:
        """Claim nothing: any table may be one, and the project file tells which are."""
        del head
        return False

    def batches(self, account: Account) -> Iterator[pa.RecordBatch]:
        """Yield the samples in the order of time, in the schema `NAVIGATION`.

        Args:
            account: Every row is one record; rejected are those with more or fewer cells than the first line, without
                a time, with a cell that is no number, nowhere on earth, and those whose time does not increase.

        Raises:
            InputError: The file cannot be read, or lacks a column, or a unit is not known.
        """
        from .navigation import navigation_batches

        factors = self._factors()
        is_parquet = head(self.path).startswith(PARQUET)
        rows = self._parquet if is_parquet else self._csv

        def read(account: Account) -> Iterator[Samples]:
            for place, columns in rows(account):
                if samples := self._samples(place, columns, factors):
                    yield samples

        unit = "row" if is_parquet else "line"
        yield from navigation_batches(read, account, {"time": self._time.format}, unit=unit, record=unit)

    @property
    def _time(self) -> Any:
        return self.nav.time

    @property
    def _wanted(self) -> list[str]:
        """The columns that are named, each once."""
        week = [self._time.week] if self._time.week else []
        return list(dict.fromkeys([self._time.column, *week, *(column.column for column in self.nav.columns.values())]))

    def _factors(self) -> dict[str, float]:
        factors, wrong = {}, []
        for name, column in self.nav.columns.items():
            stored = QUANTITIES[name].unit
            scale = column.scale if column.scale is not None else factor(column.unit or stored, stored)
            if scale is None:
                wrong.append(
                    f"nav.columns.{name}: {column.unit!r} is not known as a unit of {stored} "
                    f"({', '.join(known_units(stored))} are); or say what to multiply it by: scale = …"
                )
                continue
            factors[name] = scale * column.sign
        if wrong:
            raise InputError(self.path, "nav.columns", "; ".join(wrong))
        return factors

    def _find(self, names: list[str], where: str) -> dict[str, int]:
        """Return the places of the columns that are named.

        Raises:
            InputError: It names all that are not there or are there more than once.
        """
        stripped = [name.strip() for name in names]
        places, wrong = {}, []
        for wanted in self._wanted:
            found = [k for k, name in enumerate(stripped) if name == wanted.strip()]
            if len(found) == 1:
                places[wanted] = found[0]
            elif found:
                wrong.append(f"there are {len(found)} columns {wanted!r}; rename all but one")
            else:
                folded = {name.casefold(): name for name in stripped}
                near = difflib.get_close_matches(wanted.strip().casefold(), folded, n=1, cutoff=0.53)
                wrong.append(f"there is no column {wanted!r}{f' (did you mean {folded[near[0]]!r}?)' if near else ''}")
        if wrong:
            listed = ", ".join(repr(name) for name in stripped[:40])
            reason = (
                f"{'; '.join(wrong)}. The columns are {listed}. Correct nav.columns and nav.time in wheelprint.toml"
            )
            raise InputError(self.path, where, reason)
        return places

    def _csv(self, account: Account) -> Iterator[tuple[npt.NDArray[np.int64], dict[str, pa.Array]]]:
        """Yield numbers of lines and the cells of the columns that are named, as text."""
        import pyarrow as pa
        from pyarrow import csv as arrow_csv

        # Whatever the encoding is, no byte is an error in this one, and digits are digits.
        first = head(self.path).partition(b"\n")[0].removeprefix(b"\xef\xbb\xbf")
        line = first.decode("utf-8", "replace").rstrip("\r")
        separator: str = self.nav.separator
        if separator == "auto":
            separator = max(SEPARATORS, key=line.count)
        names = next(csv.reader([line], delimiter=separator), [])
        places = self._find(names, "line 1")
        wrong: dict[int, str] = {}
        last_wrong, short = 0, False

        def reject(row: Any) -> str:
            nonlocal last_wrong, short
            last_wrong, short = row.number, row.actual_columns < row.expected_columns
            why = f"expected {row.expected_columns} cells as in the first line; found {row.actual_columns}"
            wrong[row.number] = why if row.text.strip() else ""
            return "skip"

        stream = _Stream(blocks(self.path, account, BLOCK))
        next_line = 2
        try:
            reader = arrow_csv.open_csv(
                pa.PythonFile(stream, "r"),
                arrow_csv.ReadOptions(
                    use_threads=False, block_size=BLOCK, skip_rows=1, encoding="latin-1",
                    column_names=[str(k) for k in range(len(names))],
                ),
                arrow_csv.ParseOptions(
                    delimiter=separator, newlines_in_values=False, ignore_empty_lines=False, invalid_row_handler=reject
                ),
                arrow_csv.ConvertOptions(
                    include_columns=[str(place) for place in places.values()],
                    column_types={str(place): pa.string() for place in places.values()},
                ),
            )  # fmt: skip
            for batch in reader:
                known = (number for number in count(next_line) if number not in wrong)
                lines = np.array(list(islice(known, len(batch))), np.int64)
                next_line = int(lines[-1]) + 1 if len(lines) else next_line
                while next_line in wrong:
                    next_line += 1
                for number in [number for number in wrong if number < next_line]:
                    if why := wrong.pop(number):
                        account.reject(f"line {number}", why)
                yield lines, dict(zip(places, batch.columns, strict=True))
        except pa.ArrowInvalid as error:
            if "Empty CSV" not in str(error):
                account.truncated = True
                account.reject(f"line {next_line}", f"no CSV can be read from about here on: {str(error)[:200]}")
        for number, why in wrong.items():
            if why:
                account.reject(f"line {number}", why)
        account.truncated |= short and not stream.ended and last_wrong >= next_line - 1

    def _parquet(self, account: Account) -> Iterator[tuple[npt.NDArray[np.int64], dict[str, pa.Array]]]:
        """Yield numbers of rows and the columns that are named."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            file = pq.ParquetFile(self.path)
        except (pa.ArrowException, OSError) as error:
            reason = f"no Parquet file, or one that was cut off: {str(error)[:200]}"
            raise InputError(self.path, "", reason) from None
        names = file.schema_arrow.names
        places = self._find(names, "schema")
        done = 0
        try:
            for batch in file.iter_batches(ROWS, columns=[names[place] for place in places.values()]):
                yield (
                    np.arange(done + 1, done + 1 + len(batch)),
                    {wanted: batch[names[place]] for wanted, place in places.items()},
                )
                done += len(batch)
        except (pa.ArrowException, OSError) as error:
            account.truncated = True
            account.reject(f"row {done + 1}", f"the file is damaged from here on: {str(error)[:200]}")

    def _samples(
        self, place: npt.NDArray[np.int64], columns: Mapping[str, pa.Array], factors: Mapping[str, float]
    ) -> Samples | None:
        from .navigation import Samples, impossible_positions
        from .quantities import canonical_signals
        from .table_time import EXPECTED, parse_times

        blank = np.all([~np.asarray(_told(column).is_valid()) for column in columns.values()], axis=0)
        if blank.any():  # Empty lines.
            place, columns = place[~blank], {name: column.filter(~blank) for name, column in columns.items()}
        if not len(place):
            return None
        stamps = _with_points(columns[self._time.column], self.nav.decimal)
        time, known = parse_times(stamps, columns.get(self._time.week), self._time)
        doubts: dict[int, str] = {}
        told = {}
        for name, scale in factors.items():
            column = columns[self.nav.columns[name].column]
            values, wrong = _numbers(column, self.nav.decimal)
            told[name] = values * scale
            for row in wrong.tolist():
                hint = "" if "," not in str(column[row]) else '; where commas are decimal marks, say nav.decimal = ","'
                doubts[row] = f"expected a number as {self.nav.columns[name].column}; found {_quote(column[row])}{hint}"
        for row in np.flatnonzero(~known).tolist():
            found = _quote(columns[self._time.column][row])
            doubts[row] = f"expected {EXPECTED[self._time.format]} as {self._time.column}; found {found}"
        latitude, longitude, altitude = (
            told.get(name, np.full(len(place), np.nan)) for name in ("latitude", "longitude", "altitude")
        )
        doubts = impossible_positions(latitude, longitude, altitude, "row") | doubts
        return Samples(place, time, np.ones(len(place), bool), canonical_signals(told), doubts)


def _is_text(column: Any) -> bool:
    import pyarrow as pa

    return bool(pa.types.is_string(column.type) or pa.types.is_large_string(column.type))


def _told(column: Any) -> Any:
    """Return a column with null for what stands for a missing value; text without blanks at its ends."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if not _is_text(column):
        return column
    text = pc.utf8_trim_whitespace(column)
    missing = pc.is_in(pc.utf8_lower(text), pa.array(MISSING, column.type))
    return pc.if_else(missing, None, text)


def _with_points(column: Any, decimal: str) -> Any:
    import pyarrow.compute as pc

    return pc.replace_substring(column, ",", ".") if decimal == "," and _is_text(column) else column


def _numbers(column: pa.Array, decimal: str) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.intp]]:
    """Return the numbers of a column, NaN where missing, and which cells are no number."""
    import pyarrow as pa
    import pyarrow.compute as pc

    told = _with_points(_told(column), decimal)
    there = np.asarray(told.is_valid())
    if _is_text(told):
        told = pc.if_else(pc.match_substring_regex(told, NUMBER), told, None)
    try:
        values = told.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    except pa.ArrowException:  # Dates, lists.
        values = np.full(len(column), np.nan)
        return values, np.flatnonzero(there)
    with np.errstate(invalid="ignore"):
        sound = np.asarray(told.is_valid()) & ~(np.abs(values) > LARGEST_NUMBER)
    return np.where(sound, values, np.nan), np.flatnonzero(there & ~sound)


def _quote(cell: Any) -> str:
    text = str(cell)
    return f"{text[:80]!r}{' and more' if len(text) > 80 else ''}"


class _Stream(io.RawIOBase):
    """The pieces of a file as a stream.

    Attributes:
        ended: Whether what was read last ends a line.
    """

    def __init__(self, pieces: Iterator[bytes]) -> None:
        super().__init__()
        self.ended = True
        self._pieces = pieces
        self._rest = b""

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1, /) -> bytes:
        """Return at most `size` bytes; none at the end."""
        if not self._rest:
            self._rest = next(self._pieces, b"")
        size = len(self._rest) if size < 0 else size
        content, self._rest = self._rest[:size], self._rest[size:]
        if content:
            self.ended = content.endswith(b"\n")
        return content
