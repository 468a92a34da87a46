"""Layout: which missions make a block and which blocks make a shard; by the mission count alone.

A block is the unit of work: one task flies it and keeps it. A shard is the unit of storage: one
file for each signal, assembled from blocks. Both depend on the number of missions and on nothing
else, so that every run of a recipe, wherever it runs, makes the same files.
"""

from __future__ import annotations

from dataclasses import dataclass

LEAST_SHARD = 64
"""Missions in a shard of a small store, or all of them: 48 h of preset paper, a MB per signal"""
MOST_SHARDS = 192
"""Shards of a large store grow instead: a million missions stay below 20 000 files. Beyond 12 288
missions a shard, and with it the memory that assembling one signal takes, grows with the store"""
MOST_IN_BLOCK = 32
"""Missions in a block: some seconds of work for one process, and 60 MB while it flies them"""
BLOCKS_PER_STORE = 16
"""At least, where there are so many missions: processes that share a store end together"""
ROWS = 65_536
"""Missions in a chunk of an array that holds one value of each mission"""


@dataclass(frozen=True)
class Layout:
    """The blocks and shards of a store of `missions`."""

    missions: int

    @property
    def shard_missions(self) -> int:
        """Missions in each shard; the last one may have fewer."""
        if self.missions <= LEAST_SHARD:
            return self.missions
        return LEAST_SHARD * max(1, -(-self.missions // (LEAST_SHARD * MOST_SHARDS)))

    @property
    def block_missions(self) -> int:
        """Missions in each block: a power of two, so that blocks fill shards."""
        wanted = max(1, min(MOST_IN_BLOCK, self.missions // BLOCKS_PER_STORE))
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
