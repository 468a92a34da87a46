"""What goes into a Fossen simulation and what comes out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twin.errors import InputError
from twin.frames import quaternion_to_euler
from twin.numbers import Array


def finite(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    """`values` as a float array of `shape`; InputError names it when it is not one."""
    array = np.array(values, dtype=np.float64)
    if array.shape != shape or not np.all(np.isfinite(array)):
        raise InputError(f"{name} must be finite with shape {shape}, not {values!r}")
    return array


@dataclass(frozen=True, kw_only=True)
class FossenState:
    """Where a simulation starts; everything at rest at the origin unless given."""

    time: float = 0.0
    """[s], the time at which the current is sampled first"""
    position_ned: ArrayLike = (0.0, 0.0, 0.0)
    """of the CB [m], shape (3,), north, east, depth"""
    attitude: ArrayLike = (0.0, 0.0, 0.0)
    """roll, pitch, heading [rad], shape (3,)"""
    v_rel: ArrayLike = (0.0, 0.0, 0.0)
    """velocity of the CB through the water [m/s], shape (3,), body FRD"""
    rates: ArrayLike = (0.0, 0.0, 0.0)
    """p, q, r [rad/s], shape (3,), body FRD"""
    actuators: ArrayLike = ()
    """positions of the parts, shape (parts,), in their units; empty: at rest"""

    def __post_init__(self) -> None:
        finite("time", self.time, ())
        for name in ("position_ned", "attitude", "v_rel", "rates"):
            object.__setattr__(self, name, finite(name, getattr(self, name), (3,)))
        object.__setattr__(
            self, "actuators", finite("actuators", self.actuators, (np.size(self.actuators),))
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class FossenTrajectory:
    """A simulated track, sampled; every array has the samples along its first axis."""

    time: Array
    """[s], shape (n,)"""
    position_ned: Array
    """of the CB [m], shape (n, 3)"""
    quaternion: Array
    """scalar-first, body to NED, shape (n, 4)"""
    v_rel: Array
    """velocity through the water [m/s], shape (n, 3), body FRD"""
    rates: Array
    """p, q, r [rad/s], shape (n, 3), body FRD"""
    actuators: Array
    """positions of the parts in their units, a glider's shift [m], rotation [rad], pump [cm3];
    shape (n, parts)"""
    current_ned: Array
    """current at the CB [m/s], shape (n, 3)"""
    velocity_ned: Array
    """velocity of the CB over ground [m/s], shape (n, 3)"""

    @property
    def attitude(self) -> Array:
        """roll, pitch, heading [rad], shape (n, 3); heading in [0, 2 pi)"""
        return np.stack(quaternion_to_euler(self.quaternion), axis=-1)

    @property
    def speed(self) -> Array:
        """through the water [m/s], shape (n,)"""
        return np.linalg.norm(self.v_rel, axis=-1)
