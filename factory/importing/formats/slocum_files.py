"""Slocum files: binary ones and tables, each to its reader."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from factory.importing.formats.slocum_tables import read_slocum_tables
from factory.importing.reading.files import SLOCUM_BINARY
from factory.importing.reading.log import Log
from factory.importing.reading.tally import Tally
from twin.errors import InputError


def read_slocum(
    paths: Sequence[Path], *, variation_deg: float | None, cache: Path | None, tally: Tally
) -> list[Log]:
    """Logs of all the files; binary files and tables become deployments of their own.

    Raises:
      InputError: as the two readers.
    """
    binary = [p for p in paths if p.suffix.lower() in SLOCUM_BINARY]
    caches = [p for p in paths if p.suffix.lower() == ".cac"]
    tables = [p for p in paths if p not in binary and p not in caches]
    if not binary and not tables:
        raise InputError("only cache files (.cac) are named; add the .dbd and .ebd files")
    logs: list[Log] = []
    if binary:
        from factory.importing.formats.slocum_binary import read_slocum_binary

        logs += read_slocum_binary(
            binary, caches=caches, variation_deg=variation_deg, cache=cache, tally=tally
        )
    if tables:
        logs += read_slocum_tables(tables, variation_deg=variation_deg, tally=tally)
    return logs
