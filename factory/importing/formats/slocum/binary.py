"""Binary files of a Slocum (.dbd, .ebd, .sbd, .tbd ...), read by dbdreader, an optional extra.

A file's header is read here first: it gives the vehicle, the cache file that lists the sensors, and
their number. A missing or wrong cache file is thus reported before anything is decoded. Compressed
files (.dcd, .ecd ...) are unpacked first. `ends_whole` tells whether a file's last cycle is
complete.
"""

from __future__ import annotations

import contextlib
import tempfile
import traceback
import warnings
from collections.abc import Collection, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from factory.importing.columns import tidy
from factory.importing.deployment_log import (
    EMPTY,
    NO_FIXES,
    TRUNCATED,
    UNREADABLE,
    Channel,
    DeploymentLog,
    each_file,
    joined,
)
from factory.importing.formats.base import ReadOptions
from factory.importing.formats.slocum.caches import (
    CacheShelf,
    is_compressed,
    read_header,
    unpacked,
    vehicle_of,
)
from factory.importing.formats.slocum.native_sensors import WANTED, slocum_log
from factory.importing.payload import payload_names
from factory.importing.tally import Tally, leave_out, note_empty, note_unread
from twin.errors import InputError
from twin.records.coordinates import utc_minute

_CYCLE = b"d"
"""Tag that begins a cycle; two bits for each sensor (2: a new value) and new values follow."""
_CLOSED = b"X"
"""Last byte of a file by older software; files by newer software end with the last cycle."""
_PREAMBLE = 16
"""[bytes] Header of the binary part: tags s and a, and three known numbers of the byte order."""
_NEW = 2


def ends_whole(data: bytes, start: int, sizes: Sequence[int], state_bytes: int) -> bool:
    """True if the file ends where a cycle ends.

    Args:
      data: the whole file.
      start: [bytes] start of its binary part.
      sizes: [bytes] of each sensor's value, in the order of the cache file.
      state_bytes: number of state bytes in each cycle.
    """
    if data.endswith(_CLOSED):
        return True
    table = np.zeros((state_bytes, 256), np.int64)
    every = np.zeros(4 * state_bytes, np.int64)
    every[: len(sizes)] = sizes[: 4 * state_bytes]
    states = np.arange(256)
    for k in range(4):
        new = (states >> (6 - 2 * k)) & 3 == _NEW
        table += np.outer(every[k::4], new)
    row = np.arange(state_bytes)
    at = start + _PREAMBLE
    while data[at : at + 1] == _CYCLE:
        if at + 1 + state_bytes > len(data):
            return False
        state = np.frombuffer(data, np.uint8, state_bytes, at + 1)
        at += 1 + state_bytes + int(table[row, state].sum())
    return at == len(data)


_CLOCKS = ("m_present_time", "sci_m_present_time")
"""Times of the flight and the science computer."""


class Decoded(NamedTuple):
    """Contents of one binary file."""

    vehicle: str
    names: tuple[str, ...]
    """Every sensor that the file can hold."""
    units: dict[str, str]
    sensors: dict[str, tuple[Any, Any]]
    """Times and values of the sensors that are read."""
    whole: bool
    """True if the file ends with a whole cycle."""


