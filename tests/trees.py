"""Trees: folders compared byte for byte."""

from __future__ import annotations

import shutil
from pathlib import Path


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of a folder, by its path in it."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def keep_compiled(package: Path) -> None:
    """Give a copy of the package `twin` what this one has compiled: its content is the same.

    Without it a copy compiles for half a minute what the other tests have long compiled.
    """
    from twin.compiled.folder import cache_root

    root = cache_root()
    if root is not None:
        shutil.copytree(root, package / "__pycache__" / "compiled")
