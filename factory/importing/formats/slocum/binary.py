"""Reader of a Slocum's binary files (.dbd, .ebd, .sbd, .tbd ...) by dbdreader, an optional extra.

A file's header is read here first: it names the vehicle, the cache file that lists the sensors,
and how many there are, so that a missing or wrong cache file is told before anything is decoded.
"""

from __future__ import annotations

import shutil
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from factory.importing.formats.base import ReadOptions
from factory.importing.formats.slocum.file_names import CACHES
from factory.importing.formats.slocum.native_sensors import WANTED, slocum_log
from factory.importing.formats.slocum.tables import joined
from factory.importing.reading.columns import tidy
from factory.importing.reading.deployment_log import EMPTY, NO_FIXES, Channel, DeploymentLog
from factory.importing.reading.tally import Tally
from twin.errors import InputError

_HEADER_BYTES = 4000
"""The ASCII header of 14 lines fits."""
_LABEL = "dbd_label"
_NEEDED = ("full_filename", "sensor_list_crc", "total_num_sensors", "sensors_per_cycle")
_END_MARK = b"X"
"""Last byte of a file that was closed."""


def read_slocum_binary(
    paths: Sequence[Path],
    options: ReadOptions,
    tally: Tally,
    *,
    caches: Sequence[Path],
) -> list[DeploymentLog]:
    """One log for each vehicle among the files.

    Raises:
      ModuleNotFoundError: dbdreader (GPL, an optional extra) is not installed.
      InputError: a file is not a Slocum file, is cut within its header, or its
        cache file is missing or another one's.
    """
    reader = import_module("dbdreader")
    pieces: dict[str, dict[str, list[Channel]]] = {}
    files: dict[str, list[str]] = {}
    for path in paths:
        header = read_header(path)
        # the name that tables of the vehicle carry: unit_334 is unit334
        vehicle = vehicle_of(header, path).replace("_", "")
        with tempfile.TemporaryDirectory() as folder:
            # dbdreader writes into its cache folder: it gets a copy
            _gather_caches(path, header, caches, options.cache, Path(folder))
            sensors = _decode(reader, path, Path(folder))
        own = pieces.setdefault(vehicle, {})
        files.setdefault(vehicle, []).append(path.name)
        rows = 0
        for name, (time, values) in sensors.items():
            time, columns = tidy(
                np.asarray(time, np.float64),
                {name: np.asarray(values, np.float64)},
                f"{path.name} {name}" if name == "m_depth" else "binary sensors",
                tally,
            )
            there = np.isfinite(columns[name])
            own.setdefault(name, []).append(Channel(time[there], columns[name][there]))
            rows = max(rows, int(there.sum()))
        tally.add("read", path.name, rows, "samples of the fullest sensor")
        if not rows:
            tally.add("note", path.name, 1, "holds no sample of a sensor that is used")
        with path.open("rb") as file:
            file.seek(-1, 2)
            if file.read(1) != _END_MARK:
                tally.add("note", path.name, 1, "truncated: read up to where it ends")
    logs = []
    for vehicle, own in pieces.items():
        native = {name: joined(parts) for name, parts in own.items()}
        if not any(len(native.get(n, ())) for n in ("m_depth", "m_pressure", "m_water_pressure")):
            tally.add("note", vehicle, len(files[vehicle]), "no flight file: depth by the CTD")
            if not len(native.get("sci_water_pressure", ())):
                if any("truncated" in e.detail for e in tally.entries()):
                    raise InputError(
                        f"{', '.join(files[vehicle][:4])}: truncated before the first sample of "
                        "depth or pressure"
                    )
                raise InputError(
                    f"{vehicle}: neither depth nor pressure in {', '.join(files[vehicle][:4])}; "
                    "add the flight files (.dbd or .sbd)"
                )
        first = min(c.time[0] for c in native.values() if len(c))
        variation = EMPTY
        if options.variation_deg is not None:
            variation = Channel(np.array([first]), np.array([options.variation_deg]))
        logs.append(
            slocum_log(
                vehicle,
                native,
                fixes=NO_FIXES,
                variation=variation,
                files=files[vehicle],
                tally=tally,
            )
        )
    return logs


