"""Axes of a CF data set: coordinates of time, depth, latitude and longitude, and their values.

Attributes decide first, then the usual names. Grids that are not rectilinear in latitude and
longitude raise CurrentError, which advises a conversion.

The module also holds a mission's start place and time, the origin of its north-east-down frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from twin import geodesy
from twin.errors import CurrentError, unknown_name
from twin.water.current import checks
from twin.water.current.sampler import Floats

if TYPE_CHECKING:
    import xarray as xr


AXIS_NAMES = {
    "time": {"time", "time_counter", "t", "ocean_time", "time_centered", "mt"},
    "depth": {"depth", "depthu", "depthv", "depthw", "deptht", "lev", "level", "z", "z_t",
              "st_ocean", "zlev", "altitude", "height", "elevation"},
    "latitude": {"lat", "latitude", "y_lat", "nav_lat", "yt_ocean", "yu_ocean"},
    "longitude": {"lon", "longitude", "long", "x_lon", "nav_lon", "xt_ocean", "xu_ocean"},
}  # fmt: skip
"""Coordinate names per axis for files without attributes; case is ignored."""

LATITUDE_UNITS = {"degrees_north", "degree_north", "degrees_n", "degree_n", "degreen", "degreesn"}
LONGITUDE_UNITS = {"degrees_east", "degree_east", "degrees_e", "degree_e", "degreee", "degreese"}

DEPTH_UNITS = {"m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "": 1.0,
               "km": 1000.0, "cm": 0.01}  # fmt: skip
"""[m] Length of each depth unit; a depth without units is in metres."""

REGRID = (
    "bring u and v to common points, rotate them to east and north and regrid to one-dimensional"
    " latitude and longitude first (for example with cdo or xesmf)"
)
"""Advice for curvilinear, staggered and grid-relative files."""


class Axis(NamedTuple):
    """One coordinate of the velocity variables, in the file's order."""

    dimension: str
    """Dimension of the velocity variables."""
    coordinate: str
    """Variable that holds the values."""


def _coordinate(data: xr.Dataset, dimension: str) -> str | None:
    """Find the variable of a dimension's values: its namesake or a 1-D auxiliary one."""
    if dimension in data.variables and data[dimension].ndim == 1:
        return dimension
    for name, variable in data.variables.items():
        if variable.dims == (dimension,) and _axis_kind(data, str(name)):
            return str(name)
    return None


def _axis_kind(data: xr.Dataset, name: str) -> str | None:
    """Classify a coordinate as time, depth, latitude or longitude by attribute, then by name."""
    attrs = data[name].attrs
    standard = str(attrs.get("standard_name", ""))
    units = str(attrs.get("units", "")).lower()
    if standard in ("time", "latitude", "longitude", "depth"):
        return standard
    if standard in ("altitude", "height", "height_above_mean_sea_level"):
        return "depth"
    # model coordinates may have an axis letter although they are not in metres or degrees
    if standard.startswith(("projection_", "ocean_s", "sea_water_pressure")):
        return None
    if units in LATITUDE_UNITS:
        return "latitude"
    if units in LONGITUDE_UNITS:
        return "longitude"
    if " since " in units or np.issubdtype(data[name].dtype, np.datetime64):
        return "time"
    for kind, names in AXIS_NAMES.items():
        if name.lower() in names:
            return kind
    for kind, prefix in (("latitude", "lat"), ("longitude", "lon")):
        if name.lower().startswith(prefix):
            return kind
    return {"T": "time", "Z": "depth"}.get(str(attrs.get("axis", "")).upper())


