"""Bathymetry: sea floors from latitude-longitude files, and sea floors from texts.

Files are netCDF or zarr. The usual layout is GEBCO's: `elevation` in m, positive up, on `lat` and
`lon`. ETOPO, EMODnet and the static files of ocean models are read too. The standard_name, the
attribute `positive` or the name tells which variables count downward.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np

from twin.errors import FloorError, unknown_name
from twin.numbers import Array
from twin.water.current.axes import AXIS_NAMES, LATITUDE_UNITS, LONGITUDE_UNITS, Origin
from twin.water.floor.base import (
    LARGEST,
    SPEED,
    FlatFloor,
    Floor,
    GridFloor,
    RoughFloor,
    check_depths,
    check_reach,
)
from twin.water.floor.lookup import pack

if TYPE_CHECKING:
    import xarray as xr

UP = "up"
DOWN = "down"
STANDARD_NAMES = {
    **dict.fromkeys((
        "height_above_mean_sea_level", "height_above_geoid", "height_above_reference_ellipsoid",
        "height_above_geopotential_datum", "surface_altitude", "altitude"), UP),
    **dict.fromkeys((
        "sea_floor_depth_below_geoid", "sea_floor_depth_below_mean_sea_level",
        "sea_floor_depth_below_sea_surface", "sea_floor_depth_below_sea_level",
        "sea_floor_depth_below_reference_ellipsoid",
        "sea_floor_depth_below_geopotential_datum", "sea_floor_depth"), DOWN),
}  # fmt: skip
"""CF standard names of the sea floor, and the direction in which each counts."""
NAMES = {
    **dict.fromkeys(("elevation", "z", "topo", "altitude"), UP),
    **dict.fromkeys(("deptho", "bathymetry", "depth", "bathy_metry"), DOWN),
}
"""Variable names of GEBCO, EMODnet, ETOPO and ocean models, for files without a standard name."""
METRES = ("m", "meter", "meters", "metre", "metres", "")


@dataclass(frozen=True, kw_only=True, eq=False)
class Bathymetry(Floor):
    """Sea floor from a file around the mission's start, bilinear between the file's nodes."""

    kind: ClassVar[str] = "bathymetry"
    needs_place: ClassVar[bool] = True

    path: str
    """NetCDF file or zarr store."""
    variable: str | None = None
    """Variable of the file; None: found by standard_name, then by usual names."""
    positive: str | None = None
    """Direction in which values count, "up" or "down"; None: by attributes or name."""
    reach_m: float | None = None
    """[m] Half-width of the part to load; None: the distance a mission covers in its duration."""
    sha256: str | None = None
    """Hash of the loaded part; a file with other content is refused."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", str(self.path))
        if self.positive not in (None, UP, DOWN):
            raise FloorError(
                f"bathymetry: {unknown_name('positive', str(self.positive), (UP, DOWN))}"
            )
        check_reach("bathymetry", self.reach_m)

    def compile(self, duration_s: float, origin: Origin | None = None) -> Array:
        """Make the table around the start, with axes in metres north and east of the start."""
        return self._load(duration_s, origin)[0]

    def pinned(self, duration_s: float, origin: Origin | None = None) -> Bathymetry:
        """Return a copy with variable, direction, extent and hash of the loaded part."""
        return self._load(duration_s, origin)[1]

    def other_sense(self, duration_s: float, origin: Origin | None = None) -> str:
        """Setting with the opposite of the direction in which the file was read."""
        used = self.pinned(duration_s, origin).positive
        return f"positive={UP if used == DOWN else DOWN}"

    def _load(self, duration_s: float, origin: Origin | None) -> tuple[Array, Bathymetry]:
        from twin.water.current.velocity_file import open_data_set

        if origin is None:
            raise FloorError(
                f"bathymetry {self.path}: say where the mission starts in it: --start LAT,LON, or "
                'start={"latitude": 49.0, "longitude": -16.0}'
            )
        reach = self.reach_m if self.reach_m is not None else SPEED * duration_s
        with open_data_set(self.path, "bathymetry", FloorError) as data:
            name = self._find(data)
            positive = self.positive or _sense(data, self.path, name)
            table, digest = self._read(data, name, positive, reach, origin)
        if self.sha256 is not None and digest != self.sha256:
            raise FloorError(
                f"bathymetry {self.path} does not hold the recorded sea floor any more (sha256 "
                f"{digest[:12]}, recorded {self.sha256[:12]}); restore the file"
            )
        used = replace(self, variable=name, positive=positive, reach_m=reach, sha256=digest)
        return table, used

    def _find(self, data: xr.Dataset) -> str:
        """Find the variable of the sea floor."""
        fields = [str(n) for n, v in data.data_vars.items() if len(_horizontal(data, str(n))) == 2]
        if self.variable is not None:
            if self.variable not in data.data_vars:
                known = map(str, data.data_vars)
                raise FloorError(f"{self.path}: {unknown_name('variable', self.variable, known)}")
            if self.variable not in fields:
                raise FloorError(
                    f"{self.path}: {self.variable!r} does not lie on one-dimensional latitude and "
                    "longitude: regrid it (for example with gdalwarp -t_srs EPSG:4326)"
                )
            return self.variable
        by_standard = [n for n in fields if data[n].attrs.get("standard_name") in STANDARD_NAMES]
        by_name = [n for known in NAMES for n in fields if n.lower() == known]
        found = by_standard or by_name
        if not found:
            raise FloorError(
                f"{self.path} has no variable of a sea floor on latitude and longitude: neither a "
                f"standard_name such as height_above_mean_sea_level nor one of the names "
                f"{', '.join(NAMES)}; it holds {', '.join(map(str, data.data_vars)) or 'nothing'}: "
                "name it with variable=NAME"
            )
        if len(by_standard) > 1:
            raise FloorError(
                f"{self.path}: {', '.join(by_standard)} may all be the sea floor; choose one with "
                "variable=NAME"
            )
        return found[0]

    def _read(
        self, data: xr.Dataset, name: str, positive: str, reach: float, origin: Origin
    ) -> tuple[Array, str]:
        """Read the table within `reach` [m], and the hash of the file's own numbers."""
        units = str(data[name].attrs.get("units", "")).strip().lower()
        if units not in METRES:
            raise FloorError(f"{self.path}: {name!r} is in {units!r}: convert it to metres")
        axes = _horizontal(data, name)
        lat, lon = (np.asarray(data[axes[k]].values, np.float64) for k in ("latitude", "longitude"))
        for kind, values in (("latitude", lat), ("longitude", lon)):
            if values.size < 2 or not np.isfinite(values).all():
                raise FloorError(f"{self.path}: {axes[kind]!r} must hold two or more {kind}s")
        turned = (lon - origin.longitude_deg + 180.0) % 360.0 - 180.0
        metres = math.radians(1.0) * origin.normal_radius
        rows, north = _enclosing(
            math.radians(1.0) * origin.meridian_radius * (lat - origin.latitude_deg), reach
        )
        columns, east = _enclosing(
            metres * math.cos(math.radians(origin.latitude_deg)) * turned, reach
        )
        if not (_encloses(north, lat) and _encloses(east, lon)):
            raise FloorError(
                f"{self.path}: the start at latitude {origin.latitude_deg:g}, longitude "
                f"{origin.longitude_deg:g} is outside {lat.min():g}..{lat.max():g} degree north, "
                f"{lon.min():g}..{lon.max():g} degree east"
            )
        if rows.size * columns.size > LARGEST:
            raise FloorError(
                f"{self.path}: the part within {reach / 1000:.0f} km of the start has "
                f"{rows.size * columns.size:,} nodes, at most {LARGEST:,} are loaded: give "
                "reach=METRES, or a coarser file"
            )
        field = data[name]
        dimensions = [data[axes[kind]].dims[0] for kind in ("latitude", "longitude")]
        field = field.squeeze([d for d in field.dims if d not in dimensions])
        index = dict(zip(dimensions, (rows, columns), strict=True))
        # read one contiguous box first: picking single nodes from the file is slow
        spans = {d: slice(int(i.min()), int(i.max()) + 1) for d, i in index.items()}
        values = field.isel(spans).transpose(*dimensions).values
        values = np.asarray(values, np.float64)[np.ix_(rows - rows.min(), columns - columns.min())]
        missing = int(np.count_nonzero(~np.isfinite(values)))
        if missing:
            raise FloorError(
                f"{self.path}: {missing} of {values.size} values within {reach / 1000:.3g} km of "
                "the start are missing: give a smaller reach=METRES, or a file that has land too, "
                "such as GEBCO"
            )
        depth = values if positive == DOWN else -values
        check_depths(self.path, depth)
        digest = hashlib.sha256()
        for part in (lat[rows], lon[columns], values):
            digest.update(part.astype("<f8").tobytes())
        return pack(north, east, depth + 0.0, origin.curvature), digest.hexdigest()


