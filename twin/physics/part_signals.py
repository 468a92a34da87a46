"""Part signals: what stores call the positions of a vehicle's parts, and its state's columns."""

from __future__ import annotations

import functools
from pathlib import Path

from twin.errors import VehicleError
from twin.records.schema import VARIABLES, Variable, declare
from twin.vehicle.mjcf import MjcfReader
from twin.vehicle.vehicle import Vehicle

_OF_THE_VEHICLE = frozenset(
    {
        *("north", "east", "depth", "roll", "pitch", "heading", "surge", "sway", "heave", "speed"),
        *("roll_rate", "pitch_rate", "yaw_rate", "net_mass", "density", "immersion", "segment"),
        *(f"velocity_{axis}" for axis in ("north", "east", "down")),
        *(f"current_{axis}" for axis in ("north", "east", "down")),
        *(f"specific_force_{axis}" for axis in "xyz"),
    }
)
"""Names of signals that every vehicle has; no part may bear one"""


def declare_parts(vehicle: Vehicle) -> None:
    """Make `true_PART` and `commanded_PART` of each part variables of the schema.

    Raises:
      VehicleError: a part is called like a signal of every vehicle, or like another vehicle's part
        whose positions have another unit.
    """
    for part in vehicle.parts:
        unit, meaning = part.quantity.unit, part.quantity.long_name
        if part.name in _OF_THE_VEHICLE:
            raise VehicleError(
                f"vehicle {vehicle.name!r} ({vehicle.path}): a part must not be called "
                f"{part.name!r}, which is a signal of every vehicle; give its actuator another name"
            )
        for prefix, long_name in (
            ("true", f"{part.name} {meaning}"),
            ("commanded", f"commanded {part.name} {meaning}"),
        ):
            name = f"{prefix}_{part.name}"
            known = VARIABLES.get(name)
            if known is None:
                declare(Variable(name, unit, long_name))
            elif known.units != unit:
                raise VehicleError(
                    f"vehicle {vehicle.name!r} ({vehicle.path}): {name} of its part {part.name!r} "
                    f"({part.kind}) would be stored in {unit}, but is {known.long_name!r} in "
                    f"{known.units} already; give its actuator another name"
                )


def state_columns(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the columns of a trajectory's `states`: qpos, qvel, act, ctrl (SI, rad, cm3)."""
    return _columns(vehicle.xml, vehicle.path, vehicle.part_names)


@functools.lru_cache(maxsize=16)
def _columns(xml: str, path: Path, parts: tuple[str, ...]) -> tuple[str, ...]:
    joints = [
        f"{body.get('name')}_{joint.get('name')}"
        for body in MjcfReader(xml, path).moving_bodies()
        for joint in body.findall("joint")
    ]
    return (
        *("x", "y", "z", "qw", "qx", "qy", "qz", *joints),
        *("vx", "vy", "vz", "wx", "wy", "wz", *(f"{joint}_rate" for joint in joints)),
        *(f"act_{part}" for part in parts),
        *(f"ctrl_{part}" for part in parts),
    )
