"""OG1.0: what the import knows of the OceanGliders' common format."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory.importing.formats.base import Importer, ReadOptions

if TYPE_CHECKING:
    from factory.importing.deployment_log import DeploymentLog
    from factory.importing.tally import Tally


def _read(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    from factory.importing.formats.og1.og1_reader import read_og1

    return read_og1(paths, options, tally)


OG1 = Importer(
    name="og1",
    vehicle="any glider",
    files="OceanGliders OG1.0 netCDF, also what `factory export --to og1` writes",
    channels="whatever of attitude, pressure, actuators, CTD, payload and fixes the file has; "
    "values that its flags call bad (3, 4) are removed",
    suffixes=frozenset({".nc"}),
    marks=frozenset(
        {"LATITUDE_GPS", "PLATFORM_SERIAL_NUMBER", "TRAJECTORY", "PHASE", "LATITUDE", "LONGITUDE",
         "PITCH", "TIME"}
    ),
    period=5.0,
    read=_read,
)  # fmt: skip
