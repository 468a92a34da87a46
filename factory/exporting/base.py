"""Base of the exporters: the class `Exporter`, which describes one format and names its writer.

`EXPORTERS` holds the exporters' names for the command line.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory import seams
from twin.errors import InputError
from twin.plugins import imported, installation
from twin.records.storage.checksums import is_listed
from twin.records.storage.store_path import StorePath, named
from twin.records.storage.whole import whole_file, whole_folder
from twin.registry import Registry

if TYPE_CHECKING:
    from twin.records.reader import MissionStore


Advance = Callable[[], object]
"""Function that is called once for each finished mission or dive, for a progress bar."""


def no_progress() -> None:
    """Do nothing: the `Advance` of callers that show no progress."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """Options that a user may give with the store; each format names the fields that it takes."""

    vehicle: str | None = None
    """file or name of the vehicle whose flight model makes tracks and velocities"""
    metadata: Path | None = None
    """YAML file with facts that logs lack: operator, purpose, instruments"""
    file_dir: str | None = None
    """folder of a server for the files; default: the folder that is written"""

    @property
    def given(self) -> list[str]:
        """Names of the options that were used."""
        return [name for name, value in vars(self).items() if value is not None]


Writer = Callable[..., "list[Path]"]
"""Function of a `MissionStore`, missions, a path, an `Advance` and, if the format `takes` any
option, `ExportOptions`.

It writes the chosen missions of the store to a file that does not exist yet, or into an empty
folder, and returns the written paths. The file or folder is the user's afterwards.

It raises `StoreError` for data that cannot be read, and `OSError` when the disk refuses.
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Exporter:
    """One format; help texts show all fields but `write`."""

    name: str
    """Name that the user types: `factory export STORE --to NAME`."""
    title: str
    """Description of the output, in a few words for help texts and documents."""
    ending: str
    """Ending after the store's name if the user names no target: `.parquet`, `-og1`. With an ending
    that begins with a dot the target is a file, else a folder."""
    write: Writer | str
    """Writer, or its place `module:function`, which is imported at the first export."""
    takes: tuple[str, ...] = ()
    """Names of `ExportOptions` that the format takes; if any, `write` has a fifth argument."""
    extra: str | None = None
    """Extra of this project, or `plugins/NAME`, with the packages that writing needs."""

    def __post_init__(self) -> None:
        why = ""
        if not re.fullmatch(r"[a-z][a-z0-9_-]*", self.name):
            raise InputError(
                f"exporter name {self.name!r}: use small letters, digits, - and _, such as 'og1'"
            )
        if not self.title:
            why = "title is empty; state what it writes"
        elif not re.fullmatch(r"[.-][a-z0-9._-]+", self.ending):
            why = (
                f"ending {self.ending!r} must be like '.parquet' for a file or '-og1' for a folder"
            )
        elif not (callable(self.write) or isinstance(self.write, str)):
            why = f"write must be a function, not {self.write!r}"
        if why:
            raise InputError(f"exporter {self.name!r}: {why}")

    @property
    def target(self) -> str:
        """Type of target: file or folder."""
        return "file" if self.ending.startswith(".") else "folder"

    def default_path(self, store: StorePath) -> Path:
        """Default target of an export: beside the store, or in the current folder if the store is
        not on this machine."""
        store = named(store) if isinstance(store, Path) else store
        name = store.stem + self.ending
        return store.with_name(name) if isinstance(store, Path) else Path(name)

    def export(
        self,
        run: MissionStore,
        missions: Sequence[int],
        path: Path,
        advance: Advance = no_progress,
        options: ExportOptions | None = None,
        *,
        overwrite: bool = False,
    ) -> list[Path]:
        """Write missions after checks of the store; the export is whole or absent.

        Args:
          overwrite: replace an earlier export, which stays until the new export is whole.

        Raises:
          StoreError: no such mission, or its data cannot be read.
          InputError: an option that the format does not take, or a package is missing.
          WriteError: something is in the way, or the disk refuses.
        """
        options = options or ExportOptions()
        for name in options.given:
            if name not in self.takes:
                raise InputError(
                    f"the {self.name} export takes no --{name.replace('_', '-')}: leave it out"
                )
        run.check_arrays()
        for mission in missions:
            run.check_mission(mission)
        options = dataclasses.replace(
            options, file_dir=str(path.absolute()) if options.file_dir is None else options.file_dir
        )
        more = (options,) if self.takes else ()
        whole = (
            whole_file(path, overwrite=overwrite)
            if self.target == "file"
            else whole_folder(path, overwrite=overwrite, ours=_is_export)
        )
        try:
            write = imported(self.write) if isinstance(self.write, str) else self.write
            with whole as place:
                written: list[Path] = write(run, missions, place, advance, *more)
        except ModuleNotFoundError as error:
            if self.extra is None:
                raise
            raise InputError(
                f"the {self.name} export needs the package {error.name}, which is not installed: "
                f"{installation(self.extra)}"
            ) from error
        return [path / one.relative_to(place) for one in written]


def _is_export(folder: Path) -> bool:
    """True if a folder is an earlier export, without any file that a user added."""
    from twin.records.presence import is_complete  # deferred: help needs no numpy

    return is_listed(folder) and not is_complete(folder)


PARQUET = Exporter(
    name="parquet",
    title="one flat Parquet table, a row for every sample",
    ending=".parquet",
    write="factory.exporting.flat_table:export_parquet",
    extra="parquet",
)
"""Exporter of a flat table, for tools without arrays."""

EXPORTERS: Registry[Exporter] = seams.EXPORTERS
"""Every format that a store can be exported to, by name."""

register = EXPORTERS.add
"""Function that adds an exporter to `EXPORTERS`."""