def read_slocum_binary(
    paths: Sequence[Path],
    options: ReadOptions,
    tally: Tally,
    *,
    caches: Sequence[Path],
) -> list[DeploymentLog]:
    """Make one log for each vehicle among the files; leave out and report files that fail.

    Raises:
      ModuleNotFoundError: dbdreader (GPL, an optional extra) is not installed.
      InputError: no file can be decoded: not a Slocum file, cut within its header, or without its
        own cache file. Or no file has depth or pressure.
    """
    reader = _decoder()
    wanted = (*WANTED, *payload_names(options.payload))
    pieces: dict[str, dict[str, list[Channel]]] = {}
    units: dict[str, str] = {}
    files: dict[str, list[str]] = {}
    kinds: dict[str, set[str]] = {}
    cut: set[str] = set()
    with tempfile.TemporaryDirectory() as folder:
        shelf = CacheShelf(Path(folder), options.cache, caches)
        decoded = each_file(paths, lambda path: _decoded(reader, path, shelf, wanted), tally)
    for path, one in decoded:
        own = pieces.setdefault(one.vehicle, {})
        files.setdefault(one.vehicle, []).append(path.name)
        units |= one.units
        kind = f"{path.suffix.lower()} file"
        note_unread(kind, one.names, (*_CLOCKS, *wanted), tally)
        filled = kinds.setdefault(kind, set())
        rows, last = 0, -np.inf
        for name, (time, values) in one.sensors.items():
            subject = f"{path.name} {name}" if name == "m_depth" else "binary sensors"
            column = {name: np.asarray(values, np.float64)}
            time, columns = tidy(np.asarray(time, np.float64), column, subject, tally)
            channel = Channel.finite(time, columns[name])
            own.setdefault(name, []).append(channel)
            if len(channel):
                rows, last = max(rows, len(channel)), max(last, float(channel.time[-1]))
                filled.add(name)
        tally.add("read", path.name, rows, "samples of the fullest sensor")
        if not rows:
            tally.add("note", path.name, 1, "holds no sample of a sensor that is used")
        if not one.whole:
            cut.add(path.name)
            goes = f"goes to {utc_minute(last)} UTC" if rows else "holds no sample that is used"
            tally.add("note", path.name, 1, f"{TRUNCATED}{goes}")
    for kind, filled in kinds.items():
        note_empty(kind, [n for n in wanted if n not in filled], tally)

    logs: list[DeploymentLog] = []
    refused: list[tuple[str, InputError]] = []
    for vehicle, own in pieces.items():
        try:
            logs.append(_log(vehicle, own, units, files[vehicle], cut, options, tally))
        except InputError as error:
            refused.append((vehicle, error))
    for vehicle, why in refused:
        if not logs:
            raise why
        tally.add("left out", UNREADABLE, len(files[vehicle]), str(why))
    return logs


def _log(
    vehicle: str,
    own: dict[str, list[Channel]],
    units: dict[str, str],
    files: Sequence[str],
    cut: Collection[str],
    options: ReadOptions,
    tally: Tally,
) -> DeploymentLog:
    native = {name: joined(parts) for name, parts in own.items()}
    if not any(len(native.get(n, ())) for n in ("m_depth", "m_pressure", "m_water_pressure")):
        tally.add("note", vehicle, len(files), "no flight file: depth by the CTD")
        if not len(native.get("sci_water_pressure", ())):
            some = ", ".join(files[:4])
            if set(cut) & set(files):
                raise InputError(f"{some}: truncated before the first sample of depth or pressure")
            raise InputError(
                f"{vehicle}: neither depth nor pressure in {some}; add the flight files (.dbd or "
                ".sbd)"
            )
    variation = EMPTY
    if options.variation_deg is not None:
        first = min(c.time[0] for c in native.values() if len(c))
        variation = Channel(np.array([first]), np.array([options.variation_deg]))
        if len(native.get("m_gps_mag_var", ())):
            leave_out(["m_gps_mag_var"], "the user gives the variation", tally)
    return slocum_log(
        vehicle, native, fixes=NO_FIXES, variation=variation, payload=options.payload, units=units,
        files=files, tally=tally,
    )  # fmt: skip


def _decoder() -> Any:
    """Import dbdreader. At its first import the package makes a folder in the user's home, and
    fails if another process does so at the same moment."""
    try:
        return import_module("dbdreader")
    except FileExistsError:
        return import_module("dbdreader")


@contextlib.contextmanager
def _closing() -> Iterator[None]:
    """Close files that a decoder leaves open when it raises."""
    try:
        yield
    except Exception as error:
        traceback.clear_frames(error.__traceback__)
        raise


def _decoded(reader: Any, path: Path, shelf: CacheShelf, wanted: Sequence[str]) -> Decoded:
    """Decode one file.

    Raises:
      InputError: the file cannot be decoded.
    """
    with tempfile.TemporaryDirectory() as folder:
        plain, cut = unpacked(path, Path(folder)) if is_compressed(path) else (path, False)
        header = read_header(plain, path.name)
        shelf.prepare(path, plain, header)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                with _closing():
                    file = reader.DBD(str(plain), cacheDir=str(shelf.folder))
                try:
                    names = [name for name in wanted if file.has_parameter(name)]
                    values = file.get(*names) if names else []
                finally:
                    file.close()
                whole = not cut and ends_whole(
                    plain.read_bytes(), file.fp_binary_start, file.byteSizes, file.n_state_bytes
                )
        except Exception as error:
            raise InputError(
                f"{path.name} cannot be decoded: {' '.join(str(error).split())[:160]} "
                f"({type(error).__name__})"
            ) from error
    sensors = dict(zip(names, [values] if len(names) == 1 else values, strict=True))
    # as in the vehicle's tables: unit_334 is unit334
    vehicle = vehicle_of(header, path).replace("_", "")
    return Decoded(vehicle, tuple(file.parameterNames), dict(file.parameterUnits), sensors, whole)
