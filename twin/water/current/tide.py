"""Barotropic tidal current as a sum of ellipses."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Self

from twin.compiled import borrowing
from twin.errors import CurrentError, unknown_name
from twin.water.current import checks
from twin.water.current.axes import Origin
from twin.water.current.base import Current
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
    """One constituent: the tip of the velocity vector runs round an ellipse."""

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
        checks.finite("tide", f"{name} direction_deg", self.direction_deg, "degree")
        checks.finite("tide", f"{name} phase_deg", self.phase_deg, "degree")

    @property
    def angular_rate(self) -> float:
        """[rad/s] Angular rate of the constituent."""
        return 2.0 * math.pi / (PERIOD_HOURS[self.constituent] * SECONDS_PER_HOUR)

    def describe(self) -> dict[str, Any]:
        """The settings as a JSON-able dict."""
        return {f.name: getattr(self, f.name) for f in fields(self)}


ELLIPSE_SETTINGS = {"direction": "direction_deg", "phase": "phase_deg", "minor": "semi_minor"}
"""Command-line name and field of what every constituent has beside its amplitude."""


@borrowing
def ellipses_kernel(program, start, size, t, north, east, depth):  # type: ignore[no-untyped-def]
    """n, then per constituent: angular rate, cos and sin coefficients (north, east each)."""
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
    """Sum of tidal ellipses, the same at every place and depth.

    Usual amplitudes: 0.02-0.05 m/s in the deep ocean, 0.2-1 m/s on the shelf.
    """

    kind: ClassVar[str] = "tide"
    code: ClassVar[int] = 5
    kernel: ClassVar[Any] = ellipses_kernel
    usage: ClassVar[Mapping[str, str]] = {
        "tide:m2=0.1,s2=0.03,direction=30": (
            "ellipses; also minor=, phase=, m2_phase=, k1=, o1= ..."
        )
    }

    ellipses: tuple[TidalEllipse, ...]
    """The constituents."""

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
        """From CONSTITUENT=SPEED and settings for all constituents, or for one as m2_phase=."""
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
        """From `describe()`, nested parts rebuilt first."""
        ellipses = []
        for item in settings.get("ellipses", ()):
            try:
                ellipses.append(TidalEllipse(**item))
            except TypeError as error:
                raise CurrentError(f"tide: {error}") from None
        return super().from_settings({**settings, "ellipses": tuple(ellipses)})

    def records(self, duration_s: float, origin: Origin) -> list[Floats]:
        """One layout record."""
        rows = []
        for e in self.ellipses:
            axis = math.radians(e.direction_deg)
            lag = math.radians(e.phase_deg)
            major = (math.cos(axis), math.sin(axis))
            # Counterclockwise from above is from the major axis toward 90 degrees to its left.
            minor = (math.sin(axis), -math.cos(axis))
            # major cos(wt - lag) + minor sin(wt - lag), expanded in cos(wt) and sin(wt).
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
