"""Hugging Face: Parquet files of each split, and the card that says which is which."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from factory.exporting import Advance, ExportOptions, FlatTable, metadata_for
from glider_twin_hubs.data_card import split_name, write_card
from twin.records import SPLITS, MissionStore

LARGEST_FILE = 400_000_000
"""[bytes] after which a split goes on in a further file; hubs ask for less than 500 MB"""
FOLDER = "data"
LAYOUT = (
    "`data/SPLIT-NNNNN.parquet`: a row for every sample, a row group for every mission. The "
    "columns `mission` and `time` [s] say where a row belongs; `datetime` is UTC, `latitude` and "
    "`longitude` are WGS84.\n\n"
    "```python\n"
    "import datasets\n\n"
    'missions = datasets.load_dataset("this/folder")\n'
    'missions["train"].with_format("numpy")["measured_pitch"]\n'
    "```"
)


def export_huggingface(
    run: MissionStore,
    missions: Sequence[int],
    folder: Path,
    advance: Advance,
    options: ExportOptions,
) -> list[Path]:
    """Write the missions by split, and README.md.

    Raises:
      ModuleNotFoundError: pyarrow is not installed.
      OSError: the disk refuses.
      StoreError: no such mission, or its data cannot be read.
    """
    flat = FlatTable(run)
    (folder / FOLDER).mkdir()
    written: list[Path] = []
    configs = []
    for split in SPLITS:
        some = [mission for mission in missions if split_name(run.splits[mission]) == split]
        if some:
            tables = _told((flat.rows(mission) for mission in some), advance)
            written += write_files(tables, flat.schema, folder / FOLDER, split)
            configs.append({"split": split, "path": f"{FOLDER}/{split}-*.parquet"})
    files = [{"config_name": "default", "data_files": configs}]
    said = metadata_for(run, options.metadata)
    about = write_card(folder, run, missions, said, files, tags=("tabular",), layout=LAYOUT)
    return [about, *written]


def write_files(tables: Iterator[Any], schema: Any, folder: Path, name: str) -> list[Path]:
    """Tables one after the other in files `NAME-NNNNN.parquet` of bounded size."""
    pq = import_module("pyarrow.parquet")
    written: list[Path] = []
    writer = None
    try:
        for table in tables:
            if writer is None:
                written.append(folder / f"{name}-{len(written):05d}.parquet")
                writer = pq.ParquetWriter(written[-1], schema, compression="zstd")
            writer.write_table(table)
            if written[-1].stat().st_size > LARGEST_FILE:
                writer.close()
                writer = None
    finally:
        if writer is not None:
            writer.close()
    return written


def _told(tables: Iterator[Any], advance: Advance) -> Iterator[Any]:
    for table in tables:
        yield table
        advance()
