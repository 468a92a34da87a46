"""Parquet: a store as one flat table for tools that know no arrays."""

from factory.exporting.base import Exporter

PARQUET = Exporter(
    name="parquet",
    title="one flat Parquet table, a row for every sample",
    ending=".parquet",
    write="factory.exporting.flat_table:export_parquet",
    extra="parquet",
)
