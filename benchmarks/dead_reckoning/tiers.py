"""Tiers: training and test stores of the benchmark, which anybody makes from a recipe.

`paper`: ideal sensors, the vehicle as in its file. `field`: sensor errors, currents, coefficients
that are 10 % off. `family`: training with hulls far from their file, test with 40 % more drag, in
missions of several dives, so that a method may adapt.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import factory
from twin.errors import InputError
from twin.records.reader import MissionStore

HEAVY = {
    "vehicle.k_d0": "1.4", "vehicle.k_d": "1.4", "mission.duration_h": "6", "mission.yos": "1",
    "mission.max_depth_m": "uniform(60, 200)",
}  # fmt: skip
DIVES = (0, 1, 5)
"""Numbers of dives at the start of a test mission that a method may adapt on; all are scored on the
samples after the largest number"""


SAME = 1e-6
"""[1] Largest relative difference of `Checksum.metres` between machines, which round differently"""


class Checksum(NamedTuple):
    """Numbers that identify a store as the published one."""

    missions: int
    samples: int
    metres: float
    """[m] Sum over all missions of the path through the water along the hull"""

    @classmethod
    def of(cls, store: Path) -> Checksum:
        """Compute the checksum of a store."""
        with MissionStore(store) as reader:
            counts = reader.samples.tolist()
            ways = [
                float(np.abs(np.asarray(reader.row("true_surge", k), np.float64)[:n]).sum())
                for k, n in enumerate(counts)
            ]
            return cls(len(counts), sum(counts), round(sum(ways) * reader.period, 3))

    def same(self, other: Checksum) -> bool:
        """True if both checksums are of the same store."""
        return self[:2] == other[:2] and abs(self.metres - other.metres) < SAME * self.metres


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tier:
    """Tier: recipes of `factory generate` for training and test."""

    train: Mapping[str, Any]
    test: Mapping[str, Any]
    dives: int = 0
    """Dives at the start of a test mission that are not scored"""
    checksums: Mapping[str, Checksum] = dataclasses.field(default_factory=dict)
    """Checksums of the stores `train` and `test`, with today's physics"""

    def make(self, folder: Path, parts: Sequence[str] = ("train", "test")) -> tuple[Path, Path]:
        """Return the stores of training and test; make those of `parts` that are missing."""
        for name in parts:
            path = folder / f"{name}.zarr"
            if not path.exists():
                folder.mkdir(parents=True, exist_ok=True)
                factory.generate(path, **getattr(self, name), resume=True)
        return folder / "train.zarr", folder / "test.zarr"

    def of_seed(self, seed: int) -> Tier:
        """Return the tier with other test missions, which nobody has seen, without a checksum.

        Raises:
          InputError: the test missions do not depend on the seed.
        """
        if "seed" not in self.test:
            raise InputError("this tier has no other test missions: leave --test-seed out")
        return dataclasses.replace(self, test={**self.test, "seed": seed}, checksums={})

    def others(self, folder: Path) -> list[str]:
        """List the stores that are not the published ones: a line each, with the reason."""
        return [
            f"{folder / name}.zarr has {found}, the published one {wanted}"
            for name, wanted in self.checksums.items()
            if (folder / f"{name}.zarr").exists()
            and not wanted.same(found := Checksum.of(folder / f"{name}.zarr"))
        ]


TIERS: Mapping[str, Tier] = {
    "paper": Tier(
        train={"preset": "paper", "hours": 10.0, "seed": 9001},
        test={"preset": "paper-test"},
        checksums={
            "train": Checksum(13, 72013, 14948.292),
            "test": Checksum(3, 60003, 14896.21),
        },
    ),
    "field": Tier(
        train={"preset": "field", "hours": 400.0, "seed": 9011, "engine": "lanes"},
        test={"preset": "field", "hours": 130.0, "seed": 9012},
        checksums={
            "train": Checksum(199, 2880199, 552864.399),
            "test": Checksum(69, 936069, 176612.096),
        },
    ),
    "family": Tier(
        train={"preset": "family", "hours": 400.0, "seed": 9021, "engine": "lanes"},
        test={"preset": "field", "hours": 384.0, "seed": 9022, "engine": "lanes", "changes": HEAVY},
        dives=DIVES[-1],
        checksums={
            "train": Checksum(101, 2880101, 526757.046),
            "test": Checksum(64, 2764864, 408602.865),
        },
    ),
}
