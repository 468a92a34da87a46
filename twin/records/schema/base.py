"""Variable: one stored signal, with its unit, meaning, limits and how many decimals are kept."""

from __future__ import annotations

import dataclasses
from typing import Any

GROUPS = {"true": "truth", "measured": "measured", "commanded": "commanded"}
"""Attribute `signal_group` by the prefix of a name"""
_UNIT_DECIMALS = {"degree": 4, "rad s-1": 7, "m s-1": 6, "m s-2": 5, "cm3": 3, "kg": 6,
                  "kg m-3": 4, "dbar": 5, "S m-1": 7}  # fmt: skip
"""1e-4 degree is 2e-6 rad, 1e-6 m/s drifts 1 cm in 3 h."""
_HORIZONTAL_DECIMALS, _DEPTH_DECIMALS, _BATTERY_DECIMALS = 3, 5, 7
"""[m]: tracks to 1 mm; depth finer, since its rate is taken over half a second; 1e-7 m of battery
moves pitch by 1e-4 degree."""


@dataclasses.dataclass(frozen=True)
class Variable:
    """One stored signal."""

    name: str
    units: str
    """As CF (UDUNITS) writes it; "1" is dimensionless."""
    long_name: str
    """A short noun phrase"""
    standard_name: str | None = None
    limits: tuple[float, float] | None = None
    """Lowest and highest possible value; None: those of the table of limits, by unit and name."""
    gaps: bool = False
    """Whether it may be NaN inside a mission: no fix, no lock, no setpoint."""
    comment: str = ""
    """Conventions, and where it is NaN."""

    @property
    def decimals(self) -> int | None:
        """Decimals that bulk stores keep, far below any sensor; None keeps full float32."""
        return _decimals(self.name, self.units)

    @property
    def group(self) -> str:
        """truth, measured or commanded."""
        return GROUPS[self.name.split("_", 1)[0]]

    def attributes(self) -> dict[str, Any]:
        """CF attributes."""
        attributes: dict[str, Any] = {
            "units": self.units,
            "long_name": self.long_name,
            "signal_group": self.group,
        }
        if self.standard_name:
            attributes["standard_name"] = self.standard_name
        if self.comment:
            attributes["comment"] = self.comment
        if self.standard_name == "depth":
            attributes["positive"] = "down"
        if self.limits:
            attributes["valid_min"], attributes["valid_max"] = self.limits
        if self.gaps:
            attributes["gaps"] = 1
        return attributes

    def stored_attributes(self) -> dict[str, str | int]:
        """Attributes in bulk stores, which keep so many decimals."""
        attributes: dict[str, str | int] = {**self.attributes()}
        if self.decimals is not None:
            attributes["least_significant_digit"] = self.decimals
        return attributes


def _decimals(name: str, units: str) -> int | None:
    if units != "m":
        return _UNIT_DECIMALS.get(units)
    if name.endswith(("north", "east")):
        return _HORIZONTAL_DECIMALS
    return _BATTERY_DECIMALS if name.endswith("shift") else _DEPTH_DECIMALS
