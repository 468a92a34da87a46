"""Settings: everything that decides what a run becomes, and the networks that it asks for."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from learn.data.dataset import Division
from learn.data.labels import LabelConfig
from learn.networks.config import NetworkConfig
from learn.runs.run import DESCRIPTION, TARGETS
from learn.training.schedule import TrainingConfig
from twin.errors import InputError, StoreError

FREE = ("device", "threads")
"""Settings of a training with which another machine may go on."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FitConfig:
    """Everything that decides what a run becomes."""

    store: str
    """Path of the store."""
    features: tuple[str, ...]
    """Inputs by name, in order."""
    network: NetworkConfig = dataclasses.field(default_factory=NetworkConfig)
    training: TrainingConfig = dataclasses.field(default_factory=TrainingConfig)
    """Its seed is the first member's of surge; every network gets one of its own."""
    members: int = 1
    """Networks per velocity; their spread is an uncertainty."""
    division: Division = "missions"
    """`missions`: the store's split. `samples`: the paper's random 70/15/15, which leaks."""
    mirror: bool = True
    """Whether the training shows every mission mirrored, port for starboard, too."""
    period: float | None = None
    """[s] between samples, a multiple of the store's; None takes all of them."""
    start: str | None = None
    """Run whose weights and scales the training goes on from; None starts at random."""
    held_out: tuple[int, ...] = ()
    """Rows of the store that are not trained on, see `learn.data.preparation.prepare`."""
    labels: LabelConfig = dataclasses.field(default_factory=LabelConfig)
    """What is learned: the truth, or what a Doppler log measured."""

    def __post_init__(self) -> None:
        if self.members < 1:
            raise InputError(f"members must be at least 1, not {self.members}")
        if self.period is not None and not (math.isfinite(self.period) and self.period > 0.0):
            raise InputError(f"period must be a finite number of seconds above 0: {self.period}")
        if not self.features:
            raise InputError("the networks need at least one input feature")

    @classmethod
    def of(cls, settings: Mapping[str, Any], folder: Path) -> FitConfig:
        """From a run's stored settings; those of a later version than the run are the defaults.

        Raises:
          StoreError: they are damaged, or of a later version.
        """
        values = dict(settings)
        try:
            values["network"] = NetworkConfig(**values["network"])
            values["training"] = TrainingConfig(**values["training"])
            values["labels"] = LabelConfig(**values.get("labels", {}))
            for name in ("features", "held_out"):
                values[name] = tuple(values.get(name, ()))
            return cls(**values)
        except (TypeError, KeyError) as error:
            raise StoreError(
                f"{folder / DESCRIPTION} has settings that this version does not know ({error})"
            ) from error

    def differences(self, other: FitConfig) -> list[str]:
        """What `other` has otherwise, setting by setting, without those that may change."""
        ours, theirs = (dataclasses.asdict(config) for config in (self, other))
        for part in ("network", "training", "labels"):
            for values in (ours, theirs):
                values |= {k: v for k, v in values.pop(part).items() if k not in FREE}
        found = []
        for name, mine in ours.items():
            if mine == theirs[name]:
                continue
            if isinstance(mine, tuple):
                gone = [str(v) for v in mine if v not in theirs[name]]
                new = [str(v) for v in theirs[name] if v not in mine]
                parts = [f"with {', '.join(gone)}"] * bool(gone)
                parts += [f"without {', '.join(new)}"] * bool(new)
                found.append(f"{name} {' and '.join(parts) or 'in another order'}")
            else:
                found.append(f"{name} {mine} instead of {theirs[name]}")
        return found

    def jobs(self) -> list[Job]:
        """The networks to train."""
        return [
            Job(
                target=target,
                member=member,
                config=self,
                seed=self.training.seed + member * len(TARGETS) + place,
            )
            for member in range(self.members)
            for place, target in enumerate(TARGETS)
        ]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Job:
    """One network of a run."""

    target: str
    member: int
    config: FitConfig
    seed: int

    @property
    def name(self) -> str:
        """Name of its files."""
        return f"{self.target}-{self.member}"
