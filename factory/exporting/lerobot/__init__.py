"""LeRobot: a store as a data set of episodes, format v3.0."""

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
    from factory.exporting.lerobot.episodes import export_lerobot
    from factory.exporting.metadata import metadata_for

    metadata = metadata_for(run, options.metadata)
    return export_lerobot(run, missions, folder, advance, metadata=metadata)


LEROBOT = Exporter(
    name="lerobot",
    title="LeRobot data set v3.0: an episode for every mission, states, actions, statistics",
    ending="-lerobot",
    write=_write,
    takes=("metadata",),
    extra="parquet",
)
"""A store as a folder that `LeRobotDataset` opens."""
