"""Log of files: the dives of all files that arrived, as `log.zarr`, a function of the files alone.

All files are read again when one of them is new or has changed: a dive may lie in several files,
and a log's clock, signs and offsets are told by all of it. The store knows by which files it was
made; with the same ones it stays as it is.
"""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from factory.importing import import_logs
from factory.importing.deployment_log import UNREADABLE
from factory.watching.arrived_files import arrived
from factory.watching.deployment_folder import WatchedDeployment
from twin.errors import InputError, StoreError
from twin.records.attributes import DIVE_DURATION, HISTORY, IMPORT_REPORT, START_TIME
from twin.records.presence import is_store, read_attributes
from twin.records.schema import MISSION
from twin.records.storage.disk import lock, remove, temporary_name
from twin.records.storage.whole import clean
from twin.records.store import write_store

if TYPE_CHECKING:
    import xarray as xr

LOG = "log.zarr"
IN_SETTINGS = "--variation-deg", "variation_deg in deployment.toml"
"""What an import's message calls an option, and what it is here"""
DIGEST = "files_digest"
"""Attribute of the store: which files made it, and how they were read"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LogOfFiles:
    """What became of the files in a source."""

    store: Path | None
    """None: there are no dives yet"""
    digest: str
    """Of the files that are there now"""
    changed: bool
    """Whether the store was written"""
    files: int
    unreadable: tuple[str, ...]
    """Why files were left out, in words"""
    missing: str = ""
    """Why no dives could be had of the files that are there now; empty where they could"""


def log_of_files(
    deployment: WatchedDeployment,
    folder: Path,
    *,
    until: datetime.datetime | None = None,
    again: bool = False,
) -> LogOfFiles:
    """Bring `folder/log.zarr` up to date.

    A source whose files say nothing, such as half of the only one, leaves the store as it was.

    Args:
      until: only dives that had ended by then, UTC.
      again: read the files even where the store is of them already.

    Raises:
      InputError: a setting that cannot be used. WriteError: the disk refuses.
    """
    store = folder / LOG
    found = arrived(deployment)
    stamp = "" if until is None else f" until {until.isoformat()}"
    if not found.missing and not again and _digest(store) == found.digest + stamp:
        return _outcome(store, found.digest, changed=False, refused=found.refused)
    if found.missing:
        return _without(store, found.digest, found.missing, found.refused)
    with _staging(store) as place:
        staged = found.stage(place)
        try:
            dataset = _imported(deployment, staged.kind, place)
            if until is not None:
                dataset = _until(dataset, until)
        except InputError as error:
            said = str(error).replace(str(place), str(found.source)).replace(*IN_SETTINGS)
            return _without(store, staged.digest, said, staged.refused)
    copy = json.dumps(f"{place}/")[1:-1]  # as the report's text has it
    dataset.attrs[IMPORT_REPORT] = dataset.attrs[IMPORT_REPORT].replace(copy, "")
    dataset.attrs[HISTORY] = f"factory import {staged.kind} of all files that arrived"
    dataset.attrs[DIGEST] = staged.digest + stamp
    write_store(dataset, store, overwrite=True)
    return _outcome(store, staged.digest, changed=True, refused=staged.refused)


@contextlib.contextmanager
def _staging(store: Path) -> Iterator[Path]:
    """A hidden folder beside the store; what a killed pass left goes away first."""
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


def _imported(deployment: WatchedDeployment, kind: str, place: Path) -> xr.Dataset:
    dataset, _ = import_logs(
        kind,
        [place],
        cache=deployment.place(deployment.cache) if deployment.cache else None,
        mapping=_mapping(deployment),
        variation_deg=None if deployment.variation_deg == "" else float(deployment.variation_deg),
        recursive=True,
    )
    return dataset


def _mapping(deployment: WatchedDeployment) -> Path | str | None:
    """A file in or beside the folder, or the name of a shipped one."""
    path = deployment.place(deployment.mapping)
    if not deployment.mapping:
        return None
    return path if path.is_file() else deployment.mapping


def _until(dataset: xr.Dataset, until: datetime.datetime) -> xr.Dataset:
    """The dives that had ended.

    Raises:
      InputError: none had.
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


def _digest(store: Path) -> str:
    try:
        return str(read_attributes(store).get(DIGEST, "")) if is_store(store) else ""
    except StoreError:
        return ""


def _outcome(store: Path, digest: str, *, changed: bool, refused: dict[str, str]) -> LogOfFiles:
    attributes = read_attributes(store)
    entries = json.loads(attributes[IMPORT_REPORT])["entries"]
    said = [f"{name}: {why}" for name, why in refused.items()]
    said += [entry["detail"] for entry in entries if entry["subject"] == UNREADABLE]
    return LogOfFiles(
        store=store,
        digest=digest,
        changed=changed,
        files=len(json.loads(attributes[IMPORT_REPORT])["files"]),
        unreadable=tuple(said),
    )


def _without(store: Path, digest: str, why: str, refused: dict[str, str]) -> LogOfFiles:
    return LogOfFiles(
        store=store if is_store(store) else None,
        digest=digest,
        changed=False,
        files=0,
        unreadable=tuple(f"{name}: {reason}" for name, reason in refused.items()),
        missing=why,
    )
