"""Ensembles: a hull's motion by its Doppler log, and its angle of attack by pitch."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.real_logs.row import CENTRAL, DRAWS, SEED
from factory.importing import DeploymentLog, ReadOptions, Tally
from factory.importing.import_run import read_logs
from twin.navigation.dead_reckoning import Array

LEAST = 300
"""Fewest ensembles of a bin of pitch."""
WIDTH = 1.0
"""[degree] Width of a bin of pitch."""
MINUTE = 60.0
"""[s] Samples within it share water and errors; the bootstrap draws whole minutes."""


class Ensembles(NamedTuple):
    """Good ensembles of a Doppler log, at the times of the instrument, (ensembles,)."""

    time: Array
    """[s] Unix time"""
    depth: Array
    """[m]"""
    pitch: Array
    """[degree] Positive nose up"""
    surge: Array
    """[m/s] Forward, through the water"""
    heave: Array
    """[m/s] Down, through the water"""
    surge_deviation: Array
    """[m/s] Standard deviation"""
    heave_deviation: Array
    """[m/s] Standard deviation"""

    @property
    def attack(self) -> Array:
        """[degree] Angle of attack of each ensemble, positive in dives."""
        return np.asarray(np.degrees(np.arctan2(self.heave, self.surge)))


def ensembles_of(log: DeploymentLog) -> Ensembles:
    """Ensembles of a log that holds the velocities of a Doppler log."""
    time = log.channel("measured_dvl_surge").time
    names = ("depth", "pitch", "dvl_surge", "dvl_heave", "dvl_surge_deviation",
             "dvl_heave_deviation")  # fmt: skip
    values = [log.channel(f"measured_{name}").known(time) for name in names]
    known = np.isfinite(np.stack(values)).all(axis=0)
    return Ensembles(time[known], *(v[known] for v in values))


def read_ensembles(path: Path) -> Ensembles:
    """Read the ensembles of a PD0 file; errors as `factory.importing.import_logs`."""
    return ensembles_of(read_logs("pd0", [path], ReadOptions(), Tally())[1][0])


class AttackBin(NamedTuple):
    """Angle of attack of the ensembles in a bin of pitch."""

    pitch: float
    """[degree] Mean"""
    attack: float
    """[degree] Of the mean velocity"""
    low: float
    high: float
    """[degree] Limits of the 95 % interval, by bootstrap over minutes; a tilt of the mount that is
    not known adds to it, alike in dives and climbs"""
    surge: float
    """[m/s] Mean"""
    ensembles: int


def attack_by_pitch(
    found: Ensembles, *, width: float = WIDTH, least: int = LEAST
) -> list[AttackBin]:
    """Angle of attack in bins of pitch [degree] with enough ensembles, nose down first."""
    bins = np.floor(found.pitch / width)
    rng = np.random.default_rng(SEED)
    rows = []
    for one in np.unique(bins):
        use = bins == one
        if use.sum() < least:
            continue
        surge, heave = found.surge[use], found.heave[use]
        minute = np.unique(np.floor(found.time[use] / MINUTE), return_inverse=True)[1]
        sums = np.stack([np.bincount(minute, v) for v in (heave, surge)])
        drawn = rng.integers(sums.shape[1], size=(DRAWS, sums.shape[1]))
        angles = np.degrees(np.arctan2(*sums[:, drawn].sum(axis=2)))
        low, high = np.percentile(angles, CENTRAL)
        rows.append(AttackBin(
            pitch=float(found.pitch[use].mean()),
            attack=float(np.degrees(np.arctan2(heave.sum(), surge.sum()))),
            low=float(low), high=float(high), surge=float(surge.mean()), ensembles=int(use.sum()),
        ))  # fmt: skip
    return rows


def attacks(paths: Sequence[Path]) -> list[dict[str, object]]:
    """Rows of a table: angle of attack by pitch of every file."""
    return [
        {"file": path.name, **row._asdict()}
        for path in paths
        for row in attack_by_pitch(read_ensembles(path))
    ]
