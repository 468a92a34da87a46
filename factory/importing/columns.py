"""Columns of csv and parquet tables: numbers in order of time, each time once."""

from __future__ import annotations

import dataclasses
import io
import math
import warnings
import zlib
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np
from numpy.typing import NDArray

from factory.importing.sample_clock import FIRST_SECOND, LAST_SECOND, tell_standing
from factory.importing.tally import Tally
from twin.bounded import check_unpacked, unpacked_file
from twin.errors import InputError
from twin.extras import require

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

MISSING = frozenset({"", "nan", "na", "null", "none", "n/a", "--"})
"""Words that mean "no value", compared in lower case."""
LONGEST_HEADER = 2**20
"""[character] Longest line of column names; a Slocum's two thousand names need a tenth."""
MOST_COLUMNS = 10_000
"""Maximum number of columns of a table; a Slocum knows three thousand sensors."""
_YEAR = 365.25 * 86400.0
_JUMP = _YEAR
"""[s] Longest silence of a deployment; a longer step in time is a jump of the clock."""
_FEW = 0.01
"""Jumps of the clock divide rows into groups. A group has a wrong clock if it has at most this
fraction of the largest group's rows, or one row where the largest has at least `_SEVERAL`."""
_SEVERAL = 10
LARGEST = 1e30
"""Largest number that a log can hold, in any unit; netCDF's own fill value is 9.97e36."""


def measurable(values: Array) -> Array:
    """Replace numbers beyond any measurement by infinity, so that no product overflows; `tidy`
    removes and counts them."""
    return np.where(np.abs(values) > LARGEST, np.copysign(np.inf, values), values)


@dataclasses.dataclass(frozen=True)
class Table:
    """Columns of one file."""

    path: Path
    columns: Mapping[str, Array]
    """Columns of numbers; columns of other texts are in `texts`."""
    texts: Mapping[str, NDArray[Any]] = dataclasses.field(default_factory=dict)
    owner: str = ""
    """Vehicle or deployment, if the file names it."""
    short: int = 0
    """Number of rows left out because they are too short, in a file without a header."""

    def has(self, *names: str) -> bool:
        """True when all the columns are there."""
        return all(name in self.columns for name in names)

    def __len__(self) -> int:
        every = [*self.columns.values(), *self.texts.values()]
        return len(every[0]) if every else 0


def read_table(path: Path, names: Sequence[str] = ()) -> Table:
    """Read a csv, csv.gz or parquet file, or a text of numbers without a header.

    Args:
      names: of the columns of a text without a header, whose cells are separated by blanks.

    Raises:
      InputError: unreadable, empty or truncated, or pyarrow is missing.
    """
    if path.stat().st_size == 0:
        raise InputError(f"{path} is empty")
    if path.suffix.lower() == ".parquet":
        return _parquet(path)
    return _csv(path, names)


def _opened_parquet(path: Path) -> Any:
    require("pyarrow.parquet", extra="parquet", purpose=path.name)
    parquet: Any = import_module("pyarrow.parquet")
    try:
        with parquet.ParquetFile(path) as file:
            names = [str(name) for name in file.schema_arrow.names]
        # a repeated text is in memory once
        return parquet.ParquetFile(path, read_dictionary=names)
    except Exception as error:
        raise InputError(f"{path} is not a whole parquet file: {_line(error)}") from error


def _parquet(path: Path) -> Table:
    with _opened_parquet(path) as file:
        check_unpacked(_declared(file.metadata), path.stat().st_size, str(path))
        try:
            table = file.read()
        except Exception as error:
            raise InputError(f"{path} is not a whole parquet file: {_line(error)}") from error
    columns, texts = dict[str, Array](), dict[str, NDArray[Any]]()
    for name in table.column_names:
        values = _array(table[name])
        if values.dtype.kind == "M":
            seconds = values.astype("datetime64[ns]").astype(np.int64) / 1e9
            columns[name] = np.where(np.isnat(values), np.nan, seconds)
        elif values.dtype.kind in "fiub":
            columns[name] = measurable(values.astype(np.float64))
        else:
            texts[name] = values
    return Table(path, columns, texts)


def _declared(metadata: Any) -> float:
    """[byte] Size of a parquet file's values in memory, eight bytes or more for each."""
    groups = (metadata.row_group(k) for k in range(metadata.num_row_groups))
    columns = (group.column(k) for group in groups for k in range(group.num_columns))
    return float(sum(max(8 * c.num_values, c.total_uncompressed_size) for c in columns))


def _array(column: Any) -> NDArray[Any]:
    """Values of an arrow table's column; texts of a dictionary are in memory once each."""
    if not hasattr(column.type, "index_type"):
        return np.asarray(column.to_numpy())
    parts = [
        np.array([*chunk.dictionary.to_pylist(), None], object)[
            chunk.indices.fill_null(len(chunk.dictionary)).to_numpy()
        ]
        for chunk in column.chunks
    ]
    return np.concatenate(parts) if parts else np.zeros(0, object)


