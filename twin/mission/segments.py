"""Segments: the pieces of a mission.

Depths are m, positive down; pitch is a magnitude in deg (nose down in a dive, nose up in a
climb); headings are deg true; net mass is a magnitude in kg (heavy in a dive, light in a climb). A
segment ends at the first of its limits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from twin.mission import fields as check

DEFAULT_MIN_DEPTH_M = 5.0
"""Deep enough that the overshoot of an inflection (2 m for the Sea-Wing) stays submerged."""
SHALLOWEST_M = 1.0
"""A climb to less than this would end afloat: the hull breaks the surface before its CB arrives."""


@dataclass(frozen=True, kw_only=True)
class Segment:
    """What all segments share."""

    kind: ClassVar[str] = ""

    @property
    def limited(self) -> bool:
        """Whether the segment ends by itself."""
        return True


@dataclass(frozen=True, kw_only=True)
class Profile(Segment):
    """Dives and climbs between two depths; the base of `SawTooth` and `Spiral`."""

    max_depth_m: float
    """A dive turns into a climb here [m]."""
    min_depth_m: float = DEFAULT_MIN_DEPTH_M
    """A climb turns into a dive here [m]."""
    pitch_deg: float = 35.0
    """Pitch magnitude [deg], above 0 and below 60."""
    climb_pitch_deg: float | None = None
    """Pitch magnitude of the climb [deg]; None: that of the dive."""
    net_mass_kg: float = 0.3
    """Net buoyancy mass of the dive [kg], positive; the climb is this much light."""
    climb_net_mass_kg: float | None = None
    """Magnitude for the climb [kg]; None: that of the dive."""
    yos: float | None = None
    """Limit: number of dives with their climbs, in halves (0.5 is one dive)."""
    duration_s: float | None = None
    """Limit: time [s]."""
    until_depth_m: float | None = None
    """Limit: the segment ends when the glider passes this depth [m]."""

    def __post_init__(self) -> None:
        kind = self.kind
        check.within(kind, "min_depth_m", self.min_depth_m, "m", SHALLOWEST_M)
        check.within(kind, "max_depth_m", self.max_depth_m, "m", 0.0, open_low=True)
        if self.min_depth_m >= self.max_depth_m:
            rule = f"less than max_depth_m = {self.max_depth_m:g} m"
            check.fail(kind, "min_depth_m", self.min_depth_m, rule)
        check.pitch(kind, "pitch_deg", self.pitch_deg)
        check.net_mass(kind, "net_mass_kg", self.net_mass_kg)
        if self.climb_pitch_deg is not None:
            check.pitch(kind, "climb_pitch_deg", self.climb_pitch_deg)
        if self.climb_net_mass_kg is not None:
            check.net_mass(kind, "climb_net_mass_kg", self.climb_net_mass_kg)
        if self.yos is not None:
            check.limit(kind, "yos", self.yos, "")
            if (2 * self.yos) % 1:
                check.fail(kind, "yos", self.yos, "a multiple of 0.5")
        if self.duration_s is not None:
            check.limit(kind, "duration_s", self.duration_s, "s")
        if self.until_depth_m is not None:
            low, high = self.min_depth_m, self.max_depth_m
            check.within(kind, "until_depth_m", self.until_depth_m, "m", low, high)

    @property
    def limited(self) -> bool:
        """Whether the segment ends by itself."""
        return not (self.yos is None and self.duration_s is None and self.until_depth_m is None)


@dataclass(frozen=True, kw_only=True)
class SawTooth(Profile):
    """Wings-level dives and climbs on a heading."""

    kind: ClassVar[str] = "saw-tooth"

    heading_deg: float | None = None
    """Heading to hold [deg true]; None: the heading at the segment's start."""
    max_rotation_deg: float = 45.0
    """Limit of the heading loop [deg]; a glider rolls less than it turns its battery."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.heading_deg is not None:
            check.heading(self.kind, "heading_deg", self.heading_deg)
        field, value = "max_rotation_deg", self.max_rotation_deg
        check.within(self.kind, field, value, "deg", 0.0, 90.0, open_low=True)


@dataclass(frozen=True, kw_only=True)
class Spiral(Profile):
    """Dives and climbs at a fixed battery rotation; the heading loop rests."""

    kind: ClassVar[str] = "spiral"

    rotation_deg: float
    """Battery rotation [deg]; positive turns to starboard, in a dive and in a climb."""
    climb_rotation_deg: float | None = None
    """Battery rotation of the climb [deg]; None: that of the dive."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check.rotation(self.kind, "rotation_deg", self.rotation_deg)
        if self.climb_rotation_deg is not None:
            check.rotation(self.kind, "climb_rotation_deg", self.climb_rotation_deg)


@dataclass(frozen=True, kw_only=True)
class Surface(Segment):
    """Climb to the surface and stay there for a time, tail up with the antenna out of the water."""

    kind: ClassVar[str] = "surface"

    duration_s: float = 300.0
    """Time at the surface [s], counted from the arrival."""
    pitch_deg: float = 35.0
    """Pitch magnitude of the ascent [deg]."""
    net_mass_kg: float | None = None
    """Magnitude of the lightness [kg]; None: all that the pump has."""
    heading_deg: float | None = None
    """Heading of the ascent [deg true]; None: the heading at the segment's start."""
    max_rotation_deg: float = 45.0
    """Limit of the heading loop during the ascent [deg]."""
    shift_m: float | None = None
    """Battery position while at the surface [m]; None: all the way forward, tail up."""

    def __post_init__(self) -> None:
        kind = self.kind
        check.limit(kind, "duration_s", self.duration_s, "s")
        check.pitch(kind, "pitch_deg", self.pitch_deg)
        if self.net_mass_kg is not None:
            check.net_mass(kind, "net_mass_kg", self.net_mass_kg)
        if self.heading_deg is not None:
            check.heading(kind, "heading_deg", self.heading_deg)
        field, value = "max_rotation_deg", self.max_rotation_deg
        check.within(kind, field, value, "deg", 0.0, 90.0, open_low=True)
        if self.shift_m is not None:
            check.number(kind, "shift_m", self.shift_m)


@dataclass(frozen=True, kw_only=True)
class Hold(Segment):
    """Fixed actuator positions, no loop closed: an open-loop manoeuvre."""

    kind: ClassVar[str] = "hold"

    shift_m: float = 0.0
    """Battery displacement from neutral [m], positive forward (nose down)."""
    rotation_deg: float = 0.0
    """Battery rotation [deg], positive turns to starboard."""
    net_mass_kg: float = 0.0
    """Net buoyancy mass [kg], with its sign: positive is heavy."""
    duration_s: float | None = None
    """Limit: time [s]."""
    until_depth_m: float | None = None
    """Limit: the segment ends when the glider passes this depth [m]."""

    def __post_init__(self) -> None:
        kind = self.kind
        check.number(kind, "shift_m", self.shift_m)
        check.rotation(kind, "rotation_deg", self.rotation_deg)
        check.number(kind, "net_mass_kg", self.net_mass_kg)
        if self.duration_s is not None:
            check.limit(kind, "duration_s", self.duration_s, "s")
        if self.until_depth_m is not None:
            check.within(kind, "until_depth_m", self.until_depth_m, "m", 0.0)

    @property
    def limited(self) -> bool:
        """Whether the segment ends by itself."""
        return self.duration_s is not None or self.until_depth_m is not None


KINDS: dict[str, type[Segment]] = {c.kind: c for c in (SawTooth, Spiral, Surface, Hold)}
