"""Accounts of imports: counts, checks of the store, and its times and fixes compared with the raw
files, which are read here without the importers.

    python -m benchmarks.real_logs.accounts slocum:FOLDER slocum:FOLDER+CACHES seaglider:FOLDER ...
"""

from __future__ import annotations

import contextlib
import dataclasses
import sys
import tempfile
import warnings
from collections.abc import Iterable, Sequence
from json import dumps
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import command
from factory.importing import import_logs
from factory.soundness import verify_logs
from twin.errors import InputError
from twin.geodesy import offset
from twin.records.logged import LogStore
from twin.records.store import write_store

Array = NDArray[np.float64]

SAME_TIME = 1e-3
"""[s] Largest time difference between a fix of the store and the same fix of the file"""


@dataclasses.dataclass(frozen=True)
class Raw:
    """Times and fixes of the raw files."""

    times: Array
    """[s] Unix time of every row"""
    fixes: Array
    """Unix time [s], latitude, longitude [degree], shape (fixes, 3)."""


Account = dict[str, Any]
"""Account of one import: counts and largest differences from the raw files; or `refused` only"""


def raw_slocum(paths: Sequence[Path], caches: Path) -> Raw:
    """Read Slocum files by dbdreader; lz4 unpacks cut compressed files, which dbdreader refuses."""
    import dbdreader

    times, fixes = [np.zeros(0)], [np.zeros((0, 3))]
    for path in paths:
        if path.suffix.lower() in (".cac", ".ccc"):
            continue
        plain = path
        if path.suffix.lower()[2:] == "cd":
            plain = Path(tempfile.mkdtemp()) / f"{path.stem}.{path.suffix[1]}bd"
            plain.write_bytes(whole_blocks(path.read_bytes()))
        try:
            file = dbdreader.DBD(str(plain), cacheDir=str(caches))
        except Exception:  # the import also refuses and counts files that cannot be opened
            continue
        with np.errstate(all="ignore"), contextlib.suppress(dbdreader.DbdError):  # a cut file
            for name in ("m_depth", "m_pressure", "m_water_pressure", "sci_water_pressure"):
                if file.has_parameter(name):
                    times.append(file.get(name)[0])
            if file.has_parameter("m_gps_lat"):
                latitude, longitude = file.get("m_gps_lat"), file.get("m_gps_lon")
                _, a, b = np.intersect1d(latitude[0], longitude[0], return_indices=True)
                fixes.append(np.stack([latitude[0][a], latitude[1][a], longitude[1][b]], axis=1))
        file.close()
    return Raw(np.unique(np.concatenate(times)), np.concatenate(fixes))


def whole_blocks(packed: bytes) -> bytes:
    """Unpack the blocks of a compressed file before the first cut block."""
    import lz4.block

    plain, at = bytearray(), 0
    while at + 2 <= len(packed):
        size = int.from_bytes(packed[at : at + 2], "big")
        try:
            plain += lz4.block.decompress(packed[at + 2 : at + 2 + size], uncompressed_size=1 << 15)
        except lz4.block.LZ4BlockError:
            break
        at += 2 + size
    return bytes(plain)


