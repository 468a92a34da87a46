"""SeaExplorer: what the import knows of Alseamar's SeaExplorer gliders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory.importing.formats.base import TABLES, Importer, ReadOptions

if TYPE_CHECKING:
    from factory.importing.deployment_log import DeploymentLog
    from factory.importing.tally import Tally


def _read(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    from factory.importing.formats.seaexplorer_reader import read_seaexplorer

    return read_seaexplorer(paths, options, tally)


SEAEXPLORER = Importer(
    name="seaexplorer",
    vehicle="SeaExplorer glider",
    files=".gli and .pld logs, plain or gzip, comma or semicolon",
    channels="attitude, ballast, both masses, declination, fixes, voltage; CTD of the payload. "
    "Beam velocities of an AD2CP are left out: without their transform and a reference layer they "
    "are no velocity through the water",
    suffixes=TABLES,
    # the vehicle numbers its files: sea035.12.gli.sub.36
    name_words=frozenset({"gli", "pld1"}),
    marks=frozenset({"NavState", "BallastPos", "PLD_REALTIMECLOCK", "NAV_RESOURCE"}),
    period=5.0,
    read=_read,
)
