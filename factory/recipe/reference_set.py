"""Reference set: missions that everybody can make, with the checksum of every array."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

from twin.errors import InputError, unknown_name
from twin.vehicle.assets import asset_path, assets_folder

FOLDER = "reference"
"""Folder of the lists in `assets/`."""


@dataclass(frozen=True, kw_only=True)
class ReferenceSet:
    """A recipe and what it makes: bytes of arrays are a function of the recipe alone."""

    name: str
    """what the user types"""
    preset: str
    """of `factory generate`"""
    hours: float
    """simulated hours of all missions together"""
    seed: int
    """root of every random draw"""
    physics: int
    """version of the physics that the checksums belong to"""
    arrays: Mapping[str, str]
    """SHA-256 of each array's type, shape and values, by name, as `array_checksums` gives it"""

    def differences(self, found: Mapping[str, str]) -> dict[str, str]:
        """What is wrong with each array that is not as listed, by name; empty when all are."""
        wrong = {}
        for name in sorted(found.keys() | self.arrays.keys()):
            if name not in found:
                wrong[name] = "is missing"
            elif name not in self.arrays:
                wrong[name] = "is not listed"
            elif found[name] != self.arrays[name]:
                wrong[name] = "has other values"
        return wrong


def reference_names() -> tuple[str, ...]:
    """The sets that are shipped."""
    return tuple(sorted(path.stem for path in (assets_folder() / FOLDER).glob("*.json")))


def reference_set(name: str) -> ReferenceSet:
    """The shipped set of that name.

    Raises:
        InputError: there is none.
    """
    names = reference_names()
    if name not in names:
        raise InputError(unknown_name("reference set", name, names))
    return ReferenceSet(name=name, **json.loads(asset_path(f"{FOLDER}/{name}.json").read_text()))
