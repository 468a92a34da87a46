"""Tiers: what everybody trains on and is tested on, made by anybody from a recipe.

`paper`: ideal sensors, the vehicle as in its file. `field`: sensor errors, currents, a vehicle that
is 10 % off. `family`: trained on hulls far from their file, tested on one with 40 % more drag over
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
"""Dives at the start of a test mission that a method may adapt on; scored is what follows the last
of them, on equal samples"""


SAME = 1e-6
"""Part of the metres by which two machines may differ: processors round differently"""


class Checksum(NamedTuple):
    """By what a store is known for the published one."""

    missions: int
    samples: int
    metres: float
    """through the water, of all missions along their hulls"""

    @classmethod
    def of(cls, store: Path) -> Checksum:
        """That of a store."""
        with MissionStore(store) as reader:
            counts = reader.samples.tolist()
            ways = [
                float(np.abs(np.asarray(reader.row("true_surge", k), np.float64)[:n]).sum())
                for k, n in enumerate(counts)
            ]
            return cls(len(counts), sum(counts), round(sum(ways) * reader.period, 3))

    def same(self, other: Checksum) -> bool:
        """Whether the other store is this one."""
        return self[:2] == other[:2] and abs(self.metres - other.metres) < SAME * self.metres


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tier:
    """Two recipes of `factory generate`."""

    train: Mapping[str, Any]
    test: Mapping[str, Any]
    dives: int = 0
    """that a test mission begins with before it is scored"""
    checksums: Mapping[str, Checksum] = dataclasses.field(default_factory=dict)
    """of `train` and `test`, with today's physics"""

    def make(self, folder: Path, parts: Sequence[str] = ("train", "test")) -> tuple[Path, Path]:
        """Stores of training and test; those of `parts` are made where they are missing."""
        for name in parts:
            path = folder / f"{name}.zarr"
            if not path.exists():
                folder.mkdir(parents=True, exist_ok=True)
                factory.generate(path, **getattr(self, name), resume=True)
        return folder / "train.zarr", folder / "test.zarr"

    def of_seed(self, seed: int) -> Tier:
        """The tier with other test missions, which nobody has seen; they have no checksum.

        Raises:
          InputError: its test missions are the same ones with every seed.
        """
        if "seed" not in self.test:
            raise InputError("this tier has no other test missions: leave --test-seed out")
        return dataclasses.replace(self, test={**self.test, "seed": seed}, checksums={})

    def others(self, folder: Path) -> list[str]:
        """Which of the stores are not the published ones, and why, a line each."""
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
