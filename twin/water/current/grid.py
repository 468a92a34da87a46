"""Gridded current read from a CF netCDF file or a zarr store."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from twin.errors import CurrentError, unknown_name
from twin.water.current import checks
from twin.water.current.axes import Origin, same_place
from twin.water.current.base import Current
from twin.water.current.box import Box, load_box
from twin.water.current.grid_kernels import GRID_CODE, box_interpolation
from twin.water.current.sampler import Floats

VEHICLE_SPEED = 1.0
"""[m/s] Horizontal speed through the water that no glider exceeds; sizes the box to load."""

FIRST_GUESS = 0.5
"""[m/s] Current that sizes the first box; the box grows until it holds for the current found."""

LAND = ("auto", "nan", "zero")


@dataclass(frozen=True, kw_only=True)
class Grid(Current):
    """u, v (, w) on time, depth, latitude, longitude, laid so that the mission starts at a place.

    Velocities are interpolated linearly in time, depth, and along the meridian and parallel.
    Above the first level, below the last and beyond the file's sides the edge value is held; dry
    nodes take the value of the nearest water. The turning of north along the track (0.1 degree per
    10 km at mid-latitudes) is neglected.
    """

    kind: ClassVar[str] = "grid"
    code: ClassVar[int] = GRID_CODE
    directional: ClassVar[Any] = box_interpolation
    usage: ClassVar[Mapping[str, str]] = {
        "grid:FILE.nc,lat=49,lon=-16,time=2000-01-05": "CF netCDF or zarr"
    }
    settings: ClassVar[Mapping[str, str]] = {
        "lat": "latitude_deg",
        "lon": "longitude_deg",
        "time": "time",
        "u": "east",
        "v": "north",
        "w": "up",
        "units": "units",
        "land": "land",
        "hold": "hold_s",
        "reach": "reach_m",
        "span": "span_s",
        "sha256": "sha256",
    }

    path: str
    """CF netCDF file or zarr store."""
    latitude_deg: float | None = None
    """[degree] Where the mission starts; None: the mission's origin."""
    longitude_deg: float | None = None
    """[degree] Where the mission starts; None: the mission's origin."""
    time: str | None = None
    """UTC when the mission starts; None: the origin's time, or else the file's first time."""
    east: str | None = None
    """Variable of the eastward velocity; None: by standard_name, then by usual names."""
    north: str | None = None
    """Variable of the northward velocity; None: as above."""
    up: str | None = None
    """Variable of the upward velocity; None: as above, missing is zero; "none": leave it out."""
    units: str | None = None
    """Units of the velocities; None: the file's attribute."""
    land: str = "auto"
    """What marks land: "nan" (missing values), "zero", or "auto": zero for raw NEMO names."""
    hold_s: float = 3600.0
    """[s] How far the mission may leave the file's time range; the end value is held there."""
    reach_m: float | None = None
    """[m] Half-width of the box to load; None: what the mission can cover in its duration."""
    span_s: float | None = None
    """[s] Length of time to load; None: the mission's duration."""
    sha256: str | None = None
    """Hash of the box that was used; a file with other content is then refused."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", str(self.path))
        for name in ("latitude_deg", "longitude_deg"):
            if getattr(self, name) is not None:
                checks.finite(self.kind, name, getattr(self, name), "degree")
        if (self.latitude_deg is None) != (self.longitude_deg is None):
            raise CurrentError("grid: give both lat and lon, or neither to use the origin's")
        if self.time is not None:
            parse_time(self.time)
        if self.land not in LAND:
            raise CurrentError(f"grid: {unknown_name('land', str(self.land), LAND)}")
        checks.not_negative(self.kind, "hold_s", self.hold_s, "s")
        if self.reach_m is not None:
            checks.positive(self.kind, "reach_m", self.reach_m, "m")
        if self.span_s is not None:
            checks.positive(self.kind, "span_s", self.span_s, "s")

    @classmethod
    def parse(cls, rest: str) -> Grid:
        """From the name of a file and NAME=VALUE."""
        positional, given = checks.split_settings(cls.kind, rest)
        if len(positional) != 1:
            raise CurrentError(
                "grid: give one file first, as grid:FILE.nc,lat=49,lon=-16,time=2000-01-05,"
                f" not {rest!r}"
            )
        settings: dict[str, Any] = {}
        for name, value in given.items():
            if name not in cls.settings:
                raise CurrentError(unknown_name("grid setting", name, cls.settings))
            number = name in ("lat", "lon", "hold", "reach", "span")
            settings[cls.settings[name]] = checks.number("grid", name, value) if number else value
        return cls(path=positional[0], **settings)

    def load(self, duration_s: float, origin: Origin | None = None) -> tuple[Box, Grid]:
        """The box for a mission, and this grid with everything written out (see `pinned`)."""
        from twin.water.current.velocity_file import find_velocity, open_data_set

        place = self.start(origin or Origin())
        span = self.span_s or duration_s
        if duration_s > span:
            raise CurrentError(
                f"grid: the mission lasts {duration_s:g} s, span_s covers {span:g} s of {self.path}"
            )
        start: Any = None if place.time is None else parse_time(place.time)
        chosen = {"east": self.east, "north": self.north, "up": self.up}
        with open_data_set(self.path) as data:
            velocity = find_velocity(data, self.path, chosen, self.units)

            def load(reach: float) -> tuple[Box, float]:
                return load_box(
                    data, self.path, velocity, place, start, span, reach, self.hold_s, self.land
                )

            if self.reach_m is not None:
                reach = self.reach_m
                box, _ = load(reach)
            else:
                reach = span * (VEHICLE_SPEED + FIRST_GUESS)
                box, reached = load(reach)
                while (needed := span * (VEHICLE_SPEED + _fastest(box))) > reached:
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
        """With a box of at least that half-width, unless `reach_m` is given."""
        return replace(self, reach_m=max(distance_m, 1.0)) if self.reach_m is None else self

    def begins(self, duration_s: float, origin: Origin) -> Origin:
        """Its own place and time, else the file's first time."""
        place = self.start(origin)
        return self.pinned(duration_s, origin).start(origin) if place.time is None else place

    def check_place(self, latitude_deg: float, longitude_deg: float) -> None:
        """The place in the file must be the start's, where both are given."""
        mine = (self.latitude_deg, self.longitude_deg)
        if mine[0] is None or mine[1] is None:
            return
        if not same_place((mine[0], mine[1]), (latitude_deg, longitude_deg)):
            raise CurrentError(
                f"grid: lat={mine[0]:g}, lon={mine[1]:g} is not the mission's start at latitude "
                f"{latitude_deg:g}, longitude {longitude_deg:g}; leave lat and lon out, the "
                "start is where the file is read"
            )

    def check_time(self, time: str) -> None:
        """The time in the file must be the start's, where both are given."""
        if self.time is not None and parse_time(self.time) != parse_time(time):
            raise CurrentError(
                f"grid: time={self.time} is not the mission's start at {time}; leave time out, "
                "the file is read at the start's time"
            )

    def pinned(self, duration_s: float, origin: Origin | None = None) -> Grid:
        """With place, time, variables, extent and hash of the used box written out."""
        return self.load(duration_s, origin)[1]

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """One layout record, in metres and seconds about the mission's start."""
        box, pinned = self.load(duration_s, origin)
        place = pinned.start(origin)
        start = parse_time(str(pinned.time)) if box.time.size else None
        return [self.box_of(box, place, start)]

    @classmethod
    def box_of(cls, box: Box, place: Origin, start: np.datetime64 | None) -> Floats:
        """The record of a box, in metres and seconds about a mission's start."""
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
        """One record of a rectilinear grid.

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
        """Where and when the mission starts in the file."""
        if self.latitude_deg is None or self.longitude_deg is None:
            return replace(origin, time=self.time or origin.time)
        return Origin(
            latitude_deg=self.latitude_deg,
            longitude_deg=self.longitude_deg,
            time=self.time or origin.time,
        )


def parse_time(time: str) -> np.datetime64:
    """UTC time as datetime64[ns] from ISO 8601, with or without a trailing Z."""
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
    """[m/s] Greatest horizontal speed in the box."""
    return float(np.sqrt((box.velocity[..., :2] ** 2).sum(axis=-1).max()))
