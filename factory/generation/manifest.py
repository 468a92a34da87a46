"""Manifest: the record of a finished unit of work, so that it is neither repeated nor mistaken.

A unit is a block or a shard. Its manifest names the recipe, the files with their checksums, the
failed attempts and the versions of the libraries. It is written last, when the files are on the
disk. A unit that two processes do at once is the same bytes twice.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
from collections.abc import Mapping
from typing import Any

from factory.generation.site import Site
from twin.errors import StoreError
from twin.records.files import Files, FileSum

_DIGEST = "digest"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Manifest:
    """What one unit has made."""

    unit: str
    """such as "block 12" """
    recipe: str
    """hash of the recipe"""
    first: int
    last: int
    """missions of the unit, both included"""
    files: Mapping[str, FileSum]
    """by key"""
    failures: int
    """attempts that failed and were replaced"""
    versions: Mapping[str, str]
    """of what can change a bit of a result"""

    @property
    def missions(self) -> range:
        """The missions of the unit."""
        return range(self.first, self.last + 1)

    def to_bytes(self) -> bytes:
        """As it is kept; the last entry is the SHA-256 of the others."""
        table = dataclasses.asdict(self)
        return _text({**table, _DIGEST: hashlib.sha256(_text(table)).hexdigest()})


def read_manifest(files: Files, key: str, *, unit: str, recipe: str) -> Manifest | None:
    """The manifest of a unit; None when there is none, or a damaged one: the unit is done again.

    Raises:
      StoreError: it is that of another recipe.
    """
    try:
        table: dict[str, Any] = json.loads(files.read_small(key))
        digest = table.pop(_DIGEST)
        if digest != hashlib.sha256(_text(table)).hexdigest():
            return None
        sums = {name: FileSum(**entry) for name, entry in table["files"].items()}
        found = Manifest(**{**table, "files": sums})
    except (FileNotFoundError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    if found.recipe != recipe or found.unit != unit:
        raise StoreError(
            f"{files.name}/{key} is of {found.unit} of recipe {found.recipe[:12]}, expected is "
            f"{unit} of recipe {recipe[:12]}: remove that folder, or use another --out"
        )
    return found


def missions_kept(site: Site) -> int:
    """Missions in finished blocks and shards, by their manifests."""
    spans: list[tuple[int, int]] = []
    for key in site.files.all_keys():
        if key.startswith(("blocks/", "shards/")) and key.endswith(".json"):
            with contextlib.suppress(
                OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError
            ):
                table = json.loads(site.files.read_small(key))
                spans.append((int(table["first"]), int(table["last"])))
    kept, end = 0, -1
    for first, last in sorted(spans):  # a shard's blocks may be there with it
        kept += max(0, last - max(first - 1, end))
        end = max(end, last)
    return kept


def all_there(files: Files, sums: Mapping[str, FileSum]) -> bool:
    """Whether every file is there with its size."""
    return all(files.size(key) == one.bytes for key, one in sums.items())


def leave_manifest(files: Files, key: str, manifest: Manifest) -> None:
    """Write the manifest of a unit whose files are written.

    Raises:
      StoreError: another process has done the unit with other bytes.
    """
    before = read_manifest(files, key, unit=manifest.unit, recipe=manifest.recipe)
    if before is not None and before.files != manifest.files:
        raise StoreError(_differ(manifest, before))
    files.settle()
    files.write(key, manifest.to_bytes())
    files.settle()


def _differ(mine: Manifest, theirs: Manifest) -> str:
    """Two processes that should have made the same bytes and did not."""
    names = sorted(mine.files.keys() | theirs.files.keys())
    name = next(n for n in names if mine.files.get(n) != theirs.files.get(n))
    sums = [m.files[name].sha256[:12] if name in m.files else "no file" for m in (theirs, mine)]
    other = ", ".join(
        f"{n} {theirs.versions.get(n)} and {mine.versions.get(n)}"
        for n in sorted(mine.versions.keys() | theirs.versions.keys())
        if mine.versions.get(n) != theirs.versions.get(n)
    )
    return (
        f"{mine.unit} was made twice with different bytes ({name}: {sums[0]} and {sums[1]}; "
        f"{other or 'by the same versions'}): the processors round differently. Make a store on "
        "one kind of machine"
    )


def _text(table: Mapping[str, Any]) -> bytes:
    return json.dumps(table, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
