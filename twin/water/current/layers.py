"""Layers of the water column in closed form: Ekman, geostrophic and turbulent bottom layer."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from twin.compiled import borrowing
from twin.errors import CurrentError
from twin.water.current.axes import Origin, coriolis
from twin.water.current.base import Current
from twin.water.current.checks import not_negative, positive, setting, speed
from twin.water.current.sampler import Floats

LOWEST_LATITUDE = 2.0
"""[degree] Smallest latitude of an Ekman layer; nearer to the equator, f is too small."""
VON_KARMAN = 0.41
"""Von Karman's constant."""


@borrowing
def spiral(program, start, size, t, north, east, depth, r_t, r_n, r_e, r_d):  # type: ignore[no-untyped-def]
    """Ekman. Numbers: surface speed, 1 / depth scale, surface angle from north, latitude's sign."""
    inverse = program[start + 1]
    decay = program[start] * math.exp(-depth * inverse)
    angle = program[start + 2] + program[start + 3] * depth * inverse
    v_north = decay * math.cos(angle)
    v_east = decay * math.sin(angle)
    rate = r_d * inverse
    turn = program[start + 3] * rate
    d_north, d_east = -rate * v_north - turn * v_east, -rate * v_east + turn * v_north
    return v_north, v_east, 0.0, d_north, d_east, 0.0


@dataclass(frozen=True, kw_only=True)
class Ekman(Current):
    """Steady Ekman layer of constant eddy viscosity in deep water, driven by the wind.

    The speed is V0 exp(-depth/d), V0 = stress/(density sqrt(viscosity |f|)), d = sqrt(2
    viscosity/|f|). The surface current is 45 degrees to the right of the wind and turns right
    with depth; south of the equator, left (Ekman 1905). The transport stress/(density |f|) does
    not depend on the viscosity.
    """

    kind = "ekman"
    code = 3
    payload_size = 4
    directional = spiral
    depends_on = ("depth",)
    usage: ClassVar[Mapping[str, str]] = {
        "ekman:tau=0.1,direction=90": "wind stress Pa, degrees the wind blows toward"
    }

    stress: float = setting("tau", "stress", unit="Pa", check=not_negative)
    """[Pa] Wind stress; about 0.1 for a wind of 8 m/s."""
    direction_deg: float = setting("direction", unit="degree")
    """[degree] Compass direction TOWARD which the wind blows."""
    viscosity: float = setting("viscosity", "az", unit="m2/s", check=positive, default=0.02)
    """[m2/s] Vertical eddy viscosity."""
    density: float = setting("density", unit="kg/m3", check=positive, default=1025.0)
    """[kg/m3] Density of the water."""
    latitude_deg: float | None = setting("lat", unit="degree", default=None)
    """[degree] Latitude of the Coriolis parameter; None: the mission's origin."""

    def pinned(self, duration_s: float, origin: Origin | None = None) -> Ekman:
        """Return a copy with the latitude written out."""
        return replace(self, latitude_deg=(origin or Origin()).latitude(self.latitude_deg))

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """Make the record that the compiled function reads."""
        latitude = origin.latitude(self.latitude_deg)
        if abs(latitude) < LOWEST_LATITUDE:
            raise CurrentError(
                f"ekman: latitude_deg {latitude:g} is within {LOWEST_LATITUDE:g} degree of the"
                " equator, where no Ekman balance exists; use a profile"
            )
        f = coriolis(latitude)
        surface = self.stress / (self.density * math.sqrt(self.viscosity * abs(f)))
        depth = math.sqrt(2.0 * self.viscosity / abs(f))
        sense = math.copysign(1.0, f)
        angle = math.radians(self.direction_deg) + sense * math.pi / 4.0
        speed(self.kind, "surface speed", surface)
        return [self.record(surface, 1.0 / depth, angle, sense)]


@borrowing
def shear(program, start, size, t, north, east, depth, r_t, r_n, r_e, r_d):  # type: ignore[no-untyped-def]
    """Geostrophic. Numbers: barotropic north, east; surface baroclinic north, east; 1 / scale."""
    inverse = program[start + 4]
    decay = math.exp(-depth * inverse)
    v_north = program[start + 2] * decay
    v_east = program[start + 3] * decay
    rate = -r_d * inverse
    north, east = program[start] + v_north, program[start + 1] + v_east
    return north, east, 0.0, rate * v_north, rate * v_east, 0.0


