"""Hydrography: temperature and salinity from the file of a gridded current.

Ocean models write `thetao` and `so` beside `uo` and `vo`. Both are read on the same types of axes
and interpolated in the same way as the current. TEOS-10 converts potential or conservative
temperature and absolute salinity to in-situ temperature and practical salinity.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from twin.errors import CurrentError
from twin.water.current import sampler as layout
from twin.water.current.axes import Origin, find_axes
from twin.water.current.base import Current, CurrentSum
from twin.water.current.box import Box, Source, load_box
from twin.water.current.grid import Grid, parse_time
from twin.water.current.sampler import Floats
from twin.water.current.velocity_file import Velocity, open_data_set

if TYPE_CHECKING:
    import xarray as xr

IN_SITU, POTENTIAL, CONSERVATIVE = "in situ", "potential", "conservative"
PRACTICAL, ABSOLUTE = "practical", "absolute"
TEMPERATURES = {
    "sea_water_temperature": IN_SITU,
    "sea_water_potential_temperature": POTENTIAL,
    "sea_water_conservative_temperature": CONSERVATIVE,
}
"""CF standard names of temperature, best first, and the quantity of each."""
SALINITIES = {
    "sea_water_practical_salinity": PRACTICAL,
    "sea_water_salinity": PRACTICAL,
    "sea_water_absolute_salinity": ABSOLUTE,
}
TEMPERATURE_ALIASES = {"thetao": POTENTIAL, "votemper": POTENTIAL, "water_temp": IN_SITU}
"""Variable names of Copernicus Marine, NEMO and HYCOM, for files without standard names."""
SALINITY_ALIASES = {"so": PRACTICAL, "vosaline": PRACTICAL, "salinity": PRACTICAL}
LARGEST_VALUE = 60.0
"""[degree_Celsius, 1] Largest value; above it are kelvin, or missing values without _FillValue."""
COLUMN_REACH = 1.0
"""[m] Half-width of the box that one water column needs."""


def along_track(
    current: Current | None,
    time: Floats,
    north: Floats,
    east: Floats,
    depth: Floats,
    origin: Origin,
) -> tuple[Floats, Floats] | None:
    """In-situ temperature [degree_Celsius] and practical salinity along a track, each (n,).

    None: the current has no gridded part whose file holds both.

    Args:
      current: the current of the mission.
      time: [s] since the mission's start; north, east, depth: [m], each of shape (n,).
      origin: start place and time of the mission.

    Raises:
      CurrentError: the file cannot be read.
    """
    for grid in _grids(current):
        reach = COLUMN_REACH + float(np.max(np.abs([north, east]), initial=0.0))
        loaded = _load(grid, origin, float(time[-1]) if len(time) else 0.0, reach)
        if loaded is not None:
            return _sampled(*loaded, (time, north, east, depth))
    return None


def column(current: Current | None, origin: Origin) -> tuple[Floats, Floats, Floats] | None:
    """Depth [m], temperature and salinity at a mission's start; None as `along_track`."""
    for grid in _grids(current):
        loaded = _load(grid, origin, 0.0, COLUMN_REACH)
        if loaded is not None:
            depth = loaded[0].depth
            still = np.zeros_like(depth)
            return depth, *_sampled(*loaded, (still, still, still, depth))
    return None


def _grids(current: Current | None) -> Iterator[Grid]:
    parts = current.parts if isinstance(current, CurrentSum) else (current,)
    return (part for part in parts if isinstance(part, Grid))


def _load(
    grid: Grid, origin: Origin, duration: float, reach: float
) -> tuple[Box, Origin, tuple[str, str]] | None:
    """Load the box of temperature and salinity, the start in the file, and both quantities."""
    place = grid.start(origin)
    start = None if place.time is None else parse_time(place.time)
    with open_data_set(grid.path) as data:
        temperature = _find(data, TEMPERATURES, TEMPERATURE_ALIASES)
        salinity = _find(data, SALINITIES, SALINITY_ALIASES)
        if temperature is None or salinity is None:
            return None
        names = {"north": temperature[0], "east": salinity[0]}  # load_box expects velocities
        axes = {of: find_axes(data, grid.path, name) for of, name in names.items()}
        own = {of: {k: axis.dimension for k, axis in kinds.items()} for of, kinds in axes.items()}
        found = Velocity(names, dict.fromkeys(names, 1.0), axes["north"], own, zero_is_land=False)
        file = Source(grid.path, grid.hold_s, "nan")
        box, _ = load_box(data, file, found, place, start, duration, reach, LARGEST_VALUE)
    return box, place, (temperature[1], salinity[1])


def _find(
    data: xr.Dataset, standard: Mapping[str, str], aliases: Mapping[str, str]
) -> tuple[str, str] | None:
    """Find a variable: its name and its quantity."""
    for wanted, meaning in standard.items():
        for name, variable in data.data_vars.items():
            if variable.attrs.get("standard_name") == wanted:
                return str(name), meaning
    for name in map(str, data.data_vars):
        if name.lower() in aliases:
            return name, aliases[name.lower()]
    return None


def _sampled(
    box: Box, place: Origin, kinds: tuple[str, str], points: tuple[ArrayLike, ...]
) -> tuple[Floats, Floats]:
    """In-situ temperature and practical salinity at time [s], north, east, depth [m], (n,)."""
    import gsw

    from twin.water.current.sampler import sample_track

    first = box.time[0] if place.time is None and box.time.size else None
    start = parse_time(place.time) if place.time is not None else first
    program = layout.program([Grid.box_of(box, place, start)])
    arrays = [np.ascontiguousarray(x, dtype=float) for x in points]
    still = np.zeros_like(arrays[0])
    temperature, salinity = sample_track(program, *arrays, still, still, still)[:, :2].T
    latitude, longitude = place.latitude_deg, place.longitude_deg
    pressure = gsw.p_from_z(-np.maximum(arrays[3], 0.0), latitude)
    absolute = salinity
    if kinds[1] == PRACTICAL:
        absolute = gsw.SA_from_SP(salinity, pressure, longitude, latitude)
    else:
        salinity = gsw.SP_from_SA(absolute, pressure, longitude, latitude)
    if kinds[0] == POTENTIAL:
        temperature = gsw.CT_from_pt(absolute, temperature)
    if kinds[0] != IN_SITU:
        temperature = gsw.t_from_CT(absolute, temperature, pressure)
    if not (np.isfinite(temperature).all() and np.isfinite(salinity).all()):
        raise CurrentError("grid: temperature or salinity of the file became NaN along the track")
    return np.asarray(temperature), np.asarray(salinity)
