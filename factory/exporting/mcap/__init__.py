"""MCAP: missions as recordings of ROS 2, for Foxglove and rosbag tools."""

from factory.exporting.base import Exporter

MCAP = Exporter(
    name="mcap",
    title="MCAP recordings with standard ROS 2 messages, for Foxglove and rosbag tools",
    ending="-mcap",
    write="factory.exporting.mcap.mcap_file:export_mcap",
    extra="mcap",
)
"""A store written as recordings that Foxglove and rosbag tools open."""
