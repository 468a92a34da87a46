"""Box: the part of a velocity file around a mission, sorted, in SI units, with land filled.

Only the nodes within reach of the start and the times that cover the mission are read.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from twin.errors import CurrentError
from twin.water.current.axes import Origin, depth_values, time_values
from twin.water.current.checks import FASTEST_CURRENT
from twin.water.current.sampler import Floats
from twin.water.current.velocity_file import Velocity

if TYPE_CHECKING:
    import xarray as xr

LARGEST_BOX = 1_000_000_000
"""[byte] Largest box; each simulation would copy a larger one."""

SAME_NODE = 1e-6
"""[degree] Spacing below which nodes (0.1 m apart) are one: cyclic files repeat a meridian."""

WIDEST_GAP = 1.5
"""Largest gap around the start, in grid spacings; a wider gap puts the start outside the file."""

AXIS_ORDER = ("time", "depth", "latitude", "longitude")
"""Order of a box's axes."""

WET_START = 0.5
"""Smallest weight of wet nodes among the four around the start; below it the start is on land."""

NANOSECONDS = 1e9
"""[ns/s] Nanoseconds per second, for datetime64[ns]."""


@dataclass(frozen=True, kw_only=True)
class Box:
    """Velocities around a mission's start."""

    time: np.ndarray
    """Times, datetime64[ns], ascending, shape (nt,); empty for a field without a time axis."""
    depth: Floats
    """[m] Depths, positive down, ascending, shape (nd,)."""
    latitude: Floats
    """[degree] Latitudes, ascending, shape (nn,); one NaN when the file is one water column."""
    longitude: Floats
    """[degree] Longitudes east of the origin, ascending, shape (ne,); one NaN as for latitude."""
    velocity: Floats
    """[m/s] North, east (, down), shape (max(nt, 1), nd, nn, ne, 2 or 3), no missing values."""

    def digest(self) -> str:
        """SHA-256 of axes and values, which identifies the field that a mission used."""
        digest = hashlib.sha256()
        digest.update(self.time.astype("datetime64[ns]").astype("<i8").tobytes())
        for array in (self.depth, self.latitude, self.longitude, self.velocity):
            digest.update(str(array.shape).encode())
            digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
        return digest.hexdigest()


class Source(NamedTuple):
    """File of a gridded current, with the settings of `Grid` for reading it."""

    path: str
    hold_s: float
    land: str


def choose_times(
    times: np.ndarray, source: str, start: np.datetime64, duration_s: float, hold_s: float
) -> np.ndarray:
    """Choose the indices of the ascending `times` that cover the mission.

    A single time is a steady field. The first or last field is held up to `hold_s` outside the
    file's range; beyond, CurrentError is raised.
    """
    hold = np.timedelta64(round(hold_s * NANOSECONDS), "ns")
    end = start + np.timedelta64(round(duration_s * NANOSECONDS), "ns")
    if times.size == 1:
        end = start
        away = abs(start - times[0])
        if away > hold:
            seconds = math.ceil(away / np.timedelta64(1, "s"))
            raise CurrentError(
                f"the mission begins at {_iso(start)}, and the only time of {source} is"
                f" {_iso(times[0])}: choose time= nearer to it, or let it last longer, such as"
                f" grid:FILE,hold={seconds}"
            )
    if start < times[0] - hold or end > times[-1] + hold:
        raise CurrentError(
            f"mission {_iso(start)} to {_iso(end)} is outside the time range of {source}:"
            f" {_iso(times[0])} to {_iso(times[-1])}; choose time= within it, a shorter mission,"
            " or let its ends last longer: grid:FILE,hold=SECONDS"
        )
    first = max(int(np.searchsorted(times, start, side="right")) - 1, 0)
    last = min(int(np.searchsorted(times, end, side="left")), times.size - 1)
    return np.arange(first, last + 1)


