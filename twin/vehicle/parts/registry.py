"""The registry of vehicle parts, and what a kind must have to be one."""

from __future__ import annotations

import dataclasses

from twin.errors import VehicleError
from twin.registry import Registry, self_named
from twin.vehicle.parts.base import Part, Quantity


def _lacks(kind: type[Part]) -> str:
    """What a kind of part lacks: each effect must be there for both models."""
    if not isinstance(getattr(kind, "quantity", None), Quantity):
        return "`quantity`: how a store shows its position"
    if not kind.unit:
        return "`unit` of its position"
    shared = {field.name for field in dataclasses.fields(Part)}
    own = [field.name for field in dataclasses.fields(kind) if field.name not in shared]
    if own and kind.values is Part.values:
        return f"`values`: by it {', '.join(own)} reach its kernels"
    for effect in ("volume", "mass", "wrench"):
        native, fossen = (getattr(kind, f"{model}_{effect}") for model in ("native", "fossen"))
        if (native is None) != (fossen is None):
            absent = "fossen" if fossen is None else "native"
            return f"`{absent}_{effect}`: both models must have its {effect}, each in its own code"
    return ""


PARTS: Registry[type[Part]] = Registry(
    "vehicle part",
    group="glider_twin.vehicle_parts",
    shipped={
        "battery-slide": "twin.vehicle.parts.battery_slide:BatterySlide",
        "battery-hinge": "twin.vehicle.parts.battery_hinge:BatteryHinge",
        "pump": "twin.vehicle.parts.pump:Pump",
        "propeller": "twin.vehicle.parts.propeller:Propeller",
        "fin": "twin.vehicle.parts.fin:Fin",
        "drop-weight": "twin.vehicle.parts.drop_weight:DropWeight",
    },
    check=self_named("vehicle part", Part, _lacks, VehicleError),
    name="kind",
)
"""Every vehicle part, by name."""

register = PARTS.add
"""Add a kind of one's own; usable as a decorator."""
