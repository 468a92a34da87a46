"""Registry: the variables that this process knows, by name, and how others are added."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from twin.errors import InputError, UnknownName
from twin.records.schema.base import GROUPS, Variable
from twin.records.schema.signals import HYDROGRAPHY, LOGGED_ONLY, SIGNALS, WITH_FLOOR

SCHEMA_VERSION = 1
MISSION, TIME = "mission", "time"

VARIABLES: dict[str, Variable] = {variable.name: variable for variable in SIGNALS}
"""Every variable by name, in storage order."""

_STORED: set[str] = set()
"""Names that this process knows from a store alone"""

SIMULATED: tuple[str, ...] = tuple(
    name for name in VARIABLES if name not in LOGGED_ONLY | HYDROGRAPHY and name not in WITH_FLOOR
)
"""Variables of every simulated mission, in storage order."""


def variable(name: str) -> Variable:
    """The variable of that name; raises UnknownName (an InputError and a KeyError) otherwise."""
    try:
        return VARIABLES[name]
    except KeyError:
        raise UnknownName("variable", name, VARIABLES) from None


def variables(*names: str) -> tuple[Variable, ...]:
    """The variables of these names; raises as `variable`."""
    return tuple(variable(name) for name in names)


def declare(entry: Variable) -> None:
    """Add a variable to `VARIABLES`, as sensors and parts of your own do.

    Raises:
      InputError: the name has no group, or is declared with another meaning already. What only
        a store said of the name gives way.
    """
    if entry.name.split("_", 1)[0] not in GROUPS:
        raise InputError(
            f"variable {entry.name!r} must begin with {', '.join(f'{g}_' for g in GROUPS)}"
        )
    if entry.name in _STORED:
        _STORED.discard(entry.name)
        VARIABLES[entry.name] = entry
    known = VARIABLES.setdefault(entry.name, entry)
    if known != entry:
        raise InputError(f"variable {entry.name!r} exists already as {known}, not {entry}")


def declare_stored(name: str, attributes: Mapping[str, Any]) -> None:
    """Declare a signal that a store holds and this process does not know, as the store says."""
    if name in VARIABLES or "units" not in attributes or name.split("_", 1)[0] not in GROUPS:
        return
    limits = None
    if "valid_min" in attributes and "valid_max" in attributes:
        limits = (float(attributes["valid_min"]), float(attributes["valid_max"]))
    declare(
        Variable(
            name,
            str(attributes["units"]),
            str(attributes.get("long_name", name)),
            attributes.get("standard_name"),
            limits,
            bool(attributes.get("gaps", 0)),
            str(attributes.get("comment", "")),
        )
    )
    _STORED.add(name)
