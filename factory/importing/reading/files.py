"""Files: what the user named, expanded; and which kind of log a file looks like."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from factory.importing.reading.tally import Tally, summarise
from twin.errors import InputError

KINDS = ("slocum", "seaglider", "seaexplorer", "og1", "lrauv")
"""Formats that can be imported."""

SLOCUM_BINARY = frozenset(f".{a}{b}d" for a in "dmsent" for b in "bc")
"""Suffixes of Slocum's binary files: flight d, m, s; science e, n, t; plain b, compressed c."""
_TABLES = frozenset({".csv", ".gz", ".parquet", ".txt"})
SUFFIXES: dict[str, frozenset[str]] = {
    "slocum": SLOCUM_BINARY | _TABLES | {".cac"},
    "seaglider": _TABLES | {".nc"},
    "seaexplorer": _TABLES,
    "og1": frozenset({".nc"}),
    "lrauv": frozenset({".mat", ".nc", ".nc4", ".csv", ".gz"}),
}
"""Suffixes (lower case) that a folder is searched for."""

_MARKS: tuple[tuple[str, frozenset[str]], ...] = (
    ("slocum", frozenset({"m_depth", "m_pressure", "m_pitch", "U_dvl_ms", "og_north_m"})),
    ("slocum", frozenset({"sci_water_pressure", "m_gps_lat", "m_water_vx", "mag_var_rad"})),
    ("seaglider", frozenset({"vbd_cc", "u_ttw", "gps2_lat", "gpsE_time", "eng_pitchAng"})),
    ("seaglider", frozenset({"log_gps_lat", "sg_cal_id_str", "eng_vbdCC", "gc_st_secs"})),
    ("seaexplorer", frozenset({"NavState", "BallastPos", "PLD_REALTIMECLOCK", "NAV_RESOURCE"})),
    ("lrauv", frozenset({"EpochSeconds", "platform_pitch_angle", "latitude_fix", "time_fix"})),
    ("lrauv", frozenset({"platform_buoyancy_position", "platform_mass_position"})),
    ("og1", frozenset({"LATITUDE_GPS", "PLATFORM_SERIAL_NUMBER", "TRAJECTORY", "PHASE"})),
    ("og1", frozenset({"LATITUDE", "LONGITUDE", "PITCH", "TIME"})),
)
"""Names that tell one format from the others."""


def likely_kind(names: Iterable[str]) -> str | None:
    """The kind of log whose names these are; None when they are nobody's."""
    found = set(names)
    scores: dict[str, int] = {}
    for kind, marks in _MARKS:
        scores[kind] = scores.get(kind, 0) + len(marks & found)
    best = max(scores, key=lambda kind: scores[kind])
    return best if scores[best] else None


def wrong_kind(path: Path, names: Iterable[str], wanted: str) -> InputError:
    """The error for a file that is no log of the wanted kind; names the likely one."""
    names = list(names)
    kind = likely_kind(names)
    if kind is not None and kind != wanted:
        return InputError(
            f"{path.name} is no {wanted} log, it looks like {kind}: use `factory import {kind}`"
        )
    some = ", ".join(names[:5]) or "nothing"
    return InputError(f"{path.name} is no {wanted} log that is known here; it holds {some}")


def _is_log(kind: str, path: Path) -> bool:
    if path.suffix.lower() in SUFFIXES[kind]:
        return True
    # SeaExplorer numbers its files: sea035.12.gli.sub.36
    return kind == "seaexplorer" and bool({"gli", "pld1"} & set(path.name.lower().split(".")))


def expand(kind: str, paths: Sequence[Path], tally: Tally) -> list[Path]:
    """The files named, and those of the kind in the folders named (not in folders below).

    A file that is named twice is read once, counted.

    Raises:
      InputError: no such file, a folder without any, an unreadable or empty file.
    """
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            every = sorted(p for p in path.iterdir() if p.is_file())
            inside = [p for p in every if _is_log(kind, p)]
            if not inside:
                raise InputError(
                    f"folder {path} holds no {kind} logs ({' '.join(sorted(SUFFIXES[kind]))}); "
                    "folders below it are not searched"
                )
            others = [p.name for p in every if p not in inside]
            tally.add("left out", "files", len(others), f"of no {kind} format: {summarise(others)}")
            files += inside
        elif path.exists():
            files.append(path)
        else:
            raise InputError(f"no file {path}")
    unique = list({path.resolve(): path for path in files}.values())
    tally.add("left out", "files", len(files) - len(unique), "named twice")
    for path in unique:
        if path.stat().st_size == 0:
            raise InputError(f"{path} is empty")
        _check_container(kind, path)
    if not unique:
        raise InputError(f"no files to import; name {kind} logs or a folder that holds them")
    return unique


_CONTAINERS = (b"CDF", b"\x89HDF")
_TABLE_KINDS = frozenset({"slocum", "seaexplorer"})
"""Kinds whose logs are never netCDF or HDF5."""


def _check_container(kind: str, path: Path) -> None:
    """Refuse netCDF where tables are expected and the other way round, naming the likely kind."""
    with path.open("rb") as file:
        start = file.read(600)
    holds_arrays = start.startswith(_CONTAINERS) or start[512:516] == b"\x89HDF"
    if holds_arrays and kind in _TABLE_KINDS:
        with open_netcdf(path) as data:
            raise wrong_kind(path, [*data.variables, *data.groups], kind)
    if holds_arrays and kind == "seaglider" and path.suffix.lower() != ".nc":
        with open_netcdf(path) as data:
            names = [*data.variables, *data.groups]
        if likely_kind(names) == kind:
            raise InputError(f"{path.name} is a netCDF file: rename it to end in .nc")
        raise wrong_kind(path, names, kind)
    if kind == "og1" and path.suffix.lower() in _TABLES and not holds_arrays:
        from factory.importing.reading.columns import read_table

        table = read_table(path)
        raise wrong_kind(path, [*table.columns, *table.texts], kind)


def open_netcdf(path: Path) -> Any:
    """A netCDF or HDF5 file for reading.

    Raises:
      InputError: it is neither, or truncated.
    """
    import netCDF4

    try:
        return netCDF4.Dataset(path)
    except (OSError, RuntimeError) as error:
        with path.open("rb") as file:
            start = file.read(8)
        known = start.startswith((b"CDF", b"\x89HDF")) or b"MATLAB" in start
        why = "truncated or damaged" if known else "of another format"
        raise InputError(
            f"{path.name} cannot be opened as netCDF-4 or HDF5: {why} ({type(error).__name__})"
        ) from error
