"""Contents: everything that a page is made of.

Names and colours of the methods, the same in every table and figure.
Shown missions: the few missions of an evaluation that a report draws.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from learn.data.dataset import MissionSequence
from learn.evaluation.deviation import ErrorModel
from learn.evaluation.evaluation import Evaluation
from learn.evaluation.score import ReferenceVelocity
from twin.navigation.dead_reckoning import Array, sample_times
from twin.navigation.estimators.base import Estimate, baselines
from twin.show.style import ESTIMATE, GUIDE, PALETTE, TRUTH

TITLES = {"network": "networks", "floor": "floor: true velocities"}
"""What people read, of methods that are not baselines."""
COLOURS = {"truth": TRUTH, "network": ESTIMATE, "floor": GUIDE}

KNOWLEDGE_TITLES = {
    "none": "no current",
    "previous": "previous dive's current",
    "corrected": "corrected afterwards",
}


def title_of(method: str) -> str:
    """The method in words; of a baseline that is not registered, its name."""
    kind = baselines().get(method)
    return (kind and kind.title) or TITLES.get(method, method.replace("_", " "))


def colour_of(method: str) -> str:
    """Its colour."""
    kind = baselines().get(method)
    return PALETTE[kind.colour] if kind and kind.colour else COLOURS.get(method, GUIDE)


DRAWN_MISSIONS = 3


@dataclasses.dataclass(frozen=True)
class Shown:
    """One mission with every method's estimate of it."""

    reference: ReferenceVelocity
    estimates: Mapping[str, Estimate]

    @property
    def time(self) -> Array:
        """[s] since the start, (time,)"""
        return sample_times(self.reference.mission.samples, self.reference.mission.period)

    @property
    def label(self) -> str:
        """The mission and the mean speed of its current."""
        return f"mission {self.reference.mission.index}, {self.current_label}"

    @property
    def current_label(self) -> str:
        """Mean speed of the current where the vehicle was."""
        signals = self.reference.mission.signals
        north, east = (float(signals[f"true_current_{n}"].mean()) for n in ("north", "east"))
        return f"current {math.hypot(north, east):.2f} m/s"

    def water_track(self, method: str) -> Array | None:
        """Track through the water [m], (time, 2), of a method that has one."""
        return self.reference.tracks(self.estimates[method]).get("water")


class Showcase:
    """Keeps the missions with the longest paths; give its `add` as the evaluation's watch."""

    def __init__(self, most: int = DRAWN_MISSIONS) -> None:
        self._most = most
        self._kept: list[Shown] = []

    def add(self, reference: ReferenceVelocity, estimates: Mapping[str, Estimate]) -> None:
        """See the mission; it is kept while it is among the longest."""
        self._kept.append(Shown(reference, dict(estimates)))
        if len(self._kept) > self._most:
            shortest = min(self._kept, key=lambda shown: shown.reference.path[-1])
            self._kept.remove(shortest)

    @property
    def missions(self) -> tuple[Shown, ...]:
        """Those kept, in the store's order."""
        return tuple(sorted(self._kept, key=lambda shown: shown.reference.mission.index))


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunEvaluation:
    """A run on the missions of a store: `figures` is what `learn evaluate --json` prints."""

    evaluation: Evaluation
    figures: Mapping[str, Any]
    """By the names of `learn evaluate`: errors of the networks, the floor and each baseline."""
    shown: tuple[Shown, ...]
    """Missions that a page draws; none of a store of logs, whose true tracks nobody knows."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Study:
    """A table of a page with what it says."""

    title: str
    rows: Sequence[Mapping[str, object]]
    caption: str
    sentence: str
    """The result in words."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Contents:
    """Everything that a page is made of; what is missing is left out."""

    title: str
    lead: str
    test: RunEvaluation
    paper_test: RunEvaluation | None = None
    """The paper's three missions."""
    labels: Sequence[str] = ()
    """What was learned, in sentences, where it was not the truth."""
    error_model: ErrorModel | None = None
    metrics: Sequence[Mapping[str, Any]] = ()
    training: MissionSequence | None = None
    studies: Sequence[Study] = ()
    """Tables of its own, such as one of each store."""
    provenance: Mapping[str, object] = dataclasses.field(default_factory=dict)
    command: str = ""

    @property
    def tracks(self) -> tuple[Shown, ...]:
        """Missions whose tracks are drawn: the paper's where they were flown."""
        return (self.paper_test or self.test).shown
