"""Moving mass: a body that a slide or a hinge moves inside the hull, such as a battery."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class MovingMass:
    """A mass on the hull's axis that slides along it, turns about it, or both."""

    name: str
    """of its body in the vehicle file"""
    mass: float
    """[kg]"""
    inertia: Array
    """[kg m2], shape (3, 3), body FRD, about its own CG with the hinge at 0"""
    neutral_x: float
    """[m], of its CG forward of the CB with the slide at 0"""
    eccentricity: float
    """[m], of its CG below the axis with the hinge at 0"""
    slide: str | None = None
    """part that slides it, None: none does"""
    hinge: str | None = None
    """part that turns it, None: none does"""

    def position(self, shift: float, rotation: float) -> Array:
        """CG [m], shape (3,), body FRD, at `shift` [m] and `rotation` [rad].

        Positive rotation puts it to port (Zhang et al. 2013).
        """
        lateral = -self.eccentricity * math.sin(rotation)
        vertical = self.eccentricity * math.cos(rotation)
        return np.array([self.neutral_x + shift, lateral, vertical])
