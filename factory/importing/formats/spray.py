"""Spray: what the import knows of the binned files of Scripps' Spray gliders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory.importing.formats.base import Importer, ReadOptions

if TYPE_CHECKING:
    from factory.importing.deployment_log import DeploymentLog
    from factory.importing.tally import Tally


def _read(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    from factory.importing.formats.spray_reader import read_spray

    return read_spray(paths, options, tally)


SPRAY = Importer(
    name="spray",
    vehicle="Spray glider",
    files="binned netCDF of spraydata.ucsd.edu, a line or a project a file (a Spray's OG1.0 file: "
    "`og1`; its profiles of the National Glider DAC: `ngdac`)",
    channels="fixes and depth over time, made again of the middles of dives and profiles; CTD of "
    "the climb, reported current. Attitude and actuators are not in these files",
    suffixes=frozenset({".nc"}),
    marks=frozenset({"u_depth_mean", "v_depth_mean", "trajectory_index", "mission_profile"}),
    period=60.0,
    read=_read,
    lacks=frozenset(
        {"measured_pitch", "measured_roll", "measured_heading", "measured_pump", "measured_shift",
         "measured_rotation"}
    ),
)  # fmt: skip
