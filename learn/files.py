"""Files: JSON written whole or not at all, sealed where a changed byte must be found, and output
paths checked before long work."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from twin.bounded import parse_json, read_text
from twin.errors import InputError, StoreError
from twin.records.storage.whole import whole_file

SEAL = "sha256"
"""Entry of a sealed file: the SHA-256 of its text without this entry"""
_HASH = re.compile("[0-9a-f]{64}")


def write_json(path: Path, figures: Mapping[str, Any]) -> None:
    """Write what JSON can hold so that a kill leaves the old file or the new one.

    Raises:
      WriteError: the disk refuses.
    """
    with whole_file(path) as place:
        place.write_text(_text(figures), encoding="utf-8")


def write_sealed(path: Path, figures: Mapping[str, Any]) -> None:
    """Write JSON with the SHA-256 of its own text, by which `check_seal` finds a changed byte.

    Raises:
      WriteError: the disk refuses.
    """
    plain = {name: value for name, value in figures.items() if name != SEAL}
    write_json(path, {**plain, SEAL: _sha256(_text(plain).encode())})


def check_seal(path: Path, found: Mapping[str, Any], remedy: str) -> None:
    """Make sure that a JSON file is, byte for byte, what `write_sealed` wrote.

    Args:
      found: what was read from it.
      remedy: what makes the file again, for the error.

    Raises:
      StoreError: it is not.
    """
    plain = {name: value for name, value in found.items() if name != SEAL}
    seal = _sha256(_text(plain).encode())
    if path.read_bytes() != _text({**plain, SEAL: seal}).encode():
        raise StoreError(f"{path} is damaged: its {SEAL} is not that of its text; {remedy}")


def _text(figures: Mapping[str, Any]) -> str:
    return json.dumps(figures, indent=2) + "\n"


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


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


def read_sealed(path: Path, remedy: str) -> dict[str, Any]:
    """What `write_sealed` wrote, without the seal. Files of version 0.1.0 have none and are read as
    they are.

    Args:
      remedy: what makes the file again, for the error.

    Raises:
      StoreError: it is no JSON object, or not what was written.
    """
    found = read_json(path, remedy)
    # a seal is one under a damaged name too
    if SEAL in found or any(_HASH.fullmatch(str(value)) for value in found.values()):
        check_seal(path, found, remedy)
    return {name: value for name, value in found.items() if name != SEAL}


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
