"""Ellipse: what a covariance of north and east looks like on a map."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def chi_squared(part: float) -> float:
    """Squared Mahalanobis distance within which a part of normal points of a plane lies.

    The quantile of chi-squared with two degrees of freedom, -2 ln(1 - part).
    """
    return -2.0 * math.log1p(-part)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ellipse:
    """By its semi-axes: from the middle to the edge."""

    semi_major_m: float
    """[m] half of the longer axis"""
    semi_minor_m: float
    """[m] half of the shorter axis"""
    bearing_deg: float
    """[degree] of the longer axis, clockwise from north, 0 to 180"""

    @classmethod
    def of(cls, squares: Array) -> Ellipse:
        """The ellipse x^T squares^-1 x = 1 of north and east; `squares` [m2], (2, 2)."""
        (minor, major), axes = _axes(squares)
        return cls(
            semi_major_m=float(major),
            semi_minor_m=float(minor),
            bearing_deg=math.degrees(math.atan2(axes[1, 1], axes[0, 1])) % 180.0,
        )


def outline(squares: Array, points: int) -> Array:
    """North, east [m] around `Ellipse.of(squares)`, (points, 2), closed.

    Counterclockwise seen from above, from north over west, as GeoJSON has it.
    """
    angles = np.linspace(0.0, 2.0 * math.pi, points)
    lengths, axes = _axes(squares)
    if np.linalg.det(axes) > 0.0:
        axes = axes * [1.0, -1.0]
    return np.asarray(((axes * lengths) @ np.stack([np.cos(angles), np.sin(angles)])).T)


def _axes(squares: Array) -> tuple[Array, Array]:
    """Lengths, the shorter first, (2,), and directions, (2, 2), in columns."""
    values, vectors = np.linalg.eigh(squares)
    return np.sqrt(np.maximum(values, 0.0)), vectors