def column_names(path: Path) -> list[str]:
    """Names of the columns of a csv, csv.gz or parquet file. Errors as `read_table`."""
    if path.suffix.lower() == ".parquet":
        with _opened_parquet(path) as parquet:
            return [str(name) for name in parquet.schema_arrow.names]
    try:
        with _opened(path) as file:
            return [name for name in _header(file)[0] if name]
    except _UNREADABLE as error:
        raise InputError(f"{path} cannot be read to its end: {_line(error)}") from error


_UNREADABLE = (OSError, EOFError, zlib.error)
"""Errors that a cut or damaged file raises."""


def _opened(path: Path) -> TextIO:
    with plain(path) as binary:
        wide = binary.read(2) in (b"\xff\xfe", b"\xfe\xff")  # as spreadsheets write "Unicode text"
    encoding = "utf-16" if wide else "utf-8-sig"
    return io.TextIOWrapper(plain(path), newline="", encoding=encoding, errors="replace")


def plain(path: Path) -> io.BufferedReader:
    """Open a file for reading, unpacked if its name ends with .gz."""
    return unpacked_file(path) if path.suffix.lower() == ".gz" else path.open("rb")


def _header(file: TextIO) -> tuple[list[str], str]:
    """Column names in the first line, and their separator: a comma, semicolon or tab."""
    line = file.readline(LONGEST_HEADER)
    delimiter = max(",;\t", key=line.count)
    what = ""
    if len(line) == LONGEST_HEADER:
        what = f"a first line of more than {LONGEST_HEADER} characters"
    elif line.count(delimiter) >= MOST_COLUMNS:
        what = f"more than {MOST_COLUMNS} names in its first line"
    if what:
        raise InputError(f"{file.name} has {what}: it is not a table of columns")
    return [word.strip().strip('"') for word in line.rstrip("\r\n").split(delimiter)], delimiter


class _PaddedTable(io.TextIOBase):
    """Table preceded by a row of empty cells, which gives the parser the largest number of cells.
    The parser trusts the first row, even one with millions of cells."""

    def __init__(self, first: str, file: TextIO) -> None:
        self._first, self._file = first, file

    def read(self, size: int | None = -1) -> str:
        first, self._first = self._first, ""
        return first or self._file.read(-1 if size is None else size)


def _csv(path: Path, given: Sequence[str] = ()) -> Table:
    import pandas as pd

    try:
        with _opened(path) as file, warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # cells would be lost
            names, delimiter = (list(given), r"\s+") if given else _header(file)
            # a row may end with a separator, so that it has an empty cell more than the header
            cells = range(len(names) + 1)
            first = "- " * len(cells) if given else delimiter * len(names)
            frame = pd.read_csv(
                _PaddedTable(first + "\n", file), sep=delimiter, header=None,
                names=cells, dtype=str, na_filter=False, index_col=False,
            )[1:]  # fmt: skip
    except _UNREADABLE as error:
        raise InputError(f"{path} cannot be read to its end: {_line(error)}") from error
    except (pd.errors.ParserError, pd.errors.ParserWarning) as error:
        raise InputError(
            f"{path} is not a table of {len(names)} columns: {_line(error)}"
        ) from error
    if len(names) < 2 or any(not name for name in names[1:-1]):
        raise InputError(f"{path} does not begin with a line of column names")
    beyond = np.flatnonzero(frame[len(names)].fillna("").str.strip() != "")
    if beyond.size:
        raise InputError(
            f"{path}: row {beyond[0] + 1} of the values has more cells than the header has names"
        )
    # files that were appended to each other repeat their line of names
    again = (frame[list(range(len(names)))] == names).all(axis=1)
    frame = frame[~again]
    whole = frame[len(names) - 1].fillna("") != ""
    short = int((~whole).sum()) if given else 0
    frame = frame[whole] if given else frame
    columns, texts = dict[str, Array](), dict[str, NDArray[Any]]()
    for k, name in enumerate(names):
        if not name:  # the index that pandas writes, or a separator at the end
            continue
        words = frame[k].str.strip()
        numbers = _numbers(words)
        if numbers is None and delimiter != ",":
            numbers = _numbers(words.str.replace(_DECIMAL_COMMA, r"\1.\2", regex=True))
        if numbers is None:
            texts[name] = words.to_numpy(object)
        else:
            columns[name] = measurable(numbers)
    return Table(path, columns, texts, short=short)


_DECIMAL_COMMA = r"^([-+]?\d*),(\d+(?:[eE][-+]?\d+)?)$"
"""Pattern of a number with a decimal comma."""


