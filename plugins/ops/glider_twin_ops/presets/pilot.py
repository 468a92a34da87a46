"""Pilot: settings that change during a simulated deployment, and the gaps of its log.

A pilot begins with test dives, then changes depth, pitches and net masses every few dives. On some
dives a thruster runs, on others the CTD is off, and parts of the log are lost. The simulated
vehicles have no thruster: dives with one fly as the others do, and the log says that it ran.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from factory.importing import Channel
from factory.sampling import Distribution, number
from twin.errors import MissionError
from twin.numbers import Array

SHALLOWEST, DEEPEST = 20.0, 1000.0
"""[m] Lower turning depth. SHALLOWEST: smallest. DEEPEST: largest if there is no rated depth"""
TEST_DIVES, TEST_DEPTH = 3, (20.0, 60.0)
"""TEST_DIVES: maximum number of test dives, of one yo each. TEST_DEPTH: [m] their turning depths"""
BLOCK = (3, 14)
"""Minimum and maximum number of dives with the same settings"""
CHANGED = {"depth": 0.6, "trim": 0.5, "speed": 0.5}
"""Probability of a change of depth, of both pitches and of both net masses between blocks"""
THRUSTER, WITHOUT_CTD, LOST = 0.3, 0.4, 0.5
"""Fractions of deployments with a THRUSTER, with dives WITHOUT_CTD, and with LOST samples"""
LOST_HOURS = (0.3, 4.0)
"""[h] Shortest and longest loss of samples"""
TRIES = 30
"""Samples of a block's settings until the vehicle can fly them; then the last ones stay"""
OFF = ("measured_temperature", "measured_conductivity", "measured_salinity", "measured_density",
       "measured_pressure")  # fmt: skip
"""Signals of the CTD"""
Settings = Mapping[str, float]


@dataclasses.dataclass(frozen=True, kw_only=True)
class LogGaps:
    """Dives with a thruster or without the CTD, and times without any sample."""

    thruster: tuple[int, ...] = ()
    """Numbers of the dives with a thruster"""
    without_ctd: tuple[int, ...] = ()
    """Numbers of the dives without the CTD"""
    lost: tuple[tuple[float, float], ...] = ()
    """[s] Begin and end of each loss on the scenario's clock"""

    def applied(
        self, channels: dict[str, Channel], time: Array, dive: NDArray[np.int64]
    ) -> dict[str, Channel]:
        """Remove the samples that the log lacks.

        Args:
          time: [s] unix of all samples, (n,), the first at 0 s of the scenario's clock.
          dive: number of the dive at each of them, (n,).
        """
        kept = np.ones(len(time), bool)
        for begin, end in self.lost:
            kept &= ~((time - time[0] >= begin) & (time - time[0] < end))
        dry = kept & ~np.isin(dive, self.without_ctd)
        found = {}
        for name, channel in channels.items():
            there = np.isin(channel.time, time[dry if name in OFF else kept])
            found[name] = Channel(channel.time[there], channel.values[there])
        return found

    def ran(self, time: Array, dive: NDArray[np.int64]) -> dict[str, Channel]:
        """Channel of the thruster, 1 where it ran; empty where it never did."""
        on = np.isin(dive, self.thruster).astype(float)
        return {"thruster": Channel(time, on)} if self.thruster else {}


def draw_gaps(dives: int, lasting: float, rng: np.random.Generator) -> LogGaps:
    """Sample what a log of `dives` dives over `lasting` [s] lacks."""

    def some(part: float, most: int) -> tuple[int, ...]:
        if rng.random() > part:
            return ()
        begin, count = int(rng.integers(4, dives)), int(rng.integers(1, most + 1))
        return tuple(range(begin, min(begin + count, dives)))

    thruster, without_ctd, lost = some(THRUSTER, 6), some(WITHOUT_CTD, 12), []
    if rng.random() < LOST:
        for _ in range(int(rng.integers(1, 5))):
            begin = float(rng.uniform(0.1, 0.95)) * lasting
            lost.append((begin, begin + 3600.0 * float(rng.uniform(*LOST_HOURS))))
    return LogGaps(thruster=thruster, without_ctd=without_ctd, lost=tuple(lost))


def draw_settings(
    first: Settings,
    distributions: Mapping[str, Distribution],
    rated_depth: float | None,
    dives: int,
    check: Callable[[Settings], object],
    rng: np.random.Generator,
) -> list[Settings]:
    """Sample the settings of each dive; names are the fields of a saw-tooth.

    Args:
      first: settings that the vehicle can fly, which the first block may keep.
      check: raises MissionError for settings that the vehicle cannot fly.
    """
    full = rated_depth or DEEPEST
    reach = float(rng.uniform(0.3, 1.0)) * full

    def depth() -> float:
        """Half of the depths lie near the deepest, the others at any below."""
        low = math.log(0.7 if rng.random() < 0.5 else SHALLOWEST / reach)
        return reach * math.exp(rng.uniform(low, 0.0))

    def changed(before: Settings) -> Settings:
        found = dict(before)
        if rng.random() < CHANGED["depth"]:
            found["max_depth_m"] = depth()
        for what, ends in (("trim", "pitch_deg"), ("speed", "net_mass_kg")):
            if rng.random() < CHANGED[what]:
                for name in (ends, f"climb_{ends}"):
                    drawn = {name: distributions[f"mission.{name}"].draw(rng)}
                    found[name] = number(drawn, name)
        return found

    now = {**first, "max_depth_m": depth()}
    tests = int(rng.integers(TEST_DIVES + 1))
    shallow = float(rng.uniform(*TEST_DEPTH))
    found: list[Settings] = [{**now, "max_depth_m": shallow, "yos": 1.0}] * tests
    while len(found) < dives:
        found += [now] * int(rng.integers(*BLOCK))
        for _ in range(TRIES):
            trial = changed(now)
            try:
                check(trial)
            except MissionError:
                continue
            now = dict(trial)
            break
    return found[:dives]
