"""Importer: files of one kind of vehicle in, dataset and report out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from factory.importing.dives.build import build
from factory.importing.dives.segments import Rules
from factory.importing.reading.files import KINDS, expand
from factory.importing.reading.log import Log
from factory.importing.reading.tally import ImportReport, Tally
from twin.errors import InputError, unknown_name

if TYPE_CHECKING:
    import xarray as xr

PERIODS = {"slocum": 2.0, "seaglider": 5.0, "seaexplorer": 5.0, "og1": 5.0, "lrauv": 2.0}
"""[s] Default period of the store: about half the usual spacing of the logs."""
HELD = {"seaglider": frozenset({"measured_shift", "measured_rotation"})}
"""Channels that a kind of log gives only when they change."""


def import_logs(
    kind: str,
    files: Sequence[Path | str],
    *,
    period: float | None = None,
    rules: Rules | None = None,
    variation_deg: float | None = None,
    cache: Path | None = None,
) -> tuple[xr.Dataset, ImportReport]:
    """Read logs, cut them into dives, and put these on one time grid.

    Args:
      kind: slocum, seaglider, seaexplorer, og1 or lrauv.
      files: files or folders.
      period: [s] between samples [default: `PERIODS`].
      rules: how rows are cut.
      variation_deg: [degree] magnetic variation, east positive, instead of the log's own.
      cache: folder of a Slocum's cache files [default: beside the logs].

    Raises:
      InputError: a file cannot be used; the message names it and says why.
    """
    if kind not in KINDS:
        raise InputError(unknown_name("kind of log", kind, KINDS))
    step = PERIODS[kind] if period is None else float(period)
    if not 0.05 <= step <= 120.0:
        raise InputError(f"period must be within 0.05 to 120 s, not {step:g}")
    if variation_deg is not None and not -180.0 <= variation_deg <= 180.0:
        raise InputError(f"magnetic variation must be within +-180 degree, not {variation_deg:g}")
    tally = Tally()
    paths = expand(kind, [Path(f) for f in files], tally)
    read = _reader(kind, variation_deg, cache)
    logs = read(paths, tally)
    return build(
        logs,
        kind=kind,
        period=step,
        rules=rules or Rules(),
        tally=tally,
        files=[path.name for path in paths],
        held=HELD.get(kind, frozenset()),
    )


def _reader(
    kind: str, variation_deg: float | None, cache: Path | None
) -> Callable[[list[Path], Tally], list[Log]]:
    if kind == "slocum":
        from factory.importing.formats.slocum_files import read_slocum

        return lambda paths, tally: read_slocum(
            paths, variation_deg=variation_deg, cache=cache, tally=tally
        )
    if kind == "seaglider":
        from factory.importing.formats.seaglider import read_seaglider

        return lambda paths, tally: read_seaglider(paths, variation_deg=variation_deg, tally=tally)
    if kind == "seaexplorer":
        from factory.importing.formats.seaexplorer import read_seaexplorer

        return lambda paths, tally: read_seaexplorer(
            paths, variation_deg=variation_deg, tally=tally
        )
    if kind == "og1":
        from factory.importing.formats.og1 import read_og1

        return lambda paths, tally: read_og1(paths, variation_deg=variation_deg, tally=tally)
    from factory.importing.formats.lrauv import read_lrauv

    return lambda paths, tally: read_lrauv(paths, variation_deg=variation_deg, tally=tally)
