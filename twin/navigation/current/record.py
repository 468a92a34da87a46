"""Record: the steps of a filter, kept for smoothing, and its forecast.

A forecast is the current at later times and the displacement by it, with their covariances.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Node:
    """One step of a filter."""

    time: float
    """[s] at its end"""
    carry: Array
    """What it made of the state before, (state, state)"""
    predicted: Array
    """State before the measurements of this time, (state,)"""
    predicted_covariance: Array
    estimate: Array
    """State after them"""
    covariance: Array


class Record:
    """Nodes in order of time."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []

    def step(self, time: float, carry: Array, mean: Array, covariance: Array) -> None:
        """A step was made, to this state."""
        self.nodes.append(
            Node(
                time=time,
                carry=carry,
                predicted=mean,
                predicted_covariance=covariance,
                estimate=mean,
                covariance=covariance,
            )
        )

    def widen(self, covariance: Array) -> None:
        """The last step's covariance before the measurements was another."""
        self.nodes[-1] = dataclasses.replace(
            self.nodes[-1], predicted_covariance=covariance, covariance=covariance
        )

    def update(self, mean: Array, covariance: Array) -> None:
        """A measurement at the last step's time made this of its state."""
        self.nodes[-1] = dataclasses.replace(self.nodes[-1], estimate=mean, covariance=covariance)


@dataclasses.dataclass(frozen=True, kw_only=True)
class CurrentForecast:
    """What a filter expects."""

    times: Array
    """[s] on the filter's clock, (time,)"""
    current: Array
    """North, east [m/s], (time, 2)"""
    current_covariance: Array
    """[m2/s2], (time, 2, 2)"""
    displacement: Array
    """North, east [m] beyond the way through the water since the filter's time, (time, 2)"""
    displacement_covariance: Array
    """[m2], (time, 2, 2)"""
