"""Figures as aligned text for a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

MISSING = "-"
"""Stands where there is no value: None or NaN."""

LARGEST_PLAIN = 1e7
"""Magnitude from which a number is written with an exponent."""

NEGLIGIBLE = 1e-15
"""Magnitude below which a figure in SI units or degrees is rounding noise, shown as 0."""

SMALLEST_PLAIN = 1e-4
"""Magnitude below which a number is written with an exponent."""


def format_number(value: object, digits: int = 4) -> str:
    """A cell's text: numbers with `digits` significant digits, whole numbers in full.

    >>> format_number(0.49021), format_number(-35.547), format_number(5.3e-06, 2)
    ('0.4902', '-35.55', '5.3e-06')
    >>> format_number(12), format_number(float("nan")), format_number(True)
    ('12', '-', 'yes')
    """
    if value is None:
        return MISSING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | str):
        return str(value)
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return str(value)
    if math.isnan(number):
        return MISSING
    if abs(number) < NEGLIGIBLE:
        return "0"
    if math.isinf(number):
        return f"{number:g}"
    if not SMALLEST_PLAIN <= abs(number) < LARGEST_PLAIN:
        return f"{number:.{digits - 1}e}"
    # The exponent after rounding, so that 9.99996 becomes 10.00 and not 10.000.
    exponent = int(f"{number:.{digits - 1}e}".partition("e")[2])
    return f"{number:.{max(digits - 1 - exponent, 0)}f}"


def format_table(rows: Sequence[Mapping[str, object]], *, digits: int = 4) -> str:
    """Rows under a header line; numbers flush right, text flush left.

    The columns are the keys in order of first appearance; a row without a key shows `MISSING`.
    """
    columns = list(dict.fromkeys(key for row in rows for key in row))
    cells = [[format_number(row.get(column), digits) for column in columns] for row in rows]
    right = [not any(isinstance(row.get(column), str) for row in rows) for column in columns]
    widths = [
        max(len(text) for text in (column, *(line[i] for line in cells)))
        for i, column in enumerate(columns)
    ]

    def line(texts: Sequence[str]) -> str:
        padded = (
            text.rjust(width) if flush_right else text.ljust(width)
            for text, width, flush_right in zip(texts, widths, right, strict=True)
        )
        return "  ".join(padded).rstrip()

    rule = "  ".join("-" * width for width in widths)
    return "\n".join([line(columns), rule, *(line(texts) for texts in cells)])


def format_pairs(pairs: Mapping[str, object], *, digits: int = 4) -> str:
    """Name and value on each line, the values aligned; a (value, unit) tuple shows its unit."""
    width = max((len(name) for name in pairs), default=0)
    return "\n".join(
        f"{name:<{width}}  {_quantity(value, digits)}" for name, value in pairs.items()
    )


def _quantity(value: object, digits: int) -> str:
    if isinstance(value, tuple):
        number, unit = value
        return f"{format_number(number, digits)} {unit}"
    return format_number(value, digits)
