"""The registry of hull laws, and what a kind must have to be one."""

from __future__ import annotations

from twin.errors import VehicleError
from twin.registry import Registry, missing_method, self_named
from twin.vehicle.laws.base import HullLaw


def _lacks(kind: type[HullLaw]) -> str:
    """What a kind of law lacks: both models need it."""
    for name in ("native_wrench", "native_rate_damping", "fossen_wrench"):
        if getattr(kind, name) is None:
            return f"`{name}`"
    return missing_method(kind)


LAWS: Registry[type[HullLaw]] = Registry(
    "hull law",
    group="glider_twin.hull_laws",
    shipped={
        "flow-frame": "twin.vehicle.laws.flow_frame:FlowFrame",
        "body-axes": "twin.vehicle.laws.body_axes:BodyAxes",
        "ellipsoid": "twin.vehicle.laws.ellipsoid:Ellipsoids",
    },
    check=self_named("hull law", HullLaw, _lacks, VehicleError),  # type: ignore[type-abstract]
    name="kind",
)
"""Every hull law, by name."""

register = LAWS.add
"""Add a kind of one's own; usable as a decorator."""
