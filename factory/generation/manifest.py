"""Manifest: the record of a finished unit of work, so that it is neither repeated nor mistaken.

A unit is a block or a shard. Its manifest names the recipe, the files with their checksums, the
failed attempts and the versions of the libraries. It is written last, when the files are on the
disk. A unit that two processes do at once is the same bytes twice.

Layout: which missions make a block and which blocks make a shard; by the mission count and how many
fly together.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from factory.generation.site import Site
from twin.errors import StoreError
from twin.records.storage.stored_files import Files, FileSum

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


LEAST_SHARD = 64
"""Missions in a shard of a small store, or all of them: 48 h of preset paper, a MB per signal"""
MOST_SHARDS = 192
"""Shards of a large store grow instead: a million missions stay below 20 000 files. Beyond 12 288
missions a shard, and with it the memory that assembling one signal takes, grows with the store"""
MOST_IN_BLOCK = 32
"""Missions in a block: some seconds of work for one process, and 60 MB while it flies them"""
BLOCKS_PER_STORE = 16
"""At least, where there are so many missions: processes that share a store end together"""
BLOCKS_ABREAST = 4
"""The same of missions that fly together: of 64 each takes a twentieth of the time of one alone"""
ROWS = 65_536
"""Missions in a chunk of an array that holds one value of each mission"""


@dataclass(frozen=True)
class Layout:
    """The blocks and shards of a store of `missions`."""

    missions: int
    abreast: int = 1
    """missions that fly together"""

    @property
    def shard_missions(self) -> int:
        """Missions in each shard; the last one may have fewer."""
        if self.missions <= LEAST_SHARD:
            return self.missions
        return LEAST_SHARD * max(1, -(-self.missions // (LEAST_SHARD * MOST_SHARDS)))

    @property
    def block_missions(self) -> int:
        """Missions in each block: a power of two, so that blocks fill shards."""
        most, blocks = MOST_IN_BLOCK, BLOCKS_PER_STORE
        if self.abreast > 1:  # few blocks that are full are sooner done
            most, blocks = self.abreast, BLOCKS_ABREAST
        wanted = max(1, min(most, self.missions // blocks))
        return int(1 << (wanted.bit_length() - 1))

    @property
    def row_missions(self) -> int:
        """Missions in each chunk of an array over missions: whole shards."""
        shard = self.shard_missions
        return min(self.missions, shard * max(1, ROWS // shard))

    @property
    def shards(self) -> range:
        """Numbers of all shards."""
        return range(-(-self.missions // self.shard_missions))

    @property
    def blocks(self) -> range:
        """Numbers of all blocks."""
        return range(-(-self.missions // self.block_missions))

    def missions_of_shard(self, shard: int) -> range:
        """Missions of one shard."""
        return self._part(shard, self.shard_missions)

    def missions_of_block(self, block: int) -> range:
        """Missions of one block."""
        return self._part(block, self.block_missions)

    def blocks_of_shard(self, shard: int) -> range:
        """Blocks of one shard."""
        missions = self.missions_of_shard(shard)
        return range(missions.start // self.block_missions, missions[-1] // self.block_missions + 1)

    def shard_of_block(self, block: int) -> int:
        """The shard of one block."""
        return block * self.block_missions // self.shard_missions

    def _part(self, number: int, size: int) -> range:
        return range(number * size, min((number + 1) * size, self.missions))
