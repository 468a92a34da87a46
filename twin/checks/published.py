"""Published glides: the figures that a vehicle file must reproduce, from assets/published.toml."""

from __future__ import annotations

import dataclasses
import math
import tomllib

from twin.physics.steady_motion import Trim
from twin.vehicle.assets import asset_path

ANGLES = ("angle_of_attack", "sideslip", "roll", "pitch")


@dataclasses.dataclass(frozen=True, kw_only=True)
class PublishedGlide:
    """One steady motion in print; None where a figure was not published."""

    vehicle: str
    source: str
    net_mass: float
    """[kg]"""
    shift: float
    """[m]"""
    rotation: float
    """[deg]"""
    speed: float
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
    tolerance: dict[str, float]
    """Largest differences: speed [m/s], angle [deg], turn_rate [rad/s]."""

    @property
    def rotation_rad(self) -> float:
        """[rad]"""
        return math.radians(self.rotation)

    def differences(self, trim: Trim) -> dict[str, float]:
        """Computed minus published, for each published figure."""
        found = {"speed": trim.speed_m_s - self.speed}
        for name in ANGLES:
            value = getattr(self, name)
            if value is not None:
                found[name] = getattr(trim, f"{name}_deg") - value
        if self.turn_rate is not None:
            found["turn_rate"] = trim.turn_rate_rad_s - self.turn_rate
        return found

    def violations(self, trim: Trim) -> list[str]:
        """One phrase for each figure beyond its tolerance."""
        return [
            f"{name} off by {value:.4g} (allowed {self._limit(name):.4g})"
            for name, value in self.differences(trim).items()
            if abs(value) > self._limit(name)
        ]

    def _limit(self, name: str) -> float:
        return self.tolerance["angle" if name in ANGLES else name]


def published_glides(vehicle: str | None = None) -> list[PublishedGlide]:
    """Every published glide, or those of one shipped vehicle."""
    with asset_path("published.toml").open("rb") as file:
        entries = tomllib.load(file)["glide"]
    glides = [PublishedGlide(**entry) for entry in entries]
    return [g for g in glides if vehicle is None or g.vehicle == vehicle]
