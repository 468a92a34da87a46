"""Importing: logs of real vehicles in the schema of the missions that the factory flies."""

from __future__ import annotations

from typing import TYPE_CHECKING

from factory.importing.reading.files import KINDS

if TYPE_CHECKING:
    from factory.importing.importer import import_logs as import_logs

__all__ = ["KINDS", "import_logs"]


def __getattr__(name: str) -> object:
    """Load the importer when it is asked for: it brings xarray."""
    if name == "import_logs":
        from factory.importing.importer import import_logs

        return import_logs
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
