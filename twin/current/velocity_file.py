"""Which variables and axes of a CF data set hold the current, and in which units and sense.

`standard_name` decides first, then the usual names of Copernicus Marine, HYCOM, NEMO, altimetry
and instrument files. What cannot be read as eastward and northward velocity on a rectilinear
latitude-longitude grid is refused with the way out.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.current.layout import Floats
from twin.errors import CurrentError, unknown_name

if TYPE_CHECKING:
    import xarray as xr

STANDARD_NAMES = {
    "east": ("eastward_sea_water_velocity",
             "surface_geostrophic_eastward_sea_water_velocity",
             "surface_eastward_sea_water_velocity",
             "eastward_sea_water_velocity_assuming_no_tide"),
    "north": ("northward_sea_water_velocity",
              "surface_geostrophic_northward_sea_water_velocity",
              "surface_northward_sea_water_velocity",
              "northward_sea_water_velocity_assuming_no_tide"),
    "up": ("upward_sea_water_velocity",),
    "down": ("downward_sea_water_velocity",),
}  # fmt: skip
"""CF standard names per component, best first."""

ALIASES = {
    "east": ("uo", "water_u", "u", "vozocrtx", "ugos", "uvel", "ucur", "u_ocn", "east"),
    "north": ("vo", "water_v", "v", "vomecrty", "vgos", "vvel", "vcur", "v_ocn", "north"),
    "up": ("wo", "water_w", "w", "vovecrtz", "wvel", "w_ocn"),
}
"""Variable names per component when no standard name tells, best first; case is ignored."""

GRID_RELATIVE = {
    "x_sea_water_velocity",
    "y_sea_water_velocity",
    "sea_water_x_velocity",
    "sea_water_y_velocity",
    "ocean_sigma_x_velocity",
}
"""Standard names of components along a model's own axes."""

SPEED_UNITS = {
    "m/s": 1.0, "m s-1": 1.0, "m s^-1": 1.0, "m.s-1": 1.0, "m s**-1": 1.0, "ms-1": 1.0,
    "meter/second": 1.0, "meters/second": 1.0, "metre/second": 1.0, "meter second-1": 1.0,
    "metre second-1": 1.0, "meters second-1": 1.0, "meter/sec": 1.0, "m/sec": 1.0,
    "cm/s": 0.01, "cm s-1": 0.01, "cm s^-1": 0.01, "cm.s-1": 0.01, "cm s**-1": 0.01,
    "centimeter/s": 0.01, "centimeter/second": 0.01, "centimeters/second": 0.01, "cm/sec": 0.01,
    "centimeter second-1": 0.01,
    "mm/s": 0.001, "mm s-1": 0.001,
}  # fmt: skip
"""[m/s] per unit, as files spell them (lower case)."""

DEPTH_UNITS = {"m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "": 1.0,
               "km": 1000.0, "cm": 0.01}  # fmt: skip
"""[m] per unit; a depth without units is in metres."""

AXIS_NAMES = {
    "time": {"time", "time_counter", "t", "ocean_time", "time_centered", "mt"},
    "depth": {"depth", "depthu", "depthv", "depthw", "deptht", "lev", "level", "z", "z_t",
              "st_ocean", "zlev", "altitude", "height", "elevation"},
    "latitude": {"lat", "latitude", "y_lat", "nav_lat", "yt_ocean", "yu_ocean"},
    "longitude": {"lon", "longitude", "long", "x_lon", "nav_lon", "xt_ocean", "xu_ocean"},
}  # fmt: skip
"""Coordinate names per axis when no attribute tells; case is ignored."""

LATITUDE_UNITS = {"degrees_north", "degree_north", "degrees_n", "degree_n", "degreen", "degreesn"}
LONGITUDE_UNITS = {"degrees_east", "degree_east", "degrees_e", "degree_e", "degreee", "degreese"}

ZERO_LAND_NAMES = {"vozocrtx", "vomecrty"}
"""Raw NEMO variables, where land is 0 and not a missing value."""

REGRID = (
    "bring u and v to common points, rotate them to east and north and regrid to one-dimensional"
    " latitude and longitude first (for example with cdo or xesmf)"
)
"""The way out for curvilinear, staggered and grid-relative files."""


@dataclass(frozen=True, kw_only=True)
class Axis:
    """One coordinate of the velocity variables, in the file's order."""

    dimension: str
    """Dimension of the velocity variables."""

    coordinate: str
    """Variable that holds the values."""


