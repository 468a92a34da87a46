"""Registry of the importers, and which kind of log a file looks like."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from factory.importing.formats.base import Importer
from twin.registry import Registry, instance_of

IMPORTERS: Registry[Importer] = Registry(
    "kind of log",
    group="glider_twin.importers",
    shipped={
        "slocum": "factory.importing.formats.slocum:SLOCUM",
        "seaglider": "factory.importing.formats.seaglider:SEAGLIDER",
        "seaexplorer": "factory.importing.formats.seaexplorer:SEAEXPLORER",
        "og1": "factory.importing.formats.og1:OG1",
        "ngdac": "factory.importing.formats.ngdac:NGDAC",
        "lrauv": "factory.importing.formats.lrauv:LRAUV",
        "csv": "factory.importing.formats.csv:CSV",
    },
    check=instance_of("kind of log", Importer),
)
"""Every kind of log that can be imported, by name."""

register = IMPORTERS.add
"""Add an importer of one's own."""


def likely_kind(names: Iterable[str]) -> str | None:
    """The importer with the most marks among the names; None when no importer has any."""
    found = set(names)
    scores = {importer.name: len(importer.marks & found) for importer in IMPORTERS.values()}
    best = max(scores, key=lambda name: scores[name])
    return best if scores[best] else None


def sniff(path: str | Path) -> str | None:
    """The kind of log that a file looks like by what is in it; None when it looks like none.

    Raises:
      InputError: the file cannot be read.
    """
    from factory.importing.reading.columns import column_names
    from factory.importing.reading.netcdf import holds_arrays, variable_names

    path = Path(path)
    with path.open("rb") as file:
        start = file.read(64)
    for importer in IMPORTERS.values():
        if any(start.startswith(first) for first in importer.first_bytes):
            return importer.name
    return likely_kind(variable_names(path) if holds_arrays(path) else column_names(path))
