"""NGDAC: what the import knows of profile files of the U.S. IOOS National Glider DAC."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory.importing.formats.base import Importer, ReadOptions

if TYPE_CHECKING:
    from factory.importing.deployment_log import DeploymentLog
    from factory.importing.tally import Tally


def _read(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    from factory.importing.formats.ngdac_reader import read_ngdac

    return read_ngdac(paths, options, tally)


NGDAC = Importer(
    name="ngdac",
    vehicle="any glider",
    files="IOOS NGDAC netCDF, a profile a file; all of a deployment together",
    channels="depth, CTD, the file's track, reported current; attitude and fixes where the file "
    "keeps the vehicle's own sensors",
    suffixes=frozenset({".nc"}),
    marks=frozenset({"profile_id", "profile_lat", "profile_lon", "profile_time", "lat_uv"}),
    period=5.0,
    read=_read,
    lacks=frozenset({"measured_pump", "measured_shift", "measured_rotation"}),
)
