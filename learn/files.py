"""Files: JSON written whole or not at all, and output paths checked before long work."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from twin.bounded import parse_json, read_text
from twin.errors import InputError, StoreError


def write_json(path: Path, figures: Mapping[str, Any]) -> None:
    """Write what JSON can hold so that a kill leaves the old file or the new one."""
    half = path.with_name(path.name + ".part")
    half.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    half.replace(path)


def read_json(path: Path, remedy: str) -> dict[str, Any]:
    """A JSON object.

    Args:
      remedy: what makes the file again, for the error.

    Raises:
      StoreError: it is no JSON object.
    """
    try:
        found = parse_json(read_text(path, "file", StoreError), str(path), StoreError)
    except StoreError as error:
        raise StoreError(f"{path} is damaged ({error}); {remedy}") from error
    if not isinstance(found, dict):
        raise StoreError(f"{path} is damaged (no JSON object); {remedy}")
    return found


def check_folder(path: Path, option: str) -> None:
    """Make sure that a folder is there and can be written to, or can be made.

    Raises:
      InputError: a file is in the way, or the place may not be written to.
    """
    place = path.absolute()
    while not place.exists() and place != place.parent:
        place = place.parent
    if not place.is_dir():
        raise InputError(f"{option} {path}: {place} is a file, not a folder; choose another place")
    if not os.access(place, os.W_OK | os.X_OK):
        raise InputError(f"{option} {path}: {place} may not be written to; choose another place")


def check_file(path: Path, option: str, *, folder: bool = False) -> None:
    """Make sure that a file can be written; with `folder` it is one of those formats that are one.

    Raises:
      InputError: as `check_folder`, or a folder is where the file shall be.
    """
    check_folder(path.parent, option)
    if path.is_dir() and not folder:
        raise InputError(f"{option} {path} is a folder; give the name of a file")
    if path.exists() and not os.access(path, os.W_OK):
        raise InputError(f"{option} {path} may not be written to; choose another name")
