"""Validation tables of docs/results/validation.md: published figures and both models' values.

    python scripts/docs_validation.py            # prints them
    python scripts/docs_validation.py --write    # puts them into the page

A test compares the page with these tables.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from twin.checks.agreement import check_published  # noqa: E402
from twin.checks.published import ANGLES, FIGURES, PublishedMotion  # noqa: E402
from twin.vehicle.steady_motion import Trim  # noqa: E402

PAGE = ROOT / "docs" / "results" / "validation.md"
OURS = "independent solution"
"""First words of a source for figures that we computed from a paper's equations"""
UNITS = {"speed": "m/s", "turn_rate": "rad/s", "vertical_speed": "m/s"}
DECIMALS = {"turn_rate": 5, "speed": 4, "vertical_speed": 4}
"""Decimals shown, 3 by default: those of the finest print, without rounding noise"""
HEADS = {
    "printed": "| vehicle, source | figure | printed | MuJoCo | Fossen | allowed difference |",
}


def tables() -> dict[str, str]:
    """Make the table of printed figures, Markdown by name."""
    rows: list[str] = []
    found: dict[int, dict[str, Trim]] = {}
    motions: dict[int, PublishedMotion] = {}
    for motion, model, trim in check_published():
        if not motion.source.startswith(OURS):
            found.setdefault(id(motion), {})[model] = trim
            motions[id(motion)] = motion
    for key, motion in motions.items():
        rows += motion_rows(motion, found[key])
    head = HEADS["printed"]
    return {"printed": "\n".join([head, "|" + "---|" * (head.count("|") - 1), *rows]) + "\n"}


def settings(motion: PublishedMotion) -> str:
    """Net buoyancy mass, battery shift and battery rotation of a glide; else empty."""
    if not hasattr(motion, "net_mass"):
        return ""
    return f"{motion.net_mass:g} kg, {1000 * motion.shift:g} mm, {motion.rotation:g} deg"


def motion_rows(motion: PublishedMotion, trims: dict[str, Trim]) -> list[str]:
    """Table rows of one motion's figures; the first has vehicle, source and settings."""
    rows = []
    first = f"`{motion.vehicle}`, {motion.source}"
    if held := settings(motion):  # where the source does not say it
        first += f": {held}"
    for name in FIGURES:
        value = getattr(motion, name)
        if value is None:
            continue
        digits = DECIMALS.get(name, 3)
        ours = [getattr(trims[model], FIGURES[name]) for model in ("mujoco", "fossen")]
        limit = motion.tolerance["angle" if name in ANGLES else name]
        unit = "deg" if name in ANGLES else UNITS[name]
        cells = [
            first,
            f"{name.replace('_', ' ')} [{unit}]",
            f"{value:g}",
            *(f"{one:.{digits}f}".replace(f"-{0:.{digits}f}", f"{0:.{digits}f}") for one in ours),
            f"{limit:g}",
        ]
        rows.append(f"| {' | '.join(cells)} |")
        first = ""
    return rows


def marked(name: str) -> re.Pattern[str]:
    """Pattern that finds a table in the page."""
    return re.compile(rf"(<!-- {name} -->\n)(.*?)(<!-- end -->)", re.DOTALL)


def written(page: str) -> str:
    """Page with both tables replaced by the values computed now."""
    for name, table in tables().items():
        page = marked(name).sub(lambda found, table=table: f"{found[1]}\n{table}\n{found[3]}", page)
    return page


if __name__ == "__main__":
    if sys.argv[1:] == ["--write"]:
        PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    else:
        print("\n".join(tables().values()))
