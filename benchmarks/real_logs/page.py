"""Page: the benchmark as one HTML file, a chart wherever there are published figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.real_logs.row import Kind, Row, table
from twin.show.figures.page_layout import Page

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
