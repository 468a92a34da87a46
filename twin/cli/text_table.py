"""Text tables: numbers, tables, pairs and paragraphs as aligned text for a terminal."""

from __future__ import annotations

import math
import textwrap
import unicodedata
from collections.abc import Mapping, Sequence

WIDEST, NARROWEST_TEXT, GAP = 100, 10, "  "
"""[character] WIDEST: of tables and paragraphs. NARROWEST_TEXT: smallest width of a text column
when a wide table is folded. GAP: text between columns."""
MISSING = "-"  # shown for None or NaN
SMALLEST_PLAIN, LARGEST_PLAIN = 1e-4, 1e7
"""Numbers below SMALLEST_PLAIN, or from LARGEST_PLAIN on, are written with an exponent."""
NEGLIGIBLE = 1e-15
"""Magnitude below which a number in SI units or degrees is rounding noise, shown as 0."""
UNPRINTED = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})


def printable(text: str) -> str:
    r"""Escape every character that could move a terminal's cursor or reverse its text. So foreign
    text, such as a log's header or a file's name, is shown without effect.

    Escaped are Unicode's categories Cc, Cf, Cs, Zl and Zp, except line breaks and tabs.

    >>> printable("a\x1b[2Jb\u202e")
    'a\\x1b[2Jb\\u202e'
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(
        one.encode("unicode_escape", "surrogatepass").decode("ascii")
        if one not in "\n\t" and unicodedata.category(one) in UNPRINTED
        else one
        for one in text
    )


def counted(count: int, noun: str) -> str:
    """Text of a count and a noun whose plural ends in s, such as 1 mission and 2 missions."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def format_number(value: object, digits: int = 4) -> str:
    """Text of a cell: numbers with `digits` significant digits, integers in full.

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
    # Take the exponent after rounding, so that 9.99996 becomes 10.00 and not 10.000.
    exponent = int(f"{number:.{digits - 1}e}".partition("e")[2])
    return f"{number:.{max(digits - 1 - exponent, 0)}f}"


def format_table(rows: Sequence[Mapping[str, object]], *, digits: int = 4) -> str:
    """Format rows as a table under a header line; numbers flush right, text flush left.

    The columns are the keys in order of first appearance; a row without a key shows `MISSING`.
    A table wider than `WIDEST` is folded: first the titles, then the widest columns of text, last
    single long words.
    """
    columns = list(dict.fromkeys(key for row in rows for key in row))
    cells = [[format_number(row.get(column), digits) for column in columns] for row in rows]
    right = [not any(isinstance(row.get(column), str) for row in rows) for column in columns]
    widths = _column_widths(columns, cells, right)

    def lines(texts: Sequence[str], *, at_the_foot: bool = False) -> list[str]:
        folded = [_folded(text, width) for text, width in zip(texts, widths, strict=True)]
        height = max(map(len, folded), default=1)
        blank = [[""] * (height - len(part)) for part in folded]
        full = [
            empty + part if at_the_foot else part + empty
            for part, empty in zip(folded, blank, strict=True)
        ]
        return [
            GAP.join(
                part[k].rjust(width) if flush_right else part[k].ljust(width)
                for part, width, flush_right in zip(full, widths, right, strict=True)
            ).rstrip()
            for k in range(height)
        ]

    rule = GAP.join("-" * width for width in widths)
    body = [line for texts in cells for line in lines(texts)]
    return "\n".join([*lines(columns, at_the_foot=True), rule, *body])


def _column_widths(
    columns: Sequence[str], cells: Sequence[Sequence[str]], right: Sequence[bool]
) -> list[int]:
    """Widths of the columns: that of the widest text, or less if the table must be folded."""
    bodies = [max((len(texts[i]) for texts in cells), default=0) for i in range(len(columns))]
    widths = [max(len(title), body) for title, body in zip(columns, bodies, strict=True)]
    whole = [" ".join((title, *(texts[i] for texts in cells))) for i, title in enumerate(columns)]
    words = [max(map(len, text.split()), default=0) for text in whole]
    room = WIDEST - len(GAP) * (len(columns) - 1)
    if sum(widths) > room:
        widths = [max(pair) for pair in zip(bodies, words, strict=True)]
    least = [max(word, NARROWEST_TEXT) for word in words]
    while sum(widths) > room:
        foldable = [
            (width, i) for i, width in enumerate(widths) if not right[i] and width > least[i]
        ]
        if not foldable:  # then long words must be broken
            least = [min(word, NARROWEST_TEXT) for word in least]
            if not any(w > s and not r for w, s, r in zip(widths, least, right, strict=True)):
                break
            continue
        widths[max(foldable)[1]] -= 1
    return widths


def _folded(text: str, width: int) -> list[str]:
    """Wrap a text to lines of `width`; break a longer word, after an underscore if one is in the
    last two thirds of the line."""
    if len(text) <= width:
        return [text]
    pieces: list[str] = []
    for word in text.split():
        while len(word) > width:
            cut = word.rfind("_", 0, width) + 1
            cut = cut if cut > width // 3 else width
            pieces.append(word[:cut])
            word = word[cut:]
        pieces.append(word)
    return textwrap.wrap(" ".join(pieces), width, break_on_hyphens=False) or [""]


def format_paragraph(text: str, *, indent: str = "") -> str:
    """Wrap a text to lines of at most `WIDEST` characters, all but the first indented."""
    return textwrap.fill(
        text, WIDEST, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )


def format_pairs(pairs: Mapping[str, object], *, digits: int = 4) -> str:
    """Format one name and value a line, values aligned; a (value, unit) tuple shows its unit."""
    width = max((len(name) for name in pairs), default=0)
    lines = []
    for name, value in pairs.items():
        number, *unit = value if isinstance(value, tuple) else (value,)
        text = " ".join((format_number(number, digits), *unit))
        lines.append(format_paragraph(f"{name:<{width}}{GAP}{text}", indent=" " * width + GAP))
    return "\n".join(lines)
