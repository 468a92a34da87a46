"""Writers of logs of an imaginary flight in each layout of each kind, and what reads them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from dorado_logs import write_dorado, write_dorado_netcdf, write_dorado_product
from imc_logs import write_lsf
from logs import (
    Array,
    Flight,
    write_basestation,
    write_dbd,
    write_mat,
    write_nc4,
    write_ngdac,
    write_og1,
    write_seaexplorer,
    write_seaglider,
    write_slocum,
    write_spray,
    write_table,
)
from message_logs import write_ardusub, write_mcap, write_rosbag2

from factory.importing import IMPORTERS

TABLES = (Path(__file__).resolve().parents[1] / "docs" / "howto" / "import_tables.md").read_text()


@dataclasses.dataclass(frozen=True)
class Sound(Flight):
    """A flight whose attitude moves a little, as that of every vehicle at sea does."""

    dives: int = 2
    surface: float = 600.0

    def state(self, time: Array) -> dict[str, Array]:
        found = super().state(time)
        found["heading"] = found["heading"] + np.sin(0.05 * time)
        found["pitch"] = found["pitch"] + np.where(found["under"] > 0, np.sin(0.07 * time), 0.0)
        found["speed"] = self.speed + 0.01 * np.sin(0.06 * time)
        return found


WRITERS: dict[str, tuple[Callable[[Path, Flight], list[Path]], ...]] = {
    "slocum": (write_slocum, write_dbd),
    "seaglider": (write_seaglider, write_basestation),
    "seaexplorer": (
        lambda folder, flight: [write_seaexplorer(folder / "sea009_M3_gli.csv", flight)],
    ),
    "ngdac": (write_ngdac,),
    "og1": (lambda folder, flight: [write_og1(folder / "deployment.nc", flight)],),
    "spray": (lambda folder, flight: [write_spray(folder / "CUGN_line_90.nc", flight)],),
    "lrauv": (
        lambda folder, flight: [write_mat(folder / "log.mat", flight)],
        lambda folder, flight: [write_nc4(folder / "log.nc4", flight)],
    ),
    "mcap": (write_mcap,),
    "rosbag2": (write_rosbag2,),
    "ardusub": (write_ardusub,),
    "lsf": (write_lsf,),
    "dorado": (write_dorado, write_dorado_netcdf, write_dorado_product),
    "csv": (lambda folder, flight: write_table(folder, flight, TABLES),),
}
LAYOUTS = [(kind, k) for kind, writers in WRITERS.items() for k in range(len(writers))]
LIBRARIES = {
    ("slocum", 1): "dbdreader", ("ardusub", 0): "pymavlink", ("lsf", 0): "imcpy",
    ("mcap", 0): "rosbags", ("rosbag2", 0): "rosbags",
}  # fmt: skip
"""What writes or reads a layout and is an extra of the product"""


def write(kind: str, layout: int, folder: Path, flight: Flight) -> list[Path]:
    """Write the logs, or skip the test where their library is absent."""
    if (kind, layout) in LIBRARIES:
        pytest.importorskip(LIBRARIES[kind, layout])
    folder.mkdir(exist_ok=True)
    return WRITERS[kind][layout](folder, flight)


def mapping(kind: str, folder: Path) -> Path | None:
    """What the columns of a kind's tables are, where its names do not say."""
    return folder / "mine.toml" if IMPORTERS[kind].takes_mapping else None


def variation(kind: str, layout: int, flight: Flight) -> float | None:
    """[degree] What an import is told of the magnetic variation, where the files have none."""
    return flight.variation if (kind, layout) == ("og1", 0) else None
