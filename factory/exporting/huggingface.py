"""Hugging Face: a store as a data set folder with Parquet files of each split and a data card."""

from __future__ import annotations

from factory.exporting.base import Exporter, described

HUGGINGFACE = Exporter(
    name="huggingface",
    title="Hugging Face data set: Parquet files of each split and a data card",
    ending="-huggingface",
    write=described("factory.exporting.dataset_folder:export_huggingface"),
    takes=("metadata",),
    extra="parquet",
)
"""A store as a folder that `datasets.load_dataset` opens."""
