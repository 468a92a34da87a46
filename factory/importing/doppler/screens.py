"""Screens: select the cells and ensembles of a Doppler log whose velocity is that of the water.

Pings without an echo can enter an ensemble's mean as zeros. The speed is then too low by more than
their fraction, though correlation and error velocity are unsuspicious; percent good shows them.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from factory.importing.doppler.pd0 import Array
from factory.importing.doppler.relative_velocity import Mask, RelativeVelocity

FULL = 128.0
"""[count] Correlation of an echo without noise."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Thresholds:
    """Limits of the screens."""

    failed: float = 5.0
    """[%] Largest share of pings without a velocity."""
    decorrelation: float = 45.0
    """[count] Largest loss of correlation, of 128, in any beam."""
    echo: float = 2.0
    """[count] Smallest echo of any beam above the lowest in the file, 0.45 dB each."""
    error: float = 0.2
    """[m/s] Largest error velocity of an ensemble's mean."""
    closure: float = 0.1
    """Largest vertical velocity that the depth rate does not have, as a fraction of the speed."""

    def scaled(self, factor: float) -> Thresholds:
        """Return limits that are tighter (below 1) or looser (above 1)."""
        wider = {name: value * factor for name, value in vars(self).items()}
        return Thresholds(**{**wider, "echo": self.echo / factor})


def screen_cells(log: RelativeVelocity, limits: Thresholds) -> Array:
    """Velocities past the water of all cells, (ensembles, cells, 3); NaN where screened out."""
    error, good, correlation, echo = np.moveaxis(log.cells[..., 3:7], -1, 0)
    bad = (good < 100.0 - limits.failed) | (correlation < FULL - limits.decorrelation)
    bad |= (echo < limits.echo) | (np.abs(error) > limits.error)
    return np.where(bad[..., None], np.nan, log.cells[..., :3])


def screen(
    log: RelativeVelocity, limits: Thresholds
) -> tuple[Array, Array, dict[str, Mask]]:  # fmt: skip
    """Average the good near cells of each ensemble. A quantity that the file lacks drops nothing.

    Returns:
      Velocity past the water [m/s], (ensembles, 3), and the error velocity [m/s] of the same mean,
      NaN where every cell is dropped; ensembles whose last cells each screen dropped, by its name.
    """
    use: Mask = np.asarray(np.isfinite(log.water).all(axis=2))

    def kept() -> Mask:
        return np.asarray(use.any(axis=1))

    dropped: dict[str, Mask] = {"no velocity": ~kept()}

    def drop(name: str, bad: Mask) -> None:
        before = kept()
        np.logical_and(use, ~bad, out=use)
        dropped[name] = before & ~kept()

    drop("percent good", log.good < 100.0 - limits.failed)
    drop("correlation", log.correlation < FULL - limits.decorrelation)
    drop("echo", log.echo < limits.echo)
    weight = use / np.maximum(use.sum(axis=1), 1)[:, None]
    error = (np.nan_to_num(log.error) * weight).sum(axis=1)
    drop("error velocity", (np.abs(error) > limits.error)[:, None])
    water = np.einsum("tc,tcj->tj", weight, np.nan_to_num(log.water))
    there = kept()
    return np.where(there[:, None], water, np.nan), np.where(there, error, np.nan), dropped
