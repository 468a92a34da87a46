"""Tether: how far networks may lastingly be from the flight filter on a kind of vehicle that is
new to them.

Networks know inflections, and how hulls of their training go where the filter errs. A kind of
vehicle that no training mission was of may do what none of these did, such as begin its dives
stalled; there they can be wrong by half, and the filter, which has the vehicle's own equation of
motion, is not. So what lasts of their difference is held to what it was in validation.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from twin.navigation.c_math import number
from twin.numbers import Array

HELD_TO = ("estimated_surge", "adapted_surge")
"""The filter's surge that networks are held to, without an adapted one and with it"""
LASTS_S = 60.0
"""[s] exponential mean of the difference: longer than an inflection, shorter than a glide"""
SHARE = 0.5
"""of the validation samples that are within the reach. Chosen of 0.5, 0.68 and 0.9, as LASTS_S of
20, 60 and 200 s, on Slocums and Seagliders that networks of three other kinds had not seen."""


@dataclasses.dataclass(frozen=True)
class Tether:
    """What networks' surge, in the mean of a minute, may be off the flight filter's."""

    most: float
    """[m/s] either way"""

    @classmethod
    def of(cls, apart: Sequence[Array], period: float) -> Tether:
        """From differences [m/s] of networks and filter on validation missions, each (time,)."""
        lasting = np.concatenate([_lasting(one, period) for one in apart])
        return cls(float(np.quantile(np.abs(lasting), SHARE)))

    def held(self, surge: NDArray[Any], filtered: Array, period: float) -> Array:
        """Surge [m/s] within reach of the filter's, both (time,) from the launch on."""
        lasting = _lasting(surge - filtered, period)
        return surge - (lasting - np.clip(lasting, -self.most, self.most))

    def step(self, lasting: float, apart: float, period: float) -> tuple[float, float]:
        """One sample: the mean so far, 0 before the first, and the difference [m/s] at it to the
        next mean and what is to be taken off the surge."""
        lasting += share(period) * (apart - lasting)
        return lasting, lasting - min(max(lasting, -self.most), self.most)

    def c_statements(self, surge: str, filtered: str, period: float) -> list[str]:
        """The same in C: a line that follows the mean in `state->lasting`."""
        return [
            f"state->lasting += {number(share(period))} * ({surge} - {filtered} - state->lasting);"
        ]

    def c_off(self) -> str:
        """What to take off the surge then, in C."""
        return f"(state->lasting - gt_bounded(state->lasting, {number(self.most)}))"


def share(period: float) -> float:
    """Of a sample in the mean, one every `period` [s]."""
    return -math.expm1(-period / LASTS_S)


def _lasting(apart: Array, period: float) -> Array:
    """From 0 on: a filter that begins under way takes some seconds to know its speed."""
    part = share(period)
    return np.asarray(lfilter([part], [1.0, part - 1.0], apart), np.float64)