def _horizontal(data: xr.Dataset, name: str) -> dict[str, str]:
    """Coordinates of latitude and longitude of a variable; {} if another axis is longer than 1."""
    found: dict[str, str] = {}
    for dimension in map(str, data[name].dims):
        kind = _axis(data, dimension) if dimension in data.variables else None
        if kind is not None:
            found[kind] = dimension
        elif data.sizes[dimension] != 1:
            return {}
    return found


def _axis(data: xr.Dataset, dimension: str) -> str | None:
    """Tell whether a dimension is latitude or longitude, by attributes, then by name."""
    attributes = data[dimension].attrs
    units = str(attributes.get("units", "")).lower()
    for kind, spellings in (("latitude", LATITUDE_UNITS), ("longitude", LONGITUDE_UNITS)):
        standard = attributes.get("standard_name") == kind
        if standard or units in spellings or dimension.lower() in AXIS_NAMES[kind]:
            return kind
    return None


def _sense(data: xr.Dataset, path: str, name: str) -> str:
    """Direction in which the values of a variable count: "up" or "down"."""
    attributes = data[name].attrs
    declared = str(attributes.get("positive", "")).lower()
    if declared in (UP, DOWN):
        return declared
    standard = str(attributes.get("standard_name", ""))
    found = STANDARD_NAMES.get(standard) or NAMES.get(name.lower())
    if found is None:
        raise FloorError(
            f"{path}: whether {name!r} counts upward or downward is unknown: give positive=up "
            "(elevation) or positive=down (depth)"
        )
    return found


