"""Exporter: what the export must know of one format, and the function that writes it."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from twin.errors import InputError

if TYPE_CHECKING:
    from twin.records.reader import MissionStore

Advance = Callable[[], object]
"""Called once for each mission or dive that is done, for a progress bar."""


def no_progress() -> None:
    """For callers that show no progress."""


Writer = Callable[["MissionStore", Sequence[int], Path, Advance], "list[Path]"]
"""Writes the chosen missions of a store to a file or into a folder; returns what it wrote.

It raises `StoreError` for data that cannot be read and `InputError` when the disk refuses.
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Exporter:
    """One format. Heavy libraries belong inside `write`: help texts show the other fields."""

    name: str
    """What the user types: `factory export STORE --to NAME`."""
    title: str
    """What is written, in a few words for help texts and documents."""
    ending: str
    """Put behind the store's name where the user names no target: `.parquet`, `-og1`. One that
    begins with a dot makes a file, another one a folder."""
    write: Writer
    """The writer."""
    extra: str | None = None
    """Extra of this project that brings the packages which writing needs."""

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[a-z][a-z0-9_-]*", self.name):
            raise InputError(
                f"exporter name {self.name!r}: use small letters, digits, - and _, such as 'og1'"
            )
        if not self.title:
            raise InputError(f"exporter {self.name!r}: title is empty; say what it writes")
        if not re.fullmatch(r"[.-][a-z0-9._-]+", self.ending):
            raise InputError(
                f"exporter {self.name!r}: ending {self.ending!r} must be like '.parquet' for a "
                "file or '-og1' for a folder"
            )
        if not callable(self.write):
            raise InputError(
                f"exporter {self.name!r}: write must be a function, not {self.write!r}"
            )

    @property
    def target(self) -> str:
        """file or folder."""
        return "file" if self.ending.startswith(".") else "folder"

    def default_path(self, store: Path) -> Path:
        """Where an export goes when the user names no target."""
        return store.with_name(store.stem + self.ending)

    def export(
        self,
        run: MissionStore,
        missions: Sequence[int],
        path: Path,
        advance: Advance = no_progress,
    ) -> list[Path]:
        """Write, after the store and the missions were checked.

        Raises:
          StoreError: no such mission, or its data cannot be read.
          InputError: a package is missing, or the disk refuses.
        """
        run.check_arrays()
        for mission in missions:
            run.check_mission(mission)
        try:
            return self.write(run, missions, path, advance)
        except ModuleNotFoundError as error:
            if self.extra is None:
                raise
            raise InputError(
                f"the {self.name} export needs the package {error.name}, which is not installed: "
                f'pip install "glider-twin[{self.extra}]"'
            ) from error
