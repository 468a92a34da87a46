"""Velocity file: variables, axes, units and sign of the current in a CF data set.

`standard_name` decides first, then the usual names of Copernicus Marine, HYCOM, NEMO, altimetry
and instrument files. Data that are not eastward and northward velocity on a rectilinear
latitude-longitude grid raise CurrentError, which advises a conversion.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from twin.bounded import check_dataset, stored_size
from twin.errors import CurrentError, InputError, TwinError, shown, unknown_name
from twin.water.current.axes import REGRID, Axis, find_axes

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
"""Variable names per component for files without standard names, best first; case is ignored."""

GRID_RELATIVE = {
    "x_sea_water_velocity",
    "y_sea_water_velocity",
    "sea_water_x_velocity",
    "sea_water_y_velocity",
    "ocean_sigma_x_velocity",
}
"""Standard names of components along a model's own axes, which are refused."""

SPEED_UNITS = {
    "m/s": 1.0, "m s-1": 1.0, "m s^-1": 1.0, "m.s-1": 1.0, "m s**-1": 1.0, "ms-1": 1.0,
    "meter/second": 1.0, "meters/second": 1.0, "metre/second": 1.0, "meter second-1": 1.0,
    "metre second-1": 1.0, "meters second-1": 1.0, "meter/sec": 1.0, "m/sec": 1.0,
    "cm/s": 0.01, "cm s-1": 0.01, "cm s^-1": 0.01, "cm.s-1": 0.01, "cm s**-1": 0.01,
    "centimeter/s": 0.01, "centimeter/second": 0.01, "centimeters/second": 0.01, "cm/sec": 0.01,
    "centimeter second-1": 0.01,
    "mm/s": 0.001, "mm s-1": 0.001,
}  # fmt: skip
"""[m/s] Size of each unit, as files spell it (lower case)."""

ZERO_LAND_NAMES = {"vozocrtx", "vomecrty"}
"""Variables of raw NEMO output, where land is 0 and not a missing value."""


NO_BACKEND = "did not find a match in any of xarray's"
"""Beginning of xarray's error for an unknown file type; its advice is for programmers."""


class Velocity(NamedTuple):
    """Variables and axes of the current in a data set."""

    names: Mapping[str, str]
    """Variable per component: east, north and optionally up or down."""
    scale: Mapping[str, float]
    """Factor per component to m/s, above 0."""
    axes: Mapping[str, Axis]
    """Axes of the variables, by quantity: time, depth, latitude, longitude."""
    dimensions: Mapping[str, Mapping[str, str]]
    """Dimension of each axis per component: depthu and depthv may be equal axes."""
    zero_is_land: bool
    """True for raw NEMO output, which marks land by 0."""


@contextlib.contextmanager
def open_data_set(
    path: str, what: str = "current", failure: type[InputError] = CurrentError
) -> Iterator[xr.Dataset]:
    """Open a netCDF file or zarr store as a data set, values lazy, times undecoded.

    Times stay numbers because some HYCOM files carry a second time variable that cannot be
    decoded. Damage may show only when attributes and values are read: an error inside the context
    is raised as `failure` too.

    Args:
      what: name of the file in messages.
      failure: class of the error when the file cannot be read.
    """
    data = _open(path, what, failure)
    try:
        with data:
            _check_packing(data, path, failure)
            yield data
    except TwinError:
        raise
    except Exception as error:  # each backend raises errors of its own
        raise failure(
            f"{what} file {path} is damaged, its values cannot be read ({_reason(error)}): "
            "download or write it again"
        ) from error


def _check_packing(data: xr.Dataset, path: str, failure: type[InputError]) -> None:
    """Raise an error if the attributes for unpacking values are not numbers."""
    for name, variable in data.variables.items():
        for attribute in ("scale_factor", "add_offset"):
            value = variable.encoding.get(attribute, 0.0)
            if np.asarray(value).dtype.kind not in "iuf" or np.size(value) != 1:
                raise failure(
                    f"{path}: the attribute {attribute} of {name!r} is {shown(value)}, not a "
                    "number; correct it (for example with ncatted)"
                )


def _reason(error: Exception) -> str:
    """First line of the message of a backend's exception."""
    text = str(error).strip()
    return text.splitlines()[0] if text else type(error).__name__


def _open(path: str, what: str, failure: type[InputError]) -> xr.Dataset:
    """Open the data set; only attributes and axes are read."""
    import xarray as xr

    remote = "://" in path
    if not remote and not Path(path).exists():
        raise failure(f"no {what} file {path}: give a CF netCDF file or a zarr store")
    try:
        if not remote and stored_size(Path(path)) == 0:
            raise failure(f"{what} file {path} is empty (0 bytes): copy or download it again")
    except OSError as error:
        raise failure(
            f"cannot read {what} file {path}: {error.filename}: {error.strerror}"
        ) from error
    is_zarr = path.rstrip("/").endswith(".zarr") or (not remote and Path(path).is_dir())
    try:
        with warnings.catch_warnings():
            # a store without consolidated metadata opens slowly, but works
            warnings.filterwarnings("ignore", "Failed to open Zarr store with consolidated")
            data = xr.open_dataset(
                path,
                engine="zarr" if is_zarr else None,
                decode_times=False,
                decode_timedelta=False,
            )
    except Exception as error:  # each backend raises errors of its own
        reason = _reason(error)
        if NO_BACKEND in reason:
            reason = "its content is neither of the two; convert it, or download it again"
        raise failure(f"cannot read {path} as CF netCDF or zarr: {reason}") from None
    if not remote:
        check_dataset(data, path, f"{what} file {path}", failure)
    return data


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
    axes = find_axes(data, source, names["east"])
    dimensions = {}
    for component, name in names.items():
        own = find_axes(data, source, name)
        hint = " or leave it out with w=none" if component in ("up", "down") else ""
        for kind in sorted({*axes, *own}):
            if not _same_points(data, axes.get(kind), own.get(kind)):
                raise CurrentError(
                    f"{source}: {names['east']!r} and {name!r} have different {kind} points "
                    f"(staggered grid); interpolate them to common points first{hint}"
                )
        dimensions[component] = {kind: axis.dimension for kind, axis in own.items()}
    scale = {c: _speed_factor(data, source, name, units) for c, name in names.items()}
    zero = any(name.lower() in ZERO_LAND_NAMES for name in names.values()) or any(
        axis.coordinate.lower() in ("depthu", "depthv") for axis in axes.values()
    )
    return Velocity(names, scale, axes, dimensions, zero_is_land=zero)


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


def _same_points(data: xr.Dataset, one: Axis | None, other: Axis | None) -> bool:
    """Tell whether two axes exist and have equal values."""
    if one is None or other is None:
        return False
    a, b = data[one.coordinate].values, data[other.coordinate].values
    return a.shape == b.shape and np.array_equal(a, b)


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
