"""Tiers: what everybody trains on and is tested on, made by anybody from a recipe.

`paper`: ideal sensors, the vehicle as in its file. `field`: sensor errors, currents, a vehicle that
is 10 % off. `family`: trained on hulls far from their file, tested on one with 40 % more drag over
missions of several dives, so that a method may adapt.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import factory

HEAVY = {
    "vehicle.k_d0": "1.4", "vehicle.k_d": "1.4", "mission.duration_h": "6", "mission.yos": "1",
    "mission.max_depth_m": "uniform(60, 200)",
}  # fmt: skip
DIVES = (0, 1, 5)
"""Dives at the start of a test mission that a method may adapt on; scored is what follows the last
of them, on equal samples"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tier:
    """Two recipes of `factory generate`."""

    train: Mapping[str, Any]
    test: Mapping[str, Any]
    dives: int = 0
    """that a test mission begins with before it is scored"""

    def make(self, folder: Path) -> tuple[Path, Path]:
        """Stores of training and test, made where they are missing."""
        found = []
        for name in ("train", "test"):
            path = folder / f"{name}.zarr"
            if not path.exists():
                folder.mkdir(parents=True, exist_ok=True)
                factory.generate(path, **getattr(self, name), resume=True)
            found.append(path)
        return found[0], found[1]


TIERS: Mapping[str, Tier] = {
    "paper": Tier(
        train={"preset": "paper", "hours": 10.0, "seed": 9001},
        test={"preset": "paper-test"},
    ),
    "field": Tier(
        train={"preset": "field", "hours": 400.0, "seed": 9011, "engine": "lanes"},
        test={"preset": "field", "hours": 130.0, "seed": 9012},
    ),
    "family": Tier(
        train={"preset": "family", "hours": 400.0, "seed": 9021, "engine": "lanes"},
        test={"preset": "field", "hours": 384.0, "seed": 9022, "engine": "lanes", "changes": HEAVY},
        dives=DIVES[-1],
    ),
}
