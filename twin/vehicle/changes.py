"""Changes: what differs between two copies of a vehicle, as JSON keeps it.

Stores say with what vehicle they were made by the text of its file and the changes to it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from twin.errors import VehicleError, unknown_name

_VERSION_1_ACTUATORS = {
    "actuator_min": "low",
    "actuator_max": "high",
    "actuator_lag": "lag",
    "actuator_rate": "rate",
}
_VERSION_1_BATTERY = {
    "movable_mass": "mass",
    "movable_inertia": "inertia",
    "movable_neutral_x": "neutral_x",
    "movable_eccentricity": "eccentricity",
}


def changed(item: Any, changes: Mapping[str, Any]) -> Any:
    """A part or moving mass with some fields replaced; raises VehicleError for unknown ones."""
    known = [field.name for field in dataclasses.fields(item)]
    for name in changes:
        if name not in known:
            raise VehicleError(unknown_name(f"field of {item.name!r}", name, known))
    return dataclasses.replace(item, **{n: _typed(getattr(item, n), v) for n, v in changes.items()})


def _typed(mine: Any, value: Any) -> Any:
    """`value`, as JSON gives it, in the type that a field has."""
    if isinstance(mine, np.ndarray):
        return np.array(value, dtype=np.float64)
    return tuple(value) if isinstance(value, list) else value


def differences(mine: Any, theirs: Any, leave: tuple[str, ...] = ()) -> dict[str, Any]:
    """Fields of `mine` that are not as in `theirs`, as JSON-able values, but those to `leave`."""
    found = {}
    for field in dataclasses.fields(mine):
        a, b = getattr(mine, field.name), getattr(theirs, field.name)
        if field.name not in leave and not np.array_equal(a, b):
            found[field.name] = a if isinstance(a, str | Mapping | None) else np.asarray(a).tolist()
    return found


def renamed(
    changes: Mapping[str, Any], part_names: Sequence[str], owners: Sequence[Any]
) -> dict[str, Any]:
    """Changes with the names and types of today; stores of version 1 name all actuators at once.

    Args:
      part_names: of the vehicle, in their order.
      owners: the vehicle and its hull law, whose fields say of which type a value must be.
    """
    out: dict[str, Any] = {}
    for name, value in changes.items():
        field = _VERSION_1_ACTUATORS.get(name)
        if field is not None:
            for part, number in zip(part_names, value, strict=True):
                out.setdefault(part, {})[field] = float(number)
        elif name in _VERSION_1_BATTERY:
            out.setdefault("battery", {})[_VERSION_1_BATTERY[name]] = value
        elif isinstance(value, Mapping):
            out.setdefault(name, {}).update(value)
        else:
            present = next((getattr(o, name) for o in owners if hasattr(o, name)), None)
            out[name] = _typed(present, value)
    return out
