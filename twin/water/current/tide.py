"""Tide: oscillating currents, tidal in the whole column or near-inertial in its upper layer."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar, Self

from twin.compiled import borrowing
from twin.errors import CurrentError, unknown_name
from twin.water.current import checks
from twin.water.current.axes import Origin, coriolis
from twin.water.current.base import Current
from twin.water.current.checks import not_negative, positive, setting
from twin.water.current.sampler import Floats

PERIOD_HOURS = {
    "M2": 12.4206012,
    "S2": 12.0,
    "N2": 12.65834751,
    "K2": 11.96723606,
    "K1": 23.93447213,
    "O1": 25.81933871,
    "P1": 24.06588766,
    "Q1": 26.868350,
}
"""[h] Periods of the main constituents (Doodson; e.g. Pugh 1987, table 4.1)."""
SECONDS_PER_HOUR = 3600.0


@dataclass(frozen=True, kw_only=True)
class TidalEllipse:
    """One tidal constituent: the tip of the velocity vector moves round an ellipse."""

    constituent: str
    """Name of the constituent, e.g. "M2"."""
    semi_major: float
    """[m/s] Speed along the major axis at maximum."""
    semi_minor: float = 0.0
    """[m/s] Speed along the minor axis; positive turns counterclockwise seen from above."""
    direction_deg: float = 0.0
    """[degree] Compass direction of the major axis, toward which the flood maximum points."""
    phase_deg: float = 0.0
    """[degree] Lag of the maximum after mission start."""

    def __post_init__(self) -> None:
        name = str(self.constituent).upper()
        if name not in PERIOD_HOURS:
            raise CurrentError(
                unknown_name("tidal constituent", str(self.constituent), PERIOD_HOURS)
            )
        object.__setattr__(self, "constituent", name)
        major = checks.speed("tide", f"{name} semi_major", self.semi_major)
        minor = checks.speed("tide", f"{name} semi_minor", self.semi_minor)
        if major < 0.0 or abs(minor) > major:
            raise CurrentError(
                f"tide: {name} needs semi_major >= |semi_minor|, not {major:g} and {minor:g} m/s;"
                " turn direction_deg by 90"
            )
        for angle in ("direction_deg", "phase_deg"):
            checks.finite("tide", f"{name} {angle}", getattr(self, angle), "degree")

    @property
    def angular_rate(self) -> float:
        """[rad/s] Angular rate of the constituent."""
        return 2.0 * math.pi / (PERIOD_HOURS[self.constituent] * SECONDS_PER_HOUR)

    def describe(self) -> dict[str, Any]:
        """Return the settings as a dict of JSON values."""
        return asdict(self)


ELLIPSE_SETTINGS = {"direction": "direction_deg", "phase": "phase_deg", "minor": "semi_minor"}
"""Field of each setting of a constituent besides its amplitude, by command-line name."""


@borrowing
def ellipses_kernel(program, start, size, t, north, east, depth):  # type: ignore[no-untyped-def]
    """Payload: n, then per constituent: rate [rad/s], cos (north, east), sin (north, east)."""
    v_north = 0.0
    v_east = 0.0
    north_rate = 0.0
    east_rate = 0.0
    if size < 1 or not (program[start] >= 1.0 and 1.0 + 5.0 * program[start] == size):
        v_north = v_east = math.nan
    else:
        for i in range(int(program[start])):
            at = start + 1 + 5 * i
            omega = program[at]
            c = math.cos(omega * t)
            s = math.sin(omega * t)
            v_north += program[at + 1] * c + program[at + 3] * s
            v_east += program[at + 2] * c + program[at + 4] * s
            north_rate += omega * (program[at + 3] * c - program[at + 1] * s)
            east_rate += omega * (program[at + 4] * c - program[at + 2] * s)
    rest = (0.0, 0.0, 0.0)
    return (v_north, v_east, 0.0, north_rate, east_rate, 0.0, *rest, *rest, *rest)


@dataclass(frozen=True, kw_only=True)
class Tide(Current):
    """Sum of tidal ellipses, equal at every place and depth.

    Usual amplitudes: 0.02-0.05 m/s in the deep ocean, 0.2-1 m/s on the shelf.
    """

    kind = "tide"
    code = 5
    kernel = ellipses_kernel
    usage: ClassVar[Mapping[str, str]] = {
        "tide:m2=0.1,s2=0.03,direction=30": (
            "ellipses; also minor=, phase=, m2_phase=, k1=, o1= ..."
        )
    }

    ellipses: tuple[TidalEllipse, ...]
    """Ellipses of the constituents."""

    def __post_init__(self) -> None:
        if isinstance(self.ellipses, list):
            object.__setattr__(self, "ellipses", tuple(self.ellipses))
        if not isinstance(self.ellipses, tuple) or not all(
            isinstance(ellipse, TidalEllipse) for ellipse in self.ellipses
        ):
            raise CurrentError(f"tide: ellipses is {self.ellipses!r}: give a tuple of TidalEllipse")
        if not self.ellipses:
            raise CurrentError("tide: give at least one constituent, e.g. m2=0.1")
        names = [ellipse.constituent for ellipse in self.ellipses]
        for name in names:
            if names.count(name) > 1:
                raise CurrentError(f"tide: constituent {name} is given twice")

    @classmethod
    def parse(cls, rest: str) -> Tide:
        """Parse CONSTITUENT=SPEED and settings for all constituents, or for one as m2_phase=."""
        positional, given = checks.split_settings(cls.kind, rest)
        if positional:
            raise CurrentError(f"tide: write NAME=VALUE, e.g. m2=0.1, not {positional[0]!r}")
        constituents = [name for name in given if name.upper() in PERIOD_HOURS]
        allowed = [name.lower() for name in PERIOD_HOURS] + list(ELLIPSE_SETTINGS)
        allowed += [f"{c}_{field}" for c in constituents for field in ELLIPSE_SETTINGS]
        for name in given:
            if name not in allowed:
                raise CurrentError(unknown_name("tide setting", name, allowed))
        ellipses = []
        for name in constituents:
            settings = {
                field: checks.number("tide", key, given[key])
                for short, field in ELLIPSE_SETTINGS.items()
                for key in (short, f"{name}_{short}")
                if key in given
            }
            major = checks.number("tide", name, given[name])
            ellipses.append(TidalEllipse(constituent=name, semi_major=major, **settings))
        return cls(ellipses=tuple(ellipses))

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Rebuild the tide from `describe()`, nested ellipses first."""
        try:
            ellipses = tuple(TidalEllipse(**item) for item in settings.get("ellipses", ()))
        except TypeError as error:
            raise CurrentError(f"tide: {error}") from None
        return super().from_settings({**settings, "ellipses": ellipses})

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """Make one record."""
        rows = []
        for e in self.ellipses:
            axis = math.radians(e.direction_deg)
            lag = math.radians(e.phase_deg)
            major = (math.cos(axis), math.sin(axis))
            # counterclockwise from above: from the major axis toward 90 degrees to its left
            minor = (math.sin(axis), -math.cos(axis))
            # major cos(wt - lag) + minor sin(wt - lag), expanded in cos(wt) and sin(wt)
            cos_part = [
                e.semi_major * a * math.cos(lag) - e.semi_minor * b * math.sin(lag)
                for a, b in zip(major, minor, strict=True)
            ]
            sin_part = [
                e.semi_major * a * math.sin(lag) + e.semi_minor * b * math.cos(lag)
                for a, b in zip(major, minor, strict=True)
            ]
            rows.append([e.angular_rate, *cos_part, *sin_part])
        return [self.record(len(rows), rows)]


