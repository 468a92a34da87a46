"""Given files: folders are replaced by the logs in them, and unusable files are refused."""

from __future__ import annotations

import filecmp
from collections.abc import Sequence
from pathlib import Path

from factory.importing.columns import column_names
from factory.importing.deployment_log import each_file
from factory.importing.formats.base import (
    ARRAYS,
    IMPORTERS,
    TABLES,
    Importer,
    NeedsPlugin,
    WrongFormat,
    check_plugin,
    kind_that_takes,
    kinds_by_bytes,
    likely_kinds,
    sniff,
    takes,
)
from factory.importing.netcdf import holds_arrays, variable_names
from factory.importing.tally import Tally, summarise
from twin.bounded import check_regular
from twin.errors import InputError
from twin.records.storage.checksums import LIST
from twin.records.storage.sharded import METADATA
from twin.records.storage.store_path import check_addresses


def expand(
    importer: Importer, paths: Sequence[Path], tally: Tally, *, recursive: bool = False
) -> list[Path]:
    """List the named files, and the type's files in the named folders; in folders below on request.

    A file that is named twice is read once, counted. Unreadable files, and another type's files in
    a folder, are left out and reported.

    Raises:
      InputError: no such file, a folder without logs, or no file that can be read.
      WrongFormat: a named file is of another type by the names in it, or all files are.
    """
    check_addresses(paths)
    files: list[Path] = []
    named: set[Path] = set()
    for path in paths:
        if path.is_dir():
            files += _inside(importer, path, tally, recursive)
        elif path.exists():
            files.append(path)
            named.add(path)
        else:
            raise InputError(f"no file {path}")
    unique = list({path.resolve(): path for path in files}.values())
    tally.add("left out", "files", len(files) - len(unique), "named twice")
    logs = [path for path in unique if path.name != LIST]
    why = f"no log: an export's list of checksums, {LIST}"
    tally.add("left out", "files", len(unique) - len(logs), why)
    logs = _without_copies(logs, tally)
    if not logs:
        raise InputError(
            f"no files to import; name {importer.name} logs or a folder that holds them"
        )
    wrong: list[Path] = []

    def check(path: Path) -> None:
        try:
            size = check_regular(path)
        except OSError as error:
            raise InputError(f"{path} cannot be read: {error.strerror}") from error
        if size == 0:
            raise InputError(f"{path} is empty")
        if _is_web_page(path):
            raise InputError(
                f"{path} is a web page (HTML) and no log: fetch the file that the page offers"
            )
        try:
            _check_contents(importer, path)
        except WrongFormat:
            if path in named:
                wrong.append(path)
            raise

    usable = [path for path, _ in each_file(logs, check, tally)]
    if wrong:
        _check_contents(importer, wrong[0])
    return usable


WEB_PAGE = (b"<!doctype html", b"<html")
"""First bytes of web pages, in small letters."""


def _is_web_page(path: Path) -> bool:
    """True if the file is a web page, such as a login page, in place of a log."""
    with path.open("rb") as file:
        return file.read(256).lstrip(b"\xef\xbb\xbf \t\r\n").lower().startswith(WEB_PAGE)


def _without_copies(paths: list[Path], tally: Tally) -> list[Path]:
    """Leave out files with the name and the bytes of an earlier file; count them."""
    seen: dict[tuple[str, int], list[Path]] = {}
    kept = []
    for path in paths:
        size = path.stat().st_size
        alike = seen.setdefault((path.name, size), [])
        try:
            copy = size > 0 and any(filecmp.cmp(path, one, shallow=False) for one in alike)
        except OSError:
            copy = False  # the check that follows reports why
        if copy:
            tally.add("left out", "files", 1, f"a copy of another one: {path.name}")
        else:
            alike.append(path)
            kept.append(path)
    return kept


def _inside(importer: Importer, folder: Path, tally: Tally, recursive: bool) -> list[Path]:
    """Logs in a folder; other files in it are counted."""
    every = sorted(p for p in (folder.rglob("*") if recursive else folder.iterdir()) if p.is_file())
    inside = [path for path in every if importer.accepts(path)]
    if not inside and (folder / METADATA).exists():
        raise InputError(f"{folder} is a store already; name the logs that it was made of")
    if not inside:
        endings = " ".join(sorted(importer.suffixes))
        raise InputError(
            f"folder {folder} holds no {importer.name} logs ({endings})"
            f"{'' if recursive else _hint_below(importer, folder)}{_hint_kind(every)}"
        )
    others = [p.name for p in every if p not in inside and p.name not in importer.beside]
    tally.add("left out", "files", len(others), f"no {importer.name} logs: {summarise(others)}")
    return inside


def _hint_below(importer: Importer, folder: Path) -> str:
    """Hint for an error: folders below that hold such logs, some of them by name."""
    holding = sorted({path.parent for path in folder.rglob("*") if importer.accepts(path)})
    if not holding:
        return ", nor do the folders below it"
    names = summarise([str(one) for one in holding], _SUGGESTED)
    return f"; {len(holding)} below it do: give --recursive, or name {names}"


_SUGGESTED = 3
"""Largest number of folders that an error names."""


def _hint_kind(files: Sequence[Path]) -> str:
    """Hint for an error: the type of the first file that looks like a log."""
    for path in files:
        try:
            kind = sniff(path) if path.stat().st_size else None
        except NeedsPlugin as error:
            return f"; {error}"
        except (InputError, OSError):
            continue  # an unreadable file gives no hint
        if kind is not None:
            return f"; {path.name} looks like {kind}: use `factory import {kind}`"
    return ""


def _check_contents(importer: Importer, path: Path) -> None:
    """Refuse a file in a container that the type never uses, or with the names of another type.

    A file that is neither a table nor netCDF is the vehicle's own binary file. Its first bytes show
    its type, or its reader judges it.
    """
    begins = kinds_by_bytes(path)
    if begins:
        if importer.name not in begins:
            raise WrongFormat(path, (), kind=begins[0])
        return
    check_plugin(path)
    if holds_arrays(path):
        names, endings = variable_names(path), ARRAYS
    elif path.suffix.lower() in TABLES:
        names, endings = column_names(path), TABLES
    else:
        return
    if importer.takes_mapping and endings is TABLES and importer.suffixes & TABLES:
        return  # the mapping gives the meaning of its columns
    if not importer.suffixes & endings:
        raise WrongFormat(path, names)
    own = len(importer.marks & set(names))
    likely = likely_kinds(names)
    if likely and importer.name != likely[0]:
        others = [n for n in IMPORTERS.names() if len(IMPORTERS[n].marks & set(names)) <= own]
    elif own or importer.takes_mapping or endings is TABLES or takes(importer, path):
        return
    else:  # no name in the file marks a single type
        others = [importer.name]
    kind = kind_that_takes(path, names, arrays=endings is ARRAYS, others=others)
    if kind is not None:
        raise WrongFormat(path, names, kind=kind)
