"""Page: the benchmark as one HTML file and as tables of Markdown, and the rows that it stored.

`MEASURED` is what `python -m benchmarks.real_logs FOLDER --keep FILE` wrote on the public logs; a
test compares docs/results/real_logs.md with it.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.real_logs.row import NOT_COMPARED, Kind, Row, best, table
from twin.show.figures.page_layout import Page

MEASURED = Path(__file__).with_name("measured.json")
UNITS = {"m s-1": ("cm/s", 100.0, 2), "m h-1": ("m/h", 1.0, 0), "1": ("ratio", 1.0, 2)}
"""Of a row: unit on the page, factor to it, digits"""
COLOURS: dict[Kind, str] = {
    "published": "#8a929b",
    "public method": "#56b4e9",
    "twin": "#0072b2",
    "network": "#d55e00",
    "floor": "#009e73",
}
"""Of bars, by the kind of method (Okabe and Ito 2008)."""
BAR = 0.34
"""[in] height of a bar with its gap"""


def build_page(
    folder: Path, rows: Sequence[Row], tasks: Sequence[str], *, lead: str, command: str
) -> Path:
    """Write `index.html` and the charts as PNG.

    Args:
      rows: as `benchmarks.real_logs.run.run_benchmark` returns them.
      tasks: order of the sections; those without rows are left out.
      lead: a line below the title.

    Raises:
      InputError: the folder cannot be made.
    """
    page = Page(folder, "Real logs: twin and networks beside public methods", lead)
    for task in tasks:
        mine = [row for row in rows if row.task == task]
        if not mine:
            continue
        page.section(task)
        for data in dict.fromkeys(row.data for row in mine if row.kind == "published"):
            chosen = [r for r in mine if r.data == data and math.isfinite(r.value)]
            name = f"{task} {data}".replace(" ", "-")
            caption = f"{data}: {task}. Hollow: as published, on other samples."
            page.figure(name, chart(chosen), caption)
        for unit in dict.fromkeys(row.unit for row in mine):
            page.table(table([row for row in mine if row.unit == unit]), first=False)
    page.section("Command")
    page.code(command)
    return page.write()


def chart(rows: Sequence[Row]) -> Figure:
    """Errors of one deployment's methods as bars, best at the top."""
    ordered = sorted(rows, key=lambda row: row.value, reverse=True)
    figure = Figure(figsize=(7.0, 1.3 + BAR * len(ordered)), layout="constrained")
    axes = figure.subplots()
    values = [row.value for row in ordered]
    colours = [COLOURS.get(row.kind, "#8a929b") for row in ordered]
    hollow = [
        "white" if row.kind == "published" else c for row, c in zip(ordered, colours, strict=True)
    ]
    bars = axes.barh(range(len(ordered)), values, height=0.7, color=hollow, edgecolor=colours)
    labels = [f"{value:.3g}" for value in values]
    axes.bar_label(bars, labels, padding=4, fontsize=9)
    axes.set_yticks(range(len(ordered)), [row.method for row in ordered])
    axes.set_xlim(0.0, 1.15 * max(values))
    axes.set_ylim(-0.6, len(ordered) + 0.2)
    unit = rows[0].unit.replace("m s-1", "m/s").replace("m h-1", "m/h")
    axes.set_xlabel(f"error [{unit}]")
    axes.spines[["top", "right"]].set_visible(False)
    kinds = [kind for kind in COLOURS if kind != "published" and any(r.kind == kind for r in rows)]
    marks = [axes.barh([0], [0], color=COLOURS[kind], label=kind) for kind in kinds]
    figure.legend(
        handles=marks, loc="outside lower center", ncols=len(marks), frameon=False, fontsize=9
    )
    return figure


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
    lines = [head, ["---"] * len(head), *body]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


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
