"""Contents: the data of a report's page, and the names and colours of methods in it.

`Shown` is a mission that a report draws; `Showcase` selects such missions.
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
"""Titles of the methods that are not baselines."""
COLOURS = {"truth": TRUTH, "network": ESTIMATE, "floor": GUIDE}

KNOWLEDGE_TITLES = {
    "none": "no current",
    "previous": "previous dive's current",
    "corrected": "corrected afterwards",
}


def title_of(method: str) -> str:
    """Title of a method; for an unregistered baseline, its name."""
    kind = baselines().get(method)
    return (kind and kind.title) or TITLES.get(method, method.replace("_", " "))


def colour_of(method: str) -> str:
    """Colour of a method in figures."""
    kind = baselines().get(method)
    return PALETTE[kind.colour] if kind and kind.colour else COLOURS.get(method, GUIDE)


DRAWN_MISSIONS = 3


@dataclasses.dataclass(frozen=True)
class Shown:
    """Mission with the estimates of all methods, for figures."""

    reference: ReferenceVelocity
    estimates: Mapping[str, Estimate]

    @property
    def time(self) -> Array:
        """[s] Time since the start, (time,)"""
        return sample_times(self.reference.mission.samples, self.reference.mission.period)

    @property
    def label(self) -> str:
        """Label of the mission, with the mean speed of its current."""
        return f"mission {self.reference.mission.index}, {self.current_label}"

    @property
    def current_label(self) -> str:
        """Label of the mean current speed [m/s] at the vehicle."""
        signals = self.reference.mission.signals
        north, east = (float(signals[f"true_current_{n}"].mean()) for n in ("north", "east"))
        return f"current {math.hypot(north, east):.2f} m/s"

    def water_track(self, method: str) -> Array | None:
        """[m] Track through the water, (time, 2), of a method; None if the method has none."""
        return self.reference.tracks(self.estimates[method]).get("water")


class Showcase:
    """Keep the missions with the longest paths; `add` is a callback for `evaluate`."""

    def __init__(self, most: int = DRAWN_MISSIONS) -> None:
        self._most = most
        self._kept: list[Shown] = []

    def add(self, reference: ReferenceVelocity, estimates: Mapping[str, Estimate]) -> None:
        """Add a mission, and drop the one with the shortest path if there are too many."""
        self._kept.append(Shown(reference, dict(estimates)))
        if len(self._kept) > self._most:
            shortest = min(self._kept, key=lambda shown: shown.reference.path[-1])
            self._kept.remove(shortest)

    @property
    def missions(self) -> tuple[Shown, ...]:
        """Kept missions in the store's order."""
        return tuple(sorted(self._kept, key=lambda shown: shown.reference.mission.index))


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunEvaluation:
    """Evaluation of a run on a store, with its numbers and the missions to draw."""

    evaluation: Evaluation
    figures: Mapping[str, Any]
    """Errors of the networks, `floor` and each baseline, as `learn evaluate --json` prints."""
    shown: tuple[Shown, ...]
    """Missions that a page draws; empty for logs, whose true tracks are unknown."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Study:
    """Table of a page, with its caption and result."""

    title: str
    rows: Sequence[Mapping[str, object]]
    caption: str
    sentence: str
    """The result in words."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Contents:
    """Data of a report's page; sections without data are left out."""

    title: str
    lead: str
    test: RunEvaluation
    paper_test: RunEvaluation | None = None
    """Evaluation on the paper's three missions."""
    labels: Sequence[str] = ()
    """Sentences on a Doppler log's labels; empty if the networks learned from the truth."""
    error_model: ErrorModel | None = None
    metrics: Sequence[Mapping[str, Any]] = ()
    training: MissionSequence | None = None
    studies: Sequence[Study] = ()
    """Further tables, such as one with a row per store."""
    provenance: Mapping[str, object] = dataclasses.field(default_factory=dict)
    command: str = ""

    @property
    def tracks(self) -> tuple[Shown, ...]:
        """Missions whose tracks are drawn: the paper's test, or else the longest test missions."""
        return (self.paper_test or self.test).shown
