"""Endurance: how long the energy that is left lasts, by what the dives so far took.

The power of a dive is a level and noise; the level walks from dive to dive and has a slope, such as
that of a pump which weakens (Durbin and Koopman 2012, Time Series Analysis by State Space Methods,
chapter 3). How far it walks is averaged over by its likelihood, so that ten dives promise less than
a hundred.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from twin.logs.energy_use import EnergyUse

Array = NDArray[np.float64]

WALKS = (0.0, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
"""Variance of a step of the level over that of the noise; each as likely before the dives speak"""
SLOPE = 0.05
"""Part by which the power changes over a whole deployment, standard deviation, before the dives
speak: fouling, pump, batteries"""
LEAST_DIVES = 3
"""Below which a dive's noise is not known"""
DRAWS = 4000
LEAST_PART = 0.1
"""Of the level that a drawn power keeps: nothing takes less than its electronics"""
INTERVAL = (0.05, 0.95)
DAY_HOURS = 24.0
SEED = 0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Endurance:
    """Days that are left, where it goes on as in its last dives."""

    energy_left_kwh: float
    """[kW h]"""
    power: float
    """[W] expected"""
    powers: Array
    """[W] draws of the mean power until the energy is gone, (draw,)"""

    @property
    def days(self) -> float:
        """[d] at the expected power; 0 where nothing is left."""
        return max(self.energy_left_kwh, 0.0) * 1e3 / self.power / DAY_HOURS

    def days_drawn(self, added: float = 0.0) -> Array:
        """[d] of each draw with so much power [W] added, such as that of a change, (draw,)."""
        power = np.maximum(self.powers + added, LEAST_PART * self.power)
        return np.asarray(max(self.energy_left_kwh, 0.0) * 1e3 / power / DAY_HOURS)

    def interval(self, added: float = 0.0) -> tuple[float, float]:
        """[d] 90 % of the days left."""
        low, high = np.quantile(self.days_drawn(added), INTERVAL)
        return float(low), float(high)

    def between(self, added: float = 0.0) -> str:
        """The interval in words; it has no upper end where the power may be next to nothing."""
        low, high = self.interval(added)
        if high > 0.99 * self.days / LEAST_PART:
            return f"{low:.1f} and more"
        return f"{low:.1f} to {high:.1f}"


def endurance_of(used: EnergyUse, energy_left_kwh: float) -> Endurance | None:
    """Days left by the dives of a deployment; None of fewer than three.

    Args:
      used: of one deployment. energy_left_kwh: [kW h].
    """
    if len(used.dives) < LEAST_DIVES:
        return None
    hours = np.array([one.hours for one in used.dives])
    taken = np.array([one.measured for one in used.dives])
    whole = used.charge / used.hours / (taken.sum() / hours.sum())  # stays at the surface, too
    power = taken / hours * used.voltage * whole
    left = max(energy_left_kwh, 0.0) * 1e3 / power.mean() / float(np.median(hours))  # dives
    slope = SLOPE * power.mean() / (len(power) + left)
    found = [_followed(power, ratio, slope, left) for ratio in WALKS]
    likely = np.array([one[2] for one in found])
    weights = np.exp(likely - likely.max())
    weights /= weights.sum()
    rng = np.random.default_rng(SEED)
    which = rng.choice(len(WALKS), DRAWS, p=weights)
    expected, spread = np.array([one[:2] for one in found]).T
    drawn = expected[which] + spread[which] * rng.standard_t(len(hours) - 1, DRAWS)
    mean = float(weights @ expected)
    return Endurance(
        energy_left_kwh=energy_left_kwh,
        power=mean,
        powers=np.maximum(drawn, LEAST_PART * mean),
    )


def _followed(power: Array, walk: float, slope: float, left: float) -> tuple[float, float, float]:
    """Mean of the dives to come, its deviation, and the logarithm of the likelihood.

    A Kalman filter of level and slope, begun with the first dive; its variances are over that of
    the noise, which the innovations tell.

    Args:
      power: [W] of each dive. walk: variance of a step. slope: [W] a dive, its deviation before.
      left: dives to come.
    """
    least = (1e-6 * abs(float(power.mean()))) ** 2  # a counter that is even without end
    noise = max(0.5 * float(np.mean(np.diff(power) ** 2)), least)
    state, cover = np.array([power[0], 0.0]), np.diag([1.0, slope**2 / noise])
    step = np.array([[1.0, 1.0], [0.0, 1.0]])
    squares, variances = [], []
    for value in power[1:]:
        state, cover = step @ state, step @ cover @ step.T
        cover[0, 0] += walk
        variance = cover[0, 0] + 1.0
        innovation = value - state[0]
        gain = cover[:, 0] / variance
        state, cover = state + gain * innovation, cover - np.outer(gain, cover[0])
        squares.append(innovation**2 / variance)
        variances.append(variance)
    noise = max(float(np.mean(squares)), least)
    middle = np.array([1.0, 0.5 * left])  # the slope's part of the mean of what is to come
    ahead = middle @ cover @ middle + walk * left / 3.0 + 1.0 / max(left, 1.0)
    likelihood = -0.5 * float(np.log(variances).sum() + len(squares) * np.log(noise))
    return float(middle @ state), float(np.sqrt(noise * ahead)), likelihood
