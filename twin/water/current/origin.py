"""Where and when a mission starts: the geographic anchor of its north-east-down frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

from twin import geodesy
from twin.errors import CurrentError
from twin.water.current import arguments as checks

EARTH_ROTATION = 7.292115e-5
"""[rad/s] Angular rate of the Earth (WGS84); f = 2 EARTH_ROTATION sin(latitude)."""

HIGHEST_LATITUDE = 88.0
"""[degree] Nearer to a pole local north and east metres lose their meaning over a mission."""


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Start point of a mission at the mean sea surface, and its start time."""

    latitude_deg: float = 36.8
    """[degree] North positive, WGS84. Default: off Monterey Bay, the paper's sea area."""

    longitude_deg: float = -122.4
    """[degree] East positive, any turn (-180..180 or 0..360). Default: 50 km off the coast over
    about 2000 m of water, where the mooring M2 of MBARI was."""

    time: str | None = None
    """UTC, ISO 8601 ("2000-01-05T12:00"); None where nothing depends on the date: what is flown
    then carries DEFAULT_TIME."""

    def __post_init__(self) -> None:
        latitude = checks.finite("origin", "latitude_deg", self.latitude_deg, "degree")
        if abs(latitude) > HIGHEST_LATITUDE:
            raise CurrentError(
                f"origin: latitude_deg must be within -{HIGHEST_LATITUDE:g}..{HIGHEST_LATITUDE:g}"
                f" degree, not {latitude:g}"
            )
        checks.finite("origin", "longitude_deg", self.longitude_deg, "degree")

    @property
    def meridian_radius(self) -> float:
        """[m] WGS84 radius of curvature in the meridian, M."""
        return geodesy.meridian_radius(self.latitude_deg)

    @property
    def normal_radius(self) -> float:
        """[m] WGS84 radius of curvature in the prime vertical, N."""
        return geodesy.normal_radius(self.latitude_deg)

    @property
    def curvature(self) -> float:
        """[1/m] tan(latitude)/N: how fast the meridians converge, for the grid sampler.

        A point (n, e) of the tangent plane lies at latitude0 + (n - e^2 curvature/2)/M and
        longitude0 + e (1 + n curvature)/(N cos latitude0), to second order in distance/radius.
        """
        return geodesy.convergence(self.latitude_deg)


DEFAULT_TIME = "2020-01-01T00:00:00"
"""UTC start of missions that do not say when they begin: a round date, which nothing depends on"""
FORMER_DEFAULT = Origin(longitude_deg=-121.8)
"""What descriptions of earlier versions say where nobody had said a place: a beach"""
SAME_PLACE = 1e-9
"""[degree] 0.1 mm: places nearer to each other are one"""


def same_place(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Whether two places (latitude, longitude) [degree] are one, whatever turn they are in."""
    turned = math.remainder(one[1] - other[1], 360.0)
    return max(abs(one[0] - other[0]), abs(turned)) <= SAME_PLACE


def coriolis(latitude_deg: float) -> float:
    """[rad/s] Coriolis parameter f = 2 Omega sin(latitude), negative in the south."""
    return 2.0 * EARTH_ROTATION * math.sin(math.radians(latitude_deg))
