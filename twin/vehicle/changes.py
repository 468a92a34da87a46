"""Changes: what differs between two copies of a vehicle, as JSON keeps it.

Stores say with what vehicle they were made by the text of its file and the changes to it.

Uncertainty: a number of a vehicle that its file cannot say exactly, and how far it may be off.
"""

from __future__ import annotations

import dataclasses
import math
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


COEFFICIENT_SPREAD = "uniform(0.9, 1.1)"
"""Factor on a coefficient; +-10 % is our guess of how well one is known."""
LAG_SPREAD = "uniform(0.8, 1.2)"
"""Factor on a lag or on a largest rate; they are rarely published."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """One number of a vehicle that its file cannot say exactly."""

    name: str
    """of the factory's parameter after `vehicle.`; that of a part follows the part's own name"""
    spread: str
    """distribution of the real value, as the factory writes it"""
    long_name: str
    """what it is, a short noun phrase"""
    why: str
    """one line: why this spread, and conventions"""
    unit: str = "1"
    """as CF writes it; "1" is a factor on the file's value"""
    certain: float = 1.0
    """value at which the vehicle is as its file says"""
    field: str | None = None
    """of a part: the field that the factor multiplies; None: the position at which its encoder
    says 0"""
    scale: float = 1.0
    """of a position: the part's unit in `unit`"""
    known: bool = False
    """of a hull law: guidance has it too, as a pilot knows which way the vehicle turns"""


def coefficient(name: str, what: str, *, field: str | None = None) -> Uncertainty:
    """A factor on a coefficient of the vehicle file."""
    return Uncertainty(
        name=name,
        spread=COEFFICIENT_SPREAD,
        long_name=f"factor on the {what}",
        why="of the vehicle file; +-10 % is our guess of how well it is known",
        field=field,
    )


def encoder_zero(
    part: str, *, name: str, unit: str, scale: float, spread: str, why: str
) -> Uncertainty:
    """Zero error of a part's encoder, in `unit`, which is `scale` of the part's own."""
    return Uncertainty(
        name=name,
        unit=unit,
        scale=scale,
        certain=0.0,
        spread=spread,
        long_name=f"zero error of the encoder of the {part}",
        why=why,
    )


def turned_encoder(part: str, what: str) -> Uncertainty:
    """Zero error [degree] of the encoder of what turns: a battery or a fin."""
    return encoder_zero(
        part, name="offset_deg", unit="degree", scale=math.pi / 180.0, spread="uniform(-2, 2)",
        why=f"{what} turned from where it says",
    )  # fmt: skip
