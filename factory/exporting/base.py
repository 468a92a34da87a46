"""Exporter: what the export must know of one format, and the function that writes it.

Registry of the exporters: names for the command line, and writers.
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
"""Called once for each mission or dive that is done, for a progress bar."""


def no_progress() -> None:
    """For callers that show no progress."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """What a user may say beside the store; a format names the fields that it takes."""

    vehicle: str | None = None
    """file or name of the vehicle whose flight model makes tracks and velocities"""
    metadata: Path | None = None
    """YAML file with what the logs do not say: who, why, which instruments"""
    file_dir: str | None = None
    """folder of a server in which the files will lie; default the one that is written"""

    @property
    def given(self) -> list[str]:
        """Names of the options that were used."""
        return [name for name, value in vars(self).items() if value is not None]


Writer = Callable[..., "list[Path]"]
"""Takes a `MissionStore`, missions, a path, an `Advance` and, where the format `takes` any option,
`ExportOptions`.

It writes the chosen missions of the store to a file that is not there, or into an empty folder,
and returns what it wrote. File or folder become the user's when it returns.

It raises `StoreError` for data that cannot be read and `OSError` when the disk refuses.
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Exporter:
    """One format; help texts show all but `write`."""

    name: str
    """What the user types: `factory export STORE --to NAME`."""
    title: str
    """What is written, in a few words for help texts and documents."""
    ending: str
    """Put behind the store's name where the user names no target: `.parquet`, `-og1`. One that
    begins with a dot makes a file, another one a folder."""
    write: Writer | str
    """The writer, or its place `module:function`, which is imported when it writes."""
    takes: tuple[str, ...] = ()
    """Names of the `ExportOptions` that it takes; with any, they are `write`'s fifth argument."""
    extra: str | None = None
    """Extra of this project, or `plugins/NAME`, with the packages which writing needs."""

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
        """file or folder."""
        return "file" if self.ending.startswith(".") else "folder"

    def default_path(self, store: StorePath) -> Path:
        """Where an export goes when the user names no target: beside the store, or into the current
        folder where the store is not on this machine."""
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
        """Write, after the store and the missions were checked; whole or not at all.

        Args:
          overwrite: take the place of an earlier export, which stays until the new one is whole.

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
    """Whether a folder is an earlier export, without anything that a user put beside it."""
    from twin.records.presence import is_complete  # numpy, which help texts do without

    return is_listed(folder) and not is_complete(folder)


PARQUET = Exporter(
    name="parquet",
    title="one flat Parquet table, a row for every sample",
    ending=".parquet",
    write="factory.exporting.flat_table:export_parquet",
    extra="parquet",
)
"""For tools that know no arrays."""

EXPORTERS: Registry[Exporter] = seams.EXPORTERS
"""Every format that a store can be exported to, by name."""

register = EXPORTERS.add
"""Add an exporter of one's own."""