def read_header(path: Path) -> dict[str, str]:
    """The ASCII header; empty for a compressed file, whose header dbdreader unpacks.

    Raises:
      InputError: not a Slocum file, or cut within its header.
    """
    if path.suffix.lower()[2:3] == "c":
        return {}
    with path.open("rb") as file:
        start = file.read(_HEADER_BYTES)
    header: dict[str, str] = {}
    for line in start.split(b"\n"):
        key, colon, value = line.decode("latin-1").partition(":")
        if not colon or not key.strip().isidentifier():
            if not header:
                break
            continue
        header[key.strip()] = value.strip()
        if len(header) == int(header.get("num_ascii_tags") or 10**6):
            break
    if _LABEL not in header:
        raise InputError(f"{path.name} is not a Slocum binary file: its header lacks {_LABEL}")
    lacking = [key for key in _NEEDED if key not in header]
    if lacking:
        raise InputError(f"{path.name} is truncated within its header: no {lacking[0]}")
    return header


def vehicle_of(header: Mapping[str, str], path: Path) -> str:
    """Name of the vehicle: what `full_filename` says before the year."""
    full = header.get("full_filename", path.stem)
    return full.rsplit("-", 4)[0] or path.stem


def _gather_caches(
    path: Path,
    header: Mapping[str, str],
    caches: Sequence[Path],
    cache: Path | None,
    folder: Path,
) -> None:
    """Copy the cache files that `path` may need into `folder`; check the one that it names."""
    if cache is not None and not cache.is_dir():
        raise InputError(f"no folder {cache} for cache files")
    places = [cache] if cache is not None else [path.parent, *(c.parent for c in caches)]
    found: dict[str, Path] = {}
    for place in places:
        for one in sorted(place.iterdir()):
            if one.suffix.lower() in CACHES:
                found.setdefault(one.stem.lower() + one.suffix.lower(), one)
    for name, one in found.items():
        shutil.copyfile(one, folder / name)
    if not header or header.get("sensor_list_factored") == "0":
        return
    wanted = header["sensor_list_crc"].lower()
    if f"{wanted}.cac" not in found and f"{wanted}.ccc" not in found:
        others = ", ".join(sorted(found)[:4]) or "no cache file"
        raise InputError(
            f"{path.name} needs the cache file {wanted}.cac; there is {others} in "
            f"{', '.join(dict.fromkeys(str(p) for p in places))}; give its folder with --cache"
        )
    if f"{wanted}.cac" in found:
        lines = found[f"{wanted}.cac"].read_text("latin-1").split("\n")
        listed = [line.split() for line in lines if line.startswith("s:")]
        used = sum(1 for words in listed if len(words) > 1 and words[1] == "T")
        total = (int(header["total_num_sensors"]), int(header["sensors_per_cycle"]))
        if (len(listed), used) != total:
            raise InputError(
                f"cache file {wanted}.cac is not the one of {path.name}: it lists {used} of "
                f"{len(listed)} sensors, the header says {total[1]} of {total[0]}"
            )


def _decode(reader: Any, path: Path, folder: Path) -> dict[str, tuple[Any, Any]]:
    """Times and values of the wanted sensors that the file holds."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            file = reader.DBD(str(path), cacheDir=str(folder))
            try:
                names = [name for name in WANTED if file.has_parameter(name)]
                if not names:
                    return {}
                values = file.get(*names)
            finally:
                file.close()
    except Exception as error:
        raise InputError(
            f"{path.name} cannot be decoded: {' '.join(str(error).split())[:160]} "
            f"({type(error).__name__})"
        ) from error
    return dict(zip(names, [values] if len(names) == 1 else values, strict=True))
