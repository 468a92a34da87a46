"""Command `factory export`: write a store in formats of other programs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from factory.exporting import EXPORTERS, ExportOptions
from twin.cli.console import Console, JsonOption
from twin.cli.options import StoreArgument
from twin.cli.text_table import counted
from twin.errors import InputError

CHOICES = "{" + ",".join(EXPORTERS.names()) + "}"
FORMATS = "format. " + "; ".join(f"{one.name}: {one.title}" for one in EXPORTERS.values())
FILES = ", ".join(one.name for one in EXPORTERS.values() if one.target == "file")
ENDINGS = ", ".join(one.ending for one in EXPORTERS.values())


@dataclass(frozen=True, kw_only=True)
class ExportStore(JsonOption):
    """Write a store's missions or dives in a format that other programs read.

    Example:

        factory export data/missions.zarr --to parquet --out missions.parquet
    """

    store: Annotated[StoreArgument, tyro.conf.Positional]
    """the store"""
    to: Annotated[str, tyro.conf.arg(metavar=CHOICES, help=FORMATS)]
    out: Annotated[
        Path | None,
        tyro.conf.arg(
            help=f"folder, or file for {FILES} [default: the store's name with {ENDINGS}]"
        ),
    ] = None
    overwrite: bool = False
    """replace an earlier export"""
    mission: tuple[int, ...] | None = None
    """only these missions [default: all]"""
    vehicle: str | None = None
    """og1, erddap: vehicle file from `twin identify`, or a shipped name; its flight model makes
    track, velocities and currents [default: the shipped vehicle for the log's format]"""
    metadata: Path | None = None
    """og1, erddap, data sets: YAML file in pyglider's layout with title, people, licence,
    citation, project and instruments [default: metadata.yml or deployment.yml beside the store, and
    the file that the import found beside the log]"""
    file_dir: str | None = None
    """erddap: absolute path of the files' folder on the server [default: the output folder]"""

    def run(self, console: Console) -> int:
        """Export."""
        exporter = EXPORTERS[self.to]
        if self.mission is not None:
            check_missions(self.mission)
        from factory.generation import open_exportable
        from twin.records import LogStore

        run = open_exportable(self.store)
        missions = list(range(len(run))) if self.mission is None else list(self.mission)
        what = "dive" if isinstance(run, LogStore) else "mission"
        out = self.out or exporter.default_path(self.store)
        with console.progress(total=len(missions), label="export", unit=what + "s") as progress:
            options = ExportOptions(
                vehicle=self.vehicle, metadata=self.metadata, file_dir=self.file_dir
            )
            written = exporter.export(
                run, missions, out, progress.update, options, overwrite=self.overwrite
            )
        size = sum(path.stat().st_size for path in written)
        console.say(f"wrote {counted(len(missions), what)} to {out} ({size / 1e6:.1f} MB)")
        if "vehicle" in exporter.takes and self.vehicle is None and isinstance(run, LogStore):
            from twin.identify import start_vehicle

            name = start_vehicle(self.store).name
            console.warn(
                f"track and flight terms are by the shipped vehicle {name}, not by one identified "
                "from these logs: give --vehicle what `twin identify` wrote"
            )
        console.answer(store=self.store, to=self.to, out=out, missions=missions, bytes=size)
        return 0


def check_missions(missions: Sequence[int]) -> None:
    """Raise InputError if `--mission` has no numbers, or a number twice."""
    if not missions:
        raise InputError("--mission needs a number, such as 0; leave it out to export all")
    twice = [mission for mission, count in Counter(missions).items() if count > 1]
    if twice:
        raise InputError(f"--mission names mission {twice[0]} twice; name each once")
