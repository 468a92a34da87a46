"""Table files: CSV files of numbers with comments behind #; errors name the line."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

from twin.bounded import read_text
from twin.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

MOST_ROWS = 100_000
"""Maximum number of lines of a table, nine per metre of the deepest sea; stores hold copies."""


def read_table_file(path: Path, what: str, error: type[InputError] = InputError) -> pd.DataFrame:
    """Read the cells of a CSV file as stripped text; the index is the line in the file.

    Empty lines and lines that start with # are left out.

    Args:
      path: the file.
      what: name of the file in errors, such as "density file".
      error: the class of the errors.

    Raises:
      InputError: (or `error`) the file cannot be read or is empty, its separator is not the comma,
        it has more lines than `MOST_ROWS`, or a line has more or fewer cells than the header.
    """
    import pandas as pd

    text = read_text(path, f"the {what}", error)
    if (count := text.count("\n")) > MOST_ROWS:
        raise error(
            f"{what} {path} has {count:,} lines, more than {MOST_ROWS:,}: average them over depth,"
            " a row each 0.1 m or more"
        )
    lines = {
        number: line
        for number, line in enumerate(text.split("\n"), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    }
    if not lines:
        raise error(f"{what} {path} is empty: it needs a line of column names and rows of numbers")
    numbers = list(lines)
    width = lines[numbers[0]].count(",") + 1
    for number, line in lines.items():
        wrong = _separator(line.strip())
        if wrong:
            raise error(
                f"{what} {path} line {number}: columns are separated by {wrong}; separate them by"
                " commas and write decimals with a point (in a spreadsheet: save as CSV, comma"
                " delimited, under English number formats)"
            )
        if line.count(",") + 1 != width:
            raise error(
                f"{what} {path} row {number}: {line.count(',') + 1} values, the header has {width}"
            )
    try:
        frame = pd.read_csv(
            io.StringIO("\n".join(lines.values())), header=None, dtype=str, na_filter=False
        )
    except ValueError as cause:  # an unclosed quote
        why = " ".join(str(cause).split())
        raise error(f"{what} {path} is not a table of cells: {why}") from cause
    frame = frame.apply(lambda column: column.str.strip())
    frame.columns = pd.Index(frame.iloc[0])
    frame = frame.iloc[1:]
    frame.index = pd.Index(numbers[1:])
    return frame


def column_numbers(
    frame: pd.DataFrame, name: str, source: str, error: type[InputError] = InputError
) -> list[float]:
    """Convert a column to numbers.

    Raises:
      InputError: (or `error`) a cell is not a number; the message names its line.
    """
    values = []
    for number, cell in frame[name].items():
        try:
            values.append(float(cell))
        except ValueError:
            raise error(f"{source} row {number}: {name} is {cell!r}, not a number") from None
    return values


def _separator(line: str) -> str | None:
    """Name the separator of a line that does not use commas; None: commas.

    Cells of numbers contain none of these characters. Spreadsheets write semicolons where the
    comma is the decimal mark.
    """
    if ";" in line:
        return "semicolons"
    if "," in line:
        return None
    if "\t" in line:
        return "tabs"
    return "blanks" if len(line.split()) > 1 else None
