"""Slocum: what the import knows of Teledyne's Slocum gliders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory.importing.formats.base import TABLES, Importer, ReadOptions
from factory.importing.formats.slocum.caches import BINARY, CACHES

if TYPE_CHECKING:
    from factory.importing.deployment_log import DeploymentLog
    from factory.importing.tally import Tally


def _read(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    from factory.importing.formats.slocum.reader import read_slocum

    return read_slocum(paths, options, tally)


SLOCUM = Importer(
    name="slocum",
    vehicle="Slocum glider",
    files=".dbd .ebd .sbd .tbd .mbd .nbd with their .cac (beside the files, or `--cache FOLDER`); "
    "tables (csv, csv.gz, parquet) with the vehicle's own sensor names",
    channels="attitude, ballast or oil volume, battery, rudder, CTD, GPS, on-board track, reported "
    "current, thruster, batteries; `U_dvl_ms` becomes `true_speed`",
    suffixes=BINARY | CACHES | TABLES,
    marks=frozenset(
        {"m_depth", "m_pressure", "m_pitch", "U_dvl_ms", "og_north_m", "sci_water_pressure",
         "m_gps_lat", "m_water_vx", "mag_var_rad"}
    ),
    first_bytes=(b"dbd_label",),
    period=2.0,
    read=_read,
    extra="slocum",
    takes_cache=True,
    lacks=frozenset({"measured_rotation"}),
)  # fmt: skip
