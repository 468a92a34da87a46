"""Public methods, as glider people use them, worked out again on the samples of a log.

- `kinematic`: w / sin(pitch + angle of attack), one constant angle (OceanGliders; Spray: 3 deg).
- `SteadyModel`: forces in balance with two parameters fitted to the depth rate, trim and drag, and
  published coefficients for the rest (Merckelbach et al. 2010 and 2019, Slocum gliders).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares

from twin.identify import Calibration, Log, density_of
from twin.navigation.dead_reckoning import Array

Mask = NDArray[np.bool_]

ATTACK = math.radians(3.0)
"""[rad] the constant angle of attack"""
LEAST_PITCH = math.radians(10.0)
"""[rad] flatter, a saw-tooth glider is turning over: speeds are bridged"""
PITCH_WINDOW = 20.0
"""[s] average of the pitch"""
AFLOAT = 1.0
"""[m] above this it lies at the surface"""
AREA = 0.1
"""[m2] that the coefficients refer to"""
LIFT = 7.5
"""[1/rad] lift slope of a Slocum, wings and body (Merckelbach et al. 2010)"""
INDUCED = 10.5
"""[1/rad2] induced drag of a Slocum (the same)"""
DEEP = 4.0
"""[m] from where the fit looks at the depth rate"""
STEEP = math.radians(11.0)
"""[rad] of pitch from where it does"""
SLOWEST = 0.15
"""[m/s] below which the balance is at an inflection: bridged"""
ROUNDS = 40


@dataclasses.dataclass(frozen=True)
class Through:
    """Velocities through the water of one mission, (time,)."""

    speed: Array
    """[m/s]"""
    level: Array
    """[m/s] horizontal, along the heading"""
    sink: Array
    """[m/s] downward"""


def kinematic(log: Log, pitch: Array, attack: float = ATTACK) -> Through:
    """Speed from depth rate and a constant angle of attack; bridged at inflections."""
    slope = uniform_filter1d(pitch, max(round(PITCH_WINDOW / log.period), 1))
    rate = log.depth_rate
    good = (np.abs(slope) > LEAST_PITCH) & (rate * slope < 0.0) & (log.depth > AFLOAT)
    path = np.maximum(np.abs(slope), LEAST_PITCH) + attack
    speed = _bridged(np.abs(rate) / np.sin(path), good)
    level = _bridged(np.abs(rate) / np.tan(path), good)
    under = log.depth > AFLOAT
    return Through(np.where(under, speed, 0.0), np.where(under, level, 0.0), rate)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SteadyModel:
    """A glider of published coefficients with two of its own."""

    mass: float
    """[kg]"""
    volume: float
    """[m3] at pump 0"""
    drag: float
    """parasite drag coefficient on `AREA`"""
    lift: float = LIFT
    """[1/rad] of its slope"""
    induced: float = INDUCED
    """[1/rad2] of drag"""

    def fly(self, log: Any, pitch: Array, density: Array) -> Through:
        """Velocities of one mission."""
        steep = np.abs(pitch)
        attack = np.zeros_like(pitch)
        for _ in range(ROUNDS):
            path = np.tan(np.maximum(steep + attack, 0.12))
            attack = np.minimum((self.drag + self.induced * attack**2) / (self.lift * path), 0.3)
        path = steep + attack
        lift = 9.81 * (density * (self.volume + 1e-6 * log.pump) - self.mass)
        force = 2.0 * np.sign(pitch) * lift * np.sin(path)
        power = density * AREA * (self.drag + self.induced * attack**2)
        speed = np.sqrt(np.maximum(force, 0.0) / power)
        return Through(speed, speed * np.cos(path), -np.sign(pitch) * speed * np.sin(path))

    def bridged(self, log: Any, pitch: Array, density: Array) -> Through:
        """As `fly`, with inflections bridged by straight lines."""
        raw = self.fly(log, pitch, density)
        good = raw.speed >= SLOWEST
        return Through(
            _bridged(raw.speed, good), _bridged(raw.level, good), _bridged(raw.sink, good)
        )


def fit_steady(logs: Sequence[Log], calibration: Calibration) -> SteadyModel:
    """Volume and drag that explain the depth rate of these missions.

    Args:
      calibration: for the mass, and for what is known of the pitch sensor.
    """
    pitches = [calibration.true_pitch(log.pitch) for log in logs]
    densities = [density_of(log, calibration) for log in logs]
    start = SteadyModel(mass=calibration.vehicle.mass, volume=0.0, drag=0.15)
    return fit_balance(logs, pitches, densities, start)


def fit_balance(
    dives: Sequence[Any], pitches: Sequence[Array], densities: Sequence[Array], start: SteadyModel
) -> SteadyModel:
    """`start` with the volume and the drag that explain the depth rate.

    Args:
      dives: with period [s], depth [m], depth rate [m/s] downward, pump [cm3] and a mask of the
        samples that are compared, `use`, (time,) each; a `Log` is one.
      pitches: [rad] of each.
      densities: [kg/m3] of each.
      start: mass, lift and induced drag, and the drag to begin with; its volume has no say.
    """
    masks = [
        (dive.depth > DEEP) & (np.abs(pitch) > STEEP) & dive.use
        for dive, pitch in zip(dives, pitches, strict=True)
    ]
    middle = float(np.median(np.concatenate(densities)))

    def model(x: Array) -> SteadyModel:
        volume = start.mass / middle + 1e-3 * x[0]
        return dataclasses.replace(start, volume=volume, drag=math.exp(x[1]))

    def residual(x: Array) -> Array:
        found = model(x)
        return np.concatenate(
            [
                (found.fly(dive, pitch, density).sink - dive.depth_rate)[mask]
                for dive, pitch, density, mask in zip(dives, pitches, densities, masks, strict=True)
            ]
        )

    return model(least_squares(residual, [0.0, math.log(start.drag)]).x)


def _bridged(values: Array, good: Mask) -> Array:
    index = np.arange(len(values))
    if not good.any():
        return np.zeros_like(values)
    return np.interp(index, index[good], values[good])
