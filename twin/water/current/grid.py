"""Grid: current from a CF netCDF file or a zarr store, and its compiled interpolation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from twin.compiled import borrowing, jit
from twin.errors import CurrentError, unknown_name
from twin.water.current import checks
from twin.water.current.axes import Origin, same_place
from twin.water.current.base import Current
from twin.water.current.box import Box, Source, load_box
from twin.water.current.checks import not_negative, positive, setting
from twin.water.current.sampler import INVALID, Floats, locate, record_at

GRID_CODE = 9
"""Code of grids in compiled programs."""

HEADER = 6
"""Length of the header: nt, nd, nn, ne, velocity components (2 or 3), meridian curvature [1/m]."""


@borrowing
def _along_east(program, at, step, f, rate):  # type: ignore[no-untyped-def]
    """Value and derivative between two neighbours on the east axis."""
    here = program[at]
    slope = program[at + step] - here
    return here + f * slope, rate * slope


@borrowing
def _interpolate(a, a_rate, b, b_rate, f, rate):  # type: ignore[no-untyped-def]
    """Interpolate between two (value, derivative) pairs by a weight f that changes at `rate`."""
    return a + f * (b - a), a_rate + f * (b_rate - a_rate) + rate * (b - a)


@borrowing
def _at_one_time(program, at, steps, fractions, rates):  # type: ignore[no-untyped-def]
    """One velocity component from the 8 corners of a cell at one of the file's times."""
    _, s_d, s_n, s_e = steps
    _, f_d, f_n, f_e = fractions
    _, r_d, r_n, r_e = rates
    a, ar = _along_east(program, at, s_e, f_e, r_e)
    b, br = _along_east(program, at + s_n, s_e, f_e, r_e)
    c, cr = _interpolate(a, ar, b, br, f_n, r_n)
    a, ar = _along_east(program, at + s_d, s_e, f_e, r_e)
    b, br = _along_east(program, at + s_d + s_n, s_e, f_e, r_e)
    a, ar = _interpolate(a, ar, b, br, f_n, r_n)
    return _interpolate(c, cr, a, ar, f_d, r_d)


@borrowing
def _component(program, at, steps, fractions, rates):  # type: ignore[no-untyped-def]
    """One velocity component from the 16 corners of the cell whose first corner is `at`."""
    now, now_rate = _at_one_time(program, at, steps, fractions, rates)
    if steps[0] == 0:
        return now, now_rate
    later, later_rate = _at_one_time(program, at + steps[0], steps, fractions, rates)
    return _interpolate(now, now_rate, later, later_rate, fractions[0], rates[0])


@borrowing
def _is_grid(program, start, size):  # type: ignore[no-untyped-def]
    """Tell whether the payload has the length that its header gives."""
    if size < HEADER:
        return False
    nt, nd, nn, ne = program[start], program[start + 1], program[start + 2], program[start + 3]
    nc = program[start + 4]
    axes = nt + nd + nn + ne
    return (
        min(nt, nd, nn, ne) >= 1.0
        and (nc == 2.0 or nc == 3.0)
        and HEADER + axes + nt * nd * nn * ne * nc == size
    )