@dataclass(frozen=True, kw_only=True)
class Velocity:
    """Where the current is in a data set."""

    names: Mapping[str, str]
    """Variable per component: east, north and perhaps up or down."""

    scale: Mapping[str, float]
    """Factor per component to m/s; negative for an upward component stored as down."""

    axes: Mapping[str, Axis]
    """Those of time, depth, latitude, longitude that the variables have."""

    dimensions: Mapping[str, Mapping[str, str]]
    """Per component its dimension of each of those axes: depthu and depthv may be equal axes."""

    zero_is_land: bool
    """The names are those of raw NEMO output, which marks land by 0."""


def open_data_set(path: str) -> xr.Dataset:
    """The data set at a netCDF file or zarr store, values lazy, times undecoded.

    Times stay numbers because some HYCOM files carry a second time variable that cannot be
    decoded. Raises CurrentError when it cannot be read.
    """
    import xarray as xr

    remote = "://" in path
    if not remote and not Path(path).exists():
        raise CurrentError(f"no current file {path}: give a CF netCDF file or a zarr store")
    is_zarr = path.rstrip("/").endswith(".zarr") or (not remote and Path(path).is_dir())
    try:
        with warnings.catch_warnings():
            # A store without consolidated metadata only opens more slowly.
            warnings.filterwarnings("ignore", "Failed to open Zarr store with consolidated")
            return xr.open_dataset(
                path,
                engine="zarr" if is_zarr else None,
                decode_times=False,
                decode_timedelta=False,
            )
    except Exception as error:  # each backend raises its own kinds
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise CurrentError(f"cannot read {path} as CF netCDF or zarr: {reason}") from None


def find_velocity(
    data: xr.Dataset,
    source: str,
    chosen: Mapping[str, str | None],
    units: str | None = None,
) -> Velocity:
    """Find components, units and axes.

    source: the file's name for messages. chosen: variable names the user gave for "east",
    "north" and "up" (None: find it; "none" for up: leave it out). units: overrides the files'.
    """
    names: dict[str, str] = {}
    for component in ("east", "north", "up"):
        given = chosen.get(component)
        if given == "none" and component == "up":
            continue
        if given is not None:
            if given not in data.data_vars:
                text = unknown_name("variable", given, map(str, data.data_vars))
                raise CurrentError(f"{source}: {text}")
            names[component] = given
            continue
        found = _by_standard_name(data, source, component) or _by_alias(data, component)
        if found:
            names[component] = found
    downward = None if "up" in names or chosen.get("up") else _by_standard_name(
        data, source, "down")  # fmt: skip
    if downward:
        names["down"] = downward
    for component, example in (("east", "eastward"), ("north", "northward")):
        if component not in names:
            relative = [n for n, v in data.data_vars.items()
                        if v.attrs.get("standard_name") in GRID_RELATIVE]  # fmt: skip
            if relative:
                raise CurrentError(
                    f"{source}: {relative[0]!r} is relative to the model's own axes; {REGRID}"
                )
            raise CurrentError(
                f"{source} has no variable with standard_name {example}_sea_water_velocity nor a"
                f" known name ({', '.join(ALIASES[component])}); it holds"
                f" {', '.join(sorted(map(str, data.data_vars))) or 'nothing'}: name the variables"
                " with u=NAME,v=NAME"
            )
    for name in names.values():
        if data[name].attrs.get("standard_name") in GRID_RELATIVE:
            raise CurrentError(f"{source}: {name!r} is relative to the model's own axes; {REGRID}")
    if "up" in names and data[names["up"]].attrs.get("standard_name") in STANDARD_NAMES["down"]:
        names["down"] = names.pop("up")
    axes = _find_axes(data, source, names["east"])
    dimensions = {}
    for component, name in names.items():
        own = _find_axes(data, source, name)
        _same_points(data, source, names["east"], axes, name, own, component)
        dimensions[component] = {kind: axis.dimension for kind, axis in own.items()}
    scale = {c: _speed_factor(data, source, name, units) for c, name in names.items()}
    zero = any(name.lower() in ZERO_LAND_NAMES for name in names.values()) or any(
        axis.coordinate.lower() in ("depthu", "depthv") for axis in axes.values()
    )
    return Velocity(names=names, scale=scale, axes=axes, dimensions=dimensions, zero_is_land=zero)


