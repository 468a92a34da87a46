"""OG1.0: the OceanGliders' common format, for simulated missions and for logged deployments."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory.exporting.base import Advance, Exporter, ExportOptions
from twin.lazy import attach, places

if TYPE_CHECKING:
    from factory.exporting.og1.flight_terms import FlownTracks as FlownTracks
    from factory.exporting.og1.flight_terms import JoinedDives as JoinedDives
    from factory.exporting.og1.flight_terms import flight_terms as flight_variables  # noqa: F401
    from factory.exporting.og1.flight_terms import flown as flown
    from factory.exporting.og1.missions import corrected_places as corrected_places
    from factory.exporting.og1.variables import Og1Variable as Og1Variable
    from twin.records.reader import MissionStore


def _write(
    run: MissionStore,
    missions: Sequence[int],
    folder: Path,
    advance: Advance,
    options: ExportOptions,
) -> list[Path]:
    from factory.exporting.metadata import metadata_for
    from factory.exporting.og1.deployments import export_og1_logs
    from factory.exporting.og1.missions import export_og1
    from factory.generation.generated_store import GeneratedStore, StoredFlight
    from twin.records.logged import LogStore

    if isinstance(run, LogStore):
        metadata = metadata_for(run, options.metadata)
        return export_og1_logs(
            run, missions, folder, advance, vehicle=options.vehicle, metadata=metadata
        )
    assert isinstance(run, GeneratedStore | StoredFlight)
    written = []
    for mission in missions:
        metadata = metadata_for(run, options.metadata)
        written.append(export_og1(run, mission, folder, vehicle=options.vehicle, metadata=metadata))
        advance()
    return written


OG1 = Exporter(
    name="og1",
    title="OceanGliders OG1.0 netCDF files, one a simulated mission or one a logged deployment",
    ending="-og1",
    takes=("vehicle", "metadata"),
    write=_write,
)

__getattr__, __dir__ = attach(__name__, places(__name__))
