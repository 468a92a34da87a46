"""Made parts: whether a part of a deployment's folder is as a pass wrote it.

Log, beliefs and page have lists of checksums; the page's figures have the sums of what has none.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from twin.errors import StoreError
from twin.records.storage import damaged_files, files_below

ZARR = re.compile(r"(.+/)?(zarr\.json|c(/\d+)*)")
"""Names of the files in a zarr store, version 3"""


def damage_of(folder: Path) -> str:
    """The first file that is not as it was written, in words; empty where all are, and where there
    is no such folder. Files that somebody added are no damage.
    """
    if not folder.is_dir():
        return ""
    try:
        found = (str(one) for one in damaged_files(folder) if one.what != "unknown")
        return next(found, "")
    except StoreError as error:
        return str(error)


def is_zarr(folder: Path) -> bool:
    """Whether all files in a folder have the names of a zarr store's: none is a person's own."""
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
