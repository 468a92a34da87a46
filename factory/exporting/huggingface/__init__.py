"""Hugging Face: a store as a data set folder with Parquet files of each split and a data card."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory.exporting.base import Advance, Exporter, ExportOptions

if TYPE_CHECKING:
    from twin.records.reader import MissionStore


def _write(
    run: MissionStore,
    missions: Sequence[int],
    folder: Path,
    advance: Advance,
    options: ExportOptions,
) -> list[Path]:
    from factory.exporting.huggingface.dataset_folder import export_huggingface
    from factory.exporting.metadata import metadata_for

    metadata = metadata_for(run, options.metadata)
    return export_huggingface(run, missions, folder, advance, metadata=metadata)


HUGGINGFACE = Exporter(
    name="huggingface",
    title="Hugging Face data set: Parquet files of each split and a data card",
    ending="-huggingface",
    write=_write,
    takes=("metadata",),
    extra="parquet",
)
"""A store as a folder that `datasets.load_dataset` opens."""
