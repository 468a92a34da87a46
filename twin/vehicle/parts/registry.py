"""The registry of vehicle parts, and what a kind must have to be one."""

from __future__ import annotations

from twin.errors import VehicleError
from twin.registry import Registry
from twin.vehicle.parts.base import Part, Quantity


def _lacks(kind: type[Part]) -> str:
    """What a kind of part lacks: each effect must be there for both models."""
    if not isinstance(getattr(kind, "quantity", None), Quantity):
        return "`quantity`: how a store shows its position"
    if not kind.unit:
        return "`unit` of its position"
    for effect in ("volume", "mass", "wrench"):
        native, fossen = (getattr(kind, f"{model}_{effect}") for model in ("native", "fossen"))
        if (native is None) != (fossen is None):
            absent = "fossen" if fossen is None else "native"
            return f"`{absent}_{effect}`: both models must have its {effect}, each in its own code"
    return ""


PARTS: Registry[type[Part]] = Registry(
    "vehicle part",
    Part,
    group="glider_twin.vehicle_parts",
    name="kind",
    lacks=_lacks,
    error=VehicleError,
)
