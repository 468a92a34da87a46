"""Schema: the names, units and meanings of every variable that a store of missions holds.

Prefix and attribute `signal_group` mark three groups: `true_*` (the simulated truth), `measured_*`
(sensor outputs) and `commanded_*` (setpoints). Angles are degrees in stores, radians in code.

`signals.csv` has one row for each signal that the twin simulates or an import reads, in storage
order. Standard names are CF's if one exists. `gaps` marks signals that may be NaN inside a
mission. `held_by` is empty for a signal of every simulated mission, else it names the stores that
have the signal. Sensors, parts and stores from other programs declare further variables.
"""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from twin.errors import InputError, UnknownName

SCHEMA_VERSION = 1
MISSION, TIME = "mission", "time"

GROUPS = {"true": "truth", "measured": "measured", "commanded": "commanded"}
"""Attribute `signal_group` for each prefix of a variable's name"""
_UNIT_DECIMALS = {"degree": 4, "rad s-1": 7, "m s-1": 6, "m s-2": 5, "cm3": 3, "kg": 6,
                  "kg m-3": 4, "dbar": 5, "S m-1": 7}  # fmt: skip
"""Decimals kept for each unit: 1e-4 degree is 2e-6 rad; an error of 1e-6 m/s drifts 1 cm in 3 h."""
_HORIZONTAL_DECIMALS, _DEPTH_DECIMALS, _BATTERY_DECIMALS = 3, 5, 7
"""Decimals of metres. Tracks keep 1 mm. Depth keeps more, since it is differentiated over 0.5 s.
A battery shift of 1e-7 m moves pitch by 1e-4 degree."""


@dataclasses.dataclass(frozen=True)
class Variable:
    """Stored signal."""

    name: str
    units: str
    """Unit in CF's (UDUNITS) spelling; "1" is dimensionless."""
    long_name: str
    """Meaning, a short noun phrase"""
    standard_name: str | None = None
    limits: tuple[float, float] | None = None
    """Lowest and highest possible value; None takes the row of `limits.TABLE` for unit and name."""
    gaps: bool = False
    """True if values may be NaN inside a mission: no fix, no lock, no setpoint."""
    comment: str = ""
    """Conventions, and the circumstances in which values are NaN."""

    @property
    def decimals(self) -> int | None:
        """Decimals that bulk stores keep, far finer than any sensor; None keeps full float32."""
        if self.units != "m":
            return _UNIT_DECIMALS.get(self.units)
        if self.name.endswith(("north", "east")):
            return _HORIZONTAL_DECIMALS
        return _BATTERY_DECIMALS if self.name.endswith("shift") else _DEPTH_DECIMALS

    @property
    def group(self) -> str:
        """truth, measured or commanded."""
        return GROUPS[self.name.split("_", 1)[0]]

    def attributes(self) -> dict[str, Any]:
        """CF attributes."""
        lowest, highest = self.limits or (None, None)
        attributes = {
            "units": self.units,
            "long_name": self.long_name,
            "signal_group": self.group,
            "standard_name": self.standard_name or None,
            "comment": self.comment or None,
            "positive": "down" if self.standard_name == "depth" else None,
            "valid_min": lowest,
            "valid_max": highest,
            "gaps": 1 if self.gaps else None,
        }
        return {name: value for name, value in attributes.items() if value is not None}

    def stored_attributes(self) -> dict[str, str | int]:
        """CF attributes, plus `least_significant_digit` for the decimals that bulk stores keep."""
        kept = {} if self.decimals is None else {"least_significant_digit": self.decimals}
        return {**self.attributes(), **kept}


def _read_signals() -> tuple[dict[str, Variable], dict[str, str]]:
    """Variables in `signals.csv` by name, and the column `held_by` by name."""
    found: dict[str, Variable] = {}
    held: dict[str, str] = {}
    with Path(__file__).with_name("signals.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            name, standard, gaps = row["name"], row["standard_name"] or None, bool(row["gaps"])
            held[name], words = row["held_by"], (row["units"], row["long_name"], standard)
            found[name] = Variable(name, *words, gaps=gaps, comment=row["comment"])
    return found, held


VARIABLES, _HELD_BY = _read_signals()
"""Every variable by name, in storage order."""
SIGNALS = tuple(VARIABLES.values())
"""Variables of `signals.csv`, without later declared ones"""
LOGGED_ONLY = frozenset(name for name, held in _HELD_BY.items() if held == "logs")
"""Variables that only stores of real logs hold; the twin does not simulate them."""
HYDROGRAPHY = frozenset(name for name, held in _HELD_BY.items() if held == "hydrography")
"""Variables of simulated missions in water whose temperature and salinity are known."""
WITH_FLOOR = tuple(name for name, held in _HELD_BY.items() if held == "floor")
"""Variables of simulated missions with a sea floor; contact is also stored with obstacles alone."""
SIMULATED = tuple(name for name, held in _HELD_BY.items() if not held)
"""Variables of every simulated mission, in storage order."""

_STORED: set[str] = set()
"""Names of variables that only a store has declared in this process"""


def variable(name: str) -> Variable:
    """Return the variable `name`; raises UnknownName (an InputError and a KeyError) otherwise."""
    try:
        return VARIABLES[name]
    except KeyError:
        raise UnknownName("variable", name, VARIABLES) from None


def variables(*names: str) -> tuple[Variable, ...]:
    """Return the variables `names`; raises as `variable`."""
    return tuple(variable(name) for name in names)


def declare(entry: Variable) -> None:
    """Add a variable to `VARIABLES`, as sensors and parts of your own do.

    A declaration replaces the one that a store made (`declare_stored`).

    Raises:
      InputError: the name has no group, or is declared with another meaning already."""
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
    """Declare a signal that the schema lacks, with the attributes in its store."""
    if name in VARIABLES or "units" not in attributes or name.split("_", 1)[0] not in GROUPS:
        return
    known = "valid_min" in attributes and "valid_max" in attributes
    lowest, highest = (float(attributes.get(end, 0.0)) for end in ("valid_min", "valid_max"))
    declare(
        Variable(
            name,
            str(attributes["units"]),
            str(attributes.get("long_name", name)),
            attributes.get("standard_name"),
            (lowest, highest) if known else None,
            bool(attributes.get("gaps", 0)),
            str(attributes.get("comment", "")),
        )
    )
    _STORED.add(name)
