"""Part signals: what stores call the positions and commands of a vehicle's parts.

A part named `rudder` has `true_rudder`, `commanded_rudder` and, by its encoder, `measured_rudder`,
in the unit of its kind. Those of a glider's shift, rotation and pump are in the schema's own table.
"""

from __future__ import annotations

import functools
from pathlib import Path

from twin.errors import VehicleError
from twin.records.limits import TABLE
from twin.records.schema import SIMULATED, VARIABLES, WITH_FLOOR, Variable, declare
from twin.records.trajectory import actuator_names
from twin.vehicle.consumption import ENERGY, HOTEL
from twin.vehicle.mjcf import MjcfReader
from twin.vehicle.vehicle import Vehicle

UNITS = frozenset(row.units for row in TABLE)
"""Units whose values have limits"""
ENERGIES = (0.0, 1e10)
"""[J] nothing to the battery of a small submarine"""
_OWN = frozenset((*SIMULATED, *WITH_FLOOR))
"""The schema's own signals, whose names parts must leave alone; but for the positions of parts."""


def part_variables(vehicle: Vehicle) -> dict[str, Variable]:
    """The variables of a vehicle's parts by name: truth, command and reading of each.

    Raises:
      VehicleError: a part has the name of another signal, such as `pitch`.
    """
    found: dict[str, Variable] = {}
    shared = actuator_names(SIMULATED)
    for part in vehicle.parts:
        quantity, words = part.quantity, part.name.replace("_", " ")
        for name, text in (
            (f"true_{part.name}", f"{words}, {quantity.long_name}"),
            (f"commanded_{part.name}", f"commanded {words}, {quantity.long_name}"),
            (f"measured_{part.name}", f"{words} by its encoder, {quantity.long_name}"),
        ):
            if name in _OWN and part.name not in shared:
                raise VehicleError(
                    f"vehicle {vehicle.name!r} ({vehicle.path}): a part must not be called "
                    f"{part.name!r}, which is a signal of every vehicle; give its actuator another "
                    "name"
                )
            known = VARIABLES.get(name)
            if known is None:
                known = Variable(name, quantity.unit, text, limits=quantity.limits)
                if quantity.limits is None and quantity.unit not in UNITS:
                    raise VehicleError(
                        f"vehicle part {part.kind!r}: `quantity` has the unit {quantity.unit!r} "
                        "and no `limits`; give the lowest and highest value that one can have"
                    )
            elif known.units != quantity.unit:
                raise VehicleError(
                    f"vehicle {vehicle.name!r} ({vehicle.path}): {name} of its part {part.name!r} "
                    f"({part.kind}) would be stored in {quantity.unit}, but is "
                    f"{known.long_name!r} in {known.units} already; give its actuator another name"
                )
            found[name] = known
    return found


def energy_variables(vehicle: Vehicle) -> tuple[Variable, ...]:
    """The variables of the energy that a vehicle's electronics and parts take."""
    of = {HOTEL: "electronics and sensors"}
    of |= {name: name.replace("_", " ") for name in vehicle.part_names}
    return tuple(
        Variable(
            ENERGY + name, "J", f"electrical energy taken since the start: {text}", limits=ENERGIES
        )
        for name, text in of.items()
    )


def declare_parts(vehicle: Vehicle) -> None:
    """Add the variables of a vehicle's parts and of its energy; raises as `part_variables`."""
    for entry in (*part_variables(vehicle).values(), *energy_variables(vehicle)):
        declare(entry)


def simulated_signals(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the truth and commands of every simulated mission of a vehicle, in storage order."""
    parts = part_variables(vehicle)
    none = {f"{kind}_{name}" for kind in _KINDS for name in actuator_names(SIMULATED)}
    names = [name for name in SIMULATED if name not in none or name in parts]
    return tuple(
        name for name in dict.fromkeys((*names, *parts)) if not name.startswith("measured_")
    )


_KINDS = ("true", "commanded", "measured")


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
