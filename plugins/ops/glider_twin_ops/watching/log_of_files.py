"""Log of files: `log.zarr`, the dives of all files that arrived, in whatever order they came.

The log equals `factory import` of the same files. All files together decide the pressure sensor,
offsets of the surface and guessed units. The store keeps a digest of its files; with an equal
digest it stays as it is.

Log, beliefs and page have lists of checksums, which show whether a part is as a pass wrote it.
`latest.json` of the page has the checksums of beliefs and events.
"""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import hashlib
import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from factory.importing import IMPORTERS, TRUNCATED, UNREADABLE, import_logs
from glider_twin_ops.watching.arrived_files import CACHE, FILES, MAPPING, ArrivedFiles, arrived
from glider_twin_ops.watching.deployment_folder import WatchedDeployment
from twin.errors import InputError, StoreError
from twin.records import is_store, read_attributes, write_store
from twin.records.attributes import DIVE_DURATION, HISTORY, IMPORT_REPORT, START_TIME
from twin.records.schema import MISSION
from twin.records.storage import clean, damaged_files, files_below, lock, remove, temporary_name

if TYPE_CHECKING:
    import xarray as xr

LOG = "log.zarr"
DIGEST = "files_digest"
"""Attribute of the store: digest of its files and of how they were read"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LogOfFiles:
    """Log of the files in a source, and the files that were left out or are cut."""

    store: Path | None
    """Path of the log; None before the first dive"""
    digest: str
    """Digest of the files that are there now"""
    changed: bool
    """True where the store was written"""
    files: int
    kind: str
    """Type of the logs; empty where no file reveals it"""
    unreadable: tuple[str, ...]
    """Reason for each file that was left out"""
    short: tuple[str, ...] = ()
    """Files that are cut, each with the extent that was read"""
    damage: str = ""
    """Damage found in the log before this pass; empty where it was whole"""
    missing: str = ""
    """Reason why the files there now give no dives; empty where they give some"""

    @property
    def cut_or_left_out(self) -> list[str]:
        """Sentences on a damaged log, files that are cut, and files that were left out."""
        damaged = [self.damage] if self.damage else []
        return [*damaged, *self.short, *(f"left out: {said}" for said in self.unreadable)]


def log_of_files(
    deployment: WatchedDeployment,
    folder: Path,
    *,
    until: datetime.datetime | None = None,
    again: bool = False,
) -> LogOfFiles:
    """Bring `folder/log.zarr` up to date.

    A source without a readable dive, such as half of its only file, leaves the store as it was. A
    damaged store is made again; until the files allow it, there is no log.

    Args:
      until: only dives that had ended by then, UTC.
      again: read the files even where the store was made of them.

    Raises:
      InputError: a setting that cannot be used. WriteError: the disk refuses.
    """
    store = folder / LOG
    found = arrived(deployment)
    stamp = "" if until is None else f" until {until.isoformat()}"
    one = damage_of(store)
    damage = f"{store.name} was damaged, and is made again: {one}" if one else ""
    if not (found.missing or again or damage) and is_store(store):
        with contextlib.suppress(StoreError):
            if read_attributes(store).get(DIGEST) == found.digest + stamp:
                return _outcome(store, found)
    if found.missing:
        return _outcome(store, found, damage, missing=found.missing)
    with _staging(store) as place:
        copies = found.copied(place)
        try:
            dataset = _imported(deployment, copies, place)
            if until is not None:
                dataset = _until(dataset, until)
        except InputError as error:
            said = " ".join(_said_here(str(error), place).split())
            return _outcome(store, copies, damage, missing=said)
    dataset.attrs[DIGEST] = copies.digest + stamp
    if damage and is_zarr(store):
        remove(store)
    write_store(dataset, store, overwrite=True)
    return _outcome(store, copies, damage, changed=True)


@contextlib.contextmanager
def _staging(store: Path) -> Iterator[Path]:
    """Make a hidden folder beside the store; first remove what a killed pass left."""
    clean(store)
    place = temporary_name(store)
    place.mkdir()
    descriptor = os.open(place, os.O_RDONLY)
    try:
        lock(descriptor)  # the next writer of the store removes it once this process is gone
        yield place
    finally:
        remove(place)
        os.close(descriptor)


def _imported(deployment: WatchedDeployment, found: ArrivedFiles, place: Path) -> xr.Dataset:
    """Import the copies in a folder into a data set without paths and without the time of import.

    Raises:
      InputError: the import's own, or a setting that is for logs of other types.
    """
    importer = IMPORTERS[found.kind]
    for name, takes in (("cache", importer.takes_cache), ("mapping", importer.takes_mapping)):
        if getattr(deployment, name) and not takes:
            raise InputError(f"{found.kind} logs take no {name}: leave it empty in deployment.toml")
    cache, copy = place / CACHE, place / MAPPING / Path(deployment.mapping).name
    cache.mkdir(exist_ok=True)
    dataset, _ = import_logs(
        found.kind,
        [place / FILES],
        cache=cache if deployment.cache else None,
        mapping=(copy if copy.is_file() else deployment.mapping) if deployment.mapping else None,
        variation_deg=None if deployment.variation_deg == "" else float(deployment.variation_deg),
        recursive=deployment.recursive,
        one_deployment=found.source.joins,
    )
    report = json.loads(dataset.attrs[IMPORT_REPORT])
    for entry in report["entries"]:
        entry["detail"] = _said_here(entry["detail"], place)
    dataset.attrs[IMPORT_REPORT] = json.dumps(report)
    dataset.attrs[HISTORY] = f"factory import {found.kind} of all files that arrived"
    return dataset


def _said_here(text: str, place: Path) -> str:
    """Rewrite an import's message: paths in the source instead of those of the copies, which change
    with each pass, and settings of the deployment instead of options of the command line."""
    folders = [(f"{place / name}/", "") for name in (FILES, CACHE, MAPPING)]
    folders += [(str(place / FILES), "source"), (str(place / CACHE), "cache")]
    for was, here in (*folders, *IN_SETTINGS):
        text = text.replace(was, here)
    return text


IN_SETTINGS = (
    ("--variation-deg", "variation_deg in deployment.toml"),
    (
        "give its folder with --cache",
        "put it beside the files or into the folder that cache in deployment.toml names",
    ),
    ("give --cache ", "name it as cache in deployment.toml: "),
    ("give --recursive", "set recursive = true in deployment.toml"),
)
"""Options of the command line in an import's messages, and the settings that replace them here"""