def load_box(
    data: xr.Dataset, file: Source, velocity: Velocity, origin: Origin, start: np.datetime64 | None,
    duration_s: float, reach_m: float, largest: float = FASTEST_CURRENT,
) -> tuple[Box, float]:  # fmt: skip
    """Load the box within `reach_m` of the origin, and the distance [m] it covers on every side.

    start: mission start; None: the file's first time. largest: greatest plausible magnitude;
    above it the units are wrong. The distance is infinite on sides where the file ends.
    """
    (source, hold_s, land), axes = file, velocity.axes
    select: dict[str, np.ndarray] = {}
    times = np.empty(0, dtype="datetime64[ns]")
    if "time" in axes:
        every = time_values(data, source, axes["time"])
        order = np.argsort(every, kind="stable")
        every = every[order]
        if (np.diff(every) <= np.timedelta64(0, "ns")).any():
            raise CurrentError(f"{source}: {axes['time'].coordinate!r} repeats a time")
        begin = every[0] if start is None else start
        keep = choose_times(every, source, begin, duration_s, hold_s)
        times = every[keep]
        select["time"] = order[keep]
    depth = np.zeros(1)
    if "depth" in axes:
        depth = depth_values(data, source, axes["depth"])
        order = np.argsort(depth, kind="stable")
        depth = depth[order]
        if (np.diff(depth) <= 0).any():
            raise CurrentError(f"{source}: {axes['depth'].coordinate!r} repeats a depth")
        select["depth"] = order
    latitude = longitude = np.array([np.nan])
    reached = math.inf
    if "latitude" in axes:
        latitudes = np.asarray(data[axes["latitude"].coordinate].values, dtype=np.float64)
        longitudes = np.asarray(data[axes["longitude"].coordinate].values, dtype=np.float64)
        if latitudes.size == longitudes.size == 1:
            select["latitude"] = select["longitude"] = np.zeros(1, dtype=int)
        else:
            here = (source, origin, reach_m)
            latitude, select["latitude"], tall = _choose_latitudes(latitudes, *here)
            longitude, select["longitude"], wide = _choose_longitudes(longitudes, *here)
            reached = min(tall, wide)

    shape = (max(times.size, 1), depth.size, latitude.size, longitude.size)
    components = ["north", "east", *(c for c in ("up", "down") if c in velocity.names)]
    size = 8 * math.prod(shape) * len(components)
    if size > LARGEST_BOX:
        raise CurrentError(
            f"{source}: the box around this mission needs {size / 1e9:.1f} GB, at most"
            f" {LARGEST_BOX / 1e9:.1f} are allowed; shorten the mission or set reach=METRES"
        )
    values = np.empty((*shape, len(components)))
    for i, component in enumerate(components):
        name = velocity.names[component]
        sign = -velocity.scale[component] if component == "up" else velocity.scale[component]
        block = _read(data[name], velocity.dimensions[component], select)
        values[..., i] = sign * block.reshape(shape)
    limit = np.max(np.abs(values), initial=0.0, where=np.isfinite(values))
    if limit > largest:
        what = "a speed of {:g} m/s is beyond {:g} m/s: wrong units (set units=cm/s)"
        if largest != FASTEST_CURRENT:
            what = "a temperature or salinity of {:g} is beyond {:g}: wrong units"
        raise CurrentError(
            f"{source}: {what.format(limit, largest)}, or missing values without a _FillValue"
            " attribute"
        )
    values += 0.0  # turns -0.0 from the sign change into 0.0
    box = Box(time=times, depth=depth, latitude=latitude, longitude=longitude, velocity=values)
    zero_is_land = land == "zero" or (land == "auto" and velocity.zero_is_land)
    wet = np.asarray(np.isfinite(values).all(axis=-1))
    if zero_is_land:
        wet = wet & (values[..., :2] != 0.0).any(axis=(0, -1))
    if not wet.any():
        raise CurrentError(f"{source}: no water within reach of the start, only missing values")
    if latitude.size > 1 or longitude.size > 1:
        _check_start(box, wet, source, origin)
        if land == "auto" and not zero_is_land and wet.all():
            _check_zeros(box, source, origin)
    elif not wet.any(axis=(1, 2, 3)).all():
        raise CurrentError(f"{source}: the water column holds only missing values")
    _fill(values, wet, source, times)
    return box, reached