@borrowing
def box_interpolation(program, start, size, t, north, east, depth, r_t, r_n, r_e, r_d):  # type: ignore[no-untyped-def]
    """Payload: header, axes time, depth, north, east, velocity (axes as before, component)."""
    if not _is_grid(program, start, size):
        return INVALID
    nt, nd, nn = int(program[start]), int(program[start + 1]), int(program[start + 2])
    ne, nc = int(program[start + 3]), int(program[start + 4])
    # tangent-plane metres to metres along the meridian and the origin's parallel, second order
    curvature = program[start + 5]
    y = north - 0.5 * curvature * east * east
    y_rate = r_n - curvature * east * r_e
    x = east * (1.0 + curvature * north)
    x_rate = r_e * (1.0 + curvature * north) + curvature * east * r_n
    at = start + HEADER
    i_t, f_t, inv_t = locate(program, at, nt, t)
    at += nt
    i_d, f_d, inv_d = locate(program, at, nd, depth)
    at += nd
    i_n, f_n, inv_n = locate(program, at, nn, y)
    at += nn
    i_e, f_e, inv_e = locate(program, at, ne, x)
    at += ne
    at += (((i_t * nd + i_d) * nn + i_n) * ne + i_e) * nc
    # an axis of one node has no neighbour: a step of zero reads the node itself
    steps = (
        nd * nn * ne * nc if nt > 1 else 0,
        nn * ne * nc if nd > 1 else 0,
        ne * nc if nn > 1 else 0,
        nc if ne > 1 else 0,
    )
    fractions = (f_t, f_d, f_n, f_e)
    rates = (inv_t * r_t, inv_d * r_d, inv_n * y_rate, inv_e * x_rate)
    u, u_rate = _component(program, at, steps, fractions, rates)
    v, v_rate = _component(program, at + 1, steps, fractions, rates)
    w = w_rate = 0.0
    if nc == 3:
        w, w_rate = _component(program, at + 2, steps, fractions, rates)
    return u, v, w, u_rate, v_rate, w_rate


@jit
def beyond_grid(program, north, east):  # type: ignore[no-untyped-def]
    """Mark points of a track (north, east [m], shape (n,)) beyond the sides of a grid, shape (n,).

    The sampler holds the edge value there; such a mission needs a larger file.
    """
    out = np.zeros(north.size, dtype=np.bool_)
    if program.size == 0 or not (0.0 <= program[0] <= program.size):
        return out
    at = 1
    for _ in range(int(program[0])):
        code, start, size = record_at(program, at)
        if size < 0:
            break
        at = start + size
        if code != GRID_CODE or not _is_grid(program, start, size):
            continue
        nn = int(program[start + 2])
        ne = int(program[start + 3])
        curvature = program[start + 5]
        n_axis = start + HEADER + int(program[start]) + int(program[start + 1])
        e_axis = n_axis + nn
        for i in range(north.size):
            y = north[i] - 0.5 * curvature * east[i] * east[i]
            x = east[i] * (1.0 + curvature * north[i])
            if nn > 1 and not (program[n_axis] <= y <= program[n_axis + nn - 1]):
                out[i] = True
            if ne > 1 and not (program[e_axis] <= x <= program[e_axis + ne - 1]):
                out[i] = True
    return out


VEHICLE_SPEED = 1.0
"""[m/s] Horizontal speed through the water that no glider exceeds; sizes the box to load."""

FIRST_GUESS = 0.5
"""[m/s] Current assumed for the first box; the box is enlarged if the loaded current is faster."""

LAND = ("auto", "nan", "zero")


