"""Picture and table of extension points for the documentation's page on the architecture.

`python scripts/architecture.py` writes docs/project/architecture.png. docs_settings.py puts the
table into the site's page of types.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import factory.seams
import learn.seams
import twin.seams
from twin.registry import Registry

ROOT = Path(__file__).resolve().parents[1]
WHITE, INK = "#ffffff", "#1d2733"
BANDS = {"twin": "#e3eef9", "factory": "#e6f4e8", "learn": "#fbeedd"}
WIDTH, HEIGHT, STEP = 1.72, 0.52, 2.08
"""Width and height of a box, and distance of columns"""
ROWS = {"twin": (6.2, 5.3, 4.4), "factory": (3.0,), "learn": (1.6,)}
BANDS_Y = {"twin": (4.2, 7.1), "factory": (2.8, 3.95), "learn": (1.4, 2.55)}

BOXES = {
    "vehicle": ("vehicle", "hull law, parts (MJCF)", "twin", 0, 0),
    "water": ("water", "density, currents", "twin", 1, 0),
    "mission": ("mission", "segments, guidance", "twin", 2, 0),
    "physics": ("physics", "MuJoCo, native water", "twin", 3, 0),
    "sensors": ("sensors", "errors, seeded noise", "twin", 4, 0),
    "fossen": ("fossen", "independent model", "twin", 0, 1),
    "checks": ("checks", "the two models agree", "twin", 1, 1),
    "identify": ("identify", "parameters from logs", "twin", 2, 1),
    "pictures": ("show", "figures, films, pages", "twin", 3, 1),
    "recipe": ("sampling", "recipes, draws", "factory", 1, 0),
    "generation": ("generation", "missions in parallel", "factory", 2, 0),
    "importing": ("importing", "logs of vehicles", "factory", 3, 0),
    "exporting": ("exporting", "OG1, Parquet", "factory", 4, 0),
    "data": ("data", "sequences, labels", "learn", 0, 0),
    "networks": ("networks, training", "surge and sway", "learn", 1, 0),
    "navigation": ("navigation", "features, baselines", "twin", 4, 1),
    "evaluation": ("evaluation", "errors by method", "learn", 2, 0),
    "report": ("report", "page, model card", "learn", 3, 0),
}
"""Boxes by name: text, package, column and row"""
FLOWS = (
    ("mission", "physics"), ("physics", "sensors"), ("sensors", "navigation"),
    ("fossen", "checks"), ("recipe", "generation"), ("data", "networks"),
    ("networks", "evaluation"), ("evaluation", "report"),
)  # fmt: skip
"""Data flow from box to box, with both branches of `records`"""
INTO_RECORDS = ("navigation", "generation", "importing")
OUT_OF_RECORDS = ("identify", "pictures", "exporting", "data")


@dataclasses.dataclass(frozen=True)
class Seam:
    """Extension point, to which others can add types: classes or objects."""

    what: str
    folder: str
    base: str
    """Public class of which an entry is a subclass or an instance"""
    group: str
    """Group of entry points"""
    page: str
    """Page and anchor in docs/"""
    kinds: tuple[Any, ...]
    """Shipped classes, functions or objects"""


def seams() -> tuple[Seam, ...]:
    """List all extension points of the packages."""
    tables = [vars(module).values() for module in (twin.seams, factory.seams, learn.seams)]
    return tuple(
        Seam(one.noun, one.folder, one.base, one.group, one.page,
             tuple(one[name] for name in one.shipped()))
        for table in tables for one in table if isinstance(one, Registry)
    )  # fmt: skip


def seam_table() -> str:
    """Format all extension points as a Markdown table."""
    rows = [
        "| a new | goes into | derives from | entry points | example |",
        "|---|---|---|---|---|",
    ]
    for seam in seams():
        page = Path(seam.page.partition("#")[0]).stem.replace("_", " ")
        rows.append(
            f"| {seam.what} | `{seam.folder}/` | `{seam.base}` | `{seam.group}` "
            f"| [{page}](../{seam.page}) |"
        )
    return "\n".join(rows) + "\n"


def draw(path: Path) -> None:
    """Draw the picture into a file."""
    from matplotlib.figure import Figure
    from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

    figure = Figure(figsize=(10.6, 5.9), facecolor=WHITE)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, 10.6), ylim=(1.3, 7.2))
    axes.axis("off")

    def box(x: float, y: float, width: float, height: float, colour: str, edge: str) -> None:
        style = "round,pad=0,rounding_size=0.08"
        axes.add_patch(
            FancyBboxPatch((x, y), width, height, style, facecolor=colour, edgecolor=edge)
        )

    def label(x: float, y: float, title: str, text: str) -> None:
        axes.text(x, y + 0.34, title, ha="center", va="center", size=10, weight="bold", color=INK)
        axes.text(x, y + 0.14, text, ha="center", va="center", size=8, color=INK)

    def arrow(start: tuple[float, float], end: tuple[float, float]) -> None:
        axes.add_patch(
            FancyArrowPatch(
                start, end, arrowstyle="-|>", mutation_scale=12, color=INK, linewidth=1.2,
                shrinkA=1, shrinkB=1,
            )
        )  # fmt: skip

    for name, (low, high) in BANDS_Y.items():
        box(0.07, low, 10.46, high - low, BANDS[name], "none")
        axes.text(0.2, high - 0.14, name, va="center", size=10, style="italic", color=INK)
    places = {}
    for key, (title, text, package, column, row) in BOXES.items():
        x, y = 0.25 + STEP * column, ROWS[package][row]
        places[key] = (x, y)
        box(x, y, WIDTH, HEIGHT, WHITE, INK)
        label(x + WIDTH / 2, y, title, text)
    bar = ROWS["twin"][2]
    box(0.25, bar, 4 * STEP + WIDTH, HEIGHT, WHITE, INK)
    text = "one schema, one table of limits, one store from the water to the network"
    label(5.3, bar, "records", text)
    for one, other in FLOWS:
        (x0, y0), (x1, y1) = places[one], places[other]
        if x0 == x1:
            arrow((x0 + WIDTH / 2, y0), (x1 + WIDTH / 2, y1 + HEIGHT))
        else:
            arrow((x0 + WIDTH, y0 + HEIGHT / 2), (x1, y1 + HEIGHT / 2))
    for key in ("water", "mission"):
        x, y = places[key][0] - (STEP - WIDTH) / 2, places[key][1] + HEIGHT / 2
        axes.text(x, y, "+", ha="center", va="center", size=14, color=INK)
    for key in (*INTO_RECORDS, *OUT_OF_RECORDS):
        x, y = places[key][0] + WIDTH / 2, places[key][1]
        ends = [(x, bar + HEIGHT), (x, y)] if y > bar else [(x, bar), (x, y + HEIGHT)]
        arrow(*(ends[::-1] if key in INTO_RECORDS else ends))
    figure.savefig(path, dpi=150, metadata={"Software": None})


if __name__ == "__main__":
    draw(ROOT / "docs" / "project" / "architecture.png")
    print(seam_table())
