"""Changes: differences between two copies of a vehicle as JSON values, and uncertain numbers.

A store describes its vehicle by the text of the vehicle file and the changes to it.

Uncertainty: a number that a vehicle file cannot give exactly, with the distribution of its error.
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
    """Return a part or moving mass with fields replaced; raises VehicleError for unknown ones."""
    known = [field.name for field in dataclasses.fields(item)]
    for name in changes:
        if name not in known:
            raise VehicleError(unknown_name(f"field of {item.name!r}", name, known))
    return dataclasses.replace(item, **{n: _cast(getattr(item, n), v) for n, v in changes.items()})


def _cast(mine: Any, value: Any) -> Any:
    """Convert a JSON `value` to the type of the field value `mine`."""
    if isinstance(mine, np.ndarray):
        return np.array(value, dtype=np.float64)
    return tuple(value) if isinstance(value, list) else value


def differences(mine: Any, theirs: Any, leave: tuple[str, ...] = ()) -> dict[str, Any]:
    """Fields of `mine` that differ from `theirs`, as JSON values, without the fields in `leave`."""
    found = {}
    for field in dataclasses.fields(mine):
        a, b = getattr(mine, field.name), getattr(theirs, field.name)
        if field.name not in leave and not np.array_equal(a, b):
            found[field.name] = a if isinstance(a, str | Mapping | None) else np.asarray(a).tolist()
    return found


def renamed(
    changes: Mapping[str, Any], part_names: Sequence[str], owners: Sequence[Any]
) -> dict[str, Any]:
    """Convert changes to today's names and types; version 1 listed all actuators under one name.

    Args:
      part_names: names of the vehicle's parts, in their order.
      owners: the vehicle and its hull law, whose fields give the types of the values.
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
            out[name] = _cast(present, value)
    return out


COEFFICIENT_SPREAD = "uniform(0.9, 1.1)"
"""Distribution of the factor on a coefficient; +-10 % is our guess of its uncertainty."""
LAG_SPREAD = "uniform(0.8, 1.2)"
"""Distribution of the factor on a lag or a largest rate; these are rarely published."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """One number of a vehicle that its file cannot give exactly."""

    name: str
    """Name of the factory's parameter after `vehicle.`; for a part, the part's name precedes it."""
    spread: str
    """Distribution of the real value, as the factory writes it."""
    long_name: str
    """Short noun phrase that names the number."""
    why: str
    """Reason for this distribution, with conventions, in one line."""
    unit: str = "1"
    """Unit as CF writes it; "1" is a factor on the file's value."""
    certain: float = 1.0
    """Value at which the vehicle is exactly as in its file."""
    field: str | None = None
    """Field of a part that the factor multiplies; None: the number is the position at which the
    part's encoder reads 0."""
    scale: float = 1.0
    """Size of `unit` in the part's own unit, for a position."""
    known: bool = False
    """True: guidance has the sampled value too, as a pilot knows to which side a vehicle turns."""


def coefficient(name: str, what: str, *, field: str | None = None) -> Uncertainty:
    """Uncertain factor on a coefficient of the vehicle file."""
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
    """Uncertain zero of a part's encoder in `unit`; `scale` is that unit in the part's own."""
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
    """Uncertain zero [degree] of the encoder of a turning part: a battery or a fin."""
    return encoder_zero(
        part, name="offset_deg", unit="degree", scale=math.pi / 180.0, spread="uniform(-2, 2)",
        why=f"{what} turned from where it says",
    )  # fmt: skip