@dataclass(frozen=True, kw_only=True)
class Geostrophic(Current):
    """Geostrophic current U(depth) = barotropic + baroclinic exp(-depth/scale).

    A scale of 300-1000 m is usual; a north-east Atlantic profile fits about 800 m.
    """

    kind = "geostrophic"
    code = 4
    payload_size = 5
    directional = shear
    depends_on = ("depth",)
    usage: ClassVar[Mapping[str, str]] = {
        "geostrophic:surface=0.2,direction=45,scale=800,barotropic=0.05": "m/s, degrees toward, m"
    }

    baroclinic: float = setting("surface", "speed", unit="m/s", check=speed)
    """[m/s] Surface speed of the sheared part."""
    direction_deg: float = setting("direction", unit="degree")
    """[degree] Compass direction TOWARD which the sheared part flows."""
    scale_depth: float = setting("scale", unit="m", check=positive, default=800.0)
    """[m] Depth over which the sheared part falls by the factor e."""
    barotropic: float = setting("barotropic", unit="m/s", check=speed, default=0.0)
    """[m/s] Speed of the barotropic part, which does not depend on depth."""
    barotropic_direction_deg: float | None = setting(
        "barotropic_direction", unit="degree", default=None
    )
    """[degree] Compass direction TOWARD which the barotropic part flows; None: `direction_deg`."""

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """Make the record that the compiled function reads."""
        sheared = math.radians(self.direction_deg)
        other = self.barotropic_direction_deg
        constant = sheared if other is None else math.radians(other)
        payload = [
            self.barotropic * math.cos(constant),
            self.barotropic * math.sin(constant),
            self.baroclinic * math.cos(sheared),
            self.baroclinic * math.sin(sheared),
            1.0 / self.scale_depth,
        ]
        return [self.record(payload)]


@borrowing
def wall_layer(program, start, size, t, north, east, depth, r_t, r_n, r_e, r_d):  # type: ignore[no-untyped-def]
    """Log layer. Numbers: u*/kappa north, east; depth of the floor; roughness; thickness."""
    height = program[start + 2] - depth
    rate = 0.0
    if height <= program[start + 3]:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if height < program[start + 4]:
        rate = -r_d / height
    else:
        height = program[start + 4]
    log = math.log(height / program[start + 3])
    v_north = program[start]
    v_east = program[start + 1]
    return v_north * log, v_east * log, 0.0, v_north * rate, v_east * rate, 0.0


@dataclass(frozen=True, kw_only=True)
class LogLayer(Current):
    """Bottom layer U = (u*/0.41) ln(h/z0) with h the height above the bottom, up to `thickness`.

    The speed is constant above the layer, and zero below the roughness length.
    """

    kind = "log-layer"
    code = 7
    payload_size = 5
    directional = wall_layer
    depends_on = ("depth",)
    usage: ClassVar[Mapping[str, str]] = {
        "log-layer:friction=0.01,direction=0,bottom=100": "turbulent layer above the sea floor, m"
    }

    friction_velocity: float = setting("friction", unit="m/s", check=not_negative)
    """[m/s] Friction velocity u*; about 1/25 of the speed above the layer."""
    direction_deg: float = setting("direction", unit="degree")
    """[degree] Compass direction TOWARD which the water flows."""
    water_depth: float = setting("bottom", unit="m", check=positive)
    """[m] Depth of the sea floor."""
    roughness: float = setting("roughness", unit="m", check=positive, default=1e-3)
    """[m] Roughness length z0; 1e-4 mud to 6e-3 gravel (Soulsby 1997)."""
    thickness: float = setting("thickness", unit="m", check=positive, default=20.0)
    """[m] Height of the layer's top above the bottom."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.thickness <= self.roughness:
            raise CurrentError(
                f"log-layer: thickness {self.thickness:g} m must exceed the roughness length"
                f" {self.roughness:g} m"
            )
        top = self.friction_velocity / VON_KARMAN * math.log(self.thickness / self.roughness)
        speed(self.kind, "speed at the layer's top", top)

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """Make the record that the compiled function reads."""
        angle = math.radians(self.direction_deg)
        scale = self.friction_velocity / VON_KARMAN
        along = scale * math.cos(angle), scale * math.sin(angle)
        return [self.record(*along, self.water_depth, self.roughness, self.thickness)]
