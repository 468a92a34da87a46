"""Types and their settings, of which docs_reference.py makes a page: currents, segments, others.

python scripts/docs_settings.py                # all, in Markdown
python scripts/docs_settings.py grid hover     # some of them
"""

from __future__ import annotations

import dataclasses
import inspect
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from architecture import seam_table  # noqa: E402
from docs_markdown import escaped, table  # noqa: E402

from factory.seams import IMPORTERS  # noqa: E402
from twin.mission import Mission  # noqa: E402
from twin.seams import CURRENTS, FIGURES, SEGMENTS, SENSORS  # noqa: E402
from twin.vehicle.mjcf import field_texts  # noqa: E402
from twin.water.current import axes, velocity_file  # noqa: E402

OWN_FORMS = ("uniform", "profile", "tide", "series")
"""Currents whose texts are more than NAME=VALUE: docs/reference/currents.md has them"""
HEAD = ("setting", "default", "meaning")


def settings_page() -> str:
    """Make the page in Markdown."""
    sections = sections_by_name()
    return (
        "# Types and their settings\n\n[Currents](currents.md) and [missions](missions.md) have "
        "equations and examples. A default of None is explained beside it.\n\n"
        + "\n".join(sections.values())
    )


def sections_by_name() -> dict[str, str]:
    """Section of each current and segment, by its name in texts and files; then of the others."""
    logs = [
        (f"`{one.name}`", one.vehicle, one.files, one.channels, f"{one.period:g} s")
        for one in IMPORTERS.values()
    ]
    figures = [(f"`{name}`", FIGURES[name].summary) for name in FIGURES.shipped()]
    sensors = [
        (
            f"`{name}`",
            ", ".join(f"`{one.name}`" for one in SENSORS[name].writes) or "`measured_PART`",
        )
        for name in SENSORS.shipped()
    ]
    made = {
        "logs": "## Types of log\n\n"
        + table(("type", "vehicle", "files", "channels", "period"), logs),
        "figures": "## Figures\n\n" + table(("`--figure`", "shows"), figures),
        "sensors": "## Sensors\n\n" + table(("sensor", "measures"), sensors),
        "grid-names": "## Names in gridded files\n\n" + grid_names(),
        "points": f"## Extension points\n\n{seam_table()}",
    }
    for name in CURRENTS.shipped():
        if name not in OWN_FORMS:
            usage = ", ".join(f"`{text}`" for text in CURRENTS[name].usage)
            made[name] = section(name, CURRENTS[name], CURRENTS[name].setting_fields(), usage)
    fields = {field.name: field.name for field in dataclasses.fields(Mission)}
    made["mission"] = section("mission", Mission, fields, "Keys outside of the segments.")
    for name in SEGMENTS.shipped():
        fields = {field.name: field.name for field in dataclasses.fields(SEGMENTS[name])}
        made[name] = section(name, SEGMENTS[name], fields, f'`kind = "{name}"`')
    return made


def grid_names() -> str:
    """Names by which the type `grid` finds velocities and axes in a file."""
    rows = [
        (part, _listed(names), _listed(velocity_file.ALIASES.get(part, ())))
        for part, names in velocity_file.STANDARD_NAMES.items()
    ]
    rows += [(axis, "", _listed(names)) for axis, names in axes.AXIS_NAMES.items()]
    return table(("component, axis", "standard names", "names"), rows)


def _listed(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def section(name: str, cls: type, settings: dict[str, str], usage: str) -> str:
    """Section of a class: its description and a row for each setting that a user writes."""
    texts, names = field_texts(cls), dict[str, list[str]]()
    for written, field in settings.items():
        names.setdefault(field, []).append(f"`{written}`")
    rows = [
        (" or ".join(written), escaped(default(cls, field)), escaped(texts[field]))
        for field, written in names.items()
    ]
    first = " ".join((inspect.getdoc(cls) or "").split("\n\n")[0].split())
    return f"## `{name}`\n\n{usage}\n\n{escaped(first)}\n\n{table(HEAD, rows)}"


def default(cls: Any, name: str) -> str:
    """Text of a field's default."""
    field = cls.__dataclass_fields__[name]
    if field.default is not dataclasses.MISSING:
        value = field.default
        return f"{value:g}" if isinstance(value, float) else str(value)
    return "required" if field.default_factory is dataclasses.MISSING else "empty"


if __name__ == "__main__":
    made = sections_by_name()
    chosen = sys.argv[1:] or list(made)
    if unknown := [name for name in chosen if name not in made]:
        sys.exit(f"unknown {', '.join(unknown)} (allowed: {', '.join(made)})")
    print("\n".join(made[name] for name in chosen))