def _enclosing(metres: Array, reach: float) -> tuple[np.ndarray, Array]:
    """Indices of the nodes that enclose +-reach, in ascending order, and their places [m]."""
    order = np.argsort(metres, kind="stable")
    values = metres[order]
    different = np.concatenate([[True], np.diff(values) > 0.1])  # cyclic files repeat a meridian
    order, values = order[different], values[different]
    first = max(int(np.searchsorted(values, -reach, side="right")) - 1, 0)
    last = min(int(np.searchsorted(values, reach, side="left")), values.size - 1)
    return order[first : last + 1], values[first : last + 1]


def _encloses(metres: Array, degrees: Array) -> bool:
    """Tell whether the start lies between two neighbours of an axis, or at an end of the axis.

    False for a start on the other side of the Earth, in the wide gap of a regional file's axis.
    """
    if metres[0] > 0.1 or metres[-1] < -0.1:
        return False
    after = min(max(int(np.searchsorted(metres, 0.0)), 1), metres.size - 1)
    widest = 111_700.0 * float(np.abs(np.diff(np.unwrap(degrees, period=360.0))).max())
    return bool(metres[after] - metres[after - 1] <= 1.5 * widest)


KINDS: dict[str, type[Floor]] = {c.kind: c for c in (FlatFloor, RoughFloor, GridFloor, Bathymetry)}
"""All types of sea floor by their names in descriptions."""
ROUGH_SETTINGS = {
    "height": "height_m",
    "length": "length_m",
    "slope": "slope",
    "toward": "slope_direction_deg",
    "seed": "seed",
    "shallowest": "shallowest_m",
    "deepest": "deepest_m",
    "reach": "reach_m",
}
"""Fields of a rough floor by their names in a text."""
TEXTS = ("variable", "positive", "sha256")
FILE_SETTINGS = {"reach": "reach_m", **{name: name for name in TEXTS}}
"""Fields of a bathymetry file by their names in a text; those in TEXTS hold text."""


def parse_floor(text: str) -> Floor | None:
    """Parse `none`, `depth:200` [m], `rough:60,height=3,length=400,seed=1`, or a bathymetry file
    with settings: `FILE.nc,reach=20000`.

    Raises:
      FloorError: the text has none of these forms.
    """
    text = text.strip()
    if text == "none":
        return None
    kind, colon, rest = text.partition(":")
    if colon and kind == "depth":
        return FlatFloor(depth_m=_value("depth", rest))
    if colon and kind == "rough":
        depth, *given = rest.split(",")
        settings = _settings(text, given, ROUGH_SETTINGS, "rough sea floor")
        return RoughFloor(depth_m=_value("rough", depth), **settings)
    path, *given = text.split(",")
    if not path or ("." not in path and "/" not in path and "\\" not in path):
        raise FloorError(
            f"sea floor {text!r}: give none, depth:METRES such as depth:200, rough:METRES such as "
            "rough:60,height=3,length=400, or a bathymetry file such as GEBCO.nc"
        )
    return Bathymetry(path=path, **_settings(text, given, FILE_SETTINGS, "bathymetry file"))


def _settings(
    text: str, given: Sequence[str], known: Mapping[str, str], noun: str
) -> dict[str, Any]:
    """Convert items of NAME=VALUE to fields."""
    settings: dict[str, Any] = {}
    for item in given:
        name, sign, value = (word.strip() for word in item.partition("="))
        if not sign:
            raise FloorError(f"sea floor {text!r}: {item!r} must be NAME=VALUE")
        if name not in known:
            raise FloorError(unknown_name(f"setting of a {noun}", name, known))
        settings[known[name]] = _value(name, value)
    return settings


def floor_from_dict(data: Mapping[str, Any]) -> Floor:
    """Rebuild a floor from the settings that `describe` returned.

    Raises:
      FloorError: a type or setting is unknown.
    """
    kind = str(data.get("kind"))
    if kind not in KINDS:
        raise FloorError(unknown_name("kind of sea floor", kind, KINDS))
    settings = {name: value for name, value in data.items() if name != "kind"}
    known = [field.name for field in dataclasses.fields(cast(Any, KINDS[kind]))]
    for name in settings:
        if name not in known:
            raise FloorError(unknown_name(f"setting of a {kind} sea floor", name, known))
    return KINDS[kind](**settings)


def _value(name: str, text: str) -> Any:
    if name in TEXTS:
        return text
    try:
        return int(text) if name == "seed" else float(text)
    except ValueError:
        rule = "a whole number" if name == "seed" else "a number"
        raise FloorError(f"sea floor: {name} {text.strip()!r} must be {rule}") from None
