"""Arrived files: what a source folder holds at a moment, by name and content.

A digest stands for the set of files and for how they are read. The same content under two names
counts once, under the shorter name, so that a copy changes nothing.
"""

from __future__ import annotations

import dataclasses
import hashlib
import shutil
from collections.abc import Sequence
from pathlib import Path

from factory.importing import IMPORTERS, Importer, sniff
from factory.watching.deployment_folder import AUTO, WatchedDeployment
from factory.watching.sources.base import Source, source_of
from twin.bounded import check_regular
from twin.cli.text_table import counted
from twin.errors import InputError, OddFile
from twin.plugins import imported
from twin.version import __version__

BLOCK = 2**20
"""[byte] read at once"""
FETCHED = "fetched"
"""Folder in the deployment's for what a server sent"""
EMPTY = hashlib.sha256().hexdigest()
"""SHA-256 of a file without a byte"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArrivedFiles:
    """The files of one kind in a source folder."""

    source: Source
    folder: Path
    """Where they are"""
    kind: str
    """of the logs; empty: no file tells it"""
    sums: dict[str, str]
    """SHA-256 by the path from the source on, in the order of names"""
    refused: dict[str, str]
    """Why a file could not be read to its end, by its path"""
    missing: str = ""
    """Why there is nothing to import; empty where there is"""
    reading: str = ""
    """What else the import depends on"""

    @property
    def digest(self) -> str:
        """Of names, contents and how they are read: equal where the import must be equal."""
        return self.digest_of(tuple(self.sums))

    def digest_of(self, names: Sequence[str]) -> str:
        """The same of some of the files."""
        files = [f"{name} {self.sums[name]}" for name in names]
        text = "\n".join([__version__, self.kind, self.reading, *files])
        return hashlib.sha256(text.encode()).hexdigest()

    def stage(self, names: Sequence[str], folder: Path) -> None:
        """Copy files into a folder, for a reader: whoever copies them here may still write.

        Raises:
          InputError: one has changed, or gone, since it was listed.
        """
        for name in names:
            target = folder / name
            if target.exists():
                continue
            target.parent.mkdir(parents=True, exist_ok=True)
            try:
                shutil.copyfile(self.folder / name, target)
                same = _sum(target) == self.sums[name]
            except OSError as error:
                raise InputError(f"{name}: {error.strerror or error}") from error
            if not same:
                target.unlink()
                raise InputError(f"{name} is being written: it is read at the next pass")


def folder_of(deployment: WatchedDeployment) -> Path:
    """The folder that a deployment's files are in: the source, or where a server's are kept."""
    if "://" in deployment.source:
        return deployment.folder / FETCHED
    return deployment.place(deployment.source)


def arrived(deployment: WatchedDeployment) -> ArrivedFiles:
    """What is in the deployment's source now; of a server, after its newest days were fetched.

    A server that does not answer leaves what it sent before, and is among the refused.

    Raises:
      InputError: the source is a file.
    """
    way = source_of(deployment.source, "" if deployment.kind == AUTO else deployment.kind)
    source = folder_of(deployment)
    kind = deployment.kind
    sums: dict[str, str] = {}
    refused: dict[str, str] = {}
    if way.fetch:
        try:
            imported(way.fetch)(deployment.source, source)
        except InputError as error:
            refused["source"] = str(error)
        kind = way.logs[0] if kind == AUTO else kind
    if source.exists() and not source.is_dir():
        raise InputError(f"source {source} is a file; name the folder in which files arrive")
    names = _names(source, recursive=deployment.recursive)
    if kind == AUTO:
        kind = _kind_of([source / name for name in names]) or ""
    logs = [name for name in names if kind and IMPORTERS[kind].accepts(source / name)]
    for name in logs:
        try:
            check_regular(source / name)
            sums[name] = _sum(source / name)
        except OddFile:
            continue
        except OSError as error:
            refused[name] = error.strerror or str(error)
    missing = ""
    if not source.exists():
        missing = f"the source {source} is not there"
    elif not names:
        missing = f"no file has arrived in {source}"
        if not deployment.recursive and (below := _names(source, recursive=True)):
            folders = sorted({name.partition("/")[0] for name in below})
            missing += (
                f", but {counted(len(below), 'file')} in folders below it, such as {folders[0]}: "
                "name that folder as source in deployment.toml, or set recursive = true for all"
            )
    elif not sums:
        logs_of = f"{kind} logs" if kind else "logs of a kind that is known"
        missing = f"of {counted(len(names), 'file')} in {source} none is among {logs_of}"
    return ArrivedFiles(
        source=source_of(deployment.source, kind),
        folder=source,
        kind=kind,
        sums=_without_copies(sums),
        refused=refused,
        missing=missing,
        reading=_reading(deployment, IMPORTERS[kind] if kind else None),
    )


def kind_of(deployment: WatchedDeployment) -> str:
    """Kind of its logs: its settings', or what the files that are there now look like; empty where
    nothing tells."""
    if deployment.kind != AUTO:
        return deployment.kind
    source = folder_of(deployment)
    names = _names(source, recursive=deployment.recursive)
    return _kind_of([source / name for name in names]) or ""


def _names(source: Path, *, recursive: bool) -> list[str]:
    """Paths of the files below a folder; hidden ones are still being written by whoever copies."""
    if not source.is_dir():
        return []
    every = source.rglob("*") if recursive else source.iterdir()
    found = [path.relative_to(source) for path in every if path.is_file()]
    return sorted(str(p) for p in found if not any(part.startswith(".") for part in p.parts))


def _kind_of(paths: Sequence[Path]) -> str | None:
    """The kind of the first file that looks like one."""
    for path in paths:
        try:
            kind = sniff(path) if path.stat().st_size else None
        except (InputError, OSError):
            continue  # half of a file tells nothing; another one may
        if kind is not None:
            return kind
    return None


def _sum(path: Path) -> str:
    found = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(BLOCK):
            found.update(block)
    return found.hexdigest()


def _without_copies(sums: dict[str, str]) -> dict[str, str]:
    """Each content once, under its shortest name, in the order of names; empty files all."""
    kept: dict[str, str] = {}
    seen: set[str] = set()
    for name in sorted(sums, key=lambda one: (len(one), one)):
        if sums[name] == EMPTY or sums[name] not in seen:
            seen.add(sums[name])
            kept[name] = sums[name]
    return dict(sorted(kept.items()))


def _reading(deployment: WatchedDeployment, importer: Importer | None) -> str:
    """Settings and files beside the logs that change what an import makes of them."""
    parts = [f"recursive {deployment.recursive} variation {deployment.variation_deg}"]
    if importer is None:
        return parts[0]
    if importer.takes_mapping:
        path = deployment.place(deployment.mapping)
        parts.append(_sum(path) if deployment.mapping and path.is_file() else deployment.mapping)
    if importer.takes_cache and deployment.cache:
        folder = deployment.place(deployment.cache)
        caches = sorted(path for path in folder.glob("*") if path.is_file())
        parts += [f"{path.name} {_sum(path)}" for path in caches]
    return " ".join(parts)
