"""Content: hashes of stores, by which runs and calibrations know what they were made from."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

from twin.records.attributes import N_SAMPLES, SPLIT
from twin.records.files import Files
from twin.records.object_files import files_at
from twin.records.schema import TIME
from twin.records.store_path import StorePath


def store_hash(store: str | StorePath) -> str:
    """SHA-256 over the names and bytes of all files of a store that are not hidden."""
    files, digest = files_at(store), hashlib.sha256()
    for key in _shown(files):
        digest.update(key.encode())
        digest.update(files.read(key))
    return digest.hexdigest()


def content_hash(store: str | StorePath, names: Iterable[str]) -> str:
    """SHA-256 over names and bytes of the files of these arrays: what a training learned from.

    The store's own attributes are left out: they say when it was made, and the same recipe makes
    the same arrays again.
    """
    root, digest = files_at(store), hashlib.sha256()
    for name in sorted({TIME, N_SAMPLES, SPLIT, *names}):
        files = root.below(name)
        for key in _shown(files):
            digest.update(f"{name}/{key}".encode())
            digest.update(files.read(key))
    return digest.hexdigest()


def _shown(files: Files) -> list[str]:
    """Keys in the order of paths, without the hidden ones: what a killed writer left is no
    content."""
    keys = (key for key in files.all_keys() if not key.rpartition("/")[2].startswith("."))
    return sorted(keys, key=lambda key: key.split("/"))
