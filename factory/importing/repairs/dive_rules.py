"""The numbers by which a log is cut into dives and its GPS fixes are judged."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True, kw_only=True)
class DiveRules:
    """How a log is cut into rows. Depths are below the log's own surface."""

    min_depth: float = 5.0
    """[m] An interval between fixes that goes deeper is a dive, another one time at the surface."""
    min_stretch: float = 30.0
    """[s] It is so deep for so long at a stretch: a sensor at the surface shows single depths of 5
    to 14 m when air and waves pass it."""
    min_duration: float = 60.0
    """[s] Shorter dives are left out, counted."""
    surface_depth: float = 1.5
    """[m] Shallower counts as at the surface where no fix says so."""
    longest_gap: float = 3600.0
    """[s] Without fixes, a row ends where neither depth nor attitude is known for so long; a stay
    at the surface is interrupted by a hole in the fixes that is longer."""
    fix_depth: float = 2.0
    """[m] A GPS antenna receives nothing deeper."""
    fix_lag: float = 30.0
    """[s] For so long after the surface a receiver goes on with its last velocity, and vehicles
    log what it says."""
    coast: float = 40.0
    """[m] Such a fix is used when it has moved by less from the last one at the surface: as much
    as two fixes differ anyway. 0 uses none of them, so that rows start at the surface."""
    coast_speed: float = 3.5
    """[m/s] Three and more steps at one velocity above this are not drift: the receiver coasts."""
    fix_speed: float = 4.0
    """[m/s] Fixes that need a faster drift are wrong."""
    fix_noise: float = 100.0
    """[m] Two good fixes can differ by so much without any drift."""
    drift_speed: float = 2.0
    """[m/s] A faster drift at the surface is none: the vehicle was carried, or a fix is wrong."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (value >= 0.0 if field.name == "coast" else value > 0.0):
                raise ValueError(f"{field.name} must be positive")
