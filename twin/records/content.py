"""Content: hashes of stores, by which runs and calibrations know what they were made from."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

from twin.records.attributes import N_SAMPLES, SPLIT
from twin.records.schema import TIME


def store_hash(store: str | Path) -> str:
    """SHA-256 over the names and bytes of all files of a store that are not hidden."""
    root, digest = Path(store), hashlib.sha256()
    for path in _files(root):
        digest.update(str(path.relative_to(root)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def content_hash(store: str | Path, names: Iterable[str]) -> str:
    """SHA-256 over names and bytes of the files of these arrays: what a training learned from.

    The store's own attributes are left out: they say when it was made, and the same recipe makes
    the same arrays again.
    """
    digest = hashlib.sha256()
    for name in sorted({TIME, N_SAMPLES, SPLIT, *names}):
        folder = Path(store) / name
        for path in _files(folder):
            digest.update(path.relative_to(store).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _files(folder: Path) -> list[Path]:
    """Files of a folder, without the hidden ones: what a killed writer left is no content."""
    return sorted(p for p in folder.rglob("*") if p.is_file() and not p.name.startswith("."))