def raw_arrays(paths: Sequence[Path], kind: str) -> Raw:
    """Read Seaglider, OG1, NGDAC or LRAUV files by netCDF4."""
    import netCDF4

    times, fixes = [np.zeros(0)], [np.zeros((0, 3))]
    for path in paths:
        with netCDF4.Dataset(path) as file:
            if kind == "lrauv":
                days = {
                    n: np.ravel(g["time"][:])
                    for n, g in file.groups.items()
                    if {"time", "value"} <= set(g.variables)
                }
                unix = {n: (day - 719529.0) * 86400.0 for n, day in days.items()}
                times.append(unix["depth"])
                latitude, longitude = (
                    np.ravel(file[f"{axis}_fix"]["value"][:]) for axis in ("latitude", "longitude")
                )
                count = min(len(latitude), len(longitude))
                fix = [unix["latitude_fix"][:count], latitude[:count], longitude[:count]]
                if np.max(np.abs(fix[1])) < 2.0:  # radian
                    fix[1:] = [np.degrees(one) for one in fix[1:]]
            else:
                names = {
                    "seaglider": ("time", "log_gps_time", "log_gps_lat", "log_gps_lon"),
                    "og1": ("TIME", "TIME_GPS", "LATITUDE_GPS", "LONGITUDE_GPS"),
                    "ngdac": ("time", "time", "m_gps_lat", "m_gps_lon"),
                }[kind]
                clock = file[names[0]]
                unit = str(getattr(clock, "units", "seconds since 1970-01-01"))
                zero = 631152000.0 if "1990" in unit else 0.0
                own = _plain(clock) + zero
                times.append(own)
                if not all(n in file.variables for n in names[2:]):
                    continue
                when = own
                if names[1] in file.variables and names[1] != names[0]:
                    gps = _plain(file[names[1]])
                    gps = np.where(np.abs(gps) > 1e17, gps * 1e-9, gps)
                    when = gps if np.isfinite(gps).any() else own
                fix = [when, *(_plain(file[name]) for name in names[2:])]
            if kind == "ngdac" and np.nanmax(np.abs(fix[1])) > 90.0:  # ddmm.mmm
                fix[1:] = [np.trunc(one / 100.0) + np.fmod(one, 100.0) / 60.0 for one in fix[1:]]
            fixes.append(np.stack([np.asarray(one, float) for one in fix], axis=1))
    every = np.concatenate(fixes)
    return Raw(np.unique(np.concatenate(times)), every[np.isfinite(every).all(axis=1)])


def _plain(variable: Any) -> Array:
    return np.ma.filled(np.ma.asarray(variable[:], float), np.nan)


def raw_seaexplorer(paths: Sequence[Path]) -> Raw:
    """Read SeaExplorer files by pandas."""
    import pandas as pd

    times, fixes = [np.zeros(0)], [np.zeros((0, 3))]
    for path in paths:
        try:
            packed = "gzip" if path.suffix == ".gz" else None
            table = pd.read_csv(path, sep=";", compression=packed, on_bad_lines="skip")
            if "Timestamp" not in table:
                table = pd.read_csv(path, sep=",", compression=packed, on_bad_lines="skip")
        except (OSError, ValueError, EOFError):
            continue
        if "Timestamp" not in table or "Lat" not in table:
            continue
        moments = pd.to_datetime(table["Timestamp"], format="%d/%m/%Y %H:%M:%S", errors="coerce")
        unix = (moments - pd.Timestamp("1970-01-01")).dt.total_seconds().to_numpy(float)
        times.append(unix[np.isfinite(unix)])
        degrees = []
        for name in ("Lat", "Lon"):
            written = pd.to_numeric(table[name], errors="coerce").to_numpy(float)
            whole = np.trunc(written / 100.0)
            degrees.append(whole + (written - 100.0 * whole) / 60.0)
        fixes.append(np.stack([unix, *degrees], axis=1))
    return Raw(np.unique(np.concatenate(times)), np.concatenate(fixes))


def account(kind: str, folder: Path, caches: Path | None) -> Account:
    """Import a folder, check the store, and compare it with the raw files."""
    files = sorted(p for p in folder.iterdir() if p.is_file()) if folder.is_dir() else [folder]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            dataset, report = import_logs(
                kind, [folder], cache=caches if kind == "slocum" else None
            )
            with tempfile.TemporaryDirectory() as there:
                store = write_store(dataset, Path(there) / "log.zarr")
                checked = verify_logs(LogStore(store))
    except InputError as error:
        return {"log": folder.name, "kind": kind, "refused": str(error)}
    read = [p for p in files if p.name in report.files]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if kind == "slocum":
            raw = raw_slocum(read, caches or folder)
        elif kind == "seaexplorer":
            raw = raw_seaexplorer(read)
        else:
            raw = raw_arrays(read, kind)
    counts = dict.fromkeys(("read", "left out", "not read", "missing"), 0)
    for states in report.names.values():
        for state, names in states.items():
            counts[state] += len(names)
    fix_error, compared = fixes_apart(dataset, raw)
    return {
        "log": folder.name, "kind": kind, "deployments": ", ".join(report.deployments),
        "rows": report.rows, "with_fixes": report.rows_with_fixes,
        "hours": round(report.hours, 1), "channels": len(report.channels),
        "read": counts["read"], "left_out": counts["left out"], "not_read": counts["not read"],
        "without_value": counts["missing"],
        "unreadable": report.count("left out", "unreadable file"),
        "problems": sum(len(check.problems) for check in checked.checks),
        "time_error_s": times_apart(dataset, raw), "fix_error_m": fix_error,
        "fixes_compared": compared, "refused": "",
    }  # fmt: skip


