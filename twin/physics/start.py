"""Start: where and how a simulation begins."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twin.errors import InputError, unknown_name


@dataclasses.dataclass(frozen=True, kw_only=True)
class Start:
    """Where and how a simulation begins."""

    north: float = 0.0
    """[m]"""
    east: float = 0.0
    """[m]"""
    depth: float = 0.0
    """[m], of the CB"""
    roll: float = 0.0
    """[rad]"""
    pitch: float = 0.0
    """[rad]"""
    heading: float = 0.0
    """[rad]"""
    v_rel: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Surge, sway, heave through the water [m/s]; zero drifts with the water."""
    rates: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw rate [rad/s], body FRD"""
    actuators: tuple[float, ...] | Mapping[str, float] = ()
    """positions of the parts, all in their order or some by name, in their units; empty: at rest"""

    def positions(self, names: Sequence[str], rest: ArrayLike) -> NDArray[np.float64]:
        """Position of each part, shape (parts,).

        Args:
          names: of the vehicle's parts. rest: their positions where nothing is said, (parts,).

        Raises:
          InputError: `actuators` has another width, or names a part that is not there.
        """
        positions = np.array(rest, dtype=np.float64)
        if isinstance(self.actuators, Mapping):
            for name, value in self.actuators.items():
                if name not in names:
                    raise InputError(unknown_name("part", name, names))
                positions[list(names).index(name)] = value
        elif len(self.actuators):
            if len(self.actuators) != len(positions):
                raise InputError(
                    f"start: actuators has {len(self.actuators)} positions, the vehicle has "
                    f"{len(positions)} parts: {', '.join(names)}"
                )
            positions[:] = self.actuators
        return positions
