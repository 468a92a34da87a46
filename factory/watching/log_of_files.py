"""Log of files: the dives of all files that arrived, as `log.zarr`, a function of the files alone.

Only files that are new or have changed are read, with their neighbours in time. The store knows by
which files it was made; with the same ones it stays as it is.
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

from factory.importing import IMPORTERS, TRUNCATED, UNREADABLE, DiveRules, ReadOptions
from factory.importing.dives.dive_store import WANTED, dataset_of_rows, tell_lacking
from factory.importing.tally import summarise
from factory.watching.deployment_folder import WatchedDeployment
from factory.watching.kept_parcels import KeptParcels, ParcelRows
from factory.watching.sources.arrived_files import ArrivedFiles, arrived
from twin.errors import InputError, StoreError
from twin.records.attributes import (
    DEPLOYMENT_METADATA,
    DIVE_DURATION,
    HISTORY,
    IMPORT_REPORT,
    START_TIME,
)
from twin.records.presence import is_store, read_attributes
from twin.records.schema import MISSION
from twin.records.storage.checksums import damaged_files, is_listed
from twin.records.storage.disk import lock, remove, temporary_name
from twin.records.storage.whole import clean
from twin.records.store import write_store

if TYPE_CHECKING:
    import xarray as xr

LOG = "log.zarr"
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
    kind: str
    """of the logs; empty: no file tells it"""
    unreadable: tuple[str, ...]
    """Why files were left out, in words"""
    short: tuple[str, ...] = ()
    """Files that were read and end too early, with how far they go"""
    damage: str = ""
    """What was wrong with the log that was there, in words; empty where nothing was"""
    missing: str = ""
    """Why no dives could be had of the files that are there now; empty where they could"""

    @property
    def cut_or_left_out(self) -> list[str]:
        """A log that was damaged, files that end too early, and those that are left out."""
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

    A source whose files say nothing, such as half of the only one, leaves the store as it was. A
    store that is damaged is made again.

    Args:
      until: only dives that had ended by then, UTC.
      again: read the files even where the store is of them already.

    Raises:
      InputError: a setting that cannot be used. WriteError: the disk refuses.
    """
    store = folder / LOG
    found = arrived(deployment)
    stamp = "" if until is None else f" until {until.isoformat()}"
    damage = _damage(store)
    if not (found.missing or again or damage) and _digest(store) == found.digest + stamp:
        return _outcome(store, found, changed=False)
    if found.missing:
        return _without(store, found, found.missing)
    with _staging(store) as place:
        try:
            options = _options(deployment, found.kind)
            parcels = KeptParcels(found, options, deployment.folder, place, again=again)
            dataset = _dataset(found.kind, parcels.rows())
            if until is not None:
                dataset = _until(dataset, until)
        except InputError as error:
            said = str(error).replace(str(place), str(found.folder))
            return _without(store, found, said)
    copy = json.dumps(f"{place}/")[1:-1]  # as the report's text has it
    dataset.attrs[IMPORT_REPORT] = dataset.attrs[IMPORT_REPORT].replace(copy, "")
    dataset.attrs[HISTORY] = f"factory import {found.kind} of all files that arrived"
    dataset.attrs[DIGEST] = found.digest + stamp
    if damage:
        remove(store)
    write_store(dataset, store, overwrite=True)
    return dataclasses.replace(_outcome(store, found, changed=True), damage=damage)


def _damage(store: Path) -> str:
    """What is wrong with the log that is there, in words: of one that this program wrote, and to
    which nobody has added a file."""
    if not is_listed(store):
        return ""
    one = next(damaged_files(store), None)
    return "" if one is None else f"{store.name} was damaged, and is made again: {one}"


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


def _dataset(kind: str, found: ParcelRows) -> xr.Dataset:
    """The dives of all parcels.

    Raises:
      InputError: there are none.
    """
    if not found.rows:
        raise InputError(
            f"no dive deeper than {DiveRules().min_depth:g} m and longer than "
            f"{DiveRules().min_duration:g} s in {summarise(found.files)}"
        )
    lacking = {
        name: [
            one for one in found.deployments
            if not any(name in row.signals for row in found.rows if row.deployment == one)
        ]
        for name in WANTED if name not in IMPORTERS[kind].lacks
    }  # fmt: skip
    ends = {row.deployment for row in found.rows if row.segment.end_fix is not None}
    without = {"GPS fixes": [one for one in found.deployments if one not in ends]}
    lacking = {name: names for name, names in (without | lacking).items() if names}
    tell_lacking(lacking, found.tally, by_depth=found.by_depth)
    dataset, _ = dataset_of_rows(
        found.rows, kind=kind, period=found.period, files=found.files,
        entries=found.tally.entries(), names=found.tally.named(), models=found.models,
        simulated=found.simulated,
    )  # fmt: skip
    if found.said is not None:
        dataset.attrs[DEPLOYMENT_METADATA] = found.said
    return dataset


def _options(deployment: WatchedDeployment, kind: str) -> ReadOptions:
    """How the files are read.

    Raises:
      InputError: a setting that is for logs of other kinds.
    """
    importer = IMPORTERS[kind]
    for name, takes in (("cache", importer.takes_cache), ("mapping", importer.takes_mapping)):
        if getattr(deployment, name) and not takes:
            raise InputError(f"{kind} logs take no {name}: leave it empty in deployment.toml")
    return ReadOptions(
        cache=deployment.place(deployment.cache) if deployment.cache else None,
        mapping=_mapping(deployment),
        variation_deg=None if deployment.variation_deg == "" else float(deployment.variation_deg),
    )


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


def _outcome(store: Path, found: ArrivedFiles, *, changed: bool) -> LogOfFiles:
    attributes = read_attributes(store)
    entries = json.loads(attributes[IMPORT_REPORT])["entries"]
    said = [f"{name}: {why}" for name, why in found.refused.items()]
    said += [entry["detail"] for entry in entries if entry["subject"] == UNREADABLE]
    return LogOfFiles(
        store=store,
        digest=found.digest,
        changed=changed,
        kind=found.kind,
        files=len(json.loads(attributes[IMPORT_REPORT])["files"]),
        unreadable=tuple(said),
        short=tuple(
            f"{entry['subject']} is {entry['detail']}"
            for entry in entries
            if entry["detail"].startswith(TRUNCATED)
        ),
    )


def _without(store: Path, found: ArrivedFiles, why: str) -> LogOfFiles:
    return LogOfFiles(
        store=store if is_store(store) else None,
        digest=found.digest,
        changed=False,
        kind=found.kind,
        files=0,
        unreadable=tuple(f"{name}: {reason}" for name, reason in found.refused.items()),
        missing=why,
    )
