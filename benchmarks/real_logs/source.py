"""Source: imported logs of a folder, and the tables of truth beside them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from factory.importing import import_logs
from factory.importing.columns import Table, read_table
from twin.errors import InputError, TwinError
from twin.identify import Log, load_logs
from twin.navigation.dead_reckoning import Array
from twin.records.logged import LogStore
from twin.records.store import write_store

KINDS = ("slocum", "seaglider", "seaexplorer")
"""Types of logs: first words of the folders' names"""
NOT_JUDGED = {
    "lrauv": "a propelled vehicle without attitude in its shore logs: "
    "benchmarks/real_logs/yo_yos.py sets its depth rates beside its twin's",
    "auv": "a propelled vehicle: the section propelled judges it",
    "currents": "model fields, no logs",
}
TABLES = frozenset({".csv", ".gz", ".parquet"})


@dataclasses.dataclass(frozen=True, kw_only=True)
class Deployment:
    """Dives of one vehicle in an imported store."""

    name: str
    kind: str
    folder: Path
    store: Path
    rows: tuple[int, ...]
    """Rows of the store, in order of time"""
    starts: tuple[float, ...]
    """[s] Unix time of each row's first sample"""
    ends: tuple[float, ...]

    def logs(self, rows: Sequence[int] | None = None) -> list[Log]:
        """Read these rows for identification; rows without a dive are left out."""
        return load_logs(self.store, list(self.rows if rows is None else rows))

    def clock(self, log: Log) -> Array:
        """Unix time [s] of a log's samples."""
        start = self.starts[self.rows.index(log.index)]
        return np.asarray(start + log.period * np.arange(len(log.depth)), np.float64)


@dataclasses.dataclass(frozen=True)
class Skipped:
    """Folder or deployment that is not scored."""

    name: str
    why: str


def gather(
    root: Path, work: Path, say: Callable[[str], None]
) -> tuple[list[Deployment], list[Skipped]]:
    """Import every folder of logs below `root` into stores below `work`.

    Args:
      root: folder of folders whose names begin with the type of log.
      work: an existing folder for the stores.
      say: called with a text about each import.

    Raises:
      InputError: no such folder, or no folder of logs in it.
    """
    if not root.is_dir():
        raise InputError(f"no folder {root}; give one that holds slocum_..., seaglider_... folders")
    folders = sorted(path for path in root.iterdir() if path.is_dir())
    found: list[Deployment] = []
    skipped: list[Skipped] = []
    for folder in folders:
        word = folder.name.split("_")[0].lower()
        if word not in KINDS:
            skipped.append(Skipped(folder.name, NOT_JUDGED.get(word, "of no kind that is judged")))
            continue
        say(f"importing {folder.name}")
        try:
            found += imported(logs_folder(folder), word, work)
        except TwinError as error:
            skipped.append(Skipped(folder.name, str(error)))
    if not found:
        names = ", ".join(sorted(KINDS))
        why = f" ({skipped[0].name}: {skipped[0].why})" if skipped else ""
        raise InputError(
            f"{root} holds no logs to judge{why}; its folders must begin with one of {names}"
        )
    return found, skipped


def logs_folder(folder: Path) -> Path:
    """Return the folder, or its folder `raw` if it holds nothing else."""
    raw = folder / "raw"
    lone = raw.is_dir() and not any(path.suffix in TABLES for path in folder.iterdir())
    return raw if lone else folder


def imported(folder: Path, kind: str, work: Path) -> list[Deployment]:
    """Import the deployments of one folder; errors are those of `import_logs`."""
    dataset, report = import_logs(kind, [folder])
    named = folder.parent if folder.name == "raw" else folder
    store = work / f"{named.name}.zarr"
    write_store(dataset, store, overwrite=True)
    with LogStore(store) as logs:
        names = np.array(logs.deployments)
        start = logs.starts
        end = start + report.period * (logs.samples - 1.0)
    deployments = []
    powered = {log.index for log in load_logs(store) if log.powered}
    for name in dict.fromkeys(names):
        # dives with a thruster are no glides; `twin identify` leaves them out too
        rows = np.array([r for r in np.flatnonzero(names == name) if r not in powered], int)
        if not rows.size:
            continue
        deployments.append(Deployment(
            name=str(name), kind=kind, folder=folder, store=store, rows=tuple(rows.tolist()),
            starts=tuple(start[rows].tolist()), ends=tuple(end[rows].tolist()),
        ))  # fmt: skip
    return deployments


def tables_with(deployment: Deployment, *columns: str) -> list[Table]:
    """Tables of the deployment's folder with these columns, whose times its rows overlap.

    A table whose name begins with another deployment's name belongs to that deployment.
    """
    found = []
    for path in sorted(deployment.folder.iterdir()):
        if path.suffix not in TABLES or not path.is_file():
            continue
        try:
            table = read_table(path)
        except InputError:
            continue  # the import has reported the table
        if not table.has("time", *columns):
            continue
        if "glider" in table.texts:
            mine = {str(word).lower() for word in table.texts["glider"]}
            if deployment.name.lower() not in mine:
                continue
        time = table.columns["time"]
        if time.size and time.max() >= deployment.starts[0] and time.min() <= deployment.ends[-1]:
            found.append(table)
    return found


def at_times(clock: Array, values: Array, times: Array) -> Array:
    """Interpolate values from a clock to other times; NaN outside the clock."""
    return np.interp(times, clock, values, left=np.nan, right=np.nan)
