"""Published motions: the figures that a vehicle file must reproduce, from assets/published.toml."""

from __future__ import annotations

import dataclasses
import math
import tomllib
from collections.abc import Mapping
from typing import Any, TypeVar

from twin.physics.steady_motion import Trim
from twin.vehicle.assets import asset_path

ANGLES = ("angle_of_attack", "sideslip", "roll", "pitch")
FIGURES = {
    "speed": "speed_m_s",
    **{name: f"{name}_deg" for name in ANGLES},
    "turn_rate": "turn_rate_rad_s",
    "vertical_speed": "vertical_speed_m_s",
}
"""What can be published of a motion, and its field of `Trim`"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PublishedMotion:
    """One steady motion in print; None where a figure was not published."""

    vehicle: str
    source: str
    speed: float | None = None
    """[m/s]"""
    angle_of_attack: float | None = None
    """[deg]"""
    sideslip: float | None = None
    """[deg]"""
    roll: float | None = None
    """[deg]"""
    pitch: float | None = None
    """[deg]"""
    turn_rate: float | None = None
    """[rad/s] about the vertical"""
    vertical_speed: float | None = None
    """[m/s] down"""
    tolerance: dict[str, float]
    """Largest differences: speed, vertical_speed [m/s], angle [deg], turn_rate [rad/s]."""

    def differences(self, trim: Trim) -> dict[str, float]:
        """Computed minus published, for each published figure."""
        printed = {name: getattr(self, name) for name in FIGURES}
        return {
            name: getattr(trim, FIGURES[name]) - value
            for name, value in printed.items()
            if value is not None
        }

    def violations(self, trim: Trim) -> list[str]:
        """One phrase for each figure beyond its tolerance."""
        return [
            f"{name} off by {value:.4g} (allowed {self._limit(name):.4g})"
            for name, value in self.differences(trim).items()
            if abs(value) > self._limit(name)
        ]

    def _limit(self, name: str) -> float:
        return self.tolerance["angle" if name in ANGLES else name]


@dataclasses.dataclass(frozen=True, kw_only=True)
class PublishedGlide(PublishedMotion):
    """A glide or spiral at fixed positions of a glider's battery and pump."""

    net_mass: float
    """[kg]"""
    shift: float
    """[m]"""
    rotation: float
    """[deg]"""

    @property
    def rotation_rad(self) -> float:
        """[rad]"""
        return math.radians(self.rotation)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PublishedFlight(PublishedMotion):
    """A motion under a propeller, in which an elevator keeps the depth or a pitch."""

    positions: Mapping[str, float]
    """of parts by name, in their units; a rudder that is not named keeps a straight way"""
    held_pitch: float | None = None
    """[deg] that the elevator holds; None: it keeps the depth"""

    def request(self, turning: str) -> dict[str, Any]:
        """Arguments of `held_flight`, `turning` being the name of the part that turns it."""
        return {
            "positions": self.positions,
            "pitch": None if self.held_pitch is None else math.radians(self.held_pitch),
            "turning": turning in self.positions,
        }


Motion = TypeVar("Motion", bound=PublishedMotion)


def published_glides(vehicle: str | None = None) -> list[PublishedGlide]:
    """Every published glide, or those of one shipped vehicle."""
    return _entries("glide", PublishedGlide, vehicle)


def published_flights(vehicle: str | None = None) -> list[PublishedFlight]:
    """Every published motion under a propeller, or those of one shipped vehicle."""
    return _entries("flight", PublishedFlight, vehicle)


def _entries(table: str, kind: type[Motion], vehicle: str | None) -> list[Motion]:
    with asset_path("published.toml").open("rb") as file:
        found = [kind(**entry) for entry in tomllib.load(file)[table]]
    return [motion for motion in found if vehicle is None or motion.vehicle == vehicle]