@dataclass(frozen=True, kw_only=True)
class Grid(Current):
    """Velocity u, v (, w) on time, depth, latitude, longitude, placed by the mission's start.

    Velocities are interpolated linearly in time, depth, and along the meridian and parallel.
    The edge value is held above the first level, below the last and beyond the file's sides. Dry
    nodes get the value of the nearest water. The rotation of north along the track (0.1 degree per
    10 km at mid-latitudes) is neglected.
    """

    kind = "grid"
    code = GRID_CODE
    directional = box_interpolation
    usage: ClassVar[Mapping[str, str]] = {
        "grid:FILE.nc,lat=49,lon=-16,time=2000-01-05": "CF netCDF or zarr"
    }

    path: str = setting(check=None)
    """CF netCDF file or zarr store."""
    latitude_deg: float | None = setting("lat", unit="degree", default=None)
    """[degree] Latitude of the mission's start; None: the mission's origin."""
    longitude_deg: float | None = setting("lon", unit="degree", default=None)
    """[degree] Longitude of the mission's start; None: the mission's origin."""
    time: str | None = None
    """UTC of the mission's start; None: the origin's time, or else the file's first time."""
    east: str | None = setting("u", check=None, default=None)
    """Variable of the eastward velocity; None: found by standard_name, then by usual names."""
    north: str | None = setting("v", check=None, default=None)
    """Variable of the northward velocity; None: found like the eastward one."""
    up: str | None = setting("w", check=None, default=None)
    """Variable of the upward velocity; None: found like the others, else 0; "none": ignored."""
    units: str | None = None
    """Units of the velocities; None: the file's attribute."""
    land: str = "auto"
    """Mark of land: "nan" (missing values), "zero", or "auto": zero for raw NEMO names."""
    hold_s: float = setting("hold", unit="s", check=not_negative, default=3600.0)
    """[s] Time for which the first and last field hold outside the file's range."""
    reach_m: float | None = setting("reach", unit="m", check=positive, default=None)
    """[m] Half-width of the box to load; None: the distance a mission covers in its duration."""
    span_s: float | None = setting("span", unit="s", check=positive, default=None)
    """[s] Length of time to load; None: the mission's duration."""
    sha256: str | None = None
    """Hash of the loaded box; a file with other content is refused."""

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "path", str(self.path))
        if (self.latitude_deg is None) != (self.longitude_deg is None):
            raise CurrentError("grid: give both lat and lon, or neither to use the origin's")
        if self.time is not None:
            parse_time(self.time)
        if self.land not in LAND:
            raise CurrentError(f"grid: {unknown_name('land', str(self.land), LAND)}")

    @classmethod
    def parse(cls, rest: str) -> Grid:
        """Parse the name of a file and NAME=VALUE settings."""
        positional, given = checks.split_settings(cls.kind, rest)
        if len(positional) != 1:
            raise CurrentError(
                "grid: give one file first, as grid:FILE.nc,lat=49,lon=-16,time=2000-01-05,"
                f" not {rest!r}"
            )
        return cls(path=positional[0], **cls.values_of(given))

    def load(self, duration_s: float, origin: Origin | None = None) -> tuple[Box, Grid]:
        """Load the box for a mission; return it and this grid pinned to it (see `pinned`)."""
        from twin.water.current.velocity_file import find_velocity, open_data_set

        place = self.start(origin or Origin())
        span = self.span_s or duration_s
        if duration_s > span:
            raise CurrentError(
                f"grid: the mission lasts {duration_s:g} s, span_s covers {span:g} s of {self.path}"
            )
        start: Any = None if place.time is None else parse_time(place.time)
        file = Source(self.path, self.hold_s, self.land)
        chosen = {"east": self.east, "north": self.north, "up": self.up}
        with open_data_set(self.path) as data:
            velocity = find_velocity(data, self.path, chosen, self.units)

            def load(reach: float) -> tuple[Box, float]:
                return load_box(data, file, velocity, place, start, span, reach)

            guess = span * (VEHICLE_SPEED + FIRST_GUESS)
            reach = guess if self.reach_m is None else self.reach_m
            box, reached = load(reach)
            while self.reach_m is None:
                needed = span * (VEHICLE_SPEED + _fastest(box))
                if needed <= reached:
                    break
                reach = needed
                box, reached = load(reach)
        digest = box.digest()
        if self.sha256 is not None and digest != self.sha256:
            raise CurrentError(
                f"grid: {self.path} does not hold the recorded current any more (sha256"
                f" {digest[:12]}, recorded {self.sha256[:12]}); restore the file or drop sha256"
            )
        if start is None and box.time.size:
            start = box.time[0]
        pinned = replace(
            self,
            latitude_deg=place.latitude_deg,
            longitude_deg=place.longitude_deg,
            time=None if start is None else str(start),
            east=velocity.names["east"],
            north=velocity.names["north"],
            up=velocity.names.get("up", velocity.names.get("down", "none")),
            reach_m=float(reach),
            span_s=float(span),
            sha256=digest,
        )
        return box, pinned

    def reaching(self, distance_m: float) -> Grid:
        """Return a copy with a box of at least this half-width, unless `reach_m` is given."""
        return replace(self, reach_m=max(distance_m, 1.0)) if self.reach_m is None else self

    def begins(self, duration_s: float, origin: Origin) -> Origin:
        """Start by the grid's own place and time, else by the file's first time."""
        place = self.start(origin)
        return self.pinned(duration_s, origin).start(origin) if place.time is None else place

    def check_place(self, latitude_deg: float, longitude_deg: float) -> None:
        """Raise CurrentError when `lat` and `lon` are given and differ from the mission's start."""
        lat, lon = self.latitude_deg, self.longitude_deg
        if lat is None or lon is None:
            return
        if not same_place((lat, lon), (latitude_deg, longitude_deg)):
            raise CurrentError(
                f"grid: lat={lat:g}, lon={lon:g} is not the mission's start at latitude "
                f"{latitude_deg:g}, longitude {longitude_deg:g}; leave lat and lon out, the "
                "start is where the file is read"
            )

    def check_time(self, time: str) -> None:
        """Raise CurrentError when `time` is given and differs from the mission's start."""
        if self.time is not None and parse_time(self.time) != parse_time(time):
            raise CurrentError(
                f"grid: time={self.time} is not the mission's start at {time}; leave time out, "
                "the file is read at the start's time"
            )

    def pinned(self, duration_s: float, origin: Origin | None = None) -> Grid:
        """Return a copy with place, time, variables, extent and hash of the loaded box."""
        return self.load(duration_s, origin)[1]

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """Make one record, in metres and seconds about the mission's start."""
        box, pinned = self.load(duration_s, origin)
        place = pinned.start(origin)
        start = parse_time(str(pinned.time)) if box.time.size else None
        return [self.box_of(box, place, start)]

    @classmethod
    def box_of(cls, box: Box, place: Origin, start: np.datetime64 | None) -> Floats:
        """Make the record of a box, in metres and seconds about a mission's start."""
        time = np.zeros(1)
        if box.time.size:
            time = (box.time - start).astype(np.float64) * 1e-9
        north = east = np.zeros(1)
        curvature = 0.0
        if np.isfinite(box.latitude).all():
            cosine = np.cos(np.radians(place.latitude_deg))
            north = np.radians(box.latitude - place.latitude_deg) * place.meridian_radius
            east = np.radians(box.longitude) * place.normal_radius * cosine
            curvature = place.curvature
        return cls.box_record(time, box.depth, north, east, box.velocity, curvature)

    @classmethod
    def box_record(
        cls,
        time: Floats,
        depth: Floats,
        north: Floats,
        east: Floats,
        velocity: Floats,
        curvature: float = 0.0,
    ) -> Floats:
        """Make one record of a rectilinear grid.

        time [s since mission start], depth, north, east [m]: ascending vectors, length 1 allowed.
        velocity [m/s]: shape (time, depth, north, east, 2 or 3), north, east (, down).
        curvature [1/m]: see `Origin.curvature`; 0 for a flat grid.
        """
        shape = (time.size, depth.size, north.size, east.size)
        if velocity.shape not in ((*shape, 2), (*shape, 3)):
            raise ValueError(f"velocity has shape {velocity.shape}, axes say {shape} + (2 or 3,)")
        header = [*velocity.shape, curvature]
        return cls.record(header, time, depth, north, east, velocity)

    def start(self, origin: Origin) -> Origin:
        """Start place and time of the mission in the file."""
        if self.latitude_deg is None or self.longitude_deg is None:
            return replace(origin, time=self.time or origin.time)
        place = {"latitude_deg": self.latitude_deg, "longitude_deg": self.longitude_deg}
        return Origin(**place, time=self.time or origin.time)


def parse_time(time: str) -> np.datetime64:
    """Parse an ISO 8601 UTC time, with or without a trailing Z, to datetime64[ns]."""
    try:
        value: Any = np.datetime64(str(time).strip().removesuffix("Z"), "ns")
    except (ValueError, OverflowError):
        value = np.datetime64("NaT", "ns")
    if np.isnat(value):
        raise CurrentError(
            f"grid: time {time!r} is not ISO 8601; write UTC as 2000-01-05 or 2000-01-05T12:00"
        )
    return value


def _fastest(box: Box) -> float:
    """Greatest horizontal speed in the box [m/s]."""
    return float(np.sqrt((box.velocity[..., :2] ** 2).sum(axis=-1).max()))