def find_axes(data: xr.Dataset, source: str, name: str) -> dict[str, Axis]:
    """Find the axes of variable `name` among time, depth, latitude and longitude.

    Other dimensions of length 1 are ignored. Raises CurrentError, naming the `source`, at longer
    ones and at grids that are not rectilinear.
    """
    axes: dict[str, Axis] = {}
    for dimension in map(str, data[name].dims):
        coordinate = _coordinate(data, dimension)
        kind = _axis_kind(data, coordinate) if coordinate else None
        if kind is None:
            if data.sizes[dimension] == 1:
                continue
            raise CurrentError(f"{source}: {_refusal(data, name, dimension)}")
        if kind in axes:
            raise CurrentError(f"{source}: {name!r} has two {kind} axes, it must have one at most")
        assert coordinate is not None
        axes[kind] = Axis(dimension, coordinate)
    if ("latitude" in axes) != ("longitude" in axes):
        raise CurrentError(
            f"{source}: {name!r} has only one of latitude and longitude as a dimension; it needs"
            " both, or neither for one water column"
        )
    return axes


def _refusal(data: xr.Dataset, name: str, dimension: str) -> str:
    """Reason why a dimension of a velocity variable cannot be used, with advice."""
    plane = [str(n) for n, v in data.variables.items() if v.ndim >= 2 and dimension in v.dims]
    curvilinear = [n for n in plane if _axis_kind(data, n) in ("latitude", "longitude")]
    if curvilinear:
        return (
            f"{name!r} lies on the two-dimensional coordinate {curvilinear[0]!r} (curvilinear"
            f" grid, vectors relative to its axes); {REGRID}"
        )
    attrs = data[dimension].attrs if dimension in data.variables else {}
    standard = str(attrs.get("standard_name", ""))
    if dimension.startswith("s_") or standard.startswith(("ocean_s", "ocean_sigma")):
        return (
            f"{name!r} has terrain-following levels {dimension!r}; interpolate to fixed depths in"
            " metres first (for example with xroms or xgcm)"
        )
    if standard.startswith("projection_") or dimension.lower() in ("x", "y"):
        return f"{name!r} lies on a projected grid (dimension {dimension!r}); {REGRID}"
    if "pressure" in standard or str(attrs.get("units", "")).lower() in ("dbar", "decibar"):
        return f"{name!r} is given at pressure {dimension!r}; convert it to depth in metres first"
    if dimension.startswith(("eta", "xi")):
        return f"{name!r} lies on a curvilinear grid (dimension {dimension!r}); {REGRID}"
    return (
        f"dimension {dimension!r} of {name!r} is not time, depth, latitude or longitude;"
        " select one element of it or give its coordinate a standard_name"
    )


def depth_values(data: xr.Dataset, source: str, axis: Axis) -> Floats:
    """Depths [m], positive down, in the file's order; raises CurrentError for heights."""
    variable = data[axis.coordinate]
    values = np.asarray(variable.values, dtype=np.float64)
    units = str(variable.attrs.get("units", "")).strip().lower()
    if units not in DEPTH_UNITS:
        text = unknown_name("depth units", units, DEPTH_UNITS)
        raise CurrentError(f"{source}: {axis.coordinate!r}: {text}; convert it to metres")
    values = values * DEPTH_UNITS[units]
    if not np.isfinite(values).all():
        raise CurrentError(f"{source}: {axis.coordinate!r} holds missing values")
    upward = str(variable.attrs.get("positive", "")).lower() == "up" or variable.attrs.get(
        "standard_name"
    ) in ("altitude", "height", "height_above_mean_sea_level")
    # some files say positive down but count downward from zero: the values decide
    if (upward and not (values > 0).any()) or (values <= 0).all():
        values = -values
    elif upward:
        raise CurrentError(
            f"{source}: {axis.coordinate!r} has the attribute positive up and values up to"
            f" {values.max():g} m above the surface; correct its attribute 'positive'"
        )
    # negation leaves -0.0, which would print and hash differently from 0.0
    values = values + 0.0
    if (values < 0).any():
        raise CurrentError(
            f"{source}: {axis.coordinate!r} mixes depths below and heights above the surface"
            f" ({values.min():g} to {values.max():g} m); keep the levels below the surface"
        )
    return values


