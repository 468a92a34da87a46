"""Result: log and twin beside each other, phase by phase, and what is beyond its limit."""

from __future__ import annotations

import dataclasses
from collections import Counter
from pathlib import Path
from typing import Any

from twin.checks.agreement import EndsApart
from twin.checks.heading_leg import PHASES, Phase, Turning
from twin.checks.log_figures import PhaseFigures
from twin.checks.log_flight import PATIENCE
from twin.checks.replayed_dive import ReplayedDive
from twin.errors import SimulationUnstable
from twin.records.trajectory import Trajectory
from twin.vehicle.vehicle import Vehicle

DEPTH_RATE_LIMIT = 0.05
"""Relative, of the depth rate in each phase"""
TURN_LIMIT = 0.25
"""Relative, of the turn rate per position of what turns the vehicle"""
TURNING_LIMIT = 3.0
"""[deg] of the mean position of what turns the vehicle, twin less log: an asymmetry that the log
flew and the vehicle file lacks"""
HEADING_LIMIT = 2.0
"""[deg] of the twin's heading about its target"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PhaseComparison:
    """Log beside twin in one phase."""

    log: PhaseFigures
    twin: PhaseFigures | None
    """None: it never came to a steady part of such a leg"""
    speed_from: str | None
    """What the log's speed is: "measured", "depth rate and pitch", or None"""
    same_part: bool
    """Whether the same kind of part turns both, so that its effect can be compared"""

    def describe(self) -> dict[str, Any]:
        """JSON-able; ratios are twin over log, deviations twin less log."""
        log, twin = self.log.describe(), {} if self.twin is None else self.twin.describe()
        twin = {name: twin.get(name) for name in log}
        cycles = {
            "log": self.log.oscillation,
            "twin": None if self.twin is None else self.twin.oscillation,
        }
        ratio = {
            name: _ratio(twin[name], log[name])
            for name in ("depth_rate_m_s", "speed_m_s", "turn_per_actuator")
        }
        if not self.same_part:
            ratio["turn_per_actuator"] = None
        return {
            "log": {**log, "parts": dict(self.log.parts)},
            "twin": {**twin, "parts": {} if self.twin is None else dict(self.twin.parts)},
            "speed_from": self.speed_from,
            "ratio": ratio,
            "deviation": {
                name: _difference(twin[name], log[name])
                for name in ("pitch_deg", "turning_deg", "heading_sd_deg", "heading_bias_deg")
                if name != "turning_deg" or self.same_part
            },
            "limit_cycle": {
                name: None if one is None else dataclasses.asdict(one)
                for name, one in cycles.items()
            },
        }


@dataclasses.dataclass(frozen=True, kw_only=True)
class LogCheck:
    """What a vehicle file's twin does with the targets of a store of logs."""

    vehicle: Vehicle
    store: Path
    dives: tuple[ReplayedDive, ...]
    flights: tuple[Trajectory | SimulationUnstable, ...]
    """The twin's flight of each dive"""
    phases: dict[Phase, PhaseComparison]
    turning: Turning | None
    engine: str
    """What flew the twin"""
    beside_mujoco: EndsApart | None
    """Of the first dive, where lanes flew it"""
    notes: tuple[str, ...]
    """What the log lacks or what stands in for it, one sentence each"""

    @property
    def beyond(self) -> list[str]:
        """One phrase for each figure beyond its limit; empty when the twin flies as the log."""
        found = [f"dive {d.row}: {f}" for d, f in self._flown() if isinstance(f, Exception)]
        for name, phase in self.phases.items():
            found += [f"{name}: {text}" for text in _beyond(phase)]
        short = [d.row for d, f in self._flown() if isinstance(f, Trajectory) and not _is_flown(f)]
        if short:
            found.append(
                f"the twin took more than {PATIENCE:g} times the log's time in {len(short)} of "
                f"{len(self.dives)} dives ({', '.join(map(str, short))})"
            )
        return found

    def describe(self) -> dict[str, Any]:
        """JSON-able."""
        legs = Counter(leg.phase for dive in self.dives for leg in dive.legs if leg.compared)
        return {
            "vehicle": self.vehicle.name,
            "store": str(self.store),
            **(
                {}
                if self.beside_mujoco is None
                else {
                    "engine": self.engine,
                    "beside_mujoco": dataclasses.asdict(self.beside_mujoco),
                }
            ),
            "dives": len(self.dives),
            "missions": [dive.row for dive in self.dives],
            "legs": {phase: legs[phase] for phase in PHASES},
            "hours": sum(len(d.depth) * d.period for d in self.dives) / 3600.0,
            "turning": None if self.turning is None else dataclasses.asdict(self.turning),
            "phases": {name: phase.describe() for name, phase in self.phases.items()},
            "limits": {
                "depth_rate_relative": DEPTH_RATE_LIMIT,
                "turn_per_actuator_relative": TURN_LIMIT,
                "turning_deg": TURNING_LIMIT,
                "heading_sd_deg": HEADING_LIMIT,
            },
            "notes": list(self.notes),
            "beyond": self.beyond,
            "ok": not self.beyond,
        }

    def _flown(self) -> list[tuple[ReplayedDive, Trajectory | SimulationUnstable]]:
        return list(zip(self.dives, self.flights, strict=True))


def _beyond(phase: PhaseComparison) -> list[str]:
    log, twin = phase.log, phase.twin
    if twin is None:
        return ["the twin never flew it steadily"]
    found = []
    ratio = _ratio(twin.depth_rate, log.depth_rate)
    if ratio is not None and abs(ratio - 1.0) > DEPTH_RATE_LIMIT:
        found.append(f"depth rate {ratio:.3f} times the log's (within {DEPTH_RATE_LIMIT:.0%})")
    turn = _ratio(twin.turn_per_actuator, log.turn_per_actuator) if phase.same_part else None
    if turn is not None and abs(turn - 1.0) > TURN_LIMIT:
        found.append(f"turn per actuator {turn:.2f} times the log's (within {TURN_LIMIT:.0%})")
    held = _difference(twin.turning, log.turning) if phase.same_part else None
    if held is not None and abs(held) > TURNING_LIMIT:
        found.append(
            f"what turns it is at {twin.turning:.1f} deg on the mean, the log's at "
            f"{log.turning:.1f} (within {TURNING_LIMIT:g}): the file flies no such asymmetry; "
            "identify it (`twin identify`)"
        )
    if twin.heading_sd is not None and twin.heading_sd > HEADING_LIMIT:
        found.append(f"heading wanders by {twin.heading_sd:.1f} deg (at most {HEADING_LIMIT:g})")
    if twin.oscillation is not None:
        one = twin.oscillation
        found.append(
            f"{one.signal} swings by {one.amplitude_deg:.1f} deg every {one.period_s:.0f} s and "
            "does not die out"
        )
    return found


def _is_flown(flight: Trajectory) -> bool:
    return flight.provenance.get("ended") == "flown"


def _ratio(mine: float | None, theirs: float | None) -> float | None:
    return None if mine is None or not theirs else mine / theirs


def _difference(mine: float | None, theirs: float | None) -> float | None:
    return None if mine is None or theirs is None else mine - theirs
