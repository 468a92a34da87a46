"""Separators: refuse a table whose columns are not separated by commas, and say how to save it."""

from __future__ import annotations

from collections.abc import Iterable

from twin.errors import InputError


def check_commas(
    source: str, lines: Iterable[tuple[int, str]], error: type[InputError] = InputError
) -> None:
    """Raise `error` at the first of the numbered lines that semicolons, tabs or blanks separate.

    A table of numbers needs none of them inside a cell. Spreadsheets write semicolons where the
    comma is the decimal mark, so the message speaks of that mark too.
    """
    for number, line in lines:
        found = _separator(line.strip())
        if found:
            raise error(
                f"{source} line {number}: columns are separated by {found}; separate them by commas"
                " and write decimals with a point (in a spreadsheet: save as CSV, comma"
                " delimited, under English number formats)"
            )


def _separator(line: str) -> str | None:
    if ";" in line:
        return "semicolons"
    if "," in line:
        return None
    if "\t" in line:
        return "tabs"
    return "blanks" if len(line.split()) > 1 else None
