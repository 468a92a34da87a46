"""Shown missions: the few missions of an evaluation that a report draws."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

from learn.evaluation.score import Reference
from twin.navigation.baselines.base import Estimate
from twin.navigation.dead_reckoning import Array, sample_times

DRAWN_MISSIONS = 3


@dataclasses.dataclass(frozen=True)
class Shown:
    """One mission with every method's estimate of it."""

    reference: Reference
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

    def add(self, reference: Reference, estimates: Mapping[str, Estimate]) -> None:
        """See the mission; it is kept while it is among the longest."""
        self._kept.append(Shown(reference, dict(estimates)))
        if len(self._kept) > self._most:
            shortest = min(self._kept, key=lambda shown: shown.reference.path[-1])
            self._kept.remove(shortest)

    @property
    def missions(self) -> tuple[Shown, ...]:
        """Those kept, in the store's order."""
        return tuple(sorted(self._kept, key=lambda shown: shown.reference.mission.index))