@borrowing
def slab(program, start, size, t, north, east, depth, r_t, r_n, r_e, r_d):  # type: ignore[no-untyped-def]
    """Payload: speed, signed angular rate (+ is clockwise from above), angle at t 0, layer depth,
    1/decay depth below the layer."""
    angle = program[start + 2] + program[start + 1] * t
    below = depth - program[start + 3]
    speed = program[start]
    rate = 0.0
    if below >= 0.0:
        speed *= math.exp(-below * program[start + 4])
        rate = -r_d * program[start + 4]
    v_north = speed * math.cos(angle)
    v_east = speed * math.sin(angle)
    omega = r_t * program[start + 1]
    d_north, d_east = rate * v_north - omega * v_east, rate * v_east + omega * v_north
    return v_north, v_east, 0.0, d_north, d_east, 0.0


@dataclass(frozen=True, kw_only=True)
class Inertial(Current):
    """A slab of water that turns at the Coriolis frequency: clockwise in the north.

    The period is 12 h/sin(lat). The speed is uniform in the mixed layer and falls by the factor e
    over `decay_depth` below. 0.05-0.1 m/s is usual after a storm (Pollard & Millard 1970).
    """

    kind = "inertial"
    code = 6
    payload_size = 5
    directional = slab
    depends_on = ("time", "depth")
    usage: ClassVar[Mapping[str, str]] = {
        "inertial:speed=0.08,layer=40": "near-inertial oscillation of the mixed layer"
    }

    speed: float = setting("speed", unit="m/s", check=checks.speed)
    """[m/s] Speed in the mixed layer."""
    layer_depth: float = setting("layer", unit="m", check=not_negative, default=40.0)
    """[m] Depth of the mixed layer."""
    decay_depth: float = setting("decay", unit="m", check=positive, default=10.0)
    """[m] Depth over which the speed falls by the factor e below the layer."""
    direction_deg: float = setting("direction", unit="degree", default=0.0)
    """[degree] Compass direction TOWARD which the water flows at mission start."""
    latitude_deg: float | None = setting("lat", unit="degree", default=None)
    """[degree] Latitude of the Coriolis parameter; None: the mission's origin."""

    def pinned(self, duration_s: float, origin: Origin | None = None) -> Inertial:
        """Return a copy with the latitude written out."""
        return replace(self, latitude_deg=(origin or Origin()).latitude(self.latitude_deg))

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """Make one record."""
        rate = coriolis(origin.latitude(self.latitude_deg))
        angle = math.radians(self.direction_deg)
        return [self.record(self.speed, rate, angle, self.layer_depth, 1.0 / self.decay_depth)]
