"""Files: write JSON atomically, with a checksum if a changed byte must be found, and check
output paths before long computations."""

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
"""Entry of a sealed file: SHA-256 of the file's text without this entry"""
_HASH = re.compile("[0-9a-f]{64}")


def write_json(path: Path, figures: Mapping[str, Any]) -> None:
    """Write a JSON file atomically: a kill leaves the old file or the new one.

    Raises:
      WriteError: the disk refuses.
    """
    with whole_file(path) as place:
        place.write_text(_text(figures), encoding="utf-8")


def write_sealed(path: Path, figures: Mapping[str, Any]) -> None:
    """Write a JSON file with the SHA-256 of its own text, which `check_seal` verifies.

    Raises:
      WriteError: the disk refuses.
    """
    plain = {name: value for name, value in figures.items() if name != SEAL}
    write_json(path, {**plain, SEAL: _sha256(_text(plain).encode())})


def check_seal(path: Path, found: Mapping[str, Any], remedy: str) -> None:
    """Check that a JSON file is, byte for byte, as `write_sealed` wrote it.

    Args:
      found: the object that was read from the file.
      remedy: advice for the error: how to make the file again.

    Raises:
      StoreError: the file was changed.
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
    """Read a JSON object from a file.

    Args:
      remedy: advice for the error: how to make the file again.

    Raises:
      StoreError: the file holds no JSON object.
    """
    try:
        found = parse_json(read_text(path, "file", StoreError), str(path), StoreError)
    except StoreError as error:
        raise StoreError(f"{path} is damaged ({error}); {remedy}") from error
    if not isinstance(found, dict):
        raise StoreError(f"{path} is damaged (no JSON object); {remedy}")
    return found


def read_sealed(path: Path, remedy: str) -> dict[str, Any]:
    """Read a sealed JSON file without its seal; files of version 0.1.0 have none to verify.

    Args:
      remedy: advice for the error: how to make the file again.

    Raises:
      StoreError: the file holds no JSON object, or was changed.
    """
    found = read_json(path, remedy)
    # any SHA-256 value counts as a seal: the damaged byte may be in the entry's name
    if SEAL in found or any(_HASH.fullmatch(str(value)) for value in found.values()):
        check_seal(path, found, remedy)
    return {name: value for name, value in found.items() if name != SEAL}


def check_folder(path: Path, option: str) -> None:
    """Check that a folder is writable or can be created.

    Raises:
      InputError: a file is in the way, or there is no permission to write.
    """
    place = path.absolute()
    while not place.exists() and place != place.parent:
        place = place.parent
    if not place.is_dir():
        raise InputError(f"{option} {path}: {place} is a file, not a folder; choose another place")
    if not os.access(place, os.W_OK | os.X_OK):
        raise InputError(f"{option} {path}: {place} may not be written to; choose another place")


def check_file(path: Path, option: str, *, folder: bool = False) -> None:
    """Check that a file can be written; `folder` is for formats that are folders, such as zarr.

    Raises:
      InputError: as in `check_folder`, or a folder is in the file's place.
    """
    check_folder(path.parent, option)
    if path.is_dir() and not folder:
        raise InputError(f"{option} {path} is a folder; give the name of a file")
    if path.exists() and not os.access(path, os.W_OK):
        raise InputError(f"{option} {path} may not be written to; choose another name")