def unix_starts(dataset: Any) -> Array:
    """[s] Unix time of each row's start."""
    values = dataset["start_time"].values
    if values.dtype.kind == "M":
        values = values.astype("datetime64[ns]").astype(np.int64) / 1e9
    return np.asarray(values, float)


def times_apart(dataset: Any, raw: Raw) -> float:
    """[s] Largest difference of the store's original times of depth from the files'."""
    worst = 0.0
    for row, start in enumerate(unix_starts(dataset)):
        count = int(dataset["n_samples"][row])
        times = start + dataset["measured_depth_time"].values[row, :count].astype(float)
        at = np.clip(np.searchsorted(raw.times, times), 1, len(raw.times) - 1)
        apart = np.minimum(np.abs(raw.times[at] - times), np.abs(raw.times[at - 1] - times))
        worst = max(worst, float(apart.max()))
    return worst


def fixes_apart(dataset: Any, raw: Raw) -> tuple[float, int]:
    """[m] Largest distance of the store's fixes from the files' at equal times; number compared."""
    starts = unix_starts(dataset)
    ends = starts + dataset["dive_duration"].values
    worst, compared = float("nan"), 0
    for side, times in (("start", starts), ("end", ends)):
        for row, time in enumerate(times):
            place = [float(dataset[f"{side}_{axis}"][row]) for axis in ("latitude", "longitude")]
            if not np.isfinite(place).all():
                continue
            same = raw.fixes[np.abs(raw.fixes[:, 0] - time) < SAME_TIME]
            if not len(same):
                return float("inf"), compared
            longitude = (same[:, 2] + 180.0) % 360.0 - 180.0
            apart = np.hypot(*offset(same[:, 1], longitude, *place))
            worst = float(np.nanmax([worst, apart.min()]))
            compared += 1
    return worst, compared


def table(accounts: Iterable[Account]) -> str:
    """Table of accounts in Markdown."""
    head = (
        "log", "kind", "rows, from fix to fix", "hours", "names read, left out, not read, empty",
        "signals", "files left out", "problems", "times, s", "fixes, m (compared)",
    )  # fmt: skip
    rows = []
    for one in accounts:
        row: list[object] = [one["log"], one["kind"]]
        if one["refused"]:
            row += [f"refused: {one['refused']}", *[""] * 7]
        else:
            names = ("read", "left_out", "not_read", "without_value")
            row += [
                f"{one['rows']}, {one['with_fixes']}", f"{one['hours']:g}",
                ", ".join(str(one[name]) for name in names), one["channels"], one["unreadable"],
                one["problems"], f"{one['time_error_s']:.1g}",
                f"{one['fix_error_m']:.1g} ({one['fixes_compared']})",
            ]  # fmt: skip
        rows.append(row)
    return command.markdown(head, rows)


def main(logs: command.Positional[tuple[str, ...]], *, json: bool = False) -> None:
    """Print the accounts of the logs that are named, each KIND:FOLDER[+CACHES]."""
    found = []
    for word in logs:
        kind, _, rest = word.partition(":")
        folder, _, caches = rest.partition("+")
        found.append(account(kind, Path(folder), Path(caches) if caches else None))
    print(dumps(found, indent=1) if json else table(found))


if __name__ == "__main__":
    sys.exit(command.run(main))