def _by_standard_name(data: xr.Dataset, source: str, component: str) -> str | None:
    for standard in STANDARD_NAMES[component]:
        found = [str(n) for n, v in data.data_vars.items()
                 if v.attrs.get("standard_name") == standard]  # fmt: skip
        if len(found) > 1:
            known = [n for n in found if n.lower() in ALIASES.get(component, ())]
            if len(known) != 1:
                key = {"east": "u", "north": "v"}.get(component, "w")
                raise CurrentError(
                    f"{source}: {', '.join(found)} all have standard_name {standard}; choose one"
                    f" with {key}=NAME"
                )
            found = known
        if found:
            return found[0]
    return None


def _by_alias(data: xr.Dataset, component: str) -> str | None:
    lower = {str(name).lower(): str(name) for name in data.data_vars}
    return next((lower[alias] for alias in ALIASES[component] if alias in lower), None)


def _coordinate(data: xr.Dataset, dimension: str) -> str | None:
    """The variable that holds a dimension's values: its namesake or a 1-D auxiliary one."""
    if dimension in data.variables and data[dimension].ndim == 1:
        return dimension
    for name, variable in data.variables.items():
        if variable.dims == (dimension,) and _axis_kind(data, str(name)):
            return str(name)
    return None


def _axis_kind(data: xr.Dataset, name: str) -> str | None:
    """time, depth, latitude or longitude by attribute, then by name."""
    attrs = data[name].attrs
    standard = str(attrs.get("standard_name", ""))
    units = str(attrs.get("units", "")).lower()
    if standard in ("time", "latitude", "longitude", "depth"):
        return standard
    if standard in ("altitude", "height", "height_above_mean_sea_level"):
        return "depth"
    # Model coordinates may carry axis letters, and are still not metres or degrees.
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


def _find_axes(data: xr.Dataset, source: str, name: str) -> dict[str, Axis]:
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
        axes[kind] = Axis(dimension=dimension, coordinate=coordinate)
    if ("latitude" in axes) != ("longitude" in axes):
        raise CurrentError(
            f"{source}: {name!r} has only one of latitude and longitude as a dimension; it needs"
            " both, or neither for one water column"
        )
    return axes


def _refusal(data: xr.Dataset, name: str, dimension: str) -> str:
    """Why a dimension of a velocity variable cannot be used, and what to do."""
    curvilinear = [
        str(n)
        for n, v in data.variables.items()
        if v.ndim >= 2 and dimension in v.dims and _axis_kind(data, str(n)) in
        ("latitude", "longitude")
    ]  # fmt: skip
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
        f"dimension {dimension!r} of {name!r} is none of time, depth, latitude and longitude;"
        " select one element of it or give its coordinate a standard_name"
    )


def _same_points(
    data: xr.Dataset,
    source: str,
    first: str,
    axes: Mapping[str, Axis],
    name: str,
    own: Mapping[str, Axis],
    component: str,
) -> None:
    """Raise CurrentError unless `name`, with the axes `own`, lies on the points of `first`."""
    for kind in sorted({*axes, *own}):
        mine, its = axes.get(kind), own.get(kind)
        if mine is not None and its is not None:
            a, b = data[mine.coordinate].values, data[its.coordinate].values
            if a.shape == b.shape and np.array_equal(a, b):
                continue
        hint = " or leave it out with w=none" if component in ("up", "down") else ""
        raise CurrentError(
            f"{source}: {first!r} and {name!r} have different {kind} points (staggered grid);"
            f" interpolate them to common points first{hint}"
        )


def _speed_factor(data: xr.Dataset, source: str, name: str, units: str | None) -> float:
    given = units if units is not None else data[name].attrs.get("units")
    if given is None:
        raise CurrentError(
            f"{source}: {name!r} has no units attribute; say units=m/s or units=cm/s"
        )
    key = " ".join(str(given).strip().lower().split())
    if key not in SPEED_UNITS:
        text = unknown_name("velocity units", str(given), SPEED_UNITS)
        raise CurrentError(f"{source}: {name!r}: {text}; override with units=m/s")
    return SPEED_UNITS[key]


def depth_values(data: xr.Dataset, source: str, axis: Axis) -> Floats:
    """Depths [m], positive down, in the file's order; negative only above the sea surface."""
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
    # Some files say positive down and still count downward from zero: the values decide.
    if (upward and not (values > 0).any()) or (values <= 0).all():
        values = -values
    elif upward:
        raise CurrentError(
            f"{source}: {axis.coordinate!r} says positive up and has values up to"
            f" {values.max():g} m above the surface; correct its attribute 'positive'"
        )
    # Negation leaves -0.0, which would print and hash differently from 0.0.
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
