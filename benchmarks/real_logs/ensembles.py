"""Ensembles: a hull's motion by its Doppler log, and its angle of attack by pitch."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.real_logs.row import DRAWS, SEED
from factory.importing.doppler.hull_velocity import hull_velocity
from factory.importing.doppler.pd0 import read_pd0
from factory.importing.doppler.screens import Thresholds
from twin.navigation.dead_reckoning import Array

LEAST = 300
"""Fewest ensembles of a bin of pitch."""
WIDTH = 1.0
"""[degree] Width of a bin of pitch."""
STEEP = 15.0
"""[degree] Pitch beyond which a hull glides."""
MINUTE = 60.0
"""[s] Samples within it share water and errors; the bootstrap draws whole minutes."""


class Ensembles(NamedTuple):
    """Good ensembles of a Doppler log, at the times of the instrument, (ensembles,)."""

    time: Array
    """[s] Unix time"""
    pitch: Array
    """[degree] Positive nose up"""
    surge: Array
    """[m/s] Forward, through the water"""
    heave: Array
    """[m/s] Down, through the water"""

    @property
    def sides(self) -> tuple[Array, Array]:
        """Masks of dives and of climbs, (ensembles,) each."""
        return self.pitch < -STEEP, self.pitch > STEEP

    def where(self, use: Array) -> Ensembles:
        """Select ensembles by a mask, (ensembles,)."""
        return Ensembles(*(values[use] for values in self))


def read_ensembles(path: Path, scale: float = 1.0) -> Ensembles:
    """Read the good ensembles of a PD0 file.

    Args:
      scale: factor on the thresholds of the screens, as `Thresholds.scaled`.

    Raises:
      InputError: the file is no PD0, or shows no sound velocity through the water.
    """
    limits = Thresholds().scaled(scale)
    found = hull_velocity(path.name, read_pd0(path).layouts, None, limits)
    values = (np.degrees(found.pitch), found.water[:, 0], found.water[:, 2])
    return Ensembles(found.log.time, *values).where(found.kept & np.isfinite(found.pitch))


class MeanAttack(NamedTuple):
    """Angle of attack of some ensembles."""

    pitch: float
    """[degree] Mean"""
    attack: float
    """[degree] Of the mean velocity"""
    draws: Array
    """[degree] The same of bootstrap samples of whole minutes, (draws,); a tilt of the mount that
    is not known adds to all, alike in dives and climbs"""
    ensembles: int
    minutes: int


def mean_attack(found: Ensembles) -> MeanAttack:
    """Average the velocities of ensembles, at least one."""
    minute = np.unique(np.floor(found.time / MINUTE), return_inverse=True)[1]
    sums = np.stack([np.bincount(minute, v) for v in (found.heave, found.surge)])
    drawn = np.random.default_rng(SEED).integers(sums.shape[1], size=(DRAWS, sums.shape[1]))
    return MeanAttack(
        pitch=float(found.pitch.mean()),
        attack=float(np.degrees(np.arctan2(*sums.sum(axis=1)))),
        draws=np.degrees(np.arctan2(*sums[:, drawn].sum(axis=2))),
        ensembles=len(found.time), minutes=sums.shape[1],
    )  # fmt: skip


def both_sides(found: Ensembles) -> tuple[MeanAttack, MeanAttack]:
    """Average the velocities of dives, and of climbs."""
    down, up = (mean_attack(found.where(side)) for side in found.sides)
    return down, up


def attack_by_pitch(found: Ensembles, least: int = LEAST) -> dict[int, MeanAttack]:
    """Angle of attack in bins of pitch with enough ensembles, nose down first.

    A key is the bin's least pitch in widths [degree].
    """
    bins = np.floor(found.pitch / WIDTH).astype(int)
    counts = zip(*np.unique(bins, return_counts=True), strict=True)
    return {int(k): mean_attack(found.where(bins == k)) for k, n in counts if n >= least}
