"""ASCII tables: reads a Slocum's data as text, as `dbd2asc` and later programs write it.

A file begins with lines `key: value`; the key `num_ascii_tags` gives their number. Then come
`num_label_lines` lines: names of the sensors, their units, their sizes in bytes. Each further row
is a cycle, divided by blanks (Teledyne Webb Research, dbd_file_format.txt).
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from factory.importing.columns import MISSING, Table, plain
from factory.importing.deployment_log import TRUNCATED
from factory.importing.tally import Tally
from twin.errors import InputError

LABEL = b"dbd_label:"
ASCII = b"DBD_ASC"
"""Label of a file of text; that of a binary file has DBD only."""
MOST_TAGS = 1000
"""Maximum number of header lines and segment names; a merged file of a deployment has hundreds."""
LABELS = 3
"""Default number of lines after the header: names, units, sizes."""


def is_text(path: Path) -> bool:
    """True if the first line of a Slocum's file, gzipped or not, is that of a text file."""
    try:
        with plain(path) as file:
            first = file.readline(100)
    except (OSError, EOFError, InputError):
        return False  # its reader reports the fault
    return first.startswith(LABEL) and ASCII in first


def read_text_table(path: Path, tally: Tally) -> Table:
    """Read sensors as columns; an incomplete last row is left out and reported.

    Raises:
      InputError: the file ends within its header, or its rows are no numbers.
    """
    try:
        with plain(path) as binary:
            text = io.TextIOWrapper(binary, encoding="latin-1")
            header = _header(text, path)
            labels = [text.readline().split() for _ in range(_count(header, "num_label_lines"))]
            rows = [line.split() for line in text]
    except (OSError, EOFError) as error:
        raise InputError(f"{path.name} cannot be read to its end: {error}") from error
    names = labels[0] if labels else []
    if not names:
        raise InputError(f"{path.name} is truncated within its header: no names of sensors")
    rows = [row for row in rows if row]
    if rows and len(rows[-1]) != len(names):
        tally.add("note", path.name, 1, f"{TRUNCATED}its last row is cut")
        rows = rows[:-1]
    if not rows:
        raise InputError(f"{path.name} holds names of sensors and no whole row")
    wrong = next((k for k, row in enumerate(rows) if len(row) != len(names)), None)
    if wrong is not None:
        raise InputError(
            f"{path.name}: row {wrong + 1} of the values has {len(rows[wrong])} numbers, and "
            f"{len(names)} sensors are named: it is damaged"
        )
    values = _numbers(rows, path)
    owner = header.get("full_filename") or header.get("filename") or path.stem
    columns = {name: values[:, k] for k, name in enumerate(names)}
    # amadeus-2014-204-5-0-sf: the vehicle, then year, day, mission, segment, kind of file
    vehicle = owner.removesuffix("-sf").removesuffix("-bf").rsplit("-", 4)[0]
    return Table(path, columns, owner=vehicle.replace("_", ""))


def _header(text: io.TextIOWrapper, path: Path) -> dict[str, str]:
    header: dict[str, str] = {}
    for read in range(1, MOST_TAGS + 1):
        key, colon, value = text.readline().partition(":")
        if not colon:
            break
        header[key.strip()] = value.strip()
        # names of the segments follow the counted lines
        named = sum(key.startswith("segment_") for key in header)
        if read >= _count(header, "num_ascii_tags", MOST_TAGS) and (
            named >= _count(header, "num_segments", 0)
        ):
            return header
    raise InputError(f"{path.name} is truncated within its header: it has {len(header)} lines")


def _count(header: dict[str, str], key: str, otherwise: int = LABELS) -> int:
    try:
        return min(max(int(header.get(key, otherwise)), 0), MOST_TAGS)
    except ValueError:
        return otherwise


def _numbers(rows: list[list[str]], path: Path) -> NDArray[np.float64]:
    """Convert the rows to numbers, (rows, sensors)."""
    try:
        return np.array(rows, object).astype(np.float64)
    except ValueError:
        pass
    for number, row in enumerate(rows, start=1):
        for k, word in enumerate(row):
            if word.lower() in MISSING:
                row[k] = "nan"
                continue
            try:
                float(word)
            except ValueError:
                raise InputError(
                    f"{path.name}: row {number} of the values has {word!r}, which is no number"
                ) from None
    return np.array(rows, object).astype(np.float64)