def _numbers(words: pd.Series[str]) -> Array | None:
    """Words as numbers; None when more than half of the words with a value are no numbers."""
    there = ~words.str.lower().isin(MISSING)
    numbers = words.where(there, "nan")
    try:
        return numbers.to_numpy(object).astype(np.float64)
    except ValueError:
        pass
    values = np.array([_number(word) for word in numbers])
    bad = np.isnan(values) & there.to_numpy() & (numbers.str.lower() != "nan").to_numpy()
    return None if bad.sum() > 0.5 * there.sum() else values


def _number(word: str) -> float:
    """Convert a word to a number; NaN if the word is none."""
    try:
        return float(word)
    except ValueError:
        return math.nan


def tidy(
    time: Array, columns: Mapping[str, Array], subject: str, tally: Tally
) -> tuple[Array, dict[str, Array]]:
    """Sort by time and make times unique; repeated times become one row.

    Rows without a time are left out. All changes are counted. Rows at which the clock stands still
    are kept and marked as suspect.
    """
    known = np.isfinite(time) & (time >= FIRST_SECOND) & (time <= LAST_SECOND)
    tally.add("left out", subject, ~known, "rows without a possible time")
    tell_standing(time[known], {n: v[known] for n, v in columns.items()}, subject, tally)
    astray = _wrong_clock_rows(time, known)
    tally.add(
        "left out", subject, astray,
        f"rows whose clock had jumped by {_JUMP / _YEAR:g} year or more",
    )  # fmt: skip
    known &= ~astray
    time = time[known]
    earlier = np.flatnonzero(time < np.maximum.accumulate(time)) if time.size else np.zeros(0)
    tally.add("sorted", subject, earlier.size, "rows earlier than one before them")
    order = np.argsort(time, kind="stable")
    unique, first = np.unique(time[order], return_index=True)
    repeated = time.size - unique.size
    out: dict[str, Array] = {}
    for name, values in columns.items():
        out[name] = tally.removed(values, np.isinf(values), name, "infinite")[known][order]
    return unique, _merge_repeats(first, out, subject, tally) if repeated else out


def _wrong_clock_rows(time: Array, known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """True for the few rows so far in time from the others that their clock was wrong."""
    rows = np.flatnonzero(known)
    rows = rows[np.argsort(time[rows], kind="stable")]
    groups = np.split(rows, np.flatnonzero(np.diff(time[rows]) > _JUMP) + 1)
    largest = max(map(len, groups))
    most = max(_FEW * largest, 1.0 if largest >= _SEVERAL else 0.0)
    few = [group for group in groups if len(group) <= most]
    return np.isin(np.arange(len(time)), np.concatenate(few) if few else [])


def _merge_repeats(
    first: NDArray[np.intp], columns: Mapping[str, Array], subject: str, tally: Tally
) -> dict[str, Array]:
    """Merge rows of one time into one row.

    If the rows agree, each column keeps its first value. If they contradict each other, the first
    row with any value is kept alone: values of two rows are not mixed.

    Args:
      first: index of the first row of each time; rows are in order of time.
    """
    total = len(next(iter(columns.values()))) if columns else 0
    group = np.zeros(total, np.intp)
    group[first[1:]] = 1
    group = np.cumsum(group)
    clash = np.zeros(len(first), bool)
    some = np.zeros(total, bool)
    filled: dict[str, Array] = {}
    for name, values in columns.items():
        there = np.isfinite(values)
        some |= there
        best = np.lexsort((np.arange(total), ~there, group))
        filled[name] = values[best][first]
        differs = there & (values != filled[name][group])
        clash[group[differs]] = True
    leading = np.lexsort((np.arange(total), ~some, group))[first]
    extra = np.bincount(group, minlength=len(first)) - 1
    tally.add("repeated", subject, extra[~clash], "samples written twice: kept once")
    tally.add(
        "removed", subject, extra[clash],
        "rows that repeat a time with other values: the first is kept",
    )  # fmt: skip
    return {
        name: np.where(clash, values[leading], filled[name]) for name, values in columns.items()
    }


def stacked(pieces: Sequence[Mapping[str, Array]], names: Sequence[str]) -> dict[str, Array]:
    """Join the named columns of all chunks in order; NaN where a chunk lacks a column."""
    empty = [np.full(len(next(iter(piece.values()))), np.nan) for piece in pieces]
    return {
        name: np.concatenate([p.get(name, e) for p, e in zip(pieces, empty, strict=True)])
        for name in names
        if any(name in piece for piece in pieces)
    }


def with_values(columns: Mapping[str, Array], kept: Iterable[str] = ()) -> dict[str, Array]:
    """Columns that have a value, and the columns in `kept` in any case.

    A column without values is dropped, so that it hides no other of the same meaning.
    """
    return {n: v for n, v in columns.items() if n in set(kept) or np.isfinite(v).any()}


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())[:160] or type(error).__name__
