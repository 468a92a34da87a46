"""MCAP: missions as recordings of ROS 2, for Foxglove and rosbag tools."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory.exporting.base import Advance, Exporter

if TYPE_CHECKING:
    from twin.records.reader import MissionStore


def _write(
    run: MissionStore, missions: Sequence[int], folder: Path, advance: Advance
) -> list[Path]:
    from factory.exporting.mcap.mcap_file import export_mcap

    return export_mcap(run, missions, folder, advance)


MCAP = Exporter(
    name="mcap",
    title="MCAP recordings with standard ROS 2 messages, for Foxglove and rosbag tools",
    ending="-mcap",
    write=_write,
    extra="mcap",
)
"""A store written as recordings that Foxglove and rosbag tools open."""
