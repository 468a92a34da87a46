"""Surge of a propelled vehicle without a Doppler log, by models that runs with one have taught.

`ThrustBalance` needs the propeller's speed, `LiftBalance` depth and pitch. Neither needs a vehicle
file; `twin identify` needs minutes under water with all controls, which short runs lack.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from twin.compiled import jit
from twin.errors import InputError
from twin.navigation.dead_reckoning import Array

SPEEDS = np.linspace(0.02, 2.6, 130)
"""[m/s] Surges among which the balance of lift finds the likeliest"""
LEAST_SAMPLES = 30
"""Minimum number of samples for a fit"""


class LiftBalance(NamedTuple):
    """Balance of lift and net buoyancy under water: the slower a hull, the more it is trimmed.

    With depth rate w, surge u and s = -sin(pitch), the angle of attack is w / u - s to first order.
    The balance is w / u - s = a + b / u^2. The surge is the mean of its distribution, with a normal
    prior of the fitted samples' mean and standard deviation.
    """

    zero_lift: float
    """[rad] a, angle of attack without lift"""
    buoyancy: float
    """[m2/s2] b, net weight over the lift slope; negative for a buoyant hull"""
    scatter: float
    """[rad] Standard deviation of the angle of attack about the balance"""
    mean: float
    """[m/s] Mean surge of the fitted samples"""
    spread: float
    """[m/s] Its standard deviation"""

    @classmethod
    def fit(cls, depth_rate: Array, down: Array, surge: Array, slowest: float = 0.3) -> LiftBalance:
        """Fit the balance to samples under water, at a surge above `slowest` [m/s].

        Args:
          depth_rate: [m/s], averaged over several oscillations in pitch. down: -sin(pitch),
            averaged alike. surge: [m/s], measured, NaN without; (samples,) each.

        Raises:
          InputError: fewer than `LEAST_SAMPLES` such samples.
        """
        good = np.nan_to_num(surge) > slowest
        if good.sum() < LEAST_SAMPLES:
            few = f"{good.sum()} samples under way under water"
            raise InputError(f"{few}; the balance of lift needs {LEAST_SAMPLES}")
        rate, down, surge = depth_rate[good], down[good], surge[good]
        matrix = np.stack([surge**2, np.ones_like(surge)], axis=1)
        wanted = surge * rate - surge**2 * down
        a, b = np.linalg.lstsq(matrix, wanted, rcond=None)[0].tolist()
        scatter = float(np.std((wanted - matrix @ [a, b]) / surge**2))
        return cls(a, b, scatter, float(surge.mean()), float(surge.std()))

    def surge(self, depth_rate: Array, down: Array) -> Array:
        """Estimate the surge [m/s], (time,); NaN inputs give the prior's mean."""
        off = depth_rate[:, None] / SPEEDS - down[:, None] - self.zero_lift
        off = np.nan_to_num((off - self.buoyancy / SPEEDS**2) / self.scatter)
        score = -0.5 * (off**2 + ((SPEEDS - self.mean) / self.spread) ** 2)
        weight = np.exp(score - score.max(axis=1, keepdims=True))
        return np.asarray((weight * SPEEDS).sum(axis=1) / weight.sum(axis=1))


class Propulsion(NamedTuple):
    """Channels of the propulsion of a run, (time,) each."""

    speed: Array
    """[1] Speed of the propeller over its usual one; 0 at rest"""
    power: Array
    """[1] Power, or its setting, over its usual one; `speed` again where it is not logged"""
    depth: Array
    """[m]"""
    surge: Array
    """[m/s] Measured; NaN without"""
    period: float
    """[s] Between samples"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ThrustBalance:
    """Balance of thrust, drag and inertia: du/dt = a n^2 - b n u - c u |u|.

    A propeller near the surface draws air: it turns faster and thrusts less. Its effective speed n
    is speed^(1 - mix) power^mix, times an efficiency at the surface. The defaults are the priors: a
    vehicle of 1.5 m/s with a drag length of 2 m.
    """

    thrust: float = 0.8
    """[m/s2] a"""
    fall: float = 0.3
    """[1/s] b, fall of the thrust with the surge"""
    drag: float = 0.45
    """[1/m] c"""
    shallow: float = 0.6
    """[1] Efficiency of the propeller at the surface"""
    delay: float = 0.5
    """[s] Delay of the measured surge"""
    mix: float = 0.5
    """[1] Part of the power in the effective speed"""

    @classmethod
    def fit(cls, runs: Sequence[Propulsion]) -> ThrustBalance:
        """Fit the balance to whole runs that begin at rest.

        Raises:
          InputError: fewer than `LEAST_SAMPLES` samples with a surge.
        """
        if sum(int(np.isfinite(run.surge).sum()) for run in runs) < LEAST_SAMPLES:
            raise InputError(f"the balance of thrust needs {LEAST_SAMPLES} samples with a surge")
        names, start = [*dataclasses.asdict(cls())], np.log(dataclasses.astuple(cls()))

        def made(x: Array) -> ThrustBalance:
            return cls(**dict(zip(names, np.exp(x).tolist(), strict=True)))

        def misses(x: Array) -> Array:
            found = [(made(x).surge(run) - run.surge)[np.isfinite(run.surge)] for run in runs]
            return np.concatenate([*found, PRIOR * (x - start)])

        limits = (np.full(start.size, -5.0), np.log([50.0, 50.0, 50.0, 1.0, 5.0, 1.0]))
        return made(least_squares(
            misses, start, bounds=limits, loss="soft_l1", f_scale=OUTLIER, max_nfev=LOOKS
        ).x)  # fmt: skip

    def surge(self, run: Propulsion) -> Array:
        """Estimate the surge [m/s] of a run from rest, (time,); its own surge is not read."""
        wet = 1.0 / (1.0 + np.exp((DRAWS_AIR - run.depth) / (0.3 * DRAWS_AIR)))
        speed, power = (np.maximum(values, 1e-6) for values in (run.speed, run.power))
        n = speed ** (1.0 - self.mix) * power**self.mix
        n = n * np.where(run.speed > 0.05, self.shallow + (1.0 - self.shallow) * wet, 0.0)
        surge = _swum(n, self.thrust, self.fall, self.drag, run.period)
        clock = run.period * np.arange(n.size)
        return np.interp(clock - self.delay, clock, surge)


PRIOR, OUTLIER, LOOKS = 0.3, 0.15, 25
"""[m/s] PRIOR: weight of the priors. OUTLIER: residual beyond which samples are outliers. LOOKS:
maximum number of evaluations"""
DRAWS_AIR, SUBSTEPS = 0.25, 4
"""DRAWS_AIR: [m] depth at which half of the surface's effect is left, a propeller's diameter and
more. SUBSTEPS: steps of the integration in a sample"""


@jit
def _swum(n, thrust, fall, drag, period):  # type: ignore[no-untyped-def]
    """Surge [m/s] of effective speeds n, from rest, (time,)."""
    surge, now, step = np.zeros(n.size), 0.0, period / SUBSTEPS
    for k in range(n.size):
        surge[k] = now
        for _ in range(SUBSTEPS):
            now += step * (thrust * n[k] ** 2 - fall * n[k] * now - drag * now * abs(now))
    return surge
