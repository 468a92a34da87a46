"""Described: writers of formats that hold what the user says of the data, such as its licence."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory.exporting.base import Advance, ExportOptions, Writer
from twin.registry import imported

if TYPE_CHECKING:
    from twin.records.reader import MissionStore


def described(place: str) -> Writer:
    """The writer at `module:function`, which takes `metadata`; imported when it writes."""

    def write(
        run: MissionStore,
        missions: Sequence[int],
        folder: Path,
        advance: Advance,
        options: ExportOptions,
    ) -> list[Path]:
        from factory.exporting.metadata import metadata_for

        metadata = metadata_for(run, options.metadata)
        written: list[Path] = imported(place)(run, missions, folder, advance, metadata=metadata)
        return written

    return write
