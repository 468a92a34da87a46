"""Arrived files: names and contents of the files in a source folder at one moment.

A digest covers everything that an import reads: logs, metadata files, lists of sensors, a mapping,
settings and the reader's version. If two files have the same content, the file with the shorter
name counts, so that a copy does not change the digest.
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.util
import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from factory.importing import IMPORTERS, METADATA, OF_THE_MACHINE, TABLES, Importer, sniff
from glider_twin_ops.watching.deployment_folder import AUTO, WatchedDeployment
from glider_twin_ops.watching.sources import Source, source_of
from twin import __version__
from twin.bounded import check_regular
from twin.cli import counted
from twin.errors import InputError, OddFile
from twin.lazy import resolve

FETCHED = "fetched"
"""Folder, inside the deployment's, that holds files fetched from a server"""
EMPTY = hashlib.sha256().hexdigest()
"""SHA-256 of an empty file"""
FILES, CACHE, MAPPING = "files", "cache", "mapping"
"""Subfolders of a copy. FILES: logs with their metadata. CACHE: a Slocum's lists of sensors.
MAPPING: a table's mapping"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArrivedFiles:
    """Log files of one type in a source folder, and everything else that their import reads."""

    source: Source
    kind: str
    """Type of the logs; empty where no file reveals it"""
    places: dict[str, Path]
    """Path of each file in the source, by its path in a copy"""
    sums: dict[str, str]
    """SHA-256 of each file, by its path in a copy"""
    refused: dict[str, str]
    """Reason why a file could not be read to its end, by the file's path"""
    missing: str = ""
    """Reason why nothing can be imported; empty if there are files to import"""
    reading: str = ""
    """Settings and reader's code on which the import also depends"""

    @property
    def digest(self) -> str:
        """Digest of names, contents and reading: equal digests mean equal imports."""
        files = [f"{name} {self.sums[name]}" for name in sorted(self.sums)]
        text = "\n".join([__version__, self.kind, self.reading, *files])
        return hashlib.sha256(os.fsencode(text)).hexdigest()  # names need be no UTF-8

    def copied(self, folder: Path) -> ArrivedFiles:
        """Copy all files into a folder for the reader, because files in the source may still grow.

        A file that vanished meanwhile is listed in `refused`.
        """
        sums: dict[str, str] = {}
        refused = dict(self.refused)
        for name, path in self.places.items():
            target = folder / name
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, target)
                sums[name] = _sum(target)
            except OSError as error:
                refused[path.name] = error.strerror or str(error)
        return dataclasses.replace(self, sums=sums, refused=refused)


def folder_of(deployment: WatchedDeployment) -> Path:
    """Folder of a deployment's files: the source, or the folder of files fetched from a server."""
    if "://" in deployment.source:
        return deployment.folder / FETCHED
    return deployment.place(deployment.source)


def arrived(deployment: WatchedDeployment) -> ArrivedFiles:
    """List the files that the deployment's source holds now; fetch a server's newest days first.

    If a server does not answer, the files fetched earlier stay, and `refused` names the source.

    Raises:
      InputError: the source is a file.
    """
    way = source_of(deployment.source, "" if deployment.kind == AUTO else deployment.kind)
    source, kind = folder_of(deployment), deployment.kind
    refused: dict[str, str] = {}
    if way.fetch:
        try:
            resolve(way.fetch)(deployment.source, source)
        except InputError as error:
            refused["source"] = str(error)
        except OF_THE_MACHINE:
            raise
        except Exception as error:
            refused["source"] = " ".join(f"{type(error).__name__}: {error}".split())
        kind = way.logs[0] if kind == AUTO else kind
    if source.exists() and not source.is_dir():
        raise InputError(f"source {source} is a file; name the folder in which files arrive")
    names: list[str] = []
    missing = ""
    try:
        names = _names(source, recursive=deployment.recursive)
    except OSError as error:
        missing = f"the source {source} cannot be read: {error.strerror or error}"
    kind = _kind_of(source, names) if kind == AUTO else kind
    importer = IMPORTERS[kind] if kind else None
    logs = [name for name in names if importer and importer.accepts(source / name)]
    # each content counts once, under its shortest name; every empty file stays
    every = _sums({f"{FILES}/{name}": source / name for name in logs}, refused)
    first: dict[str, str] = {}
    for name in sorted(every, key=lambda one: (len(one), one)):
        first.setdefault(every[name], name)
    sums = {name: s for name, s in sorted(every.items()) if s == EMPTY or first[s] == name}
    beside = _beside(deployment, source, names, importer)
    return ArrivedFiles(
        source=source_of(deployment.source, kind),
        kind=kind,
        places={name: source / name.removeprefix(f"{FILES}/") for name in sums} | beside,
        sums=sums | _sums(beside, refused),
        refused=refused,
        missing=missing or ("" if sums else _missing(deployment, source, names, kind)),
        reading=_reading(deployment, importer),
    )


