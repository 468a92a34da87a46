"""Page: the benchmark as tables of Markdown, and the rows that it stored.

`MEASURED` is what `python -m benchmarks.real_logs FOLDER --keep FILE` wrote on the public logs; a
test compares docs/results/real_logs.md with it.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path

from benchmarks.command import markdown as markdown_table
from benchmarks.real_logs.row import NOT_COMPARED, Row, best

MEASURED = Path(__file__).with_name("measured.json")
UNITS = {"m s-1": ("cm/s", 100.0, 2), "m h-1": ("m/h", 1.0, 0), "1": ("ratio", 1.0, 2)}
"""Of a row: unit on the page, factor to it, digits"""


def keep(rows: Sequence[Row], path: Path) -> None:
    """Store the rows, numbers with five digits."""
    lines = [
        json.dumps(
            {
                key: float(f"{value:.5g}") if isinstance(value, float) else value
                for key, value in dataclasses.asdict(row).items()
                if not (isinstance(value, float) and math.isnan(value))
            }
        )
        for row in rows
    ]
    path.write_text("[\n" + ",\n".join(lines) + "\n]\n", encoding="utf-8")


def kept(path: Path = MEASURED) -> list[Row]:
    """The rows of a file that `keep` wrote."""
    return [Row(**entry) for entry in json.loads(path.read_text(encoding="utf-8"))]


def markdown(rows: Sequence[Row], task: str) -> str:
    """One task as a table of Markdown: a line for each method where there is one deployment, else a
    line for each deployment. The best of equal samples is bold."""
    mine = [row for row in rows if row.task == task and row.kind not in NOT_COMPARED]
    data = list(dict.fromkeys(row.data for row in mine))
    methods = list(dict.fromkeys(row.method for row in mine))
    cells = {(row.data, row.method): _cell(row, best(mine)) for row in mine}
    unit = UNITS[mine[0].unit][0]
    if len(data) == 1:
        head = [f"{data[0]}, {_samples(mine[0])}", f"{unit} (95 %)"]
        body = [[method, cells[data[0], method]] for method in methods]
    else:
        head = [f"{unit} (95 %)", *methods, "samples"]
        body = [
            [
                name,
                *(cells.get((name, method), "") for method in methods),
                _samples(next(row for row in mine if row.data == name)),
            ]
            for name in data
        ]
    return markdown_table(head, body)


def _cell(row: Row, winners: Sequence[Row]) -> str:
    _, factor, digits = UNITS[row.unit]
    text = f"{factor * row.value:.{digits}f}"
    if any(row is one for one in winners):
        text = f"**{text}**"
    if math.isfinite(row.low):
        text += f" ({factor * row.low:.{digits}f} to {factor * row.high:.{digits}f})"
    return text


def _samples(row: Row) -> str:
    if row.samples == row.dives:
        return f"{row.dives} dives"
    return f"{row.samples} in {row.dives} dives" if row.dives > 1 else f"{row.samples} in 1 dive"