def _read(
    variable: xr.DataArray, dimensions: Mapping[str, str], select: Mapping[str, np.ndarray]
) -> Floats:
    """Read the chosen nodes of a variable: time, depth, latitude, longitude; NaN: missing."""
    kept = [dimensions[kind] for kind in AXIS_ORDER if kind in dimensions]
    variable = variable.squeeze([d for d in variable.dims if d not in kept])
    index: dict[str, slice | np.ndarray] = {}
    for kind, dimension in dimensions.items():
        chosen = select[kind]
        contiguous = (np.diff(chosen) == 1).all()
        index[dimension] = slice(chosen[0], chosen[-1] + 1) if contiguous else chosen
    return np.asarray(variable.isel(index).transpose(*kept).values, dtype=np.float64)


def _choose_latitudes(
    every: Floats, source: str, origin: Origin, reach_m: float
) -> tuple[Floats, np.ndarray, float]:
    """Choose latitudes [degree] within reach, with indices and the distance [m] they enclose."""
    order = np.argsort(every, kind="stable")
    every = every[order]
    if not (np.isfinite(every).all() and every[0] <= origin.latitude_deg <= every[-1]):
        raise CurrentError(
            f"{source}: start latitude {origin.latitude_deg:g} is outside"
            f" {every[0]:g}..{every[-1]:g} degree north; set lat= within the file"
        )
    if (np.diff(every) <= SAME_NODE).any():
        raise CurrentError(f"{source}: the latitudes repeat a value")
    offset = np.radians(every - origin.latitude_deg) * origin.meridian_radius
    first, last, reached = _enclosing(offset, reach_m)
    return every[first : last + 1], order[first : last + 1], reached


def _choose_longitudes(
    raw: Floats, source: str, origin: Origin, reach_m: float
) -> tuple[Floats, np.ndarray, float]:
    """Choose longitudes as `_choose_latitudes`, relative to the origin's longitude.

    Relative longitudes treat files in -180..180, in 0..360 and across the dateline alike.
    """
    relative = (raw - origin.longitude_deg + 180.0) % 360.0 - 180.0
    order = np.argsort(relative, kind="stable")
    relative = relative[order]
    different = np.concatenate([[True], np.diff(relative) > SAME_NODE])
    relative, order = relative[different], order[different]
    inside = np.isfinite(raw).all() and relative[0] <= SAME_NODE and relative[-1] >= -SAME_NODE
    if inside and relative.size > 1:
        # around the back of the Earth, a regional file encloses the origin by a wide gap
        widest = np.abs(np.diff(np.unwrap(raw, period=360.0))).max()
        after = min(max(int(np.searchsorted(relative, 0.0)), 1), relative.size - 1)
        inside = relative[after] - relative[after - 1] <= WIDEST_GAP * widest
    if not inside:
        raise CurrentError(
            f"{source}: start longitude {origin.longitude_deg:g} is outside"
            f" {raw.min():g}..{raw.max():g} degree east; set lon= within the file"
        )
    radius = origin.normal_radius * math.cos(math.radians(origin.latitude_deg))
    first, last, reached = _enclosing(np.radians(relative) * radius, reach_m)
    return relative[first : last + 1], order[first : last + 1], reached


def _enclosing(offset: Floats, reach_m: float) -> tuple[int, int, float]:
    """First and last index that enclose +-reach, and the enclosed distance."""
    first = max(int(np.searchsorted(offset, -reach_m, side="right")) - 1, 0)
    last = min(int(np.searchsorted(offset, reach_m, side="left")), offset.size - 1)
    low = math.inf if first == 0 else -offset[first]
    high = math.inf if last == offset.size - 1 else offset[last]
    return first, last, float(min(low, high))


