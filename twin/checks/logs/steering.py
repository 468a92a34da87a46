"""Steering: which signal of a log is the position of a part of the vehicle."""

from __future__ import annotations

import dataclasses
from collections.abc import Container

from twin.vehicle.parts import BatteryHinge, BatterySlide, Fin, Part, Pump
from twin.vehicle.vehicle import Vehicle

USUAL = {
    BatterySlide: "measured_shift",
    BatteryHinge: "measured_rotation",
    Pump: "measured_pump",
}
"""Signals that importers give the parts of real vehicles, whatever a vehicle file calls them."""
RUDDER = "measured_fin"
"""The same, of a fin that turns the vehicle."""
USUAL_NAMES = frozenset({RUDDER, *USUAL.values()})
TURNING = (RUDDER, USUAL[BatteryHinge])
"""Signals of what turns a vehicle."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Turning:
    """The part that turns the vehicle, and the signal of what turned the logged one."""

    part: str
    """name of the vehicle's part"""
    signal: str | None
    """of the log, None: it has no position of what turns it"""
    same: bool
    """whether both are the same kind of part, so that their effects can be compared"""
    sense: float
    """what the vehicle's position is multiplied by to have the log's sign"""


def log_signal(vehicle: Vehicle, part: Part, names: Container[str]) -> str | None:
    """Name of the log's signal of a part: by the part's own name or by its kind; None without."""
    turns = vehicle.steering.get("heading") == part.name
    usual = RUDDER if isinstance(part, Fin) and turns else USUAL.get(type(part))
    for name in (f"measured_{part.name}", usual):
        if name is not None and name in names:
            return name
    return None


def turning_of(vehicle: Vehicle, names: Container[str]) -> Turning | None:
    """The turning part beside the log's; None of a vehicle without one."""
    part = vehicle.steered("heading")
    if part is None:
        return None
    signal = log_signal(vehicle, part, names)
    other = next((name for name in TURNING if name in names), None)
    return Turning(
        part=part.name,
        signal=signal or other,
        same=signal is not None,
        # a log's rudder is positive to starboard, a file's fin turns about an axis of its own
        sense=part.sense("heading") if isinstance(part, Fin) else 1.0,
    )
