"""Registry of the exporters: names for the command line, and writers."""

from __future__ import annotations

from factory.exporting.base import Exporter
from twin.errors import InputError
from twin.registry import Registry


def _check(name: str, kind: object) -> Exporter:
    if not isinstance(kind, Exporter):
        raise InputError(
            f"{kind!r} cannot be registered as an export format: it must be a "
            f"{Exporter.__module__}.{Exporter.__name__}"
        )
    if kind.name != name:
        raise InputError(f"export format {name!r} leads to {kind!r}, which has another name")
    return kind


EXPORTERS: Registry[Exporter] = Registry(
    "export format",
    group="glider_twin.exporters",
    shipped={
        "og1": "factory.exporting.og1:OG1",
        "parquet": "factory.exporting.parquet:PARQUET",
    },
    check=_check,
)
"""Every format that a store can be exported to, by name."""

register = EXPORTERS.add
"""Add an exporter of one's own."""
