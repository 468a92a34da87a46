"""Trees: folders compared byte for byte, and modules written for a test."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import uuid
from collections.abc import Callable
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


def own_module(folder: Path, text: str) -> Callable[..., str]:
    """A module of this text, older than any process; runs "from it import WORDS" and prints."""
    name = f"module_{uuid.uuid4().hex}"
    module = folder / f"{name}.py"
    module.write_text(text)
    os.utime(module, (1e9, 1e9))  # what was written after the process began is not kept
    path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])

    def run(words: str, **environment: str) -> str:
        done = subprocess.run(
            [sys.executable, "-c", f"from {name} import {words}"],
            env={**os.environ, "PYTHONPATH": path, **environment},
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        return done.stdout.strip()

    return run