def time_values(data: xr.Dataset, source: str, axis: Axis) -> np.ndarray:
    """Times as datetime64[ns] (UTC), in the file's order."""
    import xarray as xr

    variable = data[axis.coordinate]
    if np.issubdtype(variable.dtype, np.datetime64):
        return variable.values.astype("datetime64[ns]")
    units = str(variable.attrs.get("units", ""))
    if " since " not in units:
        raise CurrentError(
            f"{source}: {axis.coordinate!r} has units {units!r}, not e.g. 'hours since 2000-01-01'"
        )
    try:
        values = xr.decode_cf(data[[axis.coordinate]])[axis.coordinate].values
    except (ValueError, OverflowError, ImportError) as error:
        raise CurrentError(f"{source}: cannot decode {axis.coordinate!r}: {error}") from None
    if not np.issubdtype(values.dtype, np.datetime64):
        calendar = variable.attrs.get("calendar", "unknown")
        raise CurrentError(
            f"{source}: {axis.coordinate!r} uses the calendar {calendar!r}; convert it to the"
            " standard calendar first (for example cdo setcalendar,standard)"
        )
    values = values.astype("datetime64[ns]")
    if np.isnat(values).any():
        raise CurrentError(f"{source}: {axis.coordinate!r} holds missing times")
    return values


EARTH_ROTATION = 7.292115e-5
"""[rad/s] Angular rate of the Earth (WGS84); f = 2 EARTH_ROTATION sin(latitude)."""

HIGHEST_LATITUDE = 88.0
"""[degree] Highest latitude of an origin; nearer to a pole, north and east rotate along a track."""


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Start point of a mission at the mean sea surface, and its start time."""

    latitude_deg: float = 36.8
    """[degree] North positive, WGS84. Default: off Monterey Bay, the paper's sea area."""
    longitude_deg: float = -122.4
    """[degree] East positive, -180..180 or 0..360. Default: 50 km off the coast in about 2000 m of
    water, where MBARI's mooring M2 was."""
    time: str | None = None
    """UTC, ISO 8601 ("2000-01-05T12:00"); None: nothing depends on the date, and stored missions
    get DEFAULT_TIME."""

    def __post_init__(self) -> None:
        latitude = checks.finite("origin", "latitude_deg", self.latitude_deg, "degree")
        if abs(latitude) > HIGHEST_LATITUDE:
            raise CurrentError(
                f"origin: latitude_deg must be within -{HIGHEST_LATITUDE:g}..{HIGHEST_LATITUDE:g}"
                f" degree, not {latitude:g}"
            )
        checks.finite("origin", "longitude_deg", self.longitude_deg, "degree")

    def latitude(self, given: float | None) -> float:
        """Return the `given` latitude [degree], or the origin's for None."""
        return self.latitude_deg if given is None else given

    @property
    def meridian_radius(self) -> float:
        """WGS84 radius of curvature in the meridian, M [m]."""
        return geodesy.meridian_radius(self.latitude_deg)

    @property
    def normal_radius(self) -> float:
        """WGS84 radius of curvature in the prime vertical, N [m]."""
        return geodesy.normal_radius(self.latitude_deg)

    @property
    def curvature(self) -> float:
        """Convergence of the meridians tan(latitude)/N [1/m], for the grid sampler.

        A point (n, e) of the tangent plane lies at latitude0 + (n - e^2 curvature/2)/M and
        longitude0 + e (1 + n curvature)/(N cos latitude0), to second order in distance/radius.
        """
        return geodesy.convergence(self.latitude_deg)


DEFAULT_TIME = "2020-01-01T00:00:00"
"""UTC start of missions without a time: an arbitrary round date."""
FORMER_DEFAULT = Origin(longitude_deg=-121.8)
"""Start place in descriptions of earlier versions for missions without a place: a beach."""
SAME_PLACE = 1e-9
"""[degree] Distance below which two places are one: 0.1 mm."""


def same_place(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Compare two places (latitude, longitude) [degree], ignoring full turns of longitude."""
    turned = math.remainder(one[1] - other[1], 360.0)
    return max(abs(one[0] - other[0]), abs(turned)) <= SAME_PLACE


def coriolis(latitude_deg: float) -> float:
    """Coriolis parameter f = 2 Omega sin(latitude) [rad/s], negative in the south."""
    return 2.0 * EARTH_ROTATION * math.sin(math.radians(latitude_deg))
