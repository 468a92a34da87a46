"""Command `factory import`: read logs of real vehicles into a store of the factory's layout."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from factory.importing import IMPORTERS
from twin.cli.console import Console, JsonOption
from twin.cli.text_table import counted

CHOICES = "{" + ",".join(IMPORTERS.names()) + "}"
FILES = "logs, or folders of them (folders below with --recursive). " + "; ".join(
    f"{importer.name}: {importer.files.replace('`', '')}" for importer in IMPORTERS.values()
)
PERIODS = ", ".join(f"{importer.period:g} for {importer.name}" for importer in IMPORTERS.values())
CACHED = ", ".join(importer.name for importer in IMPORTERS.values() if importer.takes_cache)


@dataclass(frozen=True, kw_only=True)
class ImportLogs(JsonOption):
    """Read logs of a real vehicle, cut them into dives from GPS fix to GPS fix, and resample them
    to one time grid. Print the repairs, omissions and missing data.

    Examples:

        factory import slocum logs/*.dbd logs/*.ebd --out real.zarr
        factory import og1 deployment.nc --out real.zarr
    """

    kind: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar=CHOICES)]
    """format of the logs"""
    files: Annotated[
        tuple[Path, ...],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="FILE [FILE ...]", help=FILES, help_behavior_hint="(required)"),
    ]
    out: Path
    """the store"""
    period: Annotated[
        float | None,
        tyro.conf.arg(help=f"seconds between samples of the store [default: {PERIODS}]"),
    ] = None
    min_depth: float = 5.0
    """smallest depth in metres of a dive between two fixes"""
    variation_deg: float | None = None
    """magnetic variation, east positive [default: the log's own]"""
    cache: Annotated[
        Path | None,
        tyro.conf.arg(help=f"folder of cache files, for {CACHED} [default: beside the logs]"),
    ] = None
    mapping: Annotated[
        str | None,
        tyro.conf.arg(
            metavar="FILE|NAME",
            help="what the columns of csv tables are: a TOML file "
            "(docs/howto/import_tables.md shows one), or a shipped one by name",
        ),
    ] = None
    camera: Path | None = None
    """markers: calibration of the camera, as OpenCV writes it"""
    log: Path | None = None
    """markers: log of the vehicle in the video, of any other kind"""
    marker_side: float | None = None
    """markers: side of the black squares [m, default: 0.15]"""
    payload: tuple[str, ...] = ()
    """NAME=COLUMN or NAME=COLUMN[UNITS]: store a column as signal measured_NAME, in addition to
    known columns such as oxygen and chlorophyll"""
    doppler: tuple[Path, ...] = ()
    """PD0 files of the Doppler log that the vehicle carried: speed through the water"""
    keep_going: bool = False
    """import the readable files even if half of the files or more cannot be read"""
    recursive: bool = False
    """also search the subfolders of the given folders"""
    overwrite: bool = False
    """replace an existing store"""

    def run(self, console: Console) -> int:
        """Import, store and report."""
        from factory.importing import OTHER_KIND, TRUNCATED, UNREADABLE, DiveRules, import_logs
        from twin.errors import InputError
        from twin.records import check_target, write_store

        if not self.min_depth > 0.0:
            raise InputError(f"--min-depth must be positive, not {self.min_depth:g}")
        check_target(self.out, overwrite=self.overwrite)
        dataset, report = import_logs(
            self.kind,
            self.files,
            period=self.period,
            rules=DiveRules(min_depth=self.min_depth),
            variation_deg=self.variation_deg,
            cache=self.cache,
            mapping=self.mapping,
            camera=self.camera,
            log=self.log,
            marker_side=self.marker_side,
            payload=self.payload,
            doppler=self.doppler,
            keep_going=self.keep_going,
            recursive=self.recursive,
        )
        write_store(dataset, self.out, overwrite=self.overwrite)
        for entry in report.entries:
            if entry.action == "suspect":
                console.warn(f"{entry.subject}: {entry.detail}")
            elif entry.detail.startswith(TRUNCATED):
                console.warn(f"{entry.subject} is {entry.detail}")
            elif entry.subject in (UNREADABLE, OTHER_KIND):
                console.warn(f"left out: {entry.detail}")
        console.table(report.table(), title="what was done to the logs")
        console.pairs(
            {
                "store": str(self.out),
                "deployments": ", ".join(report.deployments),
                "rows": f"{report.rows}, {report.rows_with_fixes} from GPS fix to GPS fix",
                "time": f"{report.hours:.4g} h every {report.period:g} s",
                "signals": len(report.channels),
            },
            title="\nstore",
        )
        if report.suspect:
            console.warn(
                f"{report.suspect} of {counted(report.rows, 'row')} suspect: see `suspect` of the "
                "store, or `factory verify`"
            )
        console.answer(store=self.out, report=report.to_dict())
        return 0
