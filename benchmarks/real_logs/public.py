"""Public methods: speed estimates as glider groups use them, computed on the samples of a log.

- `kinematic`: w / sin(pitch + angle of attack), one constant angle (OceanGliders; Spray: 3 deg).
- `SteadyModel`: balance of forces with trim and drag fitted to the depth rate, and published other
  coefficients (Merckelbach et al. 2010 and 2019, Slocum gliders).
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
"""[rad] Constant angle of attack"""
LEAST_PITCH = math.radians(10.0)
"""[rad] Least pitch of a glide; while the pitch is flatter, speeds are interpolated"""
PITCH_WINDOW = 20.0
"""[s] Averaging time of the pitch"""
AFLOAT = 1.0
"""[m] Depth above which a glider is at the surface"""
AREA = 0.1
"""[m2] Reference area of the coefficients"""
LIFT = 7.5
"""[1/rad] Lift slope of a Slocum, wings and body (Merckelbach et al. 2010)"""
INDUCED = 10.5
"""[1/rad2] Induced drag of a Slocum (Merckelbach et al. 2010)"""
DEEP = 4.0
"""[m] Least depth of samples in the fit"""
STEEP = math.radians(11.0)
"""[rad] Least pitch of samples in the fit"""
SLOWEST = 0.15
"""[m/s] Least speed of a balance; slower ones are at inflections, and are interpolated"""
SLOW = 0.08
"""[m/s] Speed below which a drag that falls with speed falls no further"""
USUAL = 0.27
"""[m/s] Speed at which a drag that falls with speed has its coefficient"""
ROUNDS = 40


@dataclasses.dataclass(frozen=True)
class Through:
    """Velocities through the water of one mission, (time,)."""

    speed: Array
    """[m/s] Speed along the path"""
    level: Array
    """[m/s] Horizontal speed along the heading"""
    sink: Array
    """[m/s] Downward speed"""


def kinematic(log: Log, pitch: Array, attack: float = ATTACK) -> Through:
    """Speed from depth rate and a constant angle of attack; interpolated at inflections."""
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
    """Steady flight model with published coefficients, but its own volume and drag."""

    mass: float
    """[kg]"""
    volume: float
    """[m3] Volume at pump 0"""
    drag: float
    """[1] Parasite drag coefficient on `AREA`"""
    lift: float = LIFT
    """[1/rad] Lift slope"""
    induced: float = INDUCED
    """[1/rad2] Induced drag"""
    fall: float = 0.0
    """[1] Power of the speed by which the parasite drag coefficient falls"""

    def fly(self, log: Any, pitch: Array, density: Array) -> Through:
        """Compute the velocities of one mission."""
        steep = np.abs(pitch)
        lift = 9.81 * (density * (self.volume + 1e-6 * log.pump) - self.mass)
        attack, parasite = np.zeros_like(pitch), np.full_like(pitch, self.drag)
        for _ in range(ROUNDS):
            path = np.tan(np.maximum(steep + attack, 0.12))
            attack = np.minimum((parasite + self.induced * attack**2) / (self.lift * path), 0.3)
            path = steep + attack
            force = 2.0 * np.sign(pitch) * lift * np.sin(path)
            power = density * AREA * (parasite + self.induced * attack**2)
            speed = np.sqrt(np.maximum(force, 0.0) / power)
            if self.fall:
                parasite = self.drag * (np.maximum(speed, SLOW) / USUAL) ** -self.fall
        return Through(speed, speed * np.cos(path), -np.sign(pitch) * speed * np.sin(path))

    def bridged(self, log: Any, pitch: Array, density: Array) -> Through:
        """Compute the velocities of one mission; interpolate at inflections."""
        raw = self.fly(log, pitch, density)
        good = raw.speed >= SLOWEST
        return Through(
            _bridged(raw.speed, good), _bridged(raw.level, good), _bridged(raw.sink, good)
        )


def fit_steady(logs: Sequence[Log], calibration: Calibration) -> SteadyModel:
    """Fit volume and drag to the depth rate of missions.

    Args:
      calibration: gives the mass and the errors of the pitch sensor.
    """
    pitches = [calibration.true_pitch(log.pitch) for log in logs]
    densities = [density_of(log, calibration) for log in logs]
    start = SteadyModel(mass=calibration.vehicle.mass, volume=0.0, drag=0.15)
    return fit_balance(logs, pitches, densities, start)


def fit_balance(
    dives: Sequence[Any], pitches: Sequence[Array], densities: Sequence[Array], start: SteadyModel
) -> SteadyModel:
    """Fit volume and drag of a model to the depth rate.

    Args:
      dives: with period [s], depth [m], depth rate [m/s] downward, pump [cm3] and a mask of the
        samples that are compared, `use`, (time,) each, such as a `Log`.
      pitches: [rad] pitch of each dive.
      densities: [kg/m3] density in each dive.
      start: gives mass, lift, induced drag and the initial drag; its volume is not used.
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