def _missing(deployment: WatchedDeployment, source: Path, names: Sequence[str], kind: str) -> str:
    """Reason why there is nothing to import."""
    if not source.exists():
        return f"the source {source} is not there"
    if names:
        logs_of = f"{kind} logs" if kind else "logs of a kind that is known"
        return f"of {counted(len(names), 'file')} in {source} none is among {logs_of}"
    missing = f"no file has arrived in {source}"
    if not deployment.recursive and (below := _names(source, recursive=True)):
        missing += (
            f", but {counted(len(below), 'file')} in folders below it, such as "
            f"{below[0].partition('/')[0]}: name that folder as source in deployment.toml, or set "
            "recursive = true for all"
        )
    return missing


def kind_of(deployment: WatchedDeployment) -> str:
    """Type of a deployment's logs, by its settings or by the files there now; empty if unknown."""
    if deployment.kind != AUTO:
        return deployment.kind
    source = folder_of(deployment)
    return _kind_of(source, _names(source, recursive=deployment.recursive))


def _names(source: Path, *, recursive: bool) -> list[str]:
    """List the paths of files below a folder, without hidden ones, which are still being copied."""
    if not source.is_dir():
        return []
    every = source.rglob("*") if recursive else source.iterdir()
    found = [path.relative_to(source) for path in every if path.is_file()]
    return sorted(str(p) for p in found if not any(part.startswith(".") for part in p.parts))


def _kind_of(source: Path, names: Sequence[str]) -> str:
    """Type of the first file whose type is recognised; empty where none is.

    Logs of vehicles come before those of instruments that they carry.
    """
    carried = ""
    for path in (source / name for name in names):
        try:
            if path.stat().st_size and (kind := sniff(path)) is not None:
                if not IMPORTERS[kind].instrument:
                    return kind
                carried = carried or kind
        except OF_THE_MACHINE:
            raise
        except Exception:
            continue  # the type of a cut file may be hidden; another file may show it
    return carried


def _sums(places: dict[str, Path], refused: dict[str, str]) -> dict[str, str]:
    """SHA-256 of each readable file; `refused` gets the reason for each other file."""
    sums = {}
    for name, path in places.items():
        try:
            check_regular(path)
            sums[name] = _sum(path)
        except OddFile:
            continue
        except OSError as error:
            refused[name.partition("/")[2]] = error.strerror or str(error)
    return sums


def _sum(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _beside(
    deployment: WatchedDeployment, source: Path, names: Sequence[str], importer: Importer | None
) -> dict[str, Path]:
    """Files that an import reads beside the logs, by their paths in a copy."""
    if importer is None:
        return {}
    said = {*METADATA, *importer.beside}
    found = {f"{FILES}/{name}": source / name for name in names if Path(name).name in said}
    if importer.takes_mapping and deployment.mapping:
        path = deployment.place(deployment.mapping)
        found |= {f"{MAPPING}/{path.name}": path} if path.is_file() else {}
    if importer.takes_cache and deployment.cache:
        lists = (p for p in sorted(deployment.place(deployment.cache).iterdir()) if p.is_file())
        own = importer.suffixes - TABLES
        found |= {f"{CACHE}/{p.name}": p for p in lists if p.suffix.lower() in own}
    return found


def _reading(deployment: WatchedDeployment, importer: Importer | None) -> str:
    """Settings that change an import, and a hash of the reader's code where a plugin brings it."""
    parts = [f"recursive {deployment.recursive} variation {deployment.variation_deg}"]
    if importer is None:
        return parts[0]
    if importer.takes_mapping and not deployment.place(deployment.mapping).is_file():
        parts.append(f"mapping {deployment.mapping}")  # the name of a shipped mapping
    if importer.takes_cache:
        parts.append(f"cache {bool(deployment.cache)}")
    read = importer.read
    module = read.partition(":")[0] if isinstance(read, str) else read.__module__
    if not module.startswith("factory."):
        spec = importlib.util.find_spec(module)
        parts.append(_sum(Path(spec.origin)) if spec and spec.origin else module)
    return " ".join(parts)