def _until(dataset: xr.Dataset, until: datetime.datetime) -> xr.Dataset:
    """Select the dives that had ended by a moment.

    Raises:
      InputError: no dive had ended.
    """
    lasted = np.nan_to_num(dataset[DIVE_DURATION].values) if DIVE_DURATION in dataset else 0.0
    ended = dataset[START_TIME].values + lasted  # [s] unix
    rows = np.flatnonzero(ended <= until.timestamp())
    if not rows.size:
        first = datetime.datetime.fromtimestamp(round(float(np.nanmin(ended))), datetime.UTC)
        raise InputError(
            f"no dive had ended by {until:%Y-%m-%d %H:%M} UTC; the first did {first:%Y-%m-%d %H:%M}"
        )
    return dataset.isel({MISSION: rows})


def _outcome(
    store: Path,
    found: ArrivedFiles,
    damage: str = "",
    *,
    changed: bool = False,
    missing: str = "",
) -> LogOfFiles:
    report: dict[str, Any] = {"files": [], "entries": []}
    if not missing:
        report = json.loads(read_attributes(store)[IMPORT_REPORT])
    entries = [(entry["subject"], entry["detail"]) for entry in report["entries"]]
    said = [f"{name}: {why}" for name, why in found.refused.items()]
    said += [detail for subject, detail in entries if subject == UNREADABLE]
    short = [f"{subject} is {why}" for subject, why in entries if why.startswith(TRUNCATED)]
    return LogOfFiles(
        store=None if missing and (damage or not is_store(store)) else store,
        digest=found.digest,
        changed=changed,
        files=len(report["files"]),
        kind=found.kind,
        unreadable=tuple(map(_as_text, said)),
        short=tuple(map(_as_text, short)),
        damage=damage,
        missing=_as_text(missing),
    )


def _as_text(said: str) -> str:
    """Escape bytes of a file's name that are no UTF-8, which no page can hold."""
    return said.encode(errors="backslashreplace").decode()


ZARR = re.compile(r"(.+/)?(zarr\.json|c(/\d+)*)")
"""Names of the files in a zarr store, version 3"""


def damage_of(folder: Path) -> str:
    """Describe the first file that is not as it was written; empty where all are, and without the
    folder. Files that somebody added are no damage.
    """
    if not folder.is_dir():
        return ""
    try:
        found = (str(one) for one in damaged_files(folder) if one.what != "unknown")
        return next(found, "")
    except StoreError as error:
        return str(error)


def is_zarr(folder: Path) -> bool:
    """Return whether all files in a folder are named as in a zarr store: none is a person's own."""
    return folder.is_dir() and all(
        ZARR.fullmatch(path.relative_to(folder).as_posix()) for path in files_below(folder)
    )


def content_of(path: Path) -> str:
    """SHA-256 of a file, or of all names and bytes in a folder; empty where there is neither."""
    if not path.exists():
        return ""
    found = hashlib.sha256()
    for file in [path] if path.is_file() else files_below(path):
        found.update(f"{file.relative_to(path)}\n".encode())
        found.update(file.read_bytes())
    return found.hexdigest()
