"""Scenario: everything that one simulated mission depends on, and its JSON description."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from typing import Any

from twin.current.base import Current
from twin.current.origin import Origin
from twin.density import DensityProfile
from twin.errors import InputError
from twin.mission import Mission
from twin.schedule import Schedule
from twin.vehicle import Vehicle, load_vehicle

SAMPLE_PERIOD = 0.5
"""[s], the paper's 2 Hz"""
@dataclasses.dataclass(frozen=True, kw_only=True)
class Start:
    """Where and how a simulation begins."""

    north: float = 0.0
    """[m]"""
    east: float = 0.0
    """[m]"""
    depth: float = 0.0
    """[m], of the CB"""
    roll: float = 0.0
    """[rad]"""
    pitch: float = 0.0
    """[rad]"""
    heading: float = 0.0
    """[rad]"""
    v_rel: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Surge, sway, heave through the water [m/s]; zero drifts with the water."""
    rates: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw rate [rad/s], body FRD"""
    actuators: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """shift [m], rotation [rad], pump [cm3]"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scenario:
    """Everything that one simulated mission depends on."""

    vehicle: Vehicle = dataclasses.field(default_factory=load_vehicle)
    plan: Mission | Schedule | None = None
    """Closed-loop mission, open-loop schedule, or None (commands come from a controller)."""
    duration: float | None = None
    """[s]; None takes the mission's own."""
    start: Start | None = None
    """None takes the mission's start depth and heading, at rest in the water."""
    current: Current | None = None
    density: DensityProfile | None = None
    origin: Origin = dataclasses.field(default_factory=Origin)
    """Geographic position and time of the start, for gridded currents and tides."""
    hydrodynamics: str = "coefficients"
    timestep: float | None = None
    """[s]; None takes the vehicle file's"""
    integrator: str | None = None
    sample_period: float = SAMPLE_PERIOD
    """[s]"""

    def run_time(self) -> float:
        """Duration [s]; raises InputError when neither scenario nor mission gives one."""
        duration = self.duration
        if duration is None and isinstance(self.plan, Mission):
            duration = self.plan.duration_s
        if duration is None:
            raise InputError("give a duration: neither the scenario nor its plan has one")
        if not (math.isfinite(duration) and duration > 0):
            raise InputError(f"duration {duration} s must be positive and finite")
        return float(duration)
