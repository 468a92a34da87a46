"""Parquet: a store as one flat table for tools that know no arrays."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory.exporting.base import Advance, Exporter

if TYPE_CHECKING:
    from twin.records.reader import MissionStore


def _write(run: MissionStore, missions: Sequence[int], path: Path, advance: Advance) -> list[Path]:
    from factory.exporting.flat_table import export_parquet

    return [export_parquet(run, missions, path, advance)]


PARQUET = Exporter(
    name="parquet",
    title="one flat Parquet table, a row for every sample",
    ending=".parquet",
    write=_write,
    extra="parquet",
)
