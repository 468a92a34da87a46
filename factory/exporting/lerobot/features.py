"""Features: which signals are states, which are actions, and which are neither."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import StoreError
from twin.records.reader import MissionStore
from twin.records.schema import VARIABLES

Floats = NDArray[np.float32]

STATE, TRUTH, ACTION, OTHER = (
    "observation.state",
    "observation.environment_state",
    "action",
    "other",
)
"""Names of the vectors. Policies take those that begin with observation or action; `other` has
signals with gaps, NaN between fixes and without lock, and commands that no part carries out"""
BY_GROUP = {"measured": STATE, "true": TRUTH, "commanded": ACTION}
INDICES = {
    "timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "index": "int64",
    "task_index": "int64",
}  # fmt: skip
"""Columns that each row has beside the vectors, with their types"""


@dataclasses.dataclass(frozen=True)
class Features:
    """Signals of each vector, by its name."""

    vectors: Mapping[str, tuple[str, ...]]

    def described(self) -> dict[str, Any]:
        """As info.json has them."""
        found: dict[str, Any] = {
            name: {"dtype": "float32", "shape": [len(signals)], "names": list(signals)}
            for name, signals in self.vectors.items()
        }
        return found | {
            name: {"dtype": kind, "shape": [1], "names": None} for name, kind in INDICES.items()
        }

    def read(self, run: MissionStore, mission: int) -> dict[str, Floats]:
        """The vectors of a mission, each (samples, signals).

        Raises:
          StoreError: its data cannot be read.
        """
        count = int(run.samples[mission])
        return {
            name: np.stack([run.row(signal, mission)[:count] for signal in signals], axis=1)
            for name, signals in self.vectors.items()
        }


def choose_features(run: MissionStore, missions: Sequence[int]) -> Features:
    """Signals without a gap in any of the missions by their group, the others together.

    Actions are the commands to the vehicle's parts; a setpoint or the number of a segment is none.

    Raises:
      StoreError: no measured signal is without gaps, or the data cannot be read.
    """
    commands = {f"commanded_{part}" for part in run.vehicle.part_names}
    vectors: dict[str, list[str]] = {name: [] for name in (STATE, TRUTH, ACTION, OTHER)}
    for name in run.signals():
        group = BY_GROUP[name.split("_", 1)[0]]
        apart = VARIABLES[name].gaps or (group == ACTION and name not in commands)
        vectors[OTHER if apart or _has_gap(run, name, missions) else group].append(name)
    if not vectors[STATE]:
        raise StoreError(
            f"store {run.path}: every measured signal has gaps in some mission, so that there is "
            "no state to learn from; choose missions with --mission"
        )
    return Features({name: tuple(some) for name, some in vectors.items() if some})


def _has_gap(run: MissionStore, name: str, missions: Sequence[int]) -> bool:
    return any(
        not np.isfinite(run.row(name, mission)[: run.samples[mission]]).all()
        for mission in missions
    )
