"""Answers of a current filter: a forecast, and the smoothed track of its recorded steps.

Smoothing goes backwards over the steps (Rauch, Tung and Striebel 1965, AIAA J. 3(8)), so that all
measurements have a say in each of them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from twin.numbers import Array

_JITTER = 1e-12
"""[1] added to the diagonal of a correlation, so that parts that are known exactly can stay"""


class Node(NamedTuple):
    """One step of a filter."""

    time: float
    """[s] at its end"""
    carry: Array
    """Matrix that made it of the state before, (state, state)"""
    predicted: Array
    """State before the measurements of this time, (state,)"""
    predicted_covariance: Array
    estimate: Array
    """State after them"""
    covariance: Array


@dataclasses.dataclass(frozen=True, kw_only=True)
class CurrentForecast:
    """The current at later times and the displacement by it, with their covariances."""

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


@dataclasses.dataclass(frozen=True, kw_only=True)
class SmoothedTrack:
    """Positions and currents at the end of each recorded step; several may share a time."""

    times: Array
    """[s], (node,)"""
    position: Array
    """North, east [m], (node, 2)"""
    position_covariance: Array
    """[m2], (node, 2, 2)"""
    current: Array
    """North, east [m/s], (node, 2)"""
    current_covariance: Array
    """[m2/s2], (node, 2, 2)"""
    dive: Array
    """North, east [m/s] that the dive under way adds, (node, 2)"""


def smoothed(
    nodes: Sequence[Node], *, position: slice, current: Array, dive: slice
) -> SmoothedTrack:
    """The smoothed track of a filter's steps.

    Args:
      nodes: in order of time.
      position, dive: where they are in the state.
      current: what makes the current of a state, (2, state).
    """
    count, size = len(nodes), len(nodes[-1].estimate)
    mean, spread = nodes[-1].estimate, nodes[-1].covariance
    states, spreads = np.empty((count, size)), np.empty((count, size, size))
    states[-1], spreads[-1] = mean, spread
    for k in range(count - 2, -1, -1):
        one, after = nodes[k], nodes[k + 1]
        deviation = np.sqrt(np.maximum(np.diag(after.predicted_covariance), 0.0))
        unit = np.where(deviation > 0.0, deviation, 1.0)
        known = after.predicted_covariance / np.outer(unit, unit) + _JITTER * np.eye(size)
        cross = (after.carry @ one.covariance) / unit[:, None]
        gain = np.linalg.solve(known, cross).T / unit[None, :]
        mean = one.estimate + gain @ (mean - after.predicted)
        spread = one.covariance + gain @ (spread - after.predicted_covariance) @ gain.T
        spread = 0.5 * (spread + spread.T)
        states[k], spreads[k] = mean, spread
    return SmoothedTrack(
        times=np.array([node.time for node in nodes]),
        position=states[:, position],
        position_covariance=spreads[:, position, position],
        current=states @ current.T,
        current_covariance=current @ spreads @ current.T,
        dive=states[:, dive],
    )
