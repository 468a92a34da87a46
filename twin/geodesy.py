"""Geodesy: conversions between metres and degrees on the WGS84 ellipsoid, for all packages.

There are two conventions:

- `offset` and `position` count metres along the meridian and along the parallel of the mean
  latitude, as dead reckoning by compass adds them up, to second order in distance over the Earth's
  radius. Logs and their displacements use this.
- `from_tangent_plane` takes north and east in the plane that touches the Earth at an origin, and
  finds the place below. A simulated mission moves in such a plane.

The two differ by tan(latitude) east^2 / 2 R: 0.6 m for 3 km east at 40 degree.

pymap3d has the same radii (equal to 4e-16) and the same plane (within 1 mm to 500 km), but not the
first convention. Its import would cost each start 40 ms. So only the tests compare with pymap3d.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np

from twin.numbers import Array

Number = TypeVar("Number", float, Array)

WGS84_SEMI_MAJOR = 6378137.0
"""[m] Semi-major axis of the WGS84 ellipsoid (NGA.STND.0036)."""
WGS84_FLATTENING = 1.0 / 298.257223563
"""Flattening of the WGS84 ellipsoid (NGA.STND.0036)."""
_E2 = WGS84_FLATTENING * (2.0 - WGS84_FLATTENING)
"""First eccentricity, squared."""


def meridian_radius(latitude_deg: float) -> float:
    """[m] Radius of curvature in the meridian, M, at a latitude [degree]."""
    s = math.sin(math.radians(latitude_deg))
    return _meridian(1.0 - _E2 * s * s)


def normal_radius(latitude_deg: float) -> float:
    """[m] Radius of curvature in the prime vertical, N, at a latitude [degree]."""
    s = math.sin(math.radians(latitude_deg))
    return float(_normal(1.0 - _E2 * s * s))


def convergence(latitude_deg: float) -> float:
    """[1/m] Convergence of the meridians, tan(latitude)/N, at a latitude [degree]."""
    return math.tan(math.radians(latitude_deg)) / normal_radius(latitude_deg)


def offset(
    latitude: Array | np.float64, longitude: Array | np.float64, latitude0: float, longitude0: float
) -> tuple[Array, Array]:
    """North and east [m] of positions [degree] from (latitude0, longitude0).

    Distances run along the meridian and the parallel of the mean latitude, the short way round.
    """
    middle = np.radians(0.5 * (np.asarray(latitude) + latitude0))
    w = 1.0 - _E2 * np.sin(middle) ** 2
    turn = (np.asarray(longitude) - longitude0 + 180.0) % 360.0 - 180.0
    north = np.radians(np.asarray(latitude) - latitude0) * _meridian(w)
    east = np.radians(turn) * _normal(w) * np.cos(middle)
    return north, east


def position(north: Array, east: Array, latitude0: float, longitude0: float) -> tuple[Array, Array]:
    """Latitude and longitude [degree] of points `offset` by north and east [m].

    The radii are those at (latitude0, longitude0). `offset` inverts this to 0.4 m at 20 km, and
    to 4 mm at 2 km.
    """
    turned = np.degrees(north / meridian_radius(latitude0))
    middle = np.radians(latitude0 + 0.5 * turned)
    around = np.degrees(east / (normal_radius(latitude0) * np.cos(middle)))
    return latitude0 + turned, longitude0 + around


def from_tangent_plane(
    north: Array, east: Array, latitude0: float, longitude0: float
) -> tuple[Array, Array]:
    """Latitude and longitude [degree] of points [m] in the plane tangent at an origin [degree].

    A point of the plane and its place are on one normal of the ellipsoid.
    """
    origin, axes = _plane(latitude0, longitude0)
    x, y, z = origin[:, None] + axes[:, :2] @ np.array([np.ravel(north), np.ravel(east)])
    # Bowring 1976, Survey Review 23: latitude of a point near the ellipsoid
    p, polar = np.hypot(x, y), 1.0 - WGS84_FLATTENING
    reduced = np.arctan2(z, polar * p)
    rise = z + _E2 / polar * WGS84_SEMI_MAJOR * np.sin(reduced) ** 3
    latitude = np.arctan2(rise, p - _E2 * WGS84_SEMI_MAJOR * np.cos(reduced) ** 3)
    turned = np.mod(np.degrees(np.arctan2(y, x)) - longitude0 + 180.0, 360.0) - 180.0
    shape = np.shape(north)
    return np.degrees(latitude).reshape(shape), (longitude0 + turned).reshape(shape)


def to_tangent_plane(
    latitude: float, longitude: float, latitude0: float, longitude0: float
) -> tuple[float, float]:
    """North and east [m] of a place [degree] in the plane tangent at an origin [degree].

    This inverts `from_tangent_plane` for places less than 90 degrees of arc from the origin.
    """
    origin, axes = _plane(latitude0, longitude0)
    place, directions = _plane(latitude, longitude)
    north, east, down = (place - origin) @ axes
    up = -directions[:, 2] @ axes
    height = -down / up[2]  # at which the normal of the place meets the plane
    return float(north + height * up[0]), float(east + height * up[1])


def _plane(latitude: float, longitude: float) -> tuple[Array, Array]:
    """Earth-centred place [m] of a point of the ellipsoid, and its axes NED as columns, (3, 3)."""
    (s, c), (sl, cl) = (
        (math.sin(angle), math.cos(angle)) for angle in np.radians([latitude, longitude]).tolist()
    )
    n = normal_radius(latitude)
    axes = np.array([[-s * cl, -sl, -c * cl], [-s * sl, cl, -c * sl], [c, 0.0, -s]])
    return n * np.array([c * cl, c * sl, (1.0 - _E2) * s]), axes


def great_circle(latitude: float, longitude: float, latitude0: float, longitude0: float) -> float:
    """[m] Great-circle distance of two places [degree] on a sphere, within 0.6 %."""
    a, b = math.radians(latitude), math.radians(latitude0)
    across = math.radians(longitude - longitude0)
    haversine = (
        math.sin(0.5 * (a - b)) ** 2 + math.cos(a) * math.cos(b) * math.sin(0.5 * across) ** 2
    )
    return 2.0 * WGS84_SEMI_MAJOR * math.asin(math.sqrt(min(haversine, 1.0)))


def wrap_longitude(longitude: Array) -> Array:
    """Wrap longitudes [degree] into [-180, 180)."""
    return np.asarray(np.mod(longitude + 180.0, 360.0) - 180.0)


def turn(x: Array, y: Array, variation_deg: Array | float) -> tuple[Array, Array]:
    """Rotate vectors from magnetic east `x` and magnetic north `y` to true north and east.

    A magnetic bearing b is the true bearing b + variation, east variation positive.
    """
    angle = np.radians(variation_deg)
    cosine, sine = np.cos(angle), np.sin(angle)
    return y * cosine - x * sine, x * cosine + y * sine


def _meridian(w: Number) -> Number:
    """[m] Meridian radius M, with w = 1 - e^2 sin(latitude)^2."""
    return WGS84_SEMI_MAJOR * (1.0 - _E2) / w**1.5


def _normal(w: Number) -> Number:
    """[m] Prime vertical radius N, with w = 1 - e^2 sin(latitude)^2."""
    return WGS84_SEMI_MAJOR / np.sqrt(w)
