"""Noisy: what is measured of a vehicle, with errors, by the names of `twin.suite.physics`.

Goals are worked out from the same noisy numbers that are shown, so that no observation tells what
another one hides.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError

Array = NDArray[np.float64]

UNSHOWN = {"heading": 1, "position": 2}
"""Measurements behind goals that are no observations themselves, and how many numbers each has:
heading [rad]; north and east [m]."""


class Noisy:
    """Measurements plus errors; each is shaped as that of the physics, of one vehicle or many."""

    def __init__(self, seen: Any, errors: Mapping[str, Array]):
        """Put errors on what is `seen`.

        Args:
          seen: a Physics, a ManyPhysics or a Believed.
          errors: by the names of `GliderTask.observe_vehicle` and of UNSHOWN, in their units, shape
            (numbers,) or (vehicles, numbers). What is not named has none.
        """
        self._seen, self._errors = seen, errors

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        raise InputError(
            f"noise: a goal of this task is made of physics.{name}, which has no noisy form: work "
            f"the goal out from {', '.join(sorted(_MEASURED))}"
        )

    def _one(self, name: str, part: int = 0) -> Any:
        """The error of one number of a measurement."""
        errors = self._errors.get(name)
        return 0.0 if errors is None else errors[..., part]

    def time(self) -> Any:
        """[s], without an error."""
        return self._seen.time()

    def roll(self) -> Any:
        """[rad]"""
        return self._seen.roll() + self._one("attitude", 0)

    def pitch(self) -> Any:
        """[rad]"""
        return self._seen.pitch() + self._one("attitude", 1)

    def heading(self) -> Any:
        """[rad] in [0, 2 pi)"""
        return (self._seen.heading() + self._one("heading")) % (2.0 * np.pi)

    def rates(self) -> Array:
        """Roll, pitch, yaw rate [rad/s], (..., 3)."""
        return np.asarray(self._seen.rates() + self._errors.get("rates", 0.0))

    def velocity_through_water(self) -> Array:
        """Surge, sway, heave [m/s], (..., 3)."""
        return np.asarray(self._seen.velocity_through_water() + self._errors.get("velocity", 0.0))

    def surge(self) -> Any:
        """[m/s] through the water."""
        return self.velocity_through_water()[..., 0]

    def speed(self) -> Any:
        """[m/s] through the water."""
        return np.linalg.norm(self.velocity_through_water(), axis=-1)

    def depth(self) -> Any:
        """[m]"""
        return self._seen.depth() + self._one("depth")

    def depth_rate(self) -> Any:
        """[m/s]"""
        return self._seen.depth_rate() + self._one("depth_rate")

    def actuators(self) -> Array:
        """Positions of the parts as fractions of their travel, (..., parts)."""
        return np.asarray(self._seen.actuators() + self._errors.get("actuators", 0.0))

    def net_buoyancy(self) -> Any:
        """[kg], + = heavy."""
        return self._seen.net_buoyancy() + self._one("net_buoyancy")

    def north(self) -> Any:
        """[m]"""
        return self._seen.north() + self._one("position", 0)

    def east(self) -> Any:
        """[m]"""
        return self._seen.east() + self._one("position", 1)

    def current(self) -> Array:
        """Of the water, NED [m/s], (..., 3), without an error of its own."""
        return np.asarray(self._seen.current())


_MEASURED = [name for name in vars(Noisy) if not name.startswith("_")]
