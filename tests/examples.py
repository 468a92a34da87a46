"""Examples of the documents: run as a reader would, with their files in a folder of their own."""

from __future__ import annotations

import contextlib
import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
OWN = ROOT / "examples" / "own_types"
"""Files with a type of one's own each"""
BLOCK = re.compile(r"^```python(?: file=([\w.]+))?\n(.*?)^```", re.MULTILINE | re.DOTALL)

needs_docs = pytest.mark.skipif(
    not (ROOT / "docs").is_dir(), reason="a source distribution has no docs"
)


def blocks(page: str) -> list[tuple[str, str]]:
    """The Python examples of a page: the name of the file that each is, or "", and its text."""
    return BLOCK.findall((ROOT / page).read_text())


@contextlib.contextmanager
def own_type(name: str) -> Iterator[None]:
    """Make the files of examples/own_types importable, and forget module `name` afterwards."""
    sys.path.insert(0, str(OWN))
    importlib.invalidate_caches()
    try:
        yield
    finally:
        sys.path.remove(str(OWN))
        sys.modules.pop(name, None)


def script(name: str) -> ModuleType:
    """A program of scripts/, which is no package, as a module."""
    sys.path.insert(0, str(ROOT / "scripts"))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(ROOT / "scripts"))


def run(page: str) -> dict[str, Any]:
    """Run the examples of a page one after the other in one namespace, which is returned."""
    names: dict[str, Any] = {}
    for name, text in blocks(page):
        if not name:
            exec(compile(text, page, "exec"), names)
    return names
