"""LRAUV: what the import knows of MBARI's long-range AUVs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory.importing.formats.base import Importer, ReadOptions

if TYPE_CHECKING:
    from factory.importing.deployment_log import DeploymentLog
    from factory.importing.tally import Tally


def _read(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    from factory.importing.formats.lrauv_reader import read_lrauv

    return read_lrauv(paths, options, tally)


LRAUV = Importer(
    name="lrauv",
    vehicle="long-range AUV",
    files=".mat (v7.3), .nc4, simulator csv",
    channels="depth, attitude, temperature, fixes, on-board track, batteries; buoyancy, mass, "
    "rudder, elevator, propeller and their commands by the names of the parts of `tethys`",
    suffixes=frozenset({".mat", ".nc", ".nc4", ".csv", ".gz"}),
    marks=frozenset(
        {"EpochSeconds", "platform_pitch_angle", "latitude_fix", "time_fix",
         "platform_buoyancy_position", "platform_mass_position"}
    ),
    period=2.0,
    read=_read,
    lacks=frozenset({"measured_rotation"}),
)  # fmt: skip
