"""LeRobot features: which signals are states, which are actions, and their statistics.

The statistics, of an episode and of all, are those that LeRobot's policies scale with.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import StoreError
from twin.records import MissionStore
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


Array = NDArray[np.float64]
Statistics = dict[str, Array]

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}


def episode_statistics(values: NDArray[np.generic]) -> Statistics:
    """Of the columns of (samples, columns); NaN does not count.

    A column of nothing but NaN has zeros and a standard deviation of one, and counts zero samples.
    """
    known = np.asarray(values, float).reshape(len(values), -1)
    counts = np.isfinite(known).sum(axis=0)
    filled = np.where(counts > 0, known, 0.0)
    found = {
        "min": np.nanmin(filled, axis=0),
        "max": np.nanmax(filled, axis=0),
        "mean": np.nanmean(filled, axis=0),
        "std": np.where(counts > 0, np.nanstd(filled, axis=0), 1.0),
        "count": np.array([float(counts.max(initial=0))]),
    }
    parts = np.nanquantile(filled, list(QUANTILES.values()), axis=0)
    return found | dict(zip(QUANTILES, parts, strict=True))


class Total:
    """Statistics of all episodes from those of each, without their samples.

    Quantiles are the means of the episodes' own, by their lengths, as LeRobot makes them.
    """

    def __init__(self) -> None:
        self._found: dict[str, Statistics] = {}

    def add(self, episode: Mapping[str, Statistics]) -> None:
        """Take an episode's, by feature."""
        for name, new in episode.items():
            old = self._found.get(name)
            self._found[name] = dict(new) if old is None else _joined(old, new)

    def result(self) -> dict[str, dict[str, list[float]]]:
        """By feature and statistic, for stats.json."""
        return {
            name: {what: values.tolist() for what, values in found.items()}
            for name, found in self._found.items()
        }


def _joined(a: Statistics, b: Statistics) -> Statistics:
    """Of both together (Chan et al., 1979: the parallel algorithm for variances)."""
    count = a["count"] + b["count"]
    share = b["count"] / np.maximum(count, 1.0)
    apart = b["mean"] - a["mean"]
    variance = (1.0 - share) * a["std"] ** 2 + share * b["std"] ** 2
    found = {
        "min": np.minimum(a["min"], b["min"]),
        "max": np.maximum(a["max"], b["max"]),
        "mean": a["mean"] + share * apart,
        "std": np.sqrt(variance + share * (1.0 - share) * apart**2),
        "count": count,
    }
    return found | {name: a[name] + share * (b[name] - a[name]) for name in QUANTILES}