def _check_start(box: Box, wet: np.ndarray, source: str, origin: Origin) -> None:
    """Raise CurrentError when the start point is on land at any time; `wet`: (nt, nd, nn, ne)."""

    def weights(axis: Floats, x: float) -> Floats:
        return np.array([np.interp(x, axis, row) for row in np.eye(axis.size)])

    w_n, w_e = weights(box.latitude, origin.latitude_deg), weights(box.longitude, 0.0)
    surface = wet[:, 0]
    share = np.einsum("tne,n,e->t", surface.astype(float), w_n, w_e)
    if share.min() >= WET_START:
        return
    n, e = np.nonzero(surface.all(axis=0))
    way_out = "no water is near: choose another start"
    if n.size:
        north = np.radians(box.latitude[n] - origin.latitude_deg) * origin.meridian_radius
        scale = origin.normal_radius * math.cos(math.radians(origin.latitude_deg))
        distance = np.hypot(north, np.radians(box.longitude[e]) * scale)
        best = int(np.argmin(distance))
        nearest = (box.longitude[e[best]] + origin.longitude_deg + 180.0) % 360.0 - 180.0
        way_out = (
            f"the nearest water is lat={box.latitude[n[best]]:.4f},lon={nearest:.4f},"
            f" {distance[best] / 1000.0:.1f} km away"
        )
    raise CurrentError(
        f"{source}: the start {origin.latitude_deg:g}, {origin.longitude_deg:g} is on land;"
        f" {way_out}"
    )


def _check_zeros(box: Box, source: str, origin: Origin) -> None:
    """Raise CurrentError when zeros around the start may stand for land."""
    rows, columns = _neighbours(box.latitude, origin.latitude_deg), _neighbours(box.longitude, 0.0)
    if not box.velocity[:, :, rows, columns].any() and box.velocity.any():
        raise CurrentError(
            f"{source}: the current is exactly 0 at every depth and time around the start"
            f" {origin.latitude_deg:g}, {origin.longitude_deg:g}; say land=zero if zeros mark"
            " land in this file, land=nan if they are still water"
        )


def _neighbours(axis: Floats, x: float) -> slice:
    """Nodes on both sides of x, and a node at x."""
    first = max(int(np.searchsorted(axis, x, side="left")) - 1, 0)
    return slice(first, int(np.searchsorted(axis, x, side="right")) + 1)


def _fill(values: Floats, wet: np.ndarray, source: str, times: np.ndarray) -> None:
    """Give dry nodes the velocity of the nearest water, in place.

    Filling goes down and up each water column first, then sideways by the mean of wet neighbours.
    Interpolation near a coast or the bottom then uses water only and stays continuous.
    """
    for t in range(values.shape[0]):
        field, known = values[t], wet[t].copy()
        if not known.any():
            raise CurrentError(f"{source}: all values are missing at {_iso(times[t])}")
        levels = field.shape[0]
        downward = [(k, k - 1) for k in range(1, levels)]
        upward = [(k, k + 1) for k in range(levels - 2, -1, -1)]
        for dry, neighbour in downward + upward:
            take = ~known[dry] & known[neighbour]
            field[dry][take] = field[neighbour][take]
            known[dry] |= take
        while not known.all():
            total = np.zeros_like(field)
            count = np.zeros(known.shape)
            for axis in (1, 2):
                for shift in (1, -1):
                    seen, value = _shift(known, field, axis, shift)
                    total += np.where(seen[..., None], value, 0.0)
                    count += seen
            take = ~known & (count > 0)
            field[take] = total[take] / count[take][:, None]
            known |= take


def _shift(known: np.ndarray, field: Floats, axis: int, shift: int) -> tuple[np.ndarray, Floats]:
    """Mask and values of the neighbours, without wrapping round the edges."""
    seen = np.roll(known, shift, axis=axis)
    edge = [slice(None)] * known.ndim
    edge[axis] = slice(0, 1) if shift > 0 else slice(-1, None)
    seen[tuple(edge)] = False
    return seen, np.roll(field, shift, axis=axis)


def _iso(time: np.datetime64) -> str:
    return str(time.astype("datetime64[s]"))
