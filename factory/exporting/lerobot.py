"""LeRobot: a store as a data set of episodes, format v3.0."""

from __future__ import annotations

from factory.exporting.base import Exporter, described

LEROBOT = Exporter(
    name="lerobot",
    title="LeRobot data set v3.0: an episode for every mission, states, actions, statistics",
    ending="-lerobot",
    write=described("factory.exporting.lerobot_episodes:export_lerobot"),
    takes=("metadata",),
    extra="parquet",
)
"""A store as a folder that `LeRobotDataset` opens."""
