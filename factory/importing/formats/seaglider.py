"""Seaglider: what the import knows of Seagliders and their basestation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory.importing.formats.base import TABLES, Importer, ReadOptions

if TYPE_CHECKING:
    from factory.importing.deployment_log import DeploymentLog
    from factory.importing.tally import Tally


def _read(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    from factory.importing.formats.seaglider_reader import read_seaglider

    return read_seaglider(paths, options, tally)


SEAGLIDER = Importer(
    name="seaglider",
    vehicle="Seaglider",
    files="basestation p*.nc; tables of samples, dives and ADCP",
    channels="attitude, bladder, both battery axes, CTD, three fixes a dive, reported current, "
    "batteries, pump power; the ADCP's inverse solution becomes `true_surge/sway/heave` "
    "and `true_current_*`",
    suffixes=TABLES | {".nc"},
    marks=frozenset(
        {"vbd_cc", "u_ttw", "gps2_lat", "gpsE_time", "eng_pitchAng", "log_gps_lat",
         "sg_cal_id_str", "eng_vbdCC", "gc_st_secs"}
    ),
    period=5.0,
    read=_read,
    held=frozenset({"measured_shift", "measured_rotation"}),
)  # fmt: skip
