"""Csv: tables of any vehicle, read by a mapping file that says what their columns are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory.importing.formats.base import TABLES, Importer, ReadOptions

if TYPE_CHECKING:
    from factory.importing.deployment_log import DeploymentLog
    from factory.importing.tally import Tally


def _read(paths: Sequence[Path], options: ReadOptions, tally: Tally) -> list[DeploymentLog]:
    from factory.importing.formats.csv.table_reader import read_tables

    return read_tables(paths, options, tally)


CSV = Importer(
    name="csv",
    vehicle="any vehicle",
    files="tables with a --mapping file that names what each column is",
    channels="what the mapping names: attitude, body rates, accelerations, DVL, depth, CTD, fixes, "
    "track, controls by the names of their parts",
    suffixes=TABLES,
    marks=frozenset(),
    period=1.0,
    read=_read,
    takes_mapping=True,
    lacks=frozenset(
        {"measured_pump", "measured_shift", "measured_rotation", "measured_density"}
    ),
)  # fmt: skip
