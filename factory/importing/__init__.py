"""Importing: logs of real vehicles in the schema of the missions that the factory flies."""

from __future__ import annotations

from typing import TYPE_CHECKING

from factory.importing.formats.base import (
    IMPORTERS,
    Importer,
    ReadOptions,
    WrongFormat,
    register,
    sniff,
)

if TYPE_CHECKING:
    from factory.importing.import_run import import_logs as import_logs

__all__ = [
    "IMPORTERS",
    "Importer",
    "ReadOptions",
    "WrongFormat",
    "import_logs",
    "register",
    "sniff",
]


def __getattr__(name: str) -> object:
    """Load `import_logs` when it is asked for: it brings xarray."""
    if name == "import_logs":
        from factory.importing.import_run import import_logs

        return import_logs
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
