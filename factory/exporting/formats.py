"""Formats of one file or recording: a flat Parquet table, and MCAP with messages of ROS 2."""

from factory.exporting.base import Exporter

PARQUET = Exporter(
    name="parquet",
    title="one flat Parquet table, a row for every sample",
    ending=".parquet",
    write="factory.exporting.flat_table:export_parquet",
    extra="parquet",
)
"""For tools that know no arrays."""

MCAP = Exporter(
    name="mcap",
    title="MCAP recordings with standard ROS 2 messages, for Foxglove and rosbag tools",
    ending="-mcap",
    write="factory.exporting.mcap_file:export_mcap",
    extra="mcap",
)
"""For Foxglove and rosbag tools."""
